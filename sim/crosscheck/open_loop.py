"""Flying again without feedback: the commands of a closed-loop flight, replayed to a changed plant or integrated by an analytic model."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from control.tracking import Estimate, Target
from models.attitude import quaternion
from models.dynamics.process import ProcessModel, runge_kutta
from models.dynamics.state_layout import ATTITUDE, RATE, WHEELS
from models.plants.assembly import Assembly
from models.plants.register.entries import kind_of
from models.plants.register.parameters import BodyParameters
from sim.controllers.tracking import TrackingLaw
from sim.loop.body_parts import BodyChange, BodyEffectors, BodyFeedback
from sim.loop.build import build
from sim.loop.closed_loop import System, run_whole
from sim.loop.recording import Recording
from sim.plant.batch import Plant
from sim.scenario.one_body import Scenario

Array = NDArray[np.floating]


class Dynamics(Protocol):
    """All that a model needs here: its derivative."""

    def derivative(self, state: Array, command: Array) -> Array:
        """dx/dt of [q_BN, omega_BN_B, omega_wheel]: (..., n) and (..., wheels) N m, or (..., 3) without wheels, to (..., n)."""
        ...


P = TypeVar("P", bound=BodyParameters)
Alteration = Callable[[Assembly], None]  # of a compiled plant that has not been stepped yet


@dataclass(frozen=True)
class Rig:
    """What a kind of plant needs so that it can be flown without feedback; most need nothing.

    Attributes:
      free: takes away what would stop a body that nothing holds.
    """

    free: Alteration = lambda _: None


PLAIN = Rig()


class Flight(NamedTuple):
    """A closed-loop flight on the truth, whose commands are flown again."""

    scenario: Scenario
    system: System
    recording: Recording
    command: Array  # (ticks, trials, wheels) N m, or (ticks, trials, 3) without wheels, as sent: before drives round it
    rig: Rig = PLAIN

    @property
    def states(self) -> Array:
        """[q_BN, omega_BN_B, omega_wheel] at every tick, (ticks, trials, n)."""
        return self.recording.channels["truth/state"]


@dataclass(frozen=True)
class Change:
    """How a plant differs from the scenario's.

    Attributes:
      parameters: of the plant, that are replaced.
      no_faults: none of the scenario's faults occurs.
      built: alterations that no parameter makes, such as balance masses that cannot move.
    """

    parameters: tuple[tuple[str, Any], ...] = ()
    no_faults: bool = False
    built: tuple[Alteration, ...] = ()

    def __or__(self, other: Change) -> Change:
        """Both changes."""
        return Change(self.parameters + other.parameters, self.no_faults or other.no_faults, self.built + other.built)


def altered(parameters: P, **changes: Any) -> P:
    """The same plant with other values."""
    return type(parameters)(**(parameters.model_dump() | changes))


def fly(scenario: Scenario, trials: NDArray[np.int64], rig: Rig = PLAIN, progress: Callable[[int, int], None] = lambda *_: None) -> Flight:
    """Fly the scenario, of one loop, in closed loop; feedback is the truth, so that a testbed stays away from its tilt stop.

    Args:
      scenario: what is flown.
      trials: their numbers.
      rig: what the kind of plant needs.
      progress: called with ticks done and ticks in all.
    """
    system = without_observers(build(scenario, trials))
    recording = run_whole(system, lambda _, recorder: progress(recorder.done, recorder.ticks))
    state, torque_B = recording.channels["truth/state"], recording.channels["torque_B"]
    drives = system.effectors
    assert isinstance(drives, BodyEffectors)
    if not drives.command_step_nm:
        return Flight(scenario, system, recording, recording.channels["command"], rig)
    command, _ = drives.allocation.step(torque_B, Estimate(state[..., ATTITUDE], state[..., RATE], state[..., WHEELS]), np.zeros(0))
    return Flight(scenario, system, recording, command, rig)


def without_observers(system: System) -> System:
    """The same loop closed by the truth."""
    return replace(system, feedback=BodyFeedback("truth", ()), estimators=())


class _Playback:
    """A controller that gives the recorded torques, one a tick, whatever the state."""

    def __init__(self, torque_B: Array) -> None:
        self._left: Iterator[Array] = iter(torque_B)

    def step(self, estimate: Estimate, target: Target) -> Array:  # noqa: ARG002
        return next(self._left)


def replay(flight: Flight, ticks: int, change: Change) -> Array:
    """Fly the recorded commands with another plant from the same state, by the twin's own loop.

    Drives, disturbances and faults are drawn as in the flight; only what `change` says differs. There is no tilt stop.

    Args:
      flight: what was flown.
      ticks: how many of its ticks are flown again.
      change: how the plant differs.

    Returns:
      States (ticks, trials, n).
    """
    scenario, start = flight.scenario, flight.states[0]
    again = scenario.model_copy(
        update={
            "plant": altered(scenario.plant, **dict(change.parameters)),
            "faults": () if change.no_faults else scenario.faults,
        }
    )
    system = without_observers(build(again, flight.system.trials))
    drives, flown, law, faults = system.effectors, flight.system.effectors, system.law, system.change
    assert isinstance(faults, BodyChange)
    assert isinstance(drives, BodyEffectors)
    assert isinstance(flown, BodyEffectors)
    assert isinstance(law, TrackingLaw)
    assembly = system.plant.assembly
    flight.rig.free(assembly)
    for alter in change.built:
        alter(assembly)
    plant = Plant(assembly, len(start))
    plant.start(start[:, ATTITUDE], start[:, RATE], start[:, WHEELS])
    for actuator, setpoint in kind_of(again.plant).holds(again.plant).items():
        plant.hold(actuator, setpoint)
    system = replace(
        system,  # drawn for the whole flight, so that it meets the same noise and faults
        plant=plant,
        ticks=ticks,
        law=TrackingLaw(_Playback(flight.recording.channels["torque_B"]), law.target),
        effectors=replace(  # the same commands, whatever the drives could do
            drives, allocation=flown.allocation, command_step_nm=flown.command_step_nm if drives.command_step_nm else 0.0
        ),
        change=replace(faults, plant=plant),
    )
    return run_whole(system).channels["truth/state"]


def integrate(dynamics: Dynamics, start: Array, command: Array, tick_s: float, substeps: int = 1, euler: bool = False) -> Array:
    """States of an analytic model under commands that are held for a tick.

    Args:
      dynamics: the model.
      start: (..., n).
      command: (ticks, ..., inputs), of a plant's own model N m a wheel.
      tick_s: s.
      substeps: integration steps a tick.
      euler: explicit Euler instead of the classical Runge-Kutta method.

    Returns:
      (ticks, ..., n); the command of the last tick leads beyond them and is not used.
    """
    step = tick_s / substeps
    process = cast(ProcessModel, dynamics)  # of which Runge-Kutta needs no more than the derivative
    state, path = start, [start]
    for torque in command[:-1]:
        for _ in range(substeps):
            state = state + step * dynamics.derivative(state, torque) if euler else runge_kutta(process, state, torque, step)
        state = np.concatenate([quaternion.normalize(state[..., ATTITUDE]), state[..., 4:]], axis=-1)
        path.append(state)
    return np.stack(path)
