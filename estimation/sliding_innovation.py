"""Sliding innovation filter: a gain that switches on the size of the innovation and needs no covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimation.gaussian import Detection, Innovation

Array = NDArray[np.floating]

LEAST_SINGULAR = 1e-9  # value of C relative to the greatest, below which a direction counts as not read


def sliding_gain(residual: Array, boundary_layer: Array, sensitivity: Array | None = None) -> Array:
    """K = C^+ diag(sat(|innovation| / delta)) (Gadsden & Al-Shabi 2020, eq. 8; McCafferty-Leroux et al. 2024, eq. 18).

    Inside the boundary layer the gain grows with the innovation; outside it is one and the estimate becomes the reading. What no reading
    says anything of is not corrected, since C^+ knows of no correlation.

    Args:
      residual: (..., d), zero where the reading is missing.
      boundary_layer: delta, (d,), in the units of the residual.
      sensitivity: C, (..., d, e), rows of zeros where the reading is missing; None: the unit matrix.

    Returns:
      (..., e, d).
    """
    share = np.minimum(np.abs(residual) / boundary_layer, 1.0)
    if sensitivity is None:
        return share[..., None] * np.eye(share.shape[-1])
    return np.linalg.pinv(sensitivity, rcond=LEAST_SINGULAR) * share[..., None, :]


@dataclass(frozen=True, eq=False)
class SlidingGain:
    """The extended sliding innovation filter's gain at every reading; declares no faults.

    Attributes:
      boundary_layer: delta, (d,), in the units of the residual.
    """

    boundary_layer: Array

    def start(self, shape: tuple[int, ...]) -> Detection:
        """Empty memory."""
        return Detection(np.zeros(shape), np.zeros(shape, dtype=bool), (np.zeros((*shape, 0)),))

    def gain(self, innovation: Innovation, detection: Detection) -> tuple[Array, Detection]:
        """Saturated gain, blind to the covariance."""
        return sliding_gain(innovation.residual, self.boundary_layer, innovation.sensitivity), detection._replace(statistic=innovation.nis)
