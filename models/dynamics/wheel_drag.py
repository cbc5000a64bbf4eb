"""Friction of wheels' bearings over a whole step: its mean torque in closed form, so that a wheel stops and sticks at any step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]


class MeanDrag(NamedTuple):
    """Torque against which wheels turn, on average over a step, and how it changes with what it was found from."""

    torque: Array  # (..., wheels) N m
    by_speed: Array  # (..., wheels) N m s
    by_acceleration: Array  # (..., wheels) N m s2


@dataclass(frozen=True, eq=False)
class WheelDrag:
    """Dry and viscous friction, J_w domega_w/dt = J_w a - c sign(omega_w) - v omega_w, where a wheel at rest sticks while J_w |a| <= c.

    Attributes:
      coulomb: c, N m.
      viscous: v, N m s/rad.
      response: acceleration of a wheel by a torque on it, about 1 / J_w, (wheels,) rad/s2 per N m.
    """

    coulomb: float
    viscous: float
    response: Array

    def over(self, speed: Array, acceleration: Array, dt: float) -> MeanDrag:
        """Mean torque over `dt` seconds in which all else gives a constant acceleration.

        Each wheel's motion is solved exactly: it turns until it comes to rest, and from there on turns the other way or stays (the time
        that is left then is counted without viscous friction's second order).

        Args:
          speed: at first, (..., wheels) rad/s.
          acceleration: without friction, (..., wheels) rad/s2.
          dt: step, s.
        """
        dry, decay = self.coulomb * self.response, self.viscous * self.response
        lasting = dt * np.where(decay > 0.0, -np.expm1(-decay * dt) / np.maximum(decay * dt, 1e-300), 1.0)
        sense = np.where(speed == 0.0, np.sign(acceleration), np.sign(speed))
        first = acceleration - decay * speed - dry * sense
        end, by_speed, by_acceleration = speed + first * lasting, 1.0 - decay * lasting, lasting
        stops = end * sense <= 0.0
        if stops.any():
            slope = np.where(stops & (first != 0.0), first, 1.0)
            spent = -speed / slope
            beyond = np.sign(acceleration) * np.maximum(np.abs(acceleration) - dry, 0.0)
            end = np.where(stops, beyond * (lasting - spent), end)
            by_speed = np.where(stops, beyond * (1.0 - decay * spent) / slope, by_speed)
            by_acceleration = np.where(stops, (beyond != 0.0) * (lasting - spent) + beyond * spent / slope, by_acceleration)
        share = 1.0 / (self.response * dt)
        return MeanDrag(share * (speed + acceleration * dt - end), share * (1.0 - by_speed), share * (dt - by_acceleration))
