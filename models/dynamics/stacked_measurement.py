"""Readings of several sensors as one, and models of a part of a longer reading."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from models.dynamics.measurement import AttitudeError, MeasurementModel

Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class PartOfReading:
    """A model of some components of a longer reading, the rest of which is none of the filter's business, such as known inputs.

    Attributes:
      measurement: model of those components.
      components: which, (m,).
    """

    measurement: MeasurementModel
    components: slice | Sequence[int]

    def of(self, reading: Array) -> Array:
        """Those components; (..., longer) to (..., m)."""
        return reading[..., self.components if isinstance(self.components, slice) else np.array(self.components)]

    @property
    def noise(self) -> Array:
        """R, (..., d, d)."""
        return self.measurement.noise

    @property
    def size(self) -> int:
        """Components that are taken."""
        return self.measurement.size

    def predict(self, state: Array) -> Array:
        """Of those components alone; (..., n) to (..., m)."""
        return self.measurement.predict(state)

    def residual(self, reading: Array, predicted: Array) -> Array:
        """Of the whole reading (..., longer) against those components (..., m); (..., d)."""
        return self.measurement.residual(self.of(reading), predicted)

    def jacobian(self, state: Array) -> Array:
        """Of those components; (..., n) to (..., d, n)."""
        return self.measurement.jacobian(state)

    def linear(self, errors: AttitudeError) -> Array | None:
        """Of those components; (d, e) or None."""
        return self.measurement.linear(errors)


@dataclass(frozen=True, eq=False)
class StackedMeasurement:
    """Several sensors, whose readings come one after another and whose errors are independent.

    Attributes:
      parts: models of the sensors.
    """

    parts: tuple[MeasurementModel, ...]

    @cached_property
    def noise(self) -> Array:
        """R, block diagonal, (..., d, d)."""
        blocks = [part.noise for part in self.parts]
        ends = np.cumsum([0, *(block.shape[-1] for block in blocks)])
        out = np.zeros((*np.broadcast_shapes(*(block.shape[:-2] for block in blocks)), ends[-1], ends[-1]))
        for block, (first, last) in zip(blocks, pairwise(ends), strict=True):
            out[..., first:last, first:last] = block
        return out

    @property
    def size(self) -> int:
        """Components of all readings."""
        return sum(part.size for part in self.parts)

    @cached_property
    def _places(self) -> list[slice]:
        """Of each sensor's components in a reading."""
        ends = np.cumsum([0, *(part.size for part in self.parts)])
        return [slice(int(first), int(last)) for first, last in pairwise(ends)]

    def predict(self, state: Array) -> Array:
        """All readings; (..., n) to (..., m)."""
        return np.concatenate([part.predict(state) for part in self.parts], axis=-1)

    def residual(self, reading: Array, predicted: Array) -> Array:
        """Each sensor's own; (..., m) twice to (..., d)."""
        pairs = zip(self.parts, self._places, strict=True)
        return np.concatenate([part.residual(reading[..., place], predicted[..., place]) for part, place in pairs], axis=-1)

    def jacobian(self, state: Array) -> Array:
        """Each sensor's own, one below another; (..., n) to (..., d, n)."""
        return np.concatenate([part.jacobian(state) for part in self.parts], axis=-2)

    def linear(self, errors: AttitudeError) -> Array | None:
        """Each sensor's own, one below another, (d, e); None as soon as one is not linear."""
        return self._rows[errors]

    @cached_property
    def _rows(self) -> dict[AttitudeError, Array | None]:
        counts: tuple[AttitudeError, ...] = get_args(AttitudeError)
        each = {errors: [part.linear(errors) for part in self.parts] for errors in counts}
        found = {errors: [part for part in rows if part is not None] for errors, rows in each.items()}
        return {errors: np.concatenate(rows) if len(rows) == len(self.parts) else None for errors, rows in found.items()}
