"""Fast terminal sliding mode tracking of a leader by agents that know of their neighbours alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from control.communication_graph import lumped_error

Array = NDArray[np.floating]

K_U = 0.2785  # 0 <= |s| - s tanh(s / e) <= K_U e (Polycarpou & Ioannou 1996)


class Lumped(NamedTuple):
    """What an agent sees of its errors: those relative to its neighbours and to the leader, weighted and summed."""

    position: Array  # (..., agents, axes) m
    velocity: Array  # (..., agents, axes) m/s


def lumped(own: Array, heard: Array, listening: Array) -> Lumped:
    """Eq. 5.21, 5.22: sum_j a_ij (x_i - x_j) + b_i (x_i - x_d), and the same of velocities.

    Args:
      own: [x, v] of each agent, (..., agents, 2 axes).
      heard: the same of leader and agents as each agent has them, (..., agents or 1, 1 + agents, 2 axes).
      listening: weights, (..., agents, 1 + agents).
    """
    error = lumped_error(own, heard, listening)
    axes = own.shape[-1] // 2
    return Lumped(error[..., :axes], error[..., axes:])


class Sliding(NamedTuple):
    """A command and the surface that it was made of."""

    force: Array  # (..., agents, axes) N
    surface: Array  # (..., agents, axes) s
    robust: Array  # (..., agents, axes) N, h


@dataclass(frozen=True, eq=False)
class TerminalSlidingMode:
    """u = -W phi - K1 s - K2 sig^a(s) - h, s = e_v + L1 e_x + L2 sig^a(e_x) (Rososhansky 2017, eq. 5.17-5.26; Zou, Kumar & Hou 2013).

    sig^a(s) = |s|^a sign(s). eq. 5.17 prints s in the place of sig^a(s) and defines no xi; the gains' names tell them apart.
    The leader's acceleration is not known to the agents, and the law has no term for it: it leaves an error even with exact dynamics.

    Attributes:
      proportional: K1, 1/s.
      terminal: K2.
      slope: L1, 1/s.
      terminal_slope: L2.
      exponent: a.
      bound: phi_i, N, what h can counteract.
      width: eps, of the layer in which h is smooth.
    """

    proportional: float = 4.0
    terminal: float = 2.0
    slope: float = 1.0
    terminal_slope: float = 0.5
    exponent: float = 0.6
    bound: float = 1.0
    width: float = 0.02

    def __post_init__(self) -> None:
        if not (0.0 < self.exponent <= 1.0 and self.width > 0.0 and self.bound >= 0.0):
            settings = f"exponent = {self.exponent:g}, width = {self.width:g}, bound = {self.bound:g}"
            raise ValueError(f"{settings}: need 0 < exponent <= 1, width > 0, bound >= 0")

    def step(self, seen: Lumped, learned: Array) -> Sliding:
        """Force of every agent.

        Args:
          seen: errors relative to neighbours and leader.
          learned: W phi, what an agent believes of its own dynamics, (..., agents, axes) N.
        """
        surface = seen.velocity + self.slope * seen.position + self.terminal_slope * signed_power(seen.position, self.exponent)
        robust = self.bound * np.tanh(learned.shape[-1] * K_U * self.bound * surface / self.width)
        reach = self.proportional * surface + self.terminal * signed_power(surface, self.exponent)
        return Sliding(-learned - reach - robust, surface, robust)


def signed_power(values: Array, exponent: float) -> Array:
    """sig^a(x) = |x|^a sign(x), component by component."""
    return np.sign(values) * np.abs(values) ** exponent
