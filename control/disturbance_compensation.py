"""Compensation of a known disturbance: a control law that subtracts the torque which somebody has learned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from control.tracking import Controller, Estimate, Target

Array = NDArray[np.floating]


@dataclass(frozen=True)
class DisturbanceCompensation:
    """torque_B = law - W phi: what the network says of the unmodelled torque is fed forward (as Rososhansky 2017, eq. 5.17, first term).

    Attributes:
      law: any control law.
    """

    law: Controller

    def step(self, estimate: Estimate, target: Target) -> Array:
        """Torque on the body, (..., 3) N m in B.

        Raises:
          ValueError: nobody has learned a torque.
        """
        if estimate.learned_torque_B is None:
            raise ValueError("compensation needs an estimate with a learned torque")
        return self.law.step(estimate, target) - estimate.learned_torque_B
