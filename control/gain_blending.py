"""Gains tuned for each mode of a system, mixed by how probable the modes are."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.floating]


def blend(gains: ArrayLike, probabilities: Array | None) -> Array:
    """K_mu = sum_i mu_i K_i (Hill et al. 2021, eq. 28, 33, 34, 36, 40).

    Args:
      gains: one K_i a mode along the first axis, (modes, ...); a number is the gain of every mode.
      probabilities: mu, (..., modes); None if nobody estimates the mode: the first one, healthy, is taken for certain.

    Returns:
      The batch axes of `probabilities`, then the axes of one K_i.

    Raises:
      ValueError: if the gains are not one a mode.
    """
    each = np.asarray(gains, dtype=float)
    if each.ndim == 0:
        return each
    if probabilities is None:
        return each[0]
    modes = probabilities.shape[-1]
    if len(each) != modes:
        raise ValueError(f"gains for {len(each)} modes, probabilities of {modes}: a law needs one gain a mode, or one number for all")
    columns = np.ascontiguousarray(each.reshape(modes, -1).T)  # (entries, modes)
    mixed = np.sum(np.ascontiguousarray(probabilities)[..., None, :] * columns, axis=-1)  # no BLAS: the same bits whatever the batch
    return mixed.reshape((*probabilities.shape[:-1], *each.shape[1:]))
