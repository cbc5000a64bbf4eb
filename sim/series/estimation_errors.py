"""How far estimates are from what they are held against, block by block of the state."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from models.attitude import quaternion
from models.dynamics.state_layout import Block

Array = NDArray[np.floating]


def unit_of_error(block: Block) -> str:
    """A thousandth of the block's unit; of a quaternion an angle."""
    if len(block.names) > block.errors:
        return "mdeg"
    return "1e-3" if block.unit == "1" else f"1e-3 {block.unit}" if block.unit.startswith("1") else f"m{block.unit}"


def error_of_block(mean: Array, target: Array, block: Block, place: slice) -> Array:
    """Angle or length of the difference in thousandths, RMS over agents; NaN where mean or target does not have the block.

    Args:
      mean: (ticks, [agents,] n).
      target: what it is held against, (ticks, [agents,] m).
      block: of the state.
      place: its components.

    Returns:
      (ticks,).
    """
    if min(mean.shape[-1], target.shape[-1]) < place.stop:
        return np.full(len(mean), np.nan)
    if len(block.names) > block.errors:
        apart = 1e3 * np.degrees(quaternion.angle(mean[..., place], target[..., place]))
    else:
        apart = 1e3 * np.linalg.norm(mean[..., place] - target[..., place], axis=-1)
    return np.sqrt(np.mean(apart.reshape(len(apart), -1) ** 2, axis=-1))
