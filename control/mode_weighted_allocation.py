"""Sharing a body torque among the wheels that are probably healthy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from control.allocation import scaled
from control.gain_blending import blend
from control.tracking import Estimate
from models.dynamics.wheel_faults import WheelFault, lost_axis

Array = NDArray[np.floating]

LEAST_HEALTH = 1e-6  # weight of a dead wheel: keeps W D W' invertible, errs by as much


@dataclass(frozen=True, eq=False)
class ModeWeightedAllocation:
    """tau = -D W' (W D W')^-1 torque_B with D the probable health of the wheels, sum_i mu_i (1 - sigma_i).

    Of all torques with -W tau = torque_B it takes the one with the least sum of tau^2 / D: healthy wheels take over from failed ones,
    nothing is turned up to make good a partial loss. With all wheels healthy it is the pseudo-inverse. Wheel indicators sigma as in Hill
    et al. (2021, eq. 12), whose paper does not reallocate.

    Once a failed wheel is not used, healthy and faulty mode predict the same and their probabilities drift back; trusting the wheel
    again would bring the fault back. Hence the latch: a mode whose probability has exceeded `latch_above` for `latch_ticks` ticks in a
    row is believed for good, in that no wheel counts as healthier than it says.

    Attributes:
      wheel_axes: W, (3, wheels).
      torque_limit: N m a wheel; a demand beyond it is scaled as a whole.
      health: 1 - sigma of each mode, (modes, wheels), 0 dead to 1 healthy, the healthy mode first.
      latch_above: probability.
      latch_ticks: at least 1.
    """

    wheel_axes: Array
    torque_limit: float
    health: Array
    latch_above: float = 0.9
    latch_ticks: int = 10

    @property
    def lost_axes(self) -> tuple[Array | None, ...]:
        """For each mode a unit vector in B about which no torque is left, or None.

        Torque about a lost axis is asked of the dead wheels all the same: the demand stays finite and the other axes are served.
        """
        nothing = np.zeros(self.wheel_axes.shape[1])
        return tuple(lost_axis(self.wheel_axes, WheelFault(1.0 - wheels, nothing)) for wheels in self.health)

    def start(self, shape: tuple[int, ...]) -> Array:
        """No mode is latched: ticks in a row above `latch_above`, (*shape, modes), held once they are `latch_ticks`."""
        return np.zeros((*shape, len(self.health)))

    def notes(self, memory: Array) -> dict[str, Array]:
        """`latched`: whether a mode with a failed wheel is believed for good, (...,)."""
        failed = np.any(self.health < 1.0, axis=-1)
        return {"latched": np.any((memory >= self.latch_ticks) & failed, axis=-1)}

    def step(self, torque_B: Array, estimate: Estimate, memory: Array) -> tuple[Array, Array]:
        """Torque of each motor on its wheel, (..., wheels) N m, and the memory after it; torque_B (..., 3) N m."""
        probabilities = estimate.mode_probabilities
        if probabilities is not None:
            counted = np.where(probabilities > self.latch_above, memory + 1.0, 0.0)
            memory = np.where(memory >= self.latch_ticks, memory, counted)
        latched = (memory >= self.latch_ticks)[..., None]  # (..., modes, 1)
        health = np.minimum(blend(self.health, probabilities), np.min(np.where(latched, self.health, 1.0), axis=-2))
        weight = np.maximum(health, LEAST_HEALTH)
        shared = (self.wheel_axes * weight[..., None, :]) @ self.wheel_axes.T
        share = np.linalg.solve(shared, torque_B[..., None])
        return scaled(-weight * (self.wheel_axes.T @ share)[..., 0], self.torque_limit), memory
