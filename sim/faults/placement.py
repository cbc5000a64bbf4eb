"""One fault as it happens in one trial: when, how it grows, and what it changes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.faults.effects import Effect, Track
from sim.faults.parts import Parts

Array = NDArray[np.floating]
Agents = tuple[int, ...] | Literal["all"]


class Change(NamedTuple):
    """What one fault does to one effect in one trial."""

    trial: int | None  # its position; None: in all, which are alike
    start: int
    end: int
    weight: Array | None  # of every tick, (end - start,); None: one
    action: Literal["put", "add", "scale"]
    value: Any  # broadcast to the part; with `by_tick` its first axis is that of ticks
    part: tuple[Any, ...]  # of the axes behind the trials
    by_tick: bool


@dataclass(frozen=True, eq=False)
class Placement:
    """Where a fault lays down what it does.

    Attributes:
      parts: what there is to fail.
      trial: its position; None: in all trials, which are alike.
      start: its first tick.
      end: the tick after its last.
      weight: how much of its size there is at every tick, (end - start,); None: all of it.
      random: of this fault in this trial.
      changes: what all faults do, by effect, in the order of the file.
    """

    parts: Parts
    trial: int | None
    start: int
    end: int
    weight: Array | None
    random: np.random.Generator
    changes: dict[Effect, list[Change]] = field(default_factory=dict)

    def put(self, effect: Effect, value: Any, agents: Agents = "all", inner: Any = None) -> None:
        """Let the effect be `value`, whatever it was; of `inner` components alone if they are given."""
        self._lay("put", effect, value, agents, inner)

    def add(self, effect: Effect, value: Any, agents: Agents = "all", inner: Any = None, by_tick: bool = False) -> None:
        """Add `value`, (..., inner), or with `by_tick` (end - start, ..., inner)."""
        self._lay("add", effect, value, agents, inner, by_tick)

    def scale(self, effect: Effect, factor: float, agents: Agents = "all", inner: Any = None) -> None:
        """Multiply by a factor."""
        self._lay("scale", effect, factor, agents, inner)

    def _lay(self, action: Any, effect: Effect, value: Any, agents: Agents, inner: Any, by_tick: bool = False) -> None:
        chosen = [] if inner is None else [np.asarray(inner)]
        if effect.each and self.parts.agents:
            chosen.insert(0, np.arange(self.parts.agents) if agents == "all" else np.array(agents, dtype=np.int64) - 1)
        change = Change(self.trial, self.start, self.end, self.weight, action, value, np.ix_(*chosen) if chosen else (), by_tick)
        self.changes.setdefault(effect, []).append(change)


def compose(effect: Effect, changes: list[Change], parts: Parts, trials: int) -> Track:
    """An effect over the run; where two faults say different things, the later one is heard."""
    edges: list[Any] = [[0]]
    for change in changes:
        every = np.arange(change.start, change.end)
        moved = every if change.by_tick else every[:1] if change.weight is None else every[_moves(change.weight)]
        edges += [moved, [change.end]]
    starts = np.unique(np.concatenate(edges)).astype(np.int64)
    alike = all(change.trial is None for change in changes)
    shape = effect.shape(parts)
    values = np.array(np.broadcast_to(effect.rest(parts), (len(starts), 1 if alike else trials, *shape)))
    for change in changes:
        first, last = np.searchsorted(starts, [change.start, change.end])
        since = starts[first:last] - change.start
        view = values[first:last] if change.trial is None else values[first:last, change.trial]
        if change.trial is None:
            view = np.moveaxis(view, 1, -1)  # trials last, where no index reaches
        where = (slice(None), *change.part)
        before = view[where]
        value = np.asarray(change.value, dtype=float)
        if change.by_tick:
            value = value[since]
        if change.trial is None and value.ndim:
            value = value[..., None]
        if change.weight is None:
            after = value if change.action == "put" else before + value if change.action == "add" else before * value
        else:
            weight = change.weight[since].reshape(-1, *[1] * (before.ndim - 1))
            if change.action == "put":
                after = weight * value + (1.0 - weight) * before
            else:
                after = before + weight * value if change.action == "add" else before * (weight * value + (1.0 - weight))
        view[where] = after
    return Track(starts, values != 0.0 if effect.flag else values)


def _moves(weight: Array) -> NDArray[np.bool_]:
    """Ticks at which a weight is another than before, the first included."""
    return np.append(np.ones(len(weight[:1]), dtype=bool), weight[1:] != weight[:-1])
