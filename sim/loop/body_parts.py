"""What closes the loop of one body: who tells its law the state, its drives, and the faults that change the plant itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from control.allocation import Allocation
from control.tracking import Estimate
from models.dynamics.state_layout import ATTITUDE, RATE, WHEELS
from models.dynamics.unmodelled_torque import UnmodelledTorque
from sim.faults.effects import ACTIVE, CENTRE_OF_MASS, FRICTION, INERTIA, LOCKED, OWN_MASS
from sim.faults.timeline import Timeline
from sim.parts import ActuatorOutput, AnyArray, Array, Decision, Estimator, Flags, Snapshot
from sim.plant.batch import Plant, Truth

MASSES = (OWN_MASS, INERTIA, CENTRE_OF_MASS)
LOCKING = 40.0  # friction of a seized bearing over the drive's limit


@dataclass(frozen=True, eq=False)
class BodyFeedback:
    """Tells the law the state: an observer, the truth or the readings.

    Attributes:
      source: an observer's name, `truth` or `measurement`.
      estimators: all of the loop.
      unmodelled: what filters learn and are held against; None: none does.
    """

    source: str
    estimators: tuple[Estimator, ...]
    unmodelled: UnmodelledTorque | None = None

    def __call__(self, tick: int, beliefs: tuple[Any, ...], truth: Truth, reading: Array, held: Array) -> Estimate:
        """State that the controller acts on; `held` is the last reading without its gaps."""
        state = {"truth": truth.state, "measurement": held}.get(self.source)
        modes, q_read = None, None
        learned = self.unmodelled.at(truth.state) if self.unmodelled is not None and self.source == "truth" else None
        for estimator, raw in zip(self.estimators, beliefs, strict=True):
            if self.source in estimator.names:
                belief, member = estimator.summary(raw), estimator.names.index(self.source)
                state = belief.mean[member]
                modes = belief.modes.probabilities[member] if belief.modes is not None else None
                q_read = reading[..., ATTITUDE]
                torques = getattr(belief.memory, "learned", None)
                learned = torques[member] if torques is not None else None
        if state is None:
            raise ValueError(f"feedback {self.source!r} is no observer of this loop")
        wheels = state[..., WHEELS] if state.shape[-1] == held.shape[-1] else held[..., WHEELS]  # as read, where no state
        return Estimate(state[..., ATTITUDE], state[..., RATE], wheels, modes, q_read, learned)


@dataclass(frozen=True, eq=False)
class BodyEffectors:
    """Allocation and drives of one body; without wheels the torque acts on the body itself.

    Attributes:
      allocation: how a torque is shared among the wheels.
      command_step_nm: least step of the drives' torque set-point; 0: none.
      faults: of the drives, and torques from outside.
      drive_noise: torque errors of the drives, (ticks, trials, wheels) N m; of a body without wheels (ticks, trials, 3).
      disturbance_B: torque of the environment, (ticks, trials, 3) N m in B.
      wheels: how many.
    """

    allocation: Allocation
    command_step_nm: float
    faults: Timeline
    drive_noise: Array
    disturbance_B: Array
    wheels: int

    def rest(self) -> ActuatorOutput:
        """No torque, and wheels that stand still."""
        trials = self.drive_noise.shape[1]
        known = np.zeros((trials, (self.wheels or 3) + self.wheels))
        return ActuatorOutput(np.zeros((trials, self.wheels)), np.zeros((trials, 3)), known, self.allocation.start((trials,)), {})

    def give(self, tick: int, decision: Decision, estimate: Estimate, held: Array, before: ActuatorOutput, lost: Flags) -> ActuatorOutput:
        """Share the torque, as finely as set-points go, with the errors and faults of the drives.

        Filters know the torques that were commanded and the wheel speeds that were read, (trials, 2 wheels); of a body without wheels the
        torque alone, (trials, 3).
        """
        demand, shared = self.allocation.step(decision.effort, estimate, before.memory)
        command = _quantize(demand, self.command_step_nm)
        told, outside = command + self.drive_noise[tick], self.faults.push(tick)
        applied = self.faults.given(tick, told) if self.wheels else self.faults.commanded(tick, told)
        push = self.disturbance_B[tick] if outside is None else self.disturbance_B[tick] + outside
        wheel, push = (applied, push) if self.wheels else (applied[:, :0], push + applied)
        known = np.concatenate([command, held[..., WHEELS]], axis=-1)
        notes = self.allocation.notes(shared)
        return ActuatorOutput(wheel, push, known, shared, {"command": command, "applied": applied} | notes)


def _quantize(command: Array, step: float) -> Array:
    return step * np.round(command / step) if step else command


@dataclass(frozen=True, eq=False)
class BodyChannels:
    """What is recorded of a tick of one body."""

    faults: Timeline
    due: Callable[[int], dict[str, Flags]]
    unmodelled: UnmodelledTorque | None = None

    def __call__(self, tick: int, now: Snapshot) -> dict[str, AnyArray]:
        """By name, (trials, ...)."""
        truth, given, active = now.truth, now.given.notes, self.faults.at(ACTIVE, tick)
        return {
            "truth/qpos": truth.qpos,
            "truth/qvel": truth.qvel,
            "reading": now.reading,
            **self.due(tick),
            "torque_B": now.decision.effort,
            "command": given["command"],
            "applied": given["applied"],
            "fault": np.zeros(len(truth.qpos), dtype=bool) if active is None else np.broadcast_to(active, len(truth.qpos)),
            **({} if self.unmodelled is None else {"truth/unmodelled": self.unmodelled.at(truth.state)}),
            **{f"control/{name}": note for name, note in now.decision.notes.items()},
            **{f"control/{name}": note for name, note in given.items() if name not in ("command", "applied")},
        }


@dataclass(frozen=True, eq=False)
class BodyChange:
    """Carries out the faults that change the plant itself, at the ticks at which something changes."""

    plant: Plant
    faults: Timeline

    def __call__(self, tick: int) -> None:
        """What changes at a tick."""
        plant, faults = self.plant, self.faults
        brake_wheels(plant, faults, tick)
        if faults.changes_at(tick, *MASSES):
            own = plant.inertia, plant.centre_of_mass
            (inertia, centre), (before, centre_before) = masses(faults, tick, *own), masses(faults, tick - 1, *own)
            changed = (inertia != before).any(axis=(-2, -1)) | (centre != centre_before).any(axis=-1)
            plant.set_mass_properties(changed, inertia[changed], centre[changed])


def brake_wheels(plant: Plant, faults: Timeline, tick: int) -> None:
    """Let the dry friction of wheels' bearings be what it is from a tick on, where it changes."""
    if not faults.changes_at(tick, LOCKED, FRICTION):
        return
    now, before = (_dry_friction(plant, faults, one) for one in (tick, tick - 1))
    for wheel in np.flatnonzero((now != before).any(axis=0)):
        changed = (now != before)[:, wheel]
        plant.set_wheel_friction(changed, int(wheel), now[changed, wheel])


def _dry_friction(plant: Plant, faults: Timeline, tick: int) -> Array:
    """Of all wheels at a tick, (trials, wheels) N m; before the first, their own."""
    own: Array = plant.wheel_coulomb
    if tick < 0:
        return own
    seized, more = (np.zeros(1) if of is None else of.reshape(len(of), -1) for of in (faults.at(LOCKED, tick), faults.at(FRICTION, tick)))
    return (1.0 - seized) * (own + more) + seized * LOCKING * plant.assembly.wheel_torque_limit


def masses(faults: Timeline, tick: int, inertia: Array, centre_of_mass: Array) -> tuple[Array, Array]:
    """Inertias (trials, [agents,] 3, 3) kg m2 and centres of mass (..., 3) m at a tick, of what they are without faults."""
    if tick < 0:
        return inertia, centre_of_mass
    own, added, moved = (faults.at(effect, tick) for effect in MASSES)
    if own is not None:
        inertia, centre_of_mass = own[..., None] * inertia, own * centre_of_mass
    return inertia if added is None else inertia + added, centre_of_mass if moved is None else centre_of_mass + moved
