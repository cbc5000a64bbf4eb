"""The papers' equations as printed, shown to fail: each beside the right one, with a figure that must be beyond a limit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from control.tracking import Controller, Estimate, Target
from models.attitude import quaternion
from models.dynamics.state_layout import ATTITUDE
from models.dynamics.wheeled_body import WheeledBody
from models.plants.assembly import ImpossibleInertia
from models.plants.inertia import why_impossible
from models.plants.nacs import NacsParameters, compile_nacs
from sim.controllers.tracking import TrackingLaw
from sim.crosscheck.divergence import momentum_N, passes
from sim.crosscheck.failure import Failure, FailureFunction
from sim.crosscheck.model_variants import exact, printed_gyroscopic_sign, printed_inertia
from sim.crosscheck.open_loop import Dynamics, Flight, altered, integrate, without_observers
from sim.loop.build import build
from sim.loop.closed_loop import run_whole

Array = NDArray[np.floating]

SECONDS = 10.0  # of open loop
FALL_S = 5.0  # of closed loop with the wrong sign
LOST_TILT_DEG = 25.0
APART_DEG = 0.01
TURNED_DEG = 1.0


@dataclass(frozen=True)
class _Opposite:
    """A control law whose torque reaches the body with the opposite sign."""

    law: Controller

    def step(self, estimate: Estimate, target: Target) -> Array:
        return -self.law.step(estimate, target)


def _testbed(flight: Flight) -> NacsParameters:
    """The plant, which is the testbed: these are of its register entry."""
    return cast(NacsParameters, flight.scenario.plant)


def inertia(flight: Flight, bare: Array) -> list[Failure]:
    """Eq. 26, J_yy = 0.172994: the plant refuses it, and the analytic model with it leaves a plant that has no other effect."""
    plant, tick_s = _testbed(flight), flight.scenario.run.tick_s
    printed = altered(plant, inertia_kg_m2="printed")
    ratio, remark = 0.0, "the plant takes it"
    try:
        compile_nacs(printed)
    except ImpossibleInertia:
        ratio, remark = _triangle(printed.inertia), f"the plant refuses it: {why_impossible(printed.inertia)}"
    refused = Failure("printed-inertia", "moment to others", _triangle(plant.inertia), ratio, 1.0, "1", np.nan, remark)

    ticks = min(len(bare), 1 + round(SECONDS / tick_s))

    def _flown(dynamics: Dynamics) -> Array:
        return integrate(dynamics, bare[0], flight.command[:ticks], tick_s, 10)

    off = [
        np.degrees(quaternion.angle(_flown(m.dynamics)[..., ATTITUDE], bare[:ticks, :, ATTITUDE]))
        for m in (exact(plant), printed_inertia(plant))
    ]
    when = float(np.min(np.nan_to_num(passes(off[1], APART_DEG, tick_s), nan=np.inf)))
    return [
        refused,
        Failure(
            "printed-inertia", f"attitude in {tick_s * (ticks - 1):g} s", float(off[0].max()), float(off[1].max()), APART_DEG, "deg",
            when, "analytic model against a plant without friction and disturbances",
        ),
    ]  # fmt: skip


def _triangle(tensor: Array) -> float:
    low, middle, high = np.linalg.eigvalsh(tensor)
    return float(high / (low + middle))


def gyroscopic_sign(flight: Flight, bare: Array) -> list[Failure]:  # noqa: ARG001
    """Eq. 24, +omega x H: free of torque, the momentum must keep its direction in N (eq. 5); its length does not tell."""
    plant, steps = _testbed(flight), 500
    body = plant.process(coupled=True)
    start = np.concatenate([quaternion.IDENTITY, [0.1, -0.05, 0.12], [300.0, -200.0, 150.0, 250.0]])
    none = np.zeros((steps + 1, body.wheel_axes.shape[1]))
    turned = [_turned(body, m.dynamics, start, none) for m in (exact(plant), printed_gyroscopic_sign(plant))]
    when = float(passes(turned[1], TURNED_DEG, SECONDS / steps))
    return [
        Failure(
            "printed-gyroscopic-sign", f"turn of H in {SECONDS:g} s", float(turned[0].max()), float(turned[1].max()),
            TURNED_DEG, "deg", when, "nothing acts on the body, and its momentum turns in N",
        )
    ]  # fmt: skip


def _turned(body: WheeledBody, dynamics: Dynamics, start: Array, command: Array) -> Array:
    """Angle, deg, by which the momentum has turned in N; (steps + 1,)."""
    total = momentum_N(body, integrate(dynamics, start, command, SECONDS / (len(command) - 1)))
    across = np.linalg.norm(np.cross(total, total[0]), axis=-1)
    return np.degrees(np.arctan2(across, total @ total[0]))


def control_sign(flight: Flight, bare: Array) -> list[Failure]:  # noqa: ARG001
    """Eq. 27 as the u of eq. 9: the body feels the opposite of what would bring it back, and leaves."""
    run_s = flight.scenario.run
    ticks = 1 + max(1, round(FALL_S / run_s.tick_s))
    short = flight.scenario.model_copy(update={"run": run_s.model_copy(update={"ticks": ticks}), "faults": ()})
    tilt = []
    for wrong in (False, True):
        system = without_observers(build(short, flight.system.trials))
        law = system.law
        assert isinstance(law, TrackingLaw)
        assert isinstance(law.controller, Controller)
        flown = run_whole(replace(system, law=replace(law, controller=_Opposite(law.controller)) if wrong else law)).channels["truth/state"]
        upright = quaternion.attitude_matrix(flown[..., ATTITUDE])[..., 2, 2]
        tilt.append(np.degrees(np.arccos(np.clip(upright, -1.0, 1.0))))
    fallen = passes(tilt[1], LOST_TILT_DEG, run_s.tick_s)
    return [
        Failure(
            "printed-control-sign", f"tilt in {run_s.tick_s * (ticks - 1):g} s", float(tilt[0].max()),
            float(tilt[1].max(axis=0).min()), LOST_TILT_DEG, "deg", float(np.median(fallen)), "positive feedback in closed loop",
        )
    ]  # fmt: skip


NACS_FAILURES: tuple[FailureFunction, ...] = (inertia, gyroscopic_sign, control_sign)
