"""Sliding mode attitude control: onto a surface on which the error dies out, by switching across it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from control.feed_forward import BodyModel, feed_forward, gyroscopic_coupling, times
from control.gain_blending import blend
from control.tracking import Estimate, Target, tracking_error
from models.attitude.quaternion import cross

Array = NDArray[np.floating]


@dataclass(frozen=True)
class SlidingMode:
    """torque_B = T_eq - I K sign(S) on the surface S = w_e + lambda dq_1:3 (Hill et al. 2021, eq. 35-40).

    T_eq = -Sigma w_e + feed-forward - I lambda d(dq_1:3)/dt (eq. 38) keeps S where it is; the switching term then makes
    dS/dt = -K sign(S). On the surface the attitude error dies out with a time constant of 2 / lambda (eq. A9, A14). Blended gains are
    taken as constant, as in the paper: dlambda/dt dq_1:3 is left out.

    Attributes:
      slope: lambda, rad/s; one number, or one a mode, the healthy one first.
      reaching: K, rad/s2; one number, one a mode, or one for each body axis a mode, (modes, 3).
      model: of the body.
      boundary_layer: phi, rad/s: sign(S) becomes sat(S / phi) (Slotine & Li 1991, sec. 7.2); 0: the printed sign.
    """

    slope: float | tuple[float, ...]
    reaching: float | tuple[float, ...] | tuple[tuple[float, float, float], ...]
    model: BodyModel
    boundary_layer: float = 0.0

    def step(self, estimate: Estimate, target: Target) -> Array:
        """Torque on the body, (..., 3) N m in B."""
        error = tracking_error(estimate, target)
        vector, scalar = error.dq[..., :3], error.dq[..., 3:]
        slope = blend(self.slope, estimate.mode_probabilities)[..., None]
        surface = error.rate + slope * vector
        switch = np.clip(surface / self.boundary_layer, -1.0, 1.0) if self.boundary_layer else np.sign(surface)
        vector_rate = 0.5 * (cross(vector, error.rate) + scalar * error.rate)  # eq. A9
        wanted = slope * vector_rate + self._reaching(estimate) * switch  # minus the error's angular acceleration
        coupling = gyroscopic_coupling(self.model, estimate, error, target)
        return feed_forward(self.model, estimate, error, target) - times(coupling, error.rate) - times(self.model.inertia, wanted)

    def _reaching(self, estimate: Estimate) -> Array:
        """Diagonal of K as it is blended now, (..., 3) or (..., 1) rad/s2."""
        mixed = blend(self.reaching, estimate.mode_probabilities)
        return mixed if np.ndim(self.reaching) == 2 else mixed[..., None]
