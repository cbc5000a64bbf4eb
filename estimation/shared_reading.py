"""Measurement models that read the same and differ in their noise alone, as one model with a batch axis."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from models.dynamics.direction_measurement import DirectionMeasurement
from models.dynamics.measurement import MeasurementModel, PartOfState, WholeState
from models.dynamics.stacked_measurement import PartOfReading, StackedMeasurement

Array = NDArray[np.floating]


def reads_alike(one: MeasurementModel | None, other: MeasurementModel | None) -> bool:
    """Whether two models differ in their noise alone; None is the whole state. Of models that are not known here: whether they are one."""
    if one is other:
        return True
    match one, other:
        case WholeState(), WholeState():
            return one.attitude == other.attitude
        case PartOfState(), PartOfState():
            same = list(one.components) == list(other.components) and one.states == other.states
            return same and one.attitude == other.attitude
        case DirectionMeasurement(), DirectionMeasurement():
            return np.array_equal(one.direction_N, other.direction_N)
        case PartOfReading(), PartOfReading():
            return one.components == other.components and reads_alike(one.measurement, other.measurement)
        case StackedMeasurement(), StackedMeasurement():
            return len(one.parts) == len(other.parts) and all(reads_alike(*pair) for pair in zip(one.parts, other.parts, strict=True))
    return False


def share(models: Sequence[MeasurementModel], combine: Callable[[list[Array]], Array]) -> MeasurementModel:
    """One model of all (mutually alike); `combine` makes one R of theirs. Models that are not known here share the R that they have."""
    first = models[0]
    match first:
        case WholeState() | PartOfState() | DirectionMeasurement():
            return replace(first, noise=combine([one.noise for one in models]))
        case PartOfReading():
            return replace(first, measurement=share([cast(PartOfReading, one).measurement for one in models], combine))
        case StackedMeasurement():
            rows = zip(*(cast(StackedMeasurement, one).parts for one in models), strict=True)
            return StackedMeasurement(tuple(share(row, combine) for row in rows))
    return first
