"""A control law and its allocation linearised: what they ask for by small deviations of what they are told."""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from control.allocation import Allocation
from control.tracking import Controller, Estimate, Memoryless, RememberingController, Target
from models.attitude import quaternion
from models.dynamics.state_layout import ATTITUDE, RATE, RATE_ERROR, ROTATION, WHEEL_ERRORS, WHEELS

Array = NDArray[np.floating]

_TURN, _RATE, _WHEEL = 1e-5, 1e-5, 1e-3  # rad, rad/s of the body and of a wheel: well inside a boundary layer
_FINER = 10.0
_SMOOTH = 1e-3  # by which slopes over the two distances may differ


class Switches(ValueError):
    """A law that has no slope at its operating point."""


def law_gain(law: Controller | RememberingController, point: Array, modes: Array | None = None, late_ticks: int = 0) -> Array:
    """Torque asked for by deviations from a state that is the target too, (3, 6 + wheels): of rotation, rate and wheel speeds.

    Args:
      law: memoryless, or slowly learning: its slope is that of its first decisions.
      point: [q_BN, omega_BN_B, wheel speeds], (7 + wheels,).
      modes: probabilities, (modes,); None: nobody estimates the mode.
      late_ticks: from a decision of the law to its torque.

    Raises:
      Switches: slopes over a small and a smaller distance differ, as they do where a law switches.
    """
    remembering = law if isinstance(law, RememberingController) else Memoryless(law)
    sizes = np.concatenate([np.full(3, _TURN), np.full(3, _RATE), np.full(len(point[WHEELS]), _WHEEL)])

    def torque(deviation: Array) -> Array:
        count = len(deviation)
        q_BN = quaternion.multiply(quaternion.from_rotation_vector(deviation[:, ROTATION]), point[ATTITUDE])
        wheels = point[WHEELS] + deviation[:, WHEEL_ERRORS]
        probable = None if modes is None else np.tile(modes, (count, 1))
        estimate = Estimate(q_BN, point[RATE] + deviation[:, RATE_ERROR], wheels, probable, q_BN)
        target = Target(*(np.tile(part, (count, 1)) for part in (point[ATTITUDE], point[RATE], np.zeros(3))))
        first = remembering.decide(estimate, target, remembering.start(estimate))
        return reduce(lambda before, _: remembering.decide(estimate, target, before.memory), range(late_ticks), first).torque_B

    return _slopes(torque, sizes)


def allocation_gain(allocation: Allocation, wheels: int, modes: Array | None = None) -> Array:
    """Torques of motors by a torque that is to act on the body, (wheels, 3), where no drive is at its limit."""

    def shared(torque_B: Array) -> Array:
        count = len(torque_B)
        probable = None if modes is None else np.tile(modes, (count, 1))
        estimate = Estimate(np.tile(quaternion.IDENTITY, (count, 1)), np.zeros((count, 3)), np.zeros((count, wheels)), probable)
        return allocation.step(torque_B, estimate, allocation.start((count,)))[0]

    return _slopes(shared, np.full(3, 1e-6))


def _slopes(function: Callable[[Array], Array], sizes: Array) -> Array:
    """Derivative of a function of (k, n), (m, n), by central differences over `sizes`, (n,); raises Switches."""
    near, far = (_central(function, size) for size in (sizes / _FINER, sizes))
    scale = np.max(np.abs(far * sizes), initial=0.0)
    if not np.all(np.abs((near - far) * sizes) <= _SMOOTH * scale):
        raise Switches("it switches, and has no slope there")
    return far


def _central(function: Callable[[Array], Array], sizes: Array) -> Array:
    steps = np.diag(sizes)
    values = function(np.vstack([steps, -steps]))
    ahead, behind = values[: len(sizes)], values[len(sizes) :]
    return ((ahead - behind) / (2.0 * sizes[:, None])).T
