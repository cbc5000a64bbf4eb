"""Flying again without feedback: the commands of a closed-loop flight, replayed to a changed plant or integrated by an analytic model."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from control.tracking import Estimate, Target
from models import quaternion
from models.assembly import Assembly
from models.nacs import BALANCE_MASSES, NacsParameters
from models.process import ProcessModel, runge_kutta
from sim.build import build
from sim.loop import System, run
from sim.plant import Plant
from sim.recording import Recording
from sim.scenario import Scenario

Array = NDArray[np.floating]

OUT_OF_REACH_M = 10.0  # where the tilt stop is put when nothing shall touch it
STIFFER = 1e4  # balance masses so much stiffer, heavier and better damped give by less than 1e-12 m


class Dynamics(Protocol):
    """All that a model needs here: its derivative."""

    def derivative(self, state: Array, command: Array) -> Array:
        """dx/dt of [q_BN, omega_BN_B, omega_wheel]: (..., n) and (..., wheels) N m to (..., n)."""
        ...


class Flight(NamedTuple):
    """A closed-loop flight on the truth, whose commands are flown again."""

    scenario: Scenario
    system: System
    recording: Recording
    command: Array  # (ticks, trials, wheels) N m, as sent: before the drives round it

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
      clamped: the balance masses cannot move on their rails.
    """

    parameters: tuple[tuple[str, Any], ...] = ()
    no_faults: bool = False
    clamped: bool = False

    def __or__(self, other: Change) -> Change:
        """Both changes."""
        return Change(self.parameters + other.parameters, self.no_faults or other.no_faults, self.clamped or other.clamped)


def altered(parameters: NacsParameters, **changes: Any) -> NacsParameters:
    """The same plant with other values."""
    return type(parameters)(**(parameters.model_dump() | changes))


def take_stop_away(assembly: Assembly) -> None:
    """Put the tilt stop out of reach: open loop, a body that nothing holds goes round and round."""
    assembly.model.geom("tilt_stop").pos[2] -= OUT_OF_REACH_M


def clamp_masses(assembly: Assembly) -> None:
    """Fix the balance masses to their rails: all of the rails' drives is scaled alike, so that the step still resolves them."""
    model = assembly.model
    for name in BALANCE_MASSES:
        dof, servo = model.joint(name).dofadr[0], model.actuator(name).id
        model.dof_armature[dof] *= STIFFER
        model.dof_damping[dof] *= STIFFER
        model.actuator_gainprm[servo] *= STIFFER
        model.actuator_biasprm[servo] *= STIFFER


def fly(scenario: Scenario, trials: NDArray[np.int64]) -> Flight:
    """Fly the scenario in closed loop; feedback is the truth, so that the flight stays away from the tilt stop."""
    system = replace(build(scenario, trials), feedback="truth", banks=())
    recording = run(system)
    state, torque_B = recording.channels["truth/state"], recording.channels["torque_B"]
    command, _ = system.allocation.step(torque_B, Estimate(state[..., :4], state[..., 4:7], state[..., 7:]), np.zeros(0))
    return Flight(scenario, system, recording, command)


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
            "run": scenario.run.model_copy(update={"ticks": ticks}),
            "plant": altered(scenario.testbed, **dict(change.parameters)),
            "faults": () if change.no_faults else scenario.faults,
        }
    )
    system = build(again, flight.system.trials)
    assembly = system.plant.assembly
    take_stop_away(assembly)
    if change.clamped:
        clamp_masses(assembly)
    plant = Plant(assembly, len(start))
    plant.start(start[:, :4], start[:, 4:7], start[:, 7:])
    for name, position in zip(BALANCE_MASSES, again.testbed.balance_position_mm, strict=True):
        plant.hold(name, 1e-3 * position)
    system = replace(
        system,
        plant=plant,
        feedback="truth",
        banks=(),
        controller=_Playback(flight.recording.channels["torque_B"]),
        allocation=flight.system.allocation,  # the same commands, whatever the drives could do
        command_step_nm=flight.system.command_step_nm if again.testbed.command_bits else 0.0,
    )
    return run(system).channels["truth/state"]


def integrate(dynamics: Dynamics, start: Array, command: Array, tick_s: float, substeps: int = 1, euler: bool = False) -> Array:
    """States of an analytic model under commands that are held for a tick.

    Args:
      dynamics: the model.
      start: (..., n).
      command: (ticks, ..., wheels) N m.
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
        state = np.concatenate([quaternion.normalize(state[..., :4]), state[..., 4:]], axis=-1)
        path.append(state)
    return np.stack(path)
