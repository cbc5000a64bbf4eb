"""A user's own control law, as the loop sees it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from control.terminal_sliding_mode import Sliding
from control.tracking import Controller, Estimate, Target
from models.attitude import quaternion
from models.dynamics.state_layout import ATTITUDE, RATE
from sim.network.messages import Messages
from sim.user_code.real_numbers import real_numbers
from sim.user_code.rehearsal import TRIALS, readings, same_whatever_the_batch
from sim.user_code.surroundings import Surroundings
from sim.user_code.user_class import UserClass

Array = NDArray[np.floating]


class Own(NamedTuple):
    """What each of several agents knows of itself, as a user's law is told.

    Attributes:
      state: as its filter believes, (trials, agents, n); `setting.layout` names the components.
      leader_acceleration: of a formation, the agents' estimates of the leader's, (trials, agents, 3) 1/s2; else None.
      learned: of agents that learn, the force that each believes to act on it, (trials, agents, 2) N; else None.
    """

    state: Array
    leader_acceleration: Array | None
    learned: Array | None


@dataclass(frozen=True, eq=False)
class UserLaw:
    """A user's law; its torque or force is checked at every tick.

    Attributes:
      source: its class.
      own: the instance.
      place: how it sits in the loop.
    """

    source: UserClass
    own: Any
    place: Surroundings

    @classmethod
    def of(cls, source: UserClass, place: Surroundings) -> UserLaw:
        """A fresh one."""
        return cls(source, source.construct(place.setting), place)

    def rehearse(self) -> None:
        """Ask for the effort of three trials, also apart from each other."""
        same_whatever_the_batch(self.source, self._rehearsed)

    def ask(self, shape: tuple[int, ...], unit: str, *told: Any) -> Array:
        """Effort of that shape, of what the law is told."""
        with self.source.blamed("step"):
            effort = real_numbers(self.own.step(*map(copied, told)))
        what = "torque" if unit == "N m" else "force"
        if effort.shape != shape:
            raise self.source.complaint("step", f"{what} has shape {effort.shape}, needs {shape}")
        if not np.isfinite(effort).all():
            raise self.source.complaint("step", f"{what} is not finite: {effort[~np.isfinite(effort).all(axis=-1)][0]} {unit}")
        return effort

    def _rehearsed(self, which: slice) -> Array:
        fresh, layout = UserLaw.of(self.source, self.place), self.place.setting.layout
        state = readings(layout)[which]
        if layout.agents is None:
            target = Target(quaternion.IDENTITY, np.full(3, 1e-3), np.full(3, 1e-4))
            spin = 5.0 * np.ones((TRIALS, self.place.wheels))
            return TrackingUserLaw(fresh).step(Estimate(state[..., ATTITUDE], state[..., RATE], spin[which]), target)
        planar = layout.blocks[0].kind == "position"
        said = state if planar else np.concatenate([state, 0.01 * state[..., :3]], axis=-1)
        messages = np.concatenate([said[:, :1], said], axis=1)[:, None]
        heard = Messages(messages, np.full((1, layout.agents, 1 + layout.agents), 0.5), np.ones((1, 1), dtype=bool))
        extra = 0.1 * state[..., : 2 if planar else 3]
        own = Own(state, None, extra) if planar else Own(state, extra, None)
        return fresh.ask((*state.shape[:-1], extra.shape[-1]), "N" if planar else "N m", own, heard)


@dataclass(frozen=True, eq=False)
class TrackingUserLaw:
    """A user's law of one body that follows a target."""

    user: UserLaw

    def step(self, estimate: Estimate, target: Target) -> Array:
        """Torque on the body, (trials, 3) N m in B."""
        return self.user.ask(estimate.omega_BN_B.shape, "N m", estimate, target)


@dataclass(frozen=True, eq=False)
class FormationUserLaw:
    """A user's law of a formation, in the place of `control.formation_law.FormationLaw`."""

    user: UserLaw

    def step(
        self,
        state: Array,
        heard: Array,
        listening: Array,
        leader_acceleration: Array,
        surprise: Array | float = 0.0,  # noqa: ARG002
        gains: Any = None,  # noqa: ARG002
        stored: Array | None = None,  # noqa: ARG002
    ) -> Array:
        """Torque on each body, (trials, agents, 3) N m in B."""
        messages = Messages(heard, listening, np.ones((1, 0), dtype=bool))
        return self.user.ask((*state.shape[:-1], 3), "N m", Own(state, leader_acceleration, None), messages)


@dataclass(frozen=True, eq=False)
class PlanarUserLaw:
    """A user's law of agents in the plane; it has no sliding surface, so that the adaptive law learns nothing beside it."""

    user: UserLaw

    def step(self, motion: Array, messages: Messages, learned: Array) -> Sliding:
        """Force on each agent, (trials, agents, 2) N."""
        force = self.user.ask((*motion.shape[:-1], 2), "N", Own(motion, None, learned), messages)
        return Sliding(force, np.zeros_like(force), np.zeros_like(force))


def tracking(user: UserLaw | None) -> Controller | None:
    """As a law that follows a target; None if there is none."""
    return None if user is None else TrackingUserLaw(user)


def copied(told: Any) -> Any:
    """What a law is told, so that it may write into it without harm to what others know."""
    if isinstance(told, np.ndarray):
        return told.copy()
    if isinstance(told, tuple) and hasattr(told, "_fields"):
        return type(told)(*map(copied, told))
    return told
