"""From a scenario of one body to the linear model of its plant, with sensors' delays, about an operating point."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from models.plants.assembly import Assembly
from models.plants.register.entries import kind_of
from sim.bad_input import BadInput
from sim.linear.delays import late_readings
from sim.linear.linear_model import LinearModel, Quantities
from sim.loop.build import assembly_of, build
from sim.loop.closed_loop import Flight
from sim.plant.linearization import Coordinates, OperatingPoint, StepModel, at_state, at_truth, by_differences, by_mujoco
from sim.scenario.one_body import Scenario

Array = NDArray[np.floating]

Way = Literal["differences", "mujoco"]
WAYS: tuple[Way, ...] = ("differences", "mujoco")


def linearize(
    scenario: Any, loop: str | None = None, at: float | None = None, sampled: bool = False, way: Way = "differences"
) -> LinearModel:
    """The plant of a scenario as a linear model, from motor torques and a torque from outside to what its sensors read.

    Faults, noise, resolution, dry friction and the drives' limits are no part of it.

    Args:
      scenario: of one body.
      loop: which of several closed loops flies to `at`; None: the first.
      at: the operating point is where the first trial is after so many seconds; None: at rest in the reference's first attitude, the wheels
        as they start.
      sampled: at the control period, inputs being held; else continuous.
      way: `differences` of the twin's own step, or MuJoCo's derivatives (`mujoco`), which are continuous.

    Raises:
      BadInput: several bodies, no such loop or way, a time beyond the run, a sampled model by MuJoCo.
    """
    if scenario.family != "body":
        raise BadInput(f"scenarios of family {scenario.family} have several bodies; linear models are of one")
    if loop is not None and loop not in scenario.loop_names:
        raise BadInput(f"loop {loop}: no such loop; there are {', '.join(scenario.loop_names)}")
    if way not in WAYS:
        raise BadInput(f"way {way}: must be one of {', '.join(WAYS)}")
    if way == "mujoco" and sampled:
        raise BadInput("way mujoco: MuJoCo's derivatives are of a step, not of a control period; leave `sampled` out")
    single: Scenario = scenario.singles()[loop or scenario.loop_names[0]]
    point = _at_rest(single) if at is None else _flown(single, at)
    plant = _model(assembly_of(single), point, round(single.run.tick_s / single.plant.step_s) if sampled else None, way)
    return late_readings(plant, single.sensors.latency_s + single.sensors.jitter_s / 2.0)


def _at_rest(scenario: Scenario) -> OperatingPoint:
    attitude = scenario.reference.at(np.zeros(1)).q_DN[0]
    speeds = np.array(scenario.start.wheel_speed_rad_s)[: scenario.plant.wheel_axes.shape[1]]
    return at_state(assembly_of(scenario), attitude, np.zeros(3), speeds, kind_of(scenario.plant).holds(scenario.plant))


def _flown(scenario: Scenario, at: float) -> OperatingPoint:
    """Where the first trial is, and what its law asks for there."""
    run = scenario.run
    if not (np.isfinite(at) and 0.0 <= at <= (run.ticks - 1) * run.tick_s):
        raise BadInput(f"at {at:g} s: the run lasts from 0 to {(run.ticks - 1) * run.tick_s:g} s")
    flight = Flight(build(scenario, np.zeros(1, dtype=np.int64)))
    sensed = next(one for one in flight if one.tick == round(at / run.tick_s))
    assembly, asked = assembly_of(scenario), sensed.decision.effort[0]
    holds = kind_of(scenario.plant).holds(scenario.plant)
    if not assembly.wheel_joints:
        return at_truth(sensed.truth, np.zeros(0), asked, holds)
    limit = assembly.wheel_torque_limit
    return at_truth(sensed.truth, np.clip(-np.linalg.pinv(assembly.wheel_axes) @ asked, -limit, limit), np.zeros(3), holds)


def _model(assembly: Assembly, point: OperatingPoint, ticked: int | None, way: Way) -> LinearModel:
    coordinates = Coordinates(assembly)
    short = by_mujoco(assembly, point) if way == "mujoco" else by_differences(assembly, point, 1)
    needed = coordinates.needed(short)
    step = short if ticked is None else by_differences(assembly, point, ticked)
    A, B, drift = step.A[np.ix_(needed, needed)], step.B[needed], step.drift[needed]
    if ticked is None:
        A, B, drift = _continuous(StepModel(A, B, drift, step.dt))
    names, units = (np.array(of, dtype=object)[needed] for of in coordinates.names)
    state, wheels = Quantities(tuple(names), tuple(units)), len(assembly.wheel_joints)
    read = [*(f"theta{i}" for i in (1, 2, 3)), *(f"omega{i}" for i in (1, 2, 3)), *(f"wheel{i + 1}" for i in np.arange(wheels))]
    places = [state.names.index(name) for name in read]
    own = Quantities(tuple(f"motor{i + 1}" for i in np.arange(wheels)), ("N m",) * wheels)
    turned, spinning = coordinates.attitude
    return LinearModel(
        A=A,
        B=B,
        C=np.eye(len(A))[places],
        D=np.zeros((len(read), B.shape[1])),
        state=state,
        input=own + Quantities(("torque1", "torque2", "torque3"), ("N m",) * 3),
        output=state.chosen(places),
        dt=None if ticked is None else step.dt,
        drift=drift,
        point=np.concatenate([point.qpos[turned], point.qvel[spinning], point.qvel[coordinates.wheels]]),
    )


def _continuous(step: StepModel) -> tuple[Array, Array, Array]:
    """What moves so over a step under inputs that are held: A, B and drift of dx/dt, from the logarithm of the step's matrix."""
    n, inputs = step.B.shape
    whole = np.zeros((n + inputs + 1, n + inputs + 1))
    whole[:n, :n], whole[:n, n:-1], whole[:n, -1] = step.A, step.B, step.drift
    whole[n:, n:] = np.eye(inputs + 1)
    rates = np.real(linalg.logm(whole)) / step.dt
    return rates[:n, :n], rates[:n, n:-1], rates[:n, -1]
