"""A limit on what a control law may ask of the actuators."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from control.tracking import Controller, Estimate, Target

Array = NDArray[np.floating]


@dataclass(frozen=True)
class AxisLimited:
    """A law whose torque is cut off about each body axis by itself, so that a large demand changes its direction too.

    Reading of T_c,max in Hill et al. (2021, sec. IV), where it is the "maximum torque of each wheel": table 2 has an RMS of 1.00 N m
    about each body axis for the switching law. Wheels cut off one by one would leave nothing about the pyramid's own axis.

    Attributes:
      law: any control law.
      limit: N m about each body axis.
    """

    law: Controller
    limit: float

    def step(self, estimate: Estimate, target: Target) -> Array:
        """Torque on the body, (..., 3) N m in B."""
        return np.clip(self.law.step(estimate, target), -self.limit, self.limit)
