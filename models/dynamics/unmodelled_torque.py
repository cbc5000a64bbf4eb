"""Unmodelled torque of the testbed: what acts on its body and is in no filter's model, from the plant's own parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.attitude.quaternion import cross
from models.dynamics.state_layout import ATTITUDE, RATE, WHEELS

Array = NDArray[np.floating]


def vertical(attitude: Array) -> Array:
    """The vertical, down, in B: the third column of A(q) (Markley & Crassidis 2014, eq. 2.125); (..., 4) to (..., 3)."""
    q1, q2, q3, q4 = np.moveaxis(attitude, -1, 0)
    return np.stack([2.0 * (q1 * q3 - q2 * q4), 2.0 * (q2 * q3 + q1 * q4), q3**2 + q4**2 - q1**2 - q2**2], axis=-1)


@dataclass(frozen=True, eq=False)
class UnmodelledTorque:
    """m g r x n + W (c sign omega_w + v omega_w) - b omega, with the vertical n in B.

    What a rigid body J domega/dt = -W tau - omega x (J omega + W J_w omega_w), driven by the torques tau of the wheel motors, does not
    know: gravity on the centre of mass r, the bearings' friction, which drags the body along with its wheels, and the drag of the air
    film. Not in it: the air flow's random torque, errors of the drives, and W J_w W' domega/dt, 0.1 % of the body's own inertia.
    Parameters may differ from trial to trial.

    Attributes:
      weight: m g, (...,) N.
      centre_of_mass: r from the centre of rotation, (..., 3) m in B.
      wheel_axes: W, (3, wheels).
      wheel_coulomb: c, dry friction of a wheel's bearing, (...,) N m.
      wheel_viscous: v, (...,) N m s/rad.
      bearing_viscous: b, of the air film, (...,) N m s/rad.
    """

    weight: Array
    centre_of_mass: Array
    wheel_axes: Array
    wheel_coulomb: Array
    wheel_viscous: Array
    bearing_viscous: Array

    def at(self, state: Array) -> Array:
        """Torque on the body of states [q_BN, omega_BN_B, omega_wheel], (..., 7 + wheels) to (..., 3) N m in B."""
        speed = state[..., WHEELS]
        gravity = self.weight[..., None] * cross(self.centre_of_mass, vertical(state[..., ATTITUDE]))
        friction = self.wheel_coulomb[..., None] * np.sign(speed) + self.wheel_viscous[..., None] * speed
        return gravity + (self.wheel_axes @ friction[..., None])[..., 0] - self.bearing_viscous[..., None] * state[..., RATE]
