"""One figure of merit, of every trial."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]


class Metric(NamedTuple):
    """One figure of merit of every trial."""

    subject: str
    metric: str
    phase: str
    unit: str
    values: Array  # (trials,), NaN where it does not apply

    @property
    def key(self) -> tuple[str, str, str, str]:
        """What it is of: subject, metric, phase and unit."""
        return self.subject, self.metric, self.phase, self.unit

    def at(self, own: NDArray[np.int64], everyone: NDArray[np.int64]) -> Metric:
        """The same of all trials, `own` being the numbers of those that it is of; NaN for the others."""
        values = np.full(len(everyone), np.nan)
        values[np.isin(everyone, own)] = self.values
        return self._replace(values=values)

    def of(self, own: NDArray[np.int64], some: NDArray[np.int64]) -> Metric:
        """The same of some trials."""
        return self._replace(values=self.values[np.isin(own, some)])
