"""Faults of reaction wheels as a filter may believe in them: what torque a motor gives instead of the commanded one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]

SINGULAR = 1e-9  # relative singular value below which an axis counts as lost


class BodyTorque(NamedTuple):
    """How motor commands act on the body."""

    torque_map: Array  # (..., 3, wheels) N m on the body in B per N m commanded to a motor
    constant_torque_B: Array  # (..., 3) N m, whatever is commanded


class WheelFault(NamedTuple):
    """T_a = T_c + sigma (T_i - T_c): actuated, commanded and failed torque of each motor on its wheel (Hill et al. 2021, eq. 12).

    Torques are the motors' on their wheels, as everywhere here; the paper's act on the body: equal but for the sign of T_i. Leading axes,
    such as fault modes, broadcast with those of commands.
    """

    indicator: Array  # sigma, (..., wheels): 0 healthy, 1 deaf to commands, between them weak
    torque: Array  # T_i, (..., wheels) N m

    @classmethod
    def healthy(cls, wheels: int) -> Self:
        """Every motor does as it is told."""
        return cls(np.zeros(wheels), np.zeros(wheels))

    @classmethod
    def floating(cls, wheels: int, *failed: int) -> Self:
        """Wheels number `failed`, from 1, have no power and coast: sigma = 1, T_i = 0."""
        return cls.stuck(wheels, *failed, torque=0.0)

    @classmethod
    def stuck(cls, wheels: int, *failed: int, torque: float) -> Self:
        """Motors give a constant torque, N m, whatever they are told: sigma = 1; with the drive's limit a hard-over."""
        indicator = _chosen(wheels, failed)
        return cls(indicator, torque * indicator)

    @classmethod
    def partial(cls, wheels: int, *failed: int, remaining: float) -> Self:
        """Motors give only a share of what they are told: sigma = 1 - remaining, T_i = 0."""
        return cls((1.0 - remaining) * _chosen(wheels, failed), np.zeros(wheels))

    @classmethod
    def locked(cls, wheels: int, *failed: int) -> Self:
        """Seized wheels as a model of the body's motion sees them: as floating ones.

        Bearing and motor work between wheel and body; once the wheel has given up its momentum and turns with the body, none is
        exchanged whatever the motor does. The exchange itself, over within moments, is not in this model.
        """
        return cls.floating(wheels, *failed)

    def act(self, command: Array) -> Array:
        """T_a, (..., wheels) N m, of commanded T_c (..., wheels) N m."""
        return command + self.indicator * (self.torque - command)

    def on_body(self, wheel_axes: Array) -> BodyTorque:
        """-W (I - sigma) per command, -W sigma T_i besides: the body feels minus what the wheels do; wheel_axes W (3, wheels)."""
        given = -wheel_axes * (1.0 - self.indicator)[..., None, :]
        failed = -(wheel_axes @ (self.indicator * self.torque)[..., None])[..., 0]
        return BodyTorque(given + 0.0, failed + 0.0)  # no negative zeros


def _chosen(wheels: int, failed: tuple[int, ...]) -> Array:
    """1 for the wheels of these numbers, from 1, else 0; raises ValueError for a number that no wheel has."""
    for number in failed:
        if not 1 <= number <= wheels:
            raise ValueError(f"no wheel {number} among {wheels}; they count from 1")
    return np.isin(np.arange(1, wheels + 1), failed).astype(float)


def stack(faults: Sequence[WheelFault], batch_axes: int = 0) -> WheelFault:
    """Fault modes as one fault with a leading axis of modes, before as many axes of length 1 as states have batch axes."""
    shape = (len(faults), *[1] * batch_axes, -1)
    return WheelFault(*(np.stack(part).reshape(shape) for part in zip(*faults, strict=True)))


def lost_axis(wheel_axes: Array, fault: WheelFault) -> Array | None:
    """Unit vector in B about which no commanded torque is left, (3,), or None; wheel_axes (3, wheels), fault without leading axes.

    The left null space of W (I - sigma); a least-squares allocation leaves exactly this component out. Of several lost axes one is given.
    """
    axes, strength, _ = np.linalg.svd(fault.on_body(wheel_axes).torque_map)
    if strength[-1] > SINGULAR * np.linalg.norm(wheel_axes):
        return None
    axis: Array = axes[:, -1]
    return axis * np.sign(axis[np.argmax(np.abs(axis))])
