"""Signals of recordings."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from sim.loop.recording import Recording
from sim.parts import AnyArray
from sim.series.signals.entry import Entry, Part
from sim.series.signals.register import LEFT_OUT, OF_OBSERVER, OF_RUN
from sim.series.signals.signal import AGENT, TIME, TRIAL, Axis, LoopSignals, Signal, Signals


def signals_of(scenario: Any, recordings: dict[str, Recording]) -> Signals:
    """Every quantity of a run's recordings by name; values are views of the channels where they can be."""
    return Signals(scenario.family, {loop: _of_a_loop(scenario, loop, recording) for loop, recording in recordings.items()})


def _of_a_loop(scenario: Any, loop: str, recording: Recording) -> LoopSignals:
    agents = None if scenario.family == "body" else int(scenario.plant.agents)
    found = (signal for channel in recording.channels for signal in _of_a_channel(scenario, recording, channel, agents))
    return LoopSignals(loop, recording.time, recording.trials, agents, {signal.name: signal for signal in found})


def _of_a_channel(scenario: Any, recording: Recording, channel: str, agents: int | None) -> Iterator[Signal]:
    """Its quantities; of a channel that no entry is about itself, with numbered components."""
    if channel in LEFT_OUT[scenario.family]:
        return
    observer = next((name for name in recording.observers if channel.startswith(f"{name}/")), None)
    named = channel if observer is None else channel.removeprefix(f"{observer}/")
    register = OF_RUN if observer is None else OF_OBSERVER
    entries = [entry for entry in register[scenario.family] if entry.channel == named and _fits(entry, scenario)]
    for entry in entries:
        array: AnyArray = recording.channels[channel]
        if entry.arranged is not None:
            array = entry.arranged(scenario, array)
        yield from _parts(entry, array, scenario, channel, observer, agents)
    if not entries:
        yield _unknown(channel, recording.channels[channel], agents)


def _fits(entry: Entry, scenario: Any) -> bool:
    return entry.wheels is None or entry.wheels == bool(scenario.plant.wheel_axes.shape[1])


def _parts(entry: Entry, array: AnyArray, scenario: Any, channel: str, observer: str | None, agents: int | None) -> Iterator[Signal]:
    lead = () if entry.lead is None else (entry.lead,)
    if all(part.axis is None for part in entry.parts) and not lead and len(entry.parts) == 1:
        array = array[..., None]
    start = 0
    for part in entry.parts:
        left = array.shape[-1] - start
        size = 1 if part.axis is None else len(part.axis.labels) or left
        if left >= size > 0:
            yield _signal(entry, part, array[..., start : start + size], scenario, channel, observer, agents)
        start += size
    if start < array.shape[-1]:
        raise ValueError(f"channel {channel} has {array.shape[-1]} components; the register of signals knows {start}")


def _signal(entry: Entry, part: Part, values: AnyArray, scenario: Any, channel: str, observer: str | None, agents: int | None) -> Signal:
    axes = () if entry.lead is None else (entry.lead,)
    prefix = entry.prefix.format(observer=observer)
    if part.axis is None:
        values = values[..., 0]
    elif part.axis.labels:
        axes = (*axes, part.axis)
    else:
        labels = tuple(str(1 + i) for i in np.arange(values.shape[-1])) if entry.labels is None else entry.labels(scenario)
        axes = (*axes, Axis(part.axis.name.format(observer=observer), labels))
    stem = f"{prefix}/{part.stem}" if axes or part.stem else prefix
    name = f"{prefix}/{part.name}" if part.name else prefix
    meaning = ", ".join(text for text in (part.what, entry.meaning) if text)
    dims, values = _turned(channel, values, len(axes), agents)
    return Signal(name, values, (*dims, *(axis.name for axis in axes)), axes, stem, part.unit, part.frame, meaning, channel)


def _turned(channel: str, values: AnyArray, axes: int, agents: int | None) -> tuple[tuple[str, ...], AnyArray]:
    """Names of the axes until that of time, and (ticks, [trials, [agents,]] ...) with time behind trials and agents."""
    before = values.ndim - axes
    dims = () if channel.startswith("reference/") else (TRIAL, AGENT)[: before - 1]
    if before != 1 + len(dims) or (AGENT in dims and agents is None):
        raise ValueError(f"channel {channel} has {values.ndim} axes; the register of signals knows {1 + len(dims) + axes}")
    return (*dims, TIME), np.moveaxis(values, 0, before - 1)


def _unknown(channel: str, values: AnyArray, agents: int | None) -> Signal:
    """A channel that the register does not know, such as what somebody's own law notes."""
    before = 1 if channel.startswith("reference/") else 2
    if agents is not None and before == 2 and values.shape[before : before + 1] == (agents,):
        before = 3
    flat = values.reshape(*values.shape[:before], -1)
    axes = (Axis(f"{channel}_component", tuple(str(1 + i) for i in np.arange(flat.shape[-1]))),) if values.ndim > before else ()
    dims, flat = _turned(channel, flat if axes else values, len(axes), agents)
    stem = f"{channel}/" if axes else channel
    return Signal(channel, flat, (*dims, *(axis.name for axis in axes)), axes, stem, "", "", "as noted, not in the register", channel)
