"""Rigid body with reaction wheels: the analytic model in eleven states that the NACS filters and controllers believe in."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from models.attitude import quaternion
from models.dynamics.process import Held, Linearization
from models.dynamics.state_layout import ATTITUDE, RATE, WHEELS
from models.dynamics.wheel_drag import WheelDrag
from models.dynamics.wheel_faults import WheelFault

Array = NDArray[np.floating]

MOVING = slice(RATE.start, None)  # rates and wheel speeds
DRAG_SMOOTHING = 1.0  # rad/s over which the model's dry friction changes sign, so that it can be differentiated


@dataclass(frozen=True, eq=False)
class WheeledBody:
    """Attitude, body rate and wheel speeds, [q_BN, omega_BN_B, omega_wheel], driven by the torques of the wheel motors.

    dq/dt = Xi(q) omega / 2, J domega/dt = L - W tau - omega x (J omega + W J_w omega_w), J_w domega_w/dt = tau - J_w W' domega/dt
    (McCafferty-Leroux et al. 2024, eq. 1, 9, 10; Markley & Crassidis 2014, eq. 3.20, 3.147). The paper's u is W tau, the torque that
    the motors exert on the wheels: the body feels -u. Its eq. 24 prints the gyroscopic term with a plus, which would turn the momentum
    that must stay fixed in N; its eq. 10 leaves out the rate coupling W' domega/dt.

    Attributes:
      inertia: J of the whole with wheels locked, about the centre of rotation, (3, 3) kg m2. Any positive tensor is accepted.
      wheel_axes: W, (3, wheels) unit columns.
      wheel_inertia: J_w about the spin axis, kg m2.
      coupled: keep the rate coupling that eq. 10 neglects; exact for balanced wheels.
      gyroscopic_sign: -1 by physics, +1 as eq. 24 is printed.
      wheel_coulomb: dry friction of a wheel's bearing, N m; the paper has none. Over a step it is solved in closed form (`WheelDrag`), so
        that a wheel stops and sticks; in `derivative` it is smoothed over `DRAG_SMOOTHING`.
      wheel_viscous: viscous friction of a wheel's bearing, N m s/rad; the paper has none.
      fault: what the motors make of their commands (Hill et al. 2021, eq. 12); None: as they are told.
    """

    inertia: Array
    wheel_axes: Array
    wheel_inertia: float
    coupled: bool = False
    gyroscopic_sign: float = -1.0
    wheel_coulomb: float = 0.0
    wheel_viscous: float = 0.0
    fault: WheelFault | None = None

    turns: ClassVar[bool] = True

    @property
    def size(self) -> int:
        """Number of states."""
        return 7 + self.wheel_axes.shape[1]

    @cached_property
    def _body_inverse(self) -> Array:
        """Inverse of what resists the body's angular acceleration: without the spinning part of the wheels if they are free."""
        spinning = self.wheel_inertia * self.wheel_axes @ self.wheel_axes.T if self.coupled else 0.0
        return np.linalg.inv(self.inertia - spinning)

    @cached_property
    def _input(self) -> Array:
        """Constant input matrix, (n, wheels): dx/dt per N m of wheel torque."""
        body = -self._body_inverse @ self.wheel_axes
        wheel = np.eye(self.wheel_axes.shape[1]) / self.wheel_inertia
        if self.coupled:
            wheel = wheel - self.wheel_axes.T @ body
        return np.concatenate([np.zeros((4, wheel.shape[1])), body, wheel])

    @cached_property
    def smooth(self) -> WheeledBody:
        """The body without friction, which is stiff."""
        return replace(self, wheel_coulomb=0.0, wheel_viscous=0.0) if self.wheel_coulomb or self.wheel_viscous else self

    @cached_property
    def _drag(self) -> WheelDrag:
        return WheelDrag(self.wheel_coulomb, self.wheel_viscous, np.diagonal(self._input[WHEELS]))

    def held(self, state: Array, slope: Array, dt: float, jacobian: Array | None = None) -> Held:
        """Friction over `dt` seconds, as the mean of its part of dx/dt (..., n), if all else begins with `slope` (..., n).

        Where the `jacobian` of that slope is given, (..., n, n), also how the mean changes with rates and wheel speeds.
        """
        drag = self._drag.over(state[..., WHEELS], slope[..., WHEELS], dt)
        mean = -(self._input @ drag.torque[..., None])[..., 0]
        if jacobian is None:
            return Held(mean, np.empty((self.size, 0)), MOVING)
        by_state = drag.by_acceleration[..., None] * jacobian[..., WHEELS, MOVING]
        by_state[..., 3:] += drag.by_speed[..., None] * np.eye(drag.by_speed.shape[-1])
        return Held(mean, -self._input @ by_state, MOVING)

    def drift(self, state: Array) -> Array:
        """dx/dt without command, written as in the textbook; (..., n) to (..., n)."""
        attitude, rate, speed = state[..., ATTITUDE], state[..., RATE], state[..., WHEELS]
        momentum = (self.inertia @ rate[..., None] + self.wheel_inertia * self.wheel_axes @ speed[..., None])[..., 0]
        kinematics = 0.5 * (quaternion.xi(attitude) @ rate[..., None])[..., 0]
        torque = self.gyroscopic_sign * quaternion.cross(rate, momentum)
        body = (self._body_inverse @ torque[..., None])[..., 0]
        wheel = -(self.wheel_axes.T @ body[..., None])[..., 0] if self.coupled else np.zeros_like(speed)
        return np.concatenate([kinematics, body, wheel], axis=-1)

    @cached_property
    def _curvature(self) -> Array:
        """Constant second derivatives of the drift, (n n, n): it is purely quadratic, so polarisation finds them exactly."""
        unit = np.eye(self.size)
        single = self.drift(unit)
        pairs = self.drift(unit[:, None, :] + unit[None, :, :]) - single[:, None, :] - single[None, :, :]
        return np.ascontiguousarray(np.moveaxis(pairs, -1, 0).reshape(self.size**2, self.size))

    def linearize(self, state: Array, command: Array) -> Linearization:
        """dx/dt and its Jacobian; state (..., n), command: wheel torques (..., wheels) N m.

        The drift is quadratic, so its Jacobian is linear in the state and the drift itself is half the Jacobian times the state
        (Euler's theorem on homogeneous functions): one product with a constant tensor gives both.
        """
        jacobian = (self._curvature @ state[..., None]).reshape(*state.shape, self.size)
        torque = command if self.fault is None else self.fault.act(command)
        dragging = self.wheel_coulomb or self.wheel_viscous
        if dragging:
            direction = np.tanh(state[..., WHEELS] / DRAG_SMOOTHING)
            torque = torque - self.wheel_coulomb * direction - self.wheel_viscous * state[..., WHEELS]
        derivative = (jacobian @ (0.5 * state[..., None]) + self._input @ torque[..., None])[..., 0]
        if dragging:
            slope = self.wheel_coulomb / DRAG_SMOOTHING * (1.0 - direction**2) + self.wheel_viscous
            jacobian[..., WHEELS] -= self._input * slope[..., None, :]
        return Linearization(derivative, jacobian)

    def derivative(self, state: Array, command: Array) -> Array:
        """dx/dt; state (..., n), command: wheel torques (..., wheels) N m."""
        return self.linearize(state, command).derivative

    def momentum(self, state: Array) -> Array:
        """Total angular momentum about the centre of rotation in B, N m s; (..., n) to (..., 3) (eq. 8)."""
        return (self.inertia @ state[..., 4:7, None] + self.wheel_inertia * self.wheel_axes @ state[..., 7:, None])[..., 0]
