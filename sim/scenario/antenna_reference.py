"""Antenna mapping: slews to and fro that cut the antenna's pattern, ever faster."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]

LONGEST, MEDIUM, SHORTEST = 1.0, 0.6, 0.4  # duration of a cut over that of the first: four, four, then for good


@dataclass(frozen=True)
class AntennaCuts:
    """One axis of the reference of Tsao, Brozenec & Safonov (fig. 9, a picture without numbers; those here are chosen after it).

    The rate is a square wave averaged over the last `smoothing_s`: each cut crosses from one side to the other at constant rate, the
    first one, from the middle, at half of it.

    Attributes:
      start_s: when the first cut begins.
      cut_s: duration of each of the first four cuts; the next four take 0.6, all others 0.4 of it.
      extent: how far to either side of the middle, rad; the smoothing rounds the corners off.
      smoothing_s: length of the moving average.
    """

    start_s: float
    cut_s: float
    extent: float
    smoothing_s: float

    def __post_init__(self) -> None:
        if not (self.start_s >= 0 and self.cut_s > 0 and self.smoothing_s > 0):
            raise ValueError("antenna cuts: start_s must not be negative, cut_s and smoothing_s must be positive")

    def at(self, time: Array) -> tuple[Array, Array]:
        """Position rad and rate rad/s, (...,) each; time (...,) s."""
        corner, bend = self._corners(float(np.max(time, initial=0.0)))
        since = np.maximum(time[..., None] - corner, 0.0)
        before = np.maximum(time[..., None] - corner - self.smoothing_s, 0.0)
        position = np.sum(bend * (since - before) * (since + before), axis=-1) / (2.0 * self.smoothing_s)
        return position, np.sum(bend * (since - before), axis=-1) / self.smoothing_s

    def _corners(self, until: float) -> tuple[Array, Array]:
        """Starts of cuts (n,) s and the change of rate at each (n,) rad/s, up to a time."""
        cuts = 8 + max(1, int(np.ceil((until - self.start_s) / (SHORTEST * self.cut_s))))
        length = self.cut_s * np.concatenate([np.full(4, LONGEST), np.full(4, MEDIUM), np.full(cuts - 8, SHORTEST)])
        rate = 2.0 * self.extent / length * np.where(np.arange(cuts) % 2, -1.0, 1.0)
        rate[0] /= 2.0
        return self.start_s + np.concatenate([[0.0], np.cumsum(length[:-1])]), np.diff(rate, prepend=0.0)


def antenna_mapping(pace: float, extent: float) -> tuple[AntennaCuts, AntennaCuts]:
    """Azimuth and elevation cuts, `extent` rad to either side, for a loop of pace lambda = `pace` rad/s."""
    smoothing = 10.0 / pace
    return AntennaCuts(20.0 / pace, 100.0 / pace, extent, smoothing), AntennaCuts(50.0 / pace, 110.0 / pace, extent, smoothing)
