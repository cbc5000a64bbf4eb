"""Filters of one kind stepped as one: their beliefs share a leading axis and differ in noise and gain law alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimation.extended_kalman import ExtendedFilter, GainLaw
from estimation.gaussian import Detection, Innovation
from estimation.shared_reading import reads_alike, share

Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class StackedGain:
    """Gain laws of filters that are stacked along the first axis; each law sees its own slice.

    Attributes:
      laws: one law a filter.
    """

    laws: tuple[GainLaw, ...]

    def start(self, shape: tuple[int, ...]) -> Detection:
        """Memories of all laws, the first axis being the laws."""
        return _join([law.start(shape[1:]) for law in self.laws])

    def gain(self, innovation: Innovation, detection: Detection) -> tuple[Array, Detection]:
        """Each law's gain for its slice."""
        gains, detections = [], []
        for i, law in enumerate(self.laws):
            own = Detection(detection.statistic[i], detection.declared[i], (detection.history[i],))
            seen = Innovation(*(part[i] for part in innovation[:5]))
            if innovation.sensitivity is not None:
                seen = seen._replace(sensitivity=innovation.sensitivity[i])
            gain, after = law.gain(seen, own)
            gains.append(gain)
            detections.append(after)
        return np.stack(gains), _join(detections)


def _join(detections: list[Detection]) -> Detection:
    return Detection(
        np.stack([d.statistic for d in detections]),
        np.stack([d.declared for d in detections]),
        tuple(d.history[0] for d in detections),
    )


def stackable(left: ExtendedFilter, right: ExtendedFilter) -> bool:
    """Whether two filters share models, coordinates and discretisation, so that only noise and gain tell them apart."""
    same_models = left.process is right.process and reads_alike(left.measurement, right.measurement)
    return same_models and type(left.space) is type(right.space) and left.prediction is right.prediction


def stack(filters: list[ExtendedFilter]) -> ExtendedFilter:
    """One filter that steps all of `filters` (mutually stackable); beliefs are (filters, trials, ...)."""
    first = filters[0]
    measured = [f.measurement for f in filters if f.measurement is not None]
    prior = np.broadcast_to(first.prior, (len(filters), 1, *first.prior.shape[-1:])) if measured else first.prior
    return ExtendedFilter(
        process=first.process,
        process_noise=np.stack([f.process_noise for f in filters])[:, None],
        process_noise_before=np.stack([f.process_noise_before + 0.0 * f.process_noise for f in filters])[:, None],
        measurement_noise=None if measured else np.stack([f.measurement_model.noise for f in filters])[:, None],
        prior=prior,
        prior_variance=first.prior_variance,
        gain=StackedGain(tuple(f.gain for f in filters)),
        space=first.space,
        prediction=first.prediction,
        measurement=share(measured, lambda noises: np.stack(noises)[:, None]) if measured else None,
    )
