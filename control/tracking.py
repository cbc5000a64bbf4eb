"""What a tracking law is told, and how far the body is from where it should be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from models.attitude import quaternion

Array = NDArray[np.floating]


class Estimate(NamedTuple):
    """The state that a control law acts on; leading axes: trial, agent, ..."""

    q_BN: Array  # (..., 4)
    omega_BN_B: Array  # (..., 3) rad/s
    omega_wheel: Array  # (..., wheels) rad/s
    mode_probabilities: Array | None = None  # (..., modes), the healthy one first; None: nobody estimates the mode
    q_read: Array | None = None  # (..., 4) what the observer last read, NaN if nothing; None: no observer gives the state
    learned_torque_B: Array | None = None  # (..., 3) N m on the body that no model has; None: nobody has learned it


class Target(NamedTuple):
    """A frame D to be followed, with its rate and acceleration relative to N."""

    q_DN: Array  # (..., 4)
    omega_DN_D: Array  # (..., 3) rad/s
    alpha_DN_D: Array  # (..., 3) rad/s2


@runtime_checkable
class Controller(Protocol):
    """A control law: frozen settings and one method."""

    def step(self, estimate: Estimate, target: Target) -> Array:
        """Torque on the body, (..., 3) N m in B."""
        ...


class Decision(NamedTuple):
    """What a law with a memory decides at a tick."""

    torque_B: Array  # (..., 3) N m in B
    memory: Any  # after it
    notes: dict[str, Array]  # what is worth recording besides


@runtime_checkable
class RememberingController(Protocol):
    """A control law that learns: its memory is handed in and out."""

    def start(self, estimate: Estimate) -> Any:
        """Memory before the first tick, whose estimate it is."""
        ...

    def decide(self, estimate: Estimate, target: Target, memory: Any) -> Decision:
        """Torque on the body, and what is remembered."""
        ...


@dataclass(frozen=True)
class Memoryless:
    """A law without memory where one with a memory is expected."""

    law: Controller

    def start(self, estimate: Estimate) -> None:
        """Nothing."""

    def decide(self, estimate: Estimate, target: Target, memory: Any) -> Decision:
        """The law's torque."""
        return Decision(self.law.step(estimate, target), memory, {})


class TrackingError(NamedTuple):
    """The body relative to the frame that it should follow."""

    dq: Array  # (..., 4) q * q_d^-1, with a scalar part that is not negative
    rotation: Array  # (..., 3, 3) A(dq), which maps D to B
    rate: Array  # (..., 3) rad/s in B


def tracking_error(estimate: Estimate, target: Target) -> TrackingError:
    """Error quaternion and rate (Hill et al. 2021, eq. 13-15; Markley & Crassidis 2014, eq. 7.1, 7.11)."""
    dq = quaternion.multiply(estimate.q_BN, quaternion.inverse(target.q_DN))
    dq = dq * np.where(dq[..., 3:] < 0.0, -1.0, 1.0)
    rotation = quaternion.attitude_matrix(dq)
    return TrackingError(dq, rotation, estimate.omega_BN_B - (rotation @ target.omega_DN_D[..., None])[..., 0])
