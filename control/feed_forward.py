"""Dynamics of the tracking error, and the torque that a body needs to stay on a moving reference."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from control.tracking import Estimate, Target, TrackingError
from models.attitude.quaternion import cross, cross_matrix

Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class BodyModel:
    """What a law believes of the body.

    Attributes:
      inertia: I of the whole, (3, 3) kg m2.
      momentum_map: W J_w, (3, wheels) kg m2: wheel speeds to their momentum in B.
    """

    inertia: Array
    momentum_map: Array

    def wheel_momentum(self, estimate: Estimate) -> Array:
        """Angular momentum h of the wheels relative to the body, in B, (..., 3) N m s."""
        return times(self.momentum_map, estimate.omega_wheel)


def feed_forward(body: BodyModel, estimate: Estimate, error: TrackingError, target: Target) -> Array:
    """[w_d x] h + [w_d x] I w_d + I A(dq) alpha_d with w_d = A(dq) omega_d; (..., 3) N m in B.

    First three terms of Hill et al. (2021, eq. 32). They cancel the last three of eq. 18, so that the error moves as

        I dw_e/dt = torque_B + Sigma w_e - [w_d x] h - [w_d x] I w_d - I A(dq) alpha_d

    would with a reference at rest, but for Sigma, which does no work.
    """
    wanted = times(error.rotation, target.omega_DN_D)
    momentum = body.wheel_momentum(estimate) + times(body.inertia, wanted)
    return cross(wanted, momentum) + times(body.inertia, times(error.rotation, target.alpha_DN_D))


def gyroscopic_coupling(body: BodyModel, estimate: Estimate, error: TrackingError, target: Target) -> Array:
    """Sigma of Hill et al. (2021, eq. 18), which the paper names and does not write out; (..., 3, 3) N m s/rad.

    Sigma = [(I omega + h) x] - [w_d x] I - I [w_d x], skew-symmetric, from eq. 4 and 17 with omega = w_e + w_d: the gyroscopic torque
    of the error itself, and what the turning frames of body and reference leave over.
    """
    momentum = times(body.inertia, estimate.omega_BN_B) + body.wheel_momentum(estimate)
    turning = cross_matrix(times(error.rotation, target.omega_DN_D))
    return cross_matrix(momentum) - turning @ body.inertia - body.inertia @ turning


def times(matrix: Array, vector: Array) -> Array:
    """Matrix times vector for any leading axes; (..., m, n) and (..., n) to (..., m)."""
    return (matrix @ vector[..., None])[..., 0]
