"""Posterior Cramer-Rao bound: the least covariance that any filter can have, along a trajectory."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]


def posterior_bound(transition: Array, process_noise: Array, information: Array, first: Array) -> Array:
    """Bound on the errors' covariance after each reading (Tichavsky, Muravchik & Nehorai 1998, eq. 21), along given trajectories.

    J' = D22 - D21 (J + D11)^-1 D12 with D11 = F' Q^-1 F, D12 = -F' Q^-1 and D22 = Q^-1 + H' R^-1 H, all at the true states; by the
    matrix inversion lemma that is J' = (Q + F J^-1 F')^-1 + H' R^-1 H, which needs no inverse of Q. With one trajectory for the
    expectation it is the covariance of a Kalman filter that is linearised at the truth, and of a linear system the Kalman filter's own.

    Args:
      transition: F of each step, in error coordinates, (steps, ..., e, e).
      process_noise: Q of each step, (steps, ..., e, e), or of leading axes that broadcast to those.
      information: H' R^-1 H of the reading after each step, (steps, ..., e, e).
      first: J^-1 before the first step, (..., e, e), positive definite.

    Returns:
      J^-1 after each step, (steps, ..., e, e).
    """
    lead = np.broadcast_shapes(transition.shape, information.shape, (1, *first.shape))
    out, before = np.empty(lead), np.broadcast_to(first, lead[1:])
    noise = np.broadcast_to(process_noise, lead)
    for k, (by, known) in enumerate(zip(np.broadcast_to(transition, lead), np.broadcast_to(information, lead), strict=True)):
        predicted = by @ before @ by.swapaxes(-1, -2) + noise[k]
        after = np.linalg.inv(np.linalg.inv(predicted) + known)
        before = out[k] = 0.5 * (after + after.swapaxes(-1, -2))
    return out
