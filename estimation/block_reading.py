"""A reading of a state in two blocks, one of particles and one of Gaussians: linear in both, or linearised at every particle."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.dynamics.measurement import MeasurementModel

Array = NDArray[np.floating]
Flags = NDArray[np.bool_]

Block = Literal["sampled", "conditional", "both"]  # both: the sampled one first


class BlockReading(NamedTuple):
    """A reading z = H_s s + H_c c + v, with nothing of what is missing left in it."""

    value: Array  # (..., particles or 1, d) zero where missing
    missing: Flags  # (..., 1, d)
    by_sampled: Array  # H_s, (..., particles or 1, d, s)
    by_conditional: Array | None  # H_c, (..., particles or 1, d, c); None: zero
    noise: Array  # R, (..., 1, d, d)


def linear_reading(reading: Array, by_sampled: Array, by_conditional: Array | None, noise: Array) -> BlockReading:
    """A reading (..., d) by H_s (d, s), H_c (d, c) or None, and R (d, d)."""
    missing = np.isnan(reading)[..., None, :]
    seen = ~missing[..., None]
    value = np.nan_to_num(reading, nan=0.0)[..., None, :]
    by_sampled, by_conditional = seen * by_sampled, None if by_conditional is None else seen * by_conditional
    return BlockReading(value, missing, by_sampled, by_conditional, _of_seen(noise, seen))


def linearised_reading(reading: Array, measurement: MeasurementModel, block: Block, sampled: Array, conditional: Array) -> BlockReading:
    """A reading (..., m) linearised at both blocks, (..., particles, s) and (..., particles, c); `measurement` is of `block`."""
    state = {"sampled": sampled, "conditional": conditional}.get(block)
    if state is None:
        state = np.concatenate([sampled, np.broadcast_to(conditional, (*sampled.shape[:-1], conditional.shape[-1]))], axis=-1)
    residual = measurement.residual(reading[..., None, :], measurement.predict(state))
    missing = np.isnan(residual[..., :1, :])  # of all particles alike
    seen = ~missing[..., None]
    rows = seen * measurement.jacobian(state)
    value = np.where(missing, 0.0, residual) + (rows @ state[..., None])[..., 0]
    size = sampled.shape[-1]
    by_sampled = rows[..., :size] if block != "conditional" else np.zeros((*rows.shape[:-1], size))
    by_conditional = {"sampled": None, "conditional": rows}.get(block, rows[..., size:])
    return BlockReading(value, missing, by_sampled, by_conditional, _of_seen(measurement.noise, seen))


def _of_seen(noise: Array, seen: Flags) -> Array:
    """R of what is seen, unit variance elsewhere; (..., 1, d, d)."""
    return np.where(seen & seen.swapaxes(-1, -2), noise, np.eye(noise.shape[-1]))
