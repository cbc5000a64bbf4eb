"""Signals of a run: named arrays whose axes, unit, frame and meaning are known."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.parts import AnyArray, Array

TRIAL, AGENT, TIME = "trial", "agent", "time"


class Axis(NamedTuple):
    """An axis behind that of time.

    Attributes:
      name: the same for all signals that share the labels, or more of them: `axis` (x, y, z), `quaternion`, `wheel`, ...
      labels: what each component is called.
    """

    name: str
    labels: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Signal:
    """One quantity of one loop.

    Attributes:
      name: with slashes: `truth/attitude`, `estimate/ukf/rate`, `nis/ukf`.
      values: ([trials,] [agents,] ticks, ...), as `dims` says; a view of the recording where it can be.
      dims: names of the axes: `trial` (but of a reference), `agent` (where each has its own), `time`, then the names of `axes`.
      axes: behind that of time.
      stem: how its columns begin.
      unit: `1` if it has none.
      frame: that it is resolved in, or that it leads from and to; empty: none.
      meaning: one line.
      channel: of the recording, that it is (of).
    """

    name: str
    values: AnyArray
    dims: tuple[str, ...]
    axes: tuple[Axis, ...]
    stem: str
    unit: str
    frame: str
    meaning: str
    channel: str

    @property
    def variable(self) -> str:
        """Its name where slashes have another meaning: `truth_attitude`."""
        return self.name.replace("/", "_")

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of its scalars, the last axis running fastest: `truth/q1`, ...; of a signal without axes its own name."""
        return tuple(self.stem + "_".join(labels) for labels in product(*(axis.labels for axis in self.axes)))

    def scalars(self) -> Iterator[tuple[str, AnyArray]]:
        """Each column's name with its values, as `dims` says without the axes behind time."""
        before = self.values.ndim - len(self.axes)
        flat = self.values.reshape(*self.values.shape[:before], len(self.columns))
        return zip(self.columns, np.moveaxis(flat, -1, 0), strict=True)


@dataclass(frozen=True, eq=False)
class LoopSignals:
    """Signals of one closed loop.

    Attributes:
      loop: its name.
      time: s since the start, (ticks,).
      trials: numbers of the recorded trials, (trials,).
      agents: how many; None: one body, without an axis of agents.
      signals: all, by name.
    """

    loop: str
    time: Array
    trials: NDArray[np.int64]
    agents: int | None
    signals: dict[str, Signal]

    def __getitem__(self, name: str) -> Signal:
        return self.signals[name]

    def __iter__(self) -> Iterator[Signal]:
        return iter(self.signals.values())

    @cached_property
    def columns(self) -> dict[str, Signal]:
        """The signal that each column is of."""
        return {column: signal for signal in self for column in signal.columns}

    @property
    def agent_numbers(self) -> NDArray[np.int64]:
        """Counted from one, (agents,); of one body empty."""
        return np.arange(1, 1 + (self.agents or 0))


@dataclass(frozen=True, eq=False)
class Signals:
    """Signals of a run.

    Attributes:
      family: of its scenario: `body`, `formation` or `consensus`.
      loops: of every closed loop, by name; a single one is called `loop`. They may differ in observers, ticks and trials.
    """

    family: str
    loops: dict[str, LoopSignals]

    @cached_property
    def columns(self) -> dict[str, Signal]:
        """The signal that each column is of, of all loops, in the order in which they are met."""
        found: dict[str, Signal] = {}
        for loop in self.loops.values():
            found |= {column: signal for column, signal in loop.columns.items() if column not in found}
        return found
