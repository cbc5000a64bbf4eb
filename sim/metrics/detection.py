"""Detection of faults, event by event: which fault an alarm was raised for, which were missed, and which an alarm already stood for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.faults.events import KINDS
from sim.faults.timeline import Occurrence

Array = NDArray[np.floating]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]

PLANT_LAG = 1  # ticks until a reading shows what a fault does to the plant, also for faults of unknown kind


class Detections(NamedTuple):
    """What became of every fault that a detector could see; all (events,).

    A fault is detected if an alarm is raised while it is watched: from the first tick at which a reading can show it until the next
    fault of the trial can be seen, or the end of the run. One that is not is missed, and its delay is known to be longer than it was
    watched (right-censored), unless an alarm already stood: then nobody can say whether it would have been found.
    """

    trial: Indices
    start: Indices  # tick at which the fault begins
    detected: Flags
    standing: Flags  # an alarm already stood, and none was raised
    delay: Indices  # ticks from its beginning to the alarm; of a fault that was not detected, as long as it was watched
    raised: Indices  # tick of the alarm, -1 if there is none

    @property
    def missed(self) -> Flags:
        """Neither detected nor under a standing alarm."""
        return ~self.detected & ~self.standing


def lag(kind: str) -> int:
    """Ticks until a reading can show a fault of this kind: none for one of the sensors themselves."""
    event = KINDS.get(kind)
    return PLANT_LAG if event is None or not event.of_readings else 0


def detections(declared: Flags, occurrences: Sequence[Occurrence]) -> Detections:
    """Set alarms against faults; faults that begin in one trial at one tick are one event.

    Args:
      declared: whether a fault is declared, (trials, ticks).
      occurrences: of the faults; their trials are rows of `declared`.
    """
    ticks = declared.shape[-1]
    visible: dict[tuple[int, int], int] = {}
    for o in sorted(occurrences, key=lambda o: (o.trial, o.start_tick, lag(o.kind))):
        visible.setdefault((o.trial, o.start_tick), o.start_tick + lag(o.kind))
    events = np.array([(trial, start, seen) for (trial, start), seen in visible.items() if seen < ticks], dtype=np.int64).reshape(-1, 3)
    trial, start, seen = events.T
    follows = np.append(trial[1:] == trial[:-1], False)[: len(trial)]
    stop = np.where(follows, np.append(seen[1:], ticks)[: len(trial)], ticks)
    before = _tick_before(declared)
    rises = np.where(raised_alarms(declared), np.arange(ticks), ticks)
    following = np.minimum.accumulate(rises[:, ::-1], axis=1)[:, ::-1]  # tick of the next alarm that is raised, from each tick on
    raised = following[trial, seen]
    detected = raised < stop
    return Detections(
        trial, start, detected, ~detected & before[trial, seen], np.where(detected, raised, stop) - start, np.where(detected, raised, -1)
    )


def visible_faults(fault: Flags, occurrences: Sequence[Occurrence]) -> Flags:
    """Whether a reading can show a fault, (trials, ticks), of whether one is active and of what kind."""
    out, ticks = np.zeros_like(fault), fault.shape[-1]
    for o in occurrences:
        late = lag(o.kind)
        out[o.trial, o.start_tick + late : o.end_tick + late] |= fault[o.trial, o.start_tick : min(o.end_tick, ticks - late)]
    return out


def raised_alarms(declared: Flags) -> Flags:
    """Where a fault is declared that was not at the tick before, (trials, ticks): the switches to the sliding gain."""
    return declared & ~_tick_before(declared)


def _tick_before(declared: Flags) -> Flags:
    """What was declared at the tick before; nothing before the first."""
    return np.concatenate([np.zeros_like(declared[:, :1]), declared[:, :-1]], axis=1)


def false_alarms(declared: Flags, clear: Flags, found: Detections) -> Flags:
    """Where an alarm is raised while no fault acts or can be seen, `clear` (trials, ticks), other than the late detection of one."""
    own = np.zeros_like(declared)
    own[found.trial[found.detected], found.raised[found.detected]] = True
    return raised_alarms(declared) & clear & ~own


def detected_by(delay: Array, detected: Flags) -> tuple[Array, Array]:
    """Times of detections and the share of events detected by then, of events (events,) each (Kaplan & Meier 1958).

    Those not detected have a delay longer than that given: they count as not detected until then, and say nothing afterwards.
    """
    order = np.lexsort((~detected, delay))  # at equal times detections come first
    at_risk = np.arange(len(delay), 0, -1)
    survival = np.cumprod(np.where(detected[order], 1.0 - 1.0 / at_risk, 1.0))
    return delay[order][detected[order]], 1.0 - survival[detected[order]]


def censored_median(delay: Array, detected: Flags) -> float:
    """Median delay of events, (events,), where those not detected have a longer one than that given.

    NaN if fewer than half can be said to have been detected by any time.
    """
    time, share = detected_by(delay, detected)
    reached = np.flatnonzero(share >= 0.5 - 1e-12)
    return float(time[reached[0]]) if len(reached) else float("nan")
