"""Distributed tracking of a leader's attitude by spacecraft that hear of their neighbours alone."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from control.communication_graph import lumped_error
from models.dynamics.attitude_by_rodrigues import AttitudeByRodrigues

Array = NDArray[np.floating]


class Gains(NamedTuple):
    """Of the law, one number for all or one each, (..., agents, 1)."""

    k1: Array | float = 0.5
    k2: Array | float = 15.0
    k3: Array | float = 20.0
    gamma: Array | float = 10.0  # 1/s2, with lambda^2
    lambda_: Array | float = 2.0


@dataclass(frozen=True, eq=False)
class FormationLaw:
    """Asymptotic attitude coordination (Zou et al. 2016; Rososhansky 2017, eq. 4.11), in modified Rodrigues parameters.

    torque = g^-1 (-k1 k2 e_q - k1 k3 e_v - f - gamma lambda^2 (q_read - q) + p), cut off about each body axis, where e_q and e_v are the
    lumped errors of attitude and rate (eq. 4.12) and p the agent's estimate of the leader's acceleration. The factor of what was read minus
    what is believed is illegible in places: gamma^2 lambda is possible too. It is zero on truth. f is that of a body with wheels where
    these are known to hold momentum; the torque is then what they must leave to the body.

    Attributes:
      inertia: on board, (..., agents, 3, 3) kg m2.
      gains: of the law.
      limit: N m about each body axis.
    """

    inertia: Array
    gains: Gains = field(default_factory=Gains)
    limit: float = 0.1

    @cached_property
    def _model(self) -> AttitudeByRodrigues:
        return AttitudeByRodrigues(self.inertia)

    def step(
        self,
        state: Array,
        heard: Array,
        listening: Array,
        leader_acceleration: Array,
        surprise: Array | float = 0.0,
        gains: Gains | None = None,
        stored: Array | None = None,
    ) -> Array:
        """Torque on each body.

        Args:
          state: [sigma, v] that each agent believes of itself, (..., agents, 6).
          heard: the same of leader and agents, as each has it, (..., agents or 1, 1 + agents, 6).
          listening: weights, (..., agents, 1 + agents).
          leader_acceleration: p, (..., agents, 3) 1/s2.
          surprise: sigma read minus sigma believed, (..., agents, 3).
          gains: in place of the law's own.
          stored: momentum that wheels hold in B, (..., agents, 3) N m s; None: there are none.

        Returns:
          N m in B, (..., agents, 3).
        """
        k1, k2, k3, gamma, lambda_ = gains or self.gains
        error = lumped_error(state, heard, listening)
        wanted = leader_acceleration - k1 * k2 * error[..., :3] - k1 * k3 * error[..., 3:] - gamma * lambda_**2 * surprise
        return np.clip(self._model.torque(state, wanted, stored), -self.limit, self.limit)
