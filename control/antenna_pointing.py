"""Pointing an antenna about two axes by unfalsified control of each, the third axis being held."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from control.tracking import Decision, Estimate, Target
from control.unfalsified import Memory, UnfalsifiedController
from models.attitude import quaternion

Array = NDArray[np.floating]

AZIMUTH, ELEVATION, HELD = 2, 0, 1  # body axes
AXES = [AZIMUTH, ELEVATION]  # order of the channels


class Pointing(NamedTuple):
    """What is remembered."""

    channels: Memory  # (..., 2): azimuth, elevation
    late: Array  # (delay + 1, ..., 3) N m, torques that are still under way


@dataclass(frozen=True, eq=False)
class AntennaPointing:
    """Azimuth (body z) and elevation (body x) under unfalsified control, body y under a fixed PD (Tsao, Brozenec & Safonov, sec. 3).

    Angles are components of the rotation vector from N: slews are of a few degrees, so that axes hardly couple.

    Attributes:
      channels: the controllers of azimuth and elevation, as one.
      proportional: of the held axis, N m/rad.
      derivative: of the held axis, N m s/rad.
      delay_ticks: from a torque's decision to its command.
      theta: of the first controllers, (..., 2, 2), in place of those of `channels`: for each channel 1/C_p rad/(N m) and C_d/C_p s.
      integral: which integral action they have, whole numbers (..., 2), 0 for none; only of a law with candidates that have one.
    """

    channels: UnfalsifiedController
    proportional: float
    derivative: float
    delay_ticks: int = 0
    theta: Array | None = None
    integral: Array | None = None

    def start(self, estimate: Estimate) -> Pointing:
        """Angles are counted from the attitude at the start."""
        angle = quaternion.to_rotation_vector(estimate.q_BN)
        late = np.zeros((self.delay_ticks + 1, *angle.shape))
        memory = self.channels.start((*angle.shape[:-1], len(AXES)), angle[..., AXES])
        if self.theta is not None:
            unit = np.stack([self.channels.stiffness, np.full(len(AXES), self.channels.pace)], axis=-1)
            memory = memory._replace(theta=np.broadcast_to(self.theta * unit, memory.theta.shape))
        if self.integral is not None and memory.databank is not None:
            chosen = np.broadcast_to(self.integral.astype(np.int64), memory.databank.chosen.shape)
            memory = memory._replace(databank=memory.databank._replace(chosen=chosen))
        return Pointing(memory, late)

    def decide(self, estimate: Estimate, target: Target, memory: Pointing) -> Decision:
        """Torque on the body, (..., 3) N m in B."""
        angle, rate = quaternion.to_rotation_vector(estimate.q_BN), estimate.omega_BN_B
        wanted = quaternion.to_rotation_vector(target.q_DN)
        torque, channels, events = self.channels.step(memory.channels, wanted[..., AXES], angle[..., AXES], rate[..., AXES])
        held = self.proportional * (wanted[..., HELD] - angle[..., HELD]) - self.derivative * rate[..., HELD]
        torque_B = np.stack([torque[..., 1], held, torque[..., 0]], axis=-1)
        late = np.concatenate([memory.late[1:], torque_B[None]])
        proportional, derivative = self.channels.gains(memory.channels)
        notes: dict[str, Any] = {
            "theta": np.stack([1.0 / proportional, derivative / proportional], axis=-1),
            "score": events.score,
            "falsified": events.falsified,
            "switched": events.switched,
            "from_grid": events.from_grid,
        }
        if memory.channels.databank is not None:
            notes |= {
                "integral": memory.channels.databank.chosen,
                "integral_per_s": self.channels.integral(memory.channels),
                "asked": torque,
            }
        return Decision(late[0], Pointing(channels, late), notes)
