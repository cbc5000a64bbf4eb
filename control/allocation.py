"""Sharing a body torque among wheels."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from control.tracking import Estimate

Array = NDArray[np.floating]


class Allocation(Protocol):
    """A way of sharing: frozen settings, and a memory that is handed in and out."""

    def start(self, shape: tuple[int, ...]) -> Array:
        """Memory before the first tick, (*shape, ...) for batch axes `shape`."""
        ...

    def step(self, torque_B: Array, estimate: Estimate, memory: Array) -> tuple[Array, Array]:
        """Torque of each motor on its wheel, (..., wheels) N m, and the memory after it; torque_B (..., 3) N m."""
        ...

    def notes(self, memory: Array) -> dict[str, Array]:
        """What is worth recording of the memory, by name, (...,)."""
        ...


@dataclass(frozen=True, eq=False)
class PseudoInverseAllocation:
    """Least-squares wheel torques, tau = -W^+ torque_B: the wheels take up what the body is to be given.

    McCafferty-Leroux et al. (2024, eq. 10) with u = W tau = -torque_B; Markley & Crassidis (2014, eq. 7.157). A demand beyond the
    drives' limit is scaled as a whole, so that its direction is kept.

    Attributes:
      wheel_axes: W, (3, wheels).
      torque_limit: N m a wheel.
    """

    wheel_axes: Array
    torque_limit: float

    @cached_property
    def _inverse(self) -> Array:
        return np.linalg.pinv(self.wheel_axes)

    def start(self, shape: tuple[int, ...]) -> Array:
        """Nothing is remembered, (*shape, 0)."""
        return np.zeros((*shape, 0))

    def step(self, torque_B: Array, estimate: Estimate, memory: Array) -> tuple[Array, Array]:  # noqa: ARG002
        """Torque of each motor on its wheel, (..., wheels) N m; torque_B (..., 3) N m; estimate and memory are not used."""
        return scaled(-(self._inverse @ torque_B[..., None])[..., 0], self.torque_limit), memory

    def notes(self, memory: Array) -> dict[str, Array]:  # noqa: ARG002
        """Nothing."""
        return {}


class DirectTorque:
    """No sharing: torques act on the body itself, one about each axis."""

    def start(self, shape: tuple[int, ...]) -> Array:
        """Nothing is remembered, (*shape, 0)."""
        return np.zeros((*shape, 0))

    def step(self, torque_B: Array, estimate: Estimate, memory: Array) -> tuple[Array, Array]:  # noqa: ARG002
        """The torque on the body as it is, (..., 3) N m; estimate and memory are not used."""
        return torque_B, memory

    def notes(self, memory: Array) -> dict[str, Array]:  # noqa: ARG002
        """Nothing."""
        return {}


def scaled(wheel_torque: Array, limit: float) -> Array:
    """Torques (..., wheels), scaled as a whole where one of them would exceed `limit`, N m."""
    peak = np.max(np.abs(wheel_torque), axis=-1, keepdims=True, initial=0.0)
    return wheel_torque * np.minimum(1.0, limit / np.maximum(peak, 1e-300))
