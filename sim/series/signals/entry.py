"""What an entry of the register of signals says: which channel of a recording, and which quantities its components are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from sim.parts import AnyArray
from sim.series.signals.signal import Axis

COUNTED: tuple[str, ...] = ()  # labels of components that are numbered from one, as many as there are


class Part(NamedTuple):
    """Components of a channel that are one quantity.

    Attributes:
      name: behind the entry's, in the signal's name; empty: none.
      stem: behind the entry's, before the label, in a column's name.
      axis: that the components are along; None: there is one, without an axis.
      unit: of each.
      frame: empty: none.
      what: it is, for a person.
    """

    name: str
    stem: str
    axis: Axis | None
    unit: str
    frame: str
    what: str


@dataclass(frozen=True)
class Entry:
    """A channel of a recording as signals.

    Attributes:
      channel: its name; of an observer's what comes behind `NAME/`.
      prefix: of the signals' names; `{observer}` stands for the observer's name.
      parts: quantities along the channel's last axis, in order; those beyond its end are not there.
      meaning: behind what a part is.
      lead: an axis before the last one.
      wheels: whether it is only of a plant with wheels (True) or without (False); None: of both.
      arranged: what is made of the channel first, of the scenario and the array (ticks, trials, ...); None: nothing.
      labels: of a counted axis, of the scenario; None: numbers from one.
    """

    channel: str
    prefix: str
    parts: tuple[Part, ...]
    meaning: str
    lead: Axis | None = None
    wheels: bool | None = None
    arranged: Callable[[Any, AnyArray], AnyArray] | None = None
    labels: Callable[[Any], tuple[str, ...]] | None = None
