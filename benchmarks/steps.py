"""How far the testbed's plant drifts with other physics steps, integrators and solver tolerances: the table of docs/physics.md, "Step"."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmarks.show import table
from models.attitude import quaternion
from models.plants.nacs import NacsParameters, compile_nacs
from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.plant.batch import Plant
from sim.scenario.files import load

Array = NDArray[np.floating]

TRIALS, SEED, TICK_S = 8, 7, 0.1
TICKS = (100, 1000)  # where errors are read: 10 s and 100 s
RK4, EULER = mujoco.mjtIntegrator.mjINT_RK4, mujoco.mjtIntegrator.mjINT_EULER
COARSE, FINE = 1e-8, 1e-15  # MuJoCo's tolerance, and the twin's
SMOOTH = {"wheel_coulomb_nm": 0.0}


class Way(NamedTuple):
    """Of stepping the plant."""

    name: str
    integrator: mujoco.mjtIntegrator
    step_s: float


WAYS = (
    *(Way(f"RK4 {1e3 * step:g} ms", RK4, step) for step in (20e-3, 10e-3, 5e-3, 2.5e-3, 1e-3, 0.5e-3)),
    *(Way(f"Euler {1e3 * step:g} ms", EULER, step) for step in (5e-3, 1e-3)),
)


class Flight(NamedTuple):
    """A closed loop that was flown, to be flown again open loop."""

    start: Array  # (trials, 11)
    torque: Array  # (ticks, trials, wheels) N m on the wheels
    push: Array  # (ticks, trials, 3) N m in B
    changes: dict[str, float]


def steps() -> None:
    """Print the table."""
    dry, smooth = _flown({}), _flown(SMOOTH)
    exact = _flight(dry, Way("", RK4, 0.25e-3), FINE)
    frictionless = _flight(smooth, Way("", RK4, 0.125e-3), FINE)
    rows = []
    for way in WAYS:
        coarse, fine, without = _flight(dry, way, COARSE), _flight(dry, way, FINE), _flight(smooth, way, FINE)
        cells = [_apart(without[-1], frictionless[-1])]
        cells += [_apart(found[k], exact[k]) for found in (coarse, fine) for k in range(len(TICKS))]
        rows.append([way.name, *(f"{cell:.1e}" for cell in cells)])
    head = ["integrator, step", "no dry friction, 100 s", *(f"tolerance {t:.0e}, {s} s" for t in (COARSE, FINE) for s in (10, 100))]
    table("Greatest attitude difference of eight trials [deg]", head, rows)


def _flown(changes: dict[str, float]) -> Flight:
    """The torques of closed loops on the true state, flown at 1 ms."""
    plant = {f"plant.{key}": value for key, value in changes.items()}
    scenario = load("nacs/fault-free", {"run.seed": SEED, "control.feedback": "truth", "plant.step_s": 1e-3, "observers": {}, **plant})
    system = build(scenario, np.arange(TRIALS))
    channels = run(system).channels
    air: Array = system.effectors.disturbance_B  # type: ignore[attr-defined]  # those of a body have it
    return Flight(channels["truth/state"][0], channels["applied"], air, changes)


def _flight(flight: Flight, way: Way, tolerance: float) -> Array:
    """Attitudes after TICKS, (instants, trials, 4)."""
    assembly = compile_nacs(NacsParameters(step_s=way.step_s, **flight.changes))
    assembly.model.opt.integrator, assembly.model.opt.tolerance = way.integrator, tolerance
    plant = Plant(assembly, TRIALS)
    plant.start(flight.start[:, :4], flight.start[:, 4:7], flight.start[:, 7:])
    found = []
    for tick in range(TICKS[-1]):
        plant.advance(flight.torque[tick], flight.push[tick], round(TICK_S / way.step_s))
        if tick + 1 in TICKS:
            found.append(plant.truth().q_BN)
    return np.array(found)


def _apart(one: Array, other: Array) -> float:
    """Greatest angle between attitudes (trials, 4), deg."""
    return float(np.max(np.degrees(np.linalg.norm(quaternion.error(one, other), axis=-1))))
