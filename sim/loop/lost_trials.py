"""Trials that leave a batch: a filter or the physics broke down in them; the others run on as if nothing had happened."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Flags = NDArray[np.bool_]


class LostTrial(NamedTuple):
    """A trial that broke down.

    Attributes:
      trial: its number.
      tick: control tick from which on nothing of it counts.
      time_s: of the breakdown.
      cause: what broke down.
    """

    trial: int
    tick: int
    time_s: float
    cause: str

    def __str__(self) -> str:
        return f"trial {self.trial} failed at t = {self.time_s:.3f} s: {self.cause}"


class LostTrials:
    """Those of a run, by position in its batch."""

    def __init__(self, trials: NDArray[np.int64]) -> None:
        self._trials = trials
        self._found: dict[int, LostTrial] = {}
        self.failed: Flags = np.zeros(len(trials), dtype=bool)

    def add(self, position: int, tick: int, time_s: float, cause: str) -> None:
        """One more; the first cause counts."""
        self._found.setdefault(position, LostTrial(int(self._trials[position]), tick, time_s, cause))
        self.failed[position] = True

    def add_all(self, tick: int, time_s: float, cause: str) -> None:
        """All that are left."""
        for position, _ in enumerate(self._trials):
            self.add(position, tick, time_s, cause)

    @property
    def all(self) -> tuple[LostTrial, ...]:
        """In the order of their numbers."""
        return tuple(sorted(self._found.values()))

    def __bool__(self) -> bool:
        return bool(self._found)
