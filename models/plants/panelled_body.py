"""Rigid body with reaction wheels and one linear mode of its panels: the analytic model of the flexible spacecraft."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from models.attitude import quaternion
from models.plants.appendage import FlexibleChannel

Array = NDArray[np.floating]

AXIS = np.array([1.0, 0.0, 0.0])  # in B, about which both panels turn alike


@dataclass(frozen=True, eq=False)
class PanelledBody:
    """Attitude, body rate, wheel speeds, and angle and rate of the panels: [q_BN, omega_BN_B, omega_wheel, eta, deta/dt].

    H = (J + eta J_1) omega + W J_w omega_w + m12 deta/dt e_x, dH/dt = -omega x H in B, J_w (domega_w/dt + W' domega/dt) = tau,
    m22 d2eta/dt2 + m12 domega_x/dt + k eta = omega' J_1 omega / 2: hybrid coordinates (Likins 1970) and what is of first order in eta
    besides, J_1 = m12 (e_y e_z' + e_z e_y'). Rigid body and wheels are exact. Without J_1, whose change is half of the Coriolis torque,
    the held axis would go astray.

    Attributes:
      inertia: J of the whole with panels and wheels locked, (3, 3) kg m2.
      wheel_axes: W, (3, wheels).
      wheel_inertia: J_w, kg m2.
      panels: their mass matrix and stiffness about the hinge axis.
    """

    inertia: Array
    wheel_axes: Array
    wheel_inertia: float
    panels: FlexibleChannel

    @cached_property
    def _mass(self) -> Array:
        """What resists [domega/dt, d2eta/dt2] when the wheels are free and the panels straight, (4, 4)."""
        mass = np.zeros((4, 4))
        mass[:3, :3] = self.inertia - self.wheel_inertia * self.wheel_axes @ self.wheel_axes.T
        mass[0, 3] = mass[3, 0] = self.panels.mass[0, 1]
        mass[3, 3] = self.panels.mass[1, 1]
        return mass

    @cached_property
    def _bent(self) -> Array:
        """J_1, change of the inertia with eta, (3, 3) kg m2."""
        change = np.zeros((3, 3))
        change[1, 2] = change[2, 1] = self.panels.mass[0, 1]
        return change

    def derivative(self, state: Array, command: Array) -> Array:
        """dx/dt; state (..., 9 + wheels), command: wheel torques (..., wheels) N m."""
        wheels = self.wheel_axes.shape[1]
        attitude, rate, speed, eta, eta_rate = np.split(state, [4, 7, 7 + wheels, 8 + wheels], axis=-1)
        bent = (self._bent @ rate[..., None])[..., 0]  # J_1 omega
        momentum = (self.inertia @ rate[..., None] + self.wheel_inertia * self.wheel_axes @ speed[..., None])[..., 0] + eta * bent
        momentum = momentum + self.panels.mass[0, 1] * eta_rate * AXIS
        torque = -quaternion.cross(rate, momentum) - eta_rate * bent - (self.wheel_axes @ command[..., None])[..., 0]
        pull = 0.5 * np.sum(rate * bent, axis=-1, keepdims=True) - self.panels.stiffness[1, 1] * eta
        mass = np.broadcast_to(self._mass, (*state.shape[:-1], 4, 4)).copy()
        mass[..., :3, :3] += eta[..., None] * self._bent
        acceleration = np.linalg.solve(mass, np.concatenate([torque, pull], axis=-1)[..., None])[..., 0]
        spin = command / self.wheel_inertia - (self.wheel_axes.T @ acceleration[..., :3, None])[..., 0]
        kinematics = 0.5 * (quaternion.xi(attitude) @ rate[..., None])[..., 0]
        return np.concatenate([kinematics, acceleration[..., :3], spin, eta_rate, acceleration[..., 3:]], axis=-1)
