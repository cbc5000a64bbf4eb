"""Fault detection by the smoothed normalised innovation squared, and the gain that switches on it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from estimation.gaussian import Detection, Innovation
from estimation.sliding_innovation import sliding_gain

Array = NDArray[np.floating]


class Smoothing(Protocol):
    """Sum over past values of a statistic, with the number of values that it is worth."""

    @property
    def weight(self) -> float:
        """Expected sum of a statistic whose mean is one."""
        ...

    def start(self, shape: tuple[int, ...], mean: float) -> Array:
        """Memory (..., readings) as if the statistic had always had its mean."""
        ...

    def push(self, history: Array, value: Array) -> tuple[Array, Array]:
        """Sum (...,) including `value`, and the memory after it."""
        ...


@dataclass(frozen=True)
class Windowed:
    """Sum over the last `length` readings (McCafferty-Leroux et al. 2024, eq. 20).

    The paper calls it an average and writes it as a sum; its degrees of freedom (eq. 22) are those of a sum.
    """

    length: int

    @property
    def weight(self) -> float:
        """The length of the window (eq. 22)."""
        return float(self.length)

    def start(self, shape: tuple[int, ...], mean: float) -> Array:
        """A window full of means."""
        return np.full((*shape, self.length), mean)

    def push(self, history: Array, value: Array) -> tuple[Array, Array]:
        """Sum over the moved window."""
        history = np.concatenate([history[..., 1:], value[..., None]], axis=-1)
        return np.sum(history, axis=-1), history


@dataclass(frozen=True)
class Fading:
    """Sum with forgetting, r_k = alpha r_(k-1) + NIS_k (McCafferty-Leroux et al. 2024, eq. 21)."""

    alpha: float

    @property
    def weight(self) -> float:
        """1 / (1 - alpha) (eq. 23)."""
        return 1.0 / (1.0 - self.alpha)

    def start(self, shape: tuple[int, ...], mean: float) -> Array:
        """The sum of a constant mean."""
        return np.full((*shape, 1), mean * self.weight)

    def push(self, history: Array, value: Array) -> tuple[Array, Array]:
        """Fade and add."""
        total = self.alpha * history[..., 0] + value
        return total, total[..., None]


@dataclass(frozen=True, eq=False)
class SwitchedGain:
    """Kalman's gain in health and the sliding innovation gain in fault (NIS EKF-ESIF, McCafferty-Leroux et al. 2024, sec. 3.3).

    A fault is declared when the smoothed NIS exceeds its `tail_on` quantile and withdrawn when it falls below the `tail_off` one,
    each trial by itself. Missing components of a reading count as their expectation, so that silence neither alarms nor reassures.

    Attributes:
      boundary_layer: delta of the sliding gain, (d,).
      smoothing: windowed or fading.
      dof: measurements N in a reading (11 in the paper).
      tail_on: chi-square tail probability of the upper threshold (0.001 in the paper).
      tail_off: that of the lower one (0.05 in the paper).
    """

    boundary_layer: Array
    smoothing: Smoothing
    dof: float
    tail_on: float = 0.001
    tail_off: float = 0.05

    def __post_init__(self) -> None:
        if not 0 < self.tail_on < self.tail_off < 1:
            raise ValueError(f"tail probabilities on = {self.tail_on:g}, off = {self.tail_off:g}: need 0 < on < off < 1")

    @cached_property
    def thresholds(self) -> tuple[float, float]:
        """Smoothed NIS (on, off) that declares and withdraws a fault."""
        total = self.dof * self.smoothing.weight
        return float(chi2.isf(self.tail_on, total)), float(chi2.isf(self.tail_off, total))

    def start(self, shape: tuple[int, ...]) -> Detection:
        """No fault, and a past in which the NIS had its expectation."""
        return Detection(
            np.full(shape, self.dof * self.smoothing.weight), np.zeros(shape, dtype=bool), (self.smoothing.start(shape, self.dof),)
        )

    def gain(self, innovation: Innovation, detection: Detection) -> tuple[Array, Detection]:
        """Detect first, then choose the gain of the same reading."""
        missing = innovation.residual.shape[-1] - innovation.dof
        statistic, history = self.smoothing.push(detection.history[0], innovation.nis + missing)
        on, off = self.thresholds
        declared = np.where(detection.declared, statistic > off, statistic > on)
        sliding = sliding_gain(innovation.residual, self.boundary_layer, innovation.sensitivity)
        gain = np.where(declared[..., None, None], sliding, innovation.gain)
        return gain, Detection(statistic, declared, (history,))
