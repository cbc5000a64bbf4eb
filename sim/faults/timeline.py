"""Faults laid out over a run: what they do at every tick, to whatever part of the loop asks, and when each happened."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.faults.effects import ACTIVE, COMMAND_GAIN, COMMAND_OFFSET, DRIVE_GAIN, DRIVE_OFFSET, PUSH, Effect, Track
from sim.faults.events import Event
from sim.faults.parts import Parts
from sim.faults.placement import Change, Placement, compose
from sim.randomness import Stream, Trials, generator

Array = NDArray[np.floating]


class Occurrence(NamedTuple):
    """One fault as it happens in one trial."""

    trial: int
    start_tick: int
    end_tick: int
    kind: str
    text: str


@dataclass(frozen=True, eq=False)
class Timeline:
    """All faults of a run. What none of them touches has no track.

    Attributes:
      dt: of a tick, s.
      tracks: by effect.
      occurrences: of every trial, in the order of the file.
    """

    dt: float
    tracks: dict[Effect, Track] = field(default_factory=dict)
    occurrences: tuple[Occurrence, ...] = ()

    def at(self, effect: Effect, tick: int) -> NDArray[Any] | None:
        """An effect at a tick, (trials or 1, [agents,] ...); None: no fault of the run touches it."""
        track = self.tracks.get(effect)
        return None if track is None else track.at(tick)

    def changes_at(self, tick: int, *effects: Effect) -> bool:
        """Whether one of the effects may be another than at the tick before."""
        return any(effect in self.tracks and self.tracks[effect].starts_at(tick) for effect in effects)

    def commanded(self, tick: int, command: Array) -> Array:
        """What is carried out instead of a law's command, (trials, [agents,] axes)."""
        return self._instead(tick, command, COMMAND_GAIN, COMMAND_OFFSET)

    def given(self, tick: int, command: Array) -> Array:
        """What drives give instead of the torque that they are told, (trials, [agents,] wheels) N m."""
        return self._instead(tick, command, DRIVE_GAIN, DRIVE_OFFSET)

    def _instead(self, tick: int, command: Array, gain: Effect, offset: Effect) -> Array:
        share, more = self.at(gain, tick), self.at(offset, tick)
        if share is not None:
            command = command * share
        return command if more is None else command + more

    def push(self, tick: int) -> Array | None:
        """Torque or force from outside, (trials or 1, [agents,] axes) N m or N; None: there never is any."""
        total = self.at(PUSH, tick)
        for effect, track in self.tracks.items():
            if effect.pulsation_rad_s is not None:
                amplitude = track.at(tick)
                angle = effect.pulsation_rad_s * self.dt * tick * (np.arange(1, amplitude.shape[-2] + 1) if effect.numbered else 1)
                one = amplitude * np.stack([np.sin(angle), np.cos(angle), np.sin(2.0 * angle)], axis=-1)
                total = one if total is None else total + one
        return total


def schedule(faults: Sequence[tuple[Event, ...]], parts: Parts, seed: int, trials: Trials, ticks: int, dt: float) -> Timeline:
    """Lay out the faults of each trial over its ticks; trial i is the same whatever the batch.

    Args:
      faults: of every trial.
      parts: what there is to fail.
      seed: of the run.
      trials: their numbers, (trials,).
      ticks: of the run.
      dt: of a tick, s.
    """
    changes: dict[Effect, list[Change]] = {}
    occurrences: list[tuple[int, int, Occurrence]] = []
    one_file = all(own is faults[0] for own in faults)
    for number in range(max(map(len, faults), default=0)):
        placed: list[tuple[int | None, Event]] = [(i, own[number]) for i, own in enumerate(faults) if number < len(own)]
        if one_file and not placed[0][1].drawn:
            placed = [(None, placed[0][1])]
        for i, fault in placed:
            random = generator(seed, int(trials[i or 0]), Stream.FAULT + number)
            on = _placed(fault, parts, i, ticks, dt, random, changes)
            on.put(ACTIVE, 1.0) if on.weight is None else _whole(on).put(ACTIVE, 1.0)
            text = fault.lay(on)
            where = range(len(trials)) if i is None else (i,)
            occurrences += [(at, number, Occurrence(at, on.start, on.end, fault.kind, text)) for at in where]
    tracks = {effect: compose(effect, changes[effect], parts, len(trials)) for effect in changes}
    return Timeline(dt, tracks, _until_the_next(sorted(occurrences, key=lambda o: o[:2]), faults))


def _placed(
    fault: Event, parts: Parts, trial: int | None, ticks: int, dt: float, random: np.random.Generator, changes: dict[Effect, list[Change]]
) -> Placement:
    """When a fault happens in a trial, and how it grows."""
    start = round(fault.start_s.sample(random) / dt)
    if fault.end_s is not None:
        last = max(start + 1, round(fault.end_s.sample(random) / dt))
    elif fault.duration_s is not None:
        last = start + max(1, round(fault.duration_s.sample(random) / dt))
    else:
        last = ticks
    end, weight = max(start, min(ticks, last)), None
    since = np.arange(end - start)
    if fault.shape == "ramp":
        grown = (last - start) if fault.ramp_s is None else fault.ramp_s.sample(random) / dt
        weight = np.minimum(1.0, since / grown)
    elif fault.period_s is not None:
        period, duty = fault.period_s.sample(random) / dt, 0.5 if fault.duty is None else fault.duty.sample(random)
        weight = ((since / period + 1e-9) % 1.0 < duty).astype(float)
    return Placement(parts, trial, start, end, weight, random, changes)


def _whole(on: Placement) -> Placement:
    """The same while it lasts, however much of it there is."""
    return Placement(on.parts, on.trial, on.start, on.end, None, on.random, on.changes)


def _until_the_next(ordered: list[tuple[int, int, Occurrence]], faults: Sequence[tuple[Event, ...]]) -> tuple[Occurrence, ...]:
    """Faults without an end last until the next of their kind."""
    told: list[Occurrence] = []
    for trial, number, one in reversed(ordered):
        fault, end = faults[trial][number], one.end_tick
        if fault.end_s is None and fault.duration_s is None:
            later = (o.start_tick for o in told[-len(faults[trial]) :] if (o.trial, o.kind) == (trial, one.kind))
            end = min([end, *(start for start in later if start > one.start_tick)])
        told.append(one._replace(end_tick=end))
    return tuple(reversed(told))
