"""Filters of several modes as one: models side by side, beliefs with an axis of modes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimation.extended_kalman import ExtendedFilter, KalmanGain
from estimation.gaussian import Belief, Detection
from estimation.shared_reading import reads_alike, share
from estimation.unscented import UnscentedFilter
from models.dynamics.process import Prediction, ProcessModel

Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class IntegrateEach:
    """Discretisation of several models, each moving its own slice of sigma points.

    Attributes:
      integrate: that of one model.
      processes: one a mode.
    """

    integrate: Callable[[ProcessModel, Array, Array, float], Array]
    processes: tuple[ProcessModel, ...]

    def __call__(self, process: ProcessModel, state: Array, command: Array, dt: float) -> Array:
        """States (..., modes, points, n) after `dt` seconds of command (..., 1, 1, r); `process` is not asked."""
        told = command[..., 0, :, :]
        return np.stack([self.integrate(one, state[..., i, :, :], told, dt) for i, one in enumerate(self.processes)], axis=-3)


@dataclass(frozen=True, eq=False)
class PredictEach:
    """Discretisation of several models with their transition matrices, each moving its own state.

    Attributes:
      prediction: that of one model.
      processes: one a mode.
    """

    prediction: Callable[[ProcessModel, Array, Array, float], Prediction]
    processes: tuple[ProcessModel, ...]

    def __call__(self, process: ProcessModel, state: Array, command: Array, dt: float) -> Prediction:
        """States (..., modes, n) after `dt` seconds of command (..., 1, r), and their sensitivities; `process` is not asked."""
        told = command[..., 0, :]
        each = [self.prediction(one, state[..., i, :], told, dt) for i, one in enumerate(self.processes)]
        return Prediction(np.stack([ahead.state for ahead in each], axis=-2), np.stack([ahead.transition for ahead in each], axis=-3))


def stacked(filters: Sequence[object]) -> ExtendedFilter | UnscentedFilter | None:
    """One filter whose beliefs are (..., modes), or None if the filters differ in more than process model, noise and prior."""
    unscented = [one for one in filters if isinstance(one, UnscentedFilter)]
    if len(unscented) == len(filters) and len({(type(one.space), one.points, one.integrate) for one in unscented}) == 1:
        sampled = unscented[0]
        models = tuple(one.process for one in unscented)
        if all(reads_alike(sampled.measurement, one.measurement) for one in unscented):
            return replace(sampled, integrate=IntegrateEach(sampled.integrate, models), **_noises(unscented))
    extended = [one for one in filters if isinstance(one, ExtendedFilter)]
    if len(extended) == len(filters) and len({(type(one.space), type(one.gain), one.prediction) for one in extended}) == 1:
        linearized = extended[0]
        models = tuple(one.process for one in extended)
        alike = all(reads_alike(linearized.measurement, one.measurement) for one in extended)
        if alike and isinstance(linearized.gain, KalmanGain):  # other laws have settings and memories of their own
            return replace(linearized, prediction=PredictEach(linearized.prediction, models), **_noises(extended))
    return None


def _noises(filters: Sequence[ExtendedFilter] | Sequence[UnscentedFilter]) -> dict[str, Any]:
    """Noise and prior of every mode, the modes being the last batch axis."""

    def side_by_side(noises: list[Array]) -> Array:
        return np.stack(np.broadcast_arrays(*noises), axis=-3)

    measured = [one.measurement for one in filters if one.measurement is not None]
    return {
        "process_noise": side_by_side([one.process_noise for one in filters]),
        "process_noise_before": side_by_side([one.process_noise_before + 0.0 * one.process_noise for one in filters]),
        "measurement_noise": None if measured else side_by_side([one.measurement_model.noise for one in filters]),
        "measurement": share(measured, side_by_side) if measured else None,
        "prior": np.stack([one.prior for one in filters]),
        "prior_variance": np.stack([one.prior_variance for one in filters]),
    }


def join(beliefs: Sequence[Belief]) -> Belief:
    """Beliefs of the modes (...) as one with an axis of modes (..., modes); a filter keeps one history."""

    def each(name: str, axis: int) -> Array:
        return np.stack([getattr(belief, name) for belief in beliefs], axis=axis)

    repaired = [np.zeros(b.nis.shape) if b.lost is None else b.lost for b in beliefs]
    return Belief(
        mean=each("mean", -2),
        covariance=each("covariance", -3),
        innovation=each("innovation", -2),
        nis=each("nis", -1),
        log_likelihood=each("log_likelihood", -1),
        dof=each("dof", -1),
        detection=Detection(
            np.stack([belief.detection.statistic for belief in beliefs], axis=-1),
            np.stack([belief.detection.declared for belief in beliefs], axis=-1),
            tuple(belief.detection.history[0] for belief in beliefs),
        ),
        lost=None if all(belief.lost is None for belief in beliefs) else np.stack(repaired, axis=-1),
    )


def one_of(joined: Belief, mode: int) -> Belief:
    """Belief (...) of one mode among beliefs (..., modes)."""
    found = joined.detection
    return Belief(
        mean=joined.mean[..., mode, :],
        covariance=joined.covariance[..., mode, :, :],
        innovation=joined.innovation[..., mode, :],
        nis=joined.nis[..., mode],
        log_likelihood=joined.log_likelihood[..., mode],
        dof=joined.dof[..., mode],
        detection=Detection(found.statistic[..., mode], found.declared[..., mode], (found.history[mode],)),
        lost=None if joined.lost is None else joined.lost[..., mode],
    )
