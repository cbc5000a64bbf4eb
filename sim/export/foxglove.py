"""Signals as an MCAP log, for Foxglove and other readers of robots' logs: a topic for each trial and agent, a JSON object a tick."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sim.export.export_format import ExportFormat
from sim.parts import AnyArray
from sim.series.signals.signal import AGENT, TRIAL, LoopSignals, Signal, Signals


class Topic(NamedTuple):
    """What one topic carries.

    Attributes:
      name: `/loop/trial0`, of several agents `/loop/trial0/agent1`.
      columns: numbers of each, (ticks,).
    """

    name: str
    columns: dict[str, AnyArray]


def topics(loop: LoopSignals) -> Iterator[Topic]:
    """Of every trial and agent."""
    for trial, number in enumerate(loop.trials.tolist()):
        for agent in np.arange(loop.agents or 1).tolist():
            name = f"/{loop.loop}/trial{number}" + ("" if loop.agents is None else f"/agent{1 + agent}")
            columns = {column: _of_one(signal, values, trial, agent) for signal in loop for column, values in signal.scalars()}
            yield Topic(name, columns)


def _of_one(signal: Signal, values: AnyArray, trial: int, agent: int) -> AnyArray:
    """A column of one trial and agent, (ticks,)."""
    values = values[trial] if TRIAL in signal.dims else values
    return values[agent] if AGENT in signal.dims else values


def _nested(flat: dict[str, Any]) -> dict[str, Any]:
    """`a/b` as b within a: a reader's path to a number is then its name with dots."""
    whole: dict[str, Any] = {}
    for name, value in flat.items():
        *outer, last = name.split("/")
        inside = whole
        for part in outer:
            inside = inside.setdefault(part, {})
        inside[last] = value
    return whole


def _schema(fields: dict[str, Any]) -> dict[str, Any]:
    """JSON schema of nested fields, whose leaves are schemas themselves."""
    properties = {name: field if "type" in field and isinstance(field["type"], list) else _schema(field) for name, field in fields.items()}
    return {"type": "object", "properties": properties}


def _leaf(signal: Signal) -> dict[str, Any]:
    said = f"{signal.meaning} [{signal.unit}]" + (f", frame {signal.frame}" if signal.frame else "")
    return {"type": ["boolean" if signal.values.dtype == bool else "number", "null"], "description": said}


def _write(path: Path, signals: Signals) -> None:
    from mcap.writer import Writer

    with path.open("wb") as file:
        log = Writer(file)
        log.start()
        for loop in signals.loops.values():
            described = _schema(_nested({column: _leaf(signal) for column, signal in loop.columns.items()}))
            schema = log.register_schema(f"nacs.{loop.loop}", "jsonschema", json.dumps(described).encode())
            stamps = np.rint(1e9 * loop.time).astype(np.int64).tolist()
            for topic in topics(loop):
                channel = log.register_channel(topic.name, "json", schema)
                numbers = {name: _json_numbers(values) for name, values in topic.columns.items()}
                for tick, (stamp, time) in enumerate(zip(stamps, loop.time.tolist(), strict=True)):
                    message = {"time_s": time} | _nested({name: values[tick] for name, values in numbers.items()})
                    log.add_message(channel, stamp, json.dumps(message).encode(), stamp, tick)
        log.finish()


def _json_numbers(values: AnyArray) -> list[Any]:
    """As JSON has them: what is no number is null."""
    numbers = values.astype(object)
    if values.dtype != bool:
        numbers[~np.isfinite(values)] = None
    return numbers.tolist()


FORMAT = ExportFormat("mcap", ".mcap", _write, needs=("mcap",))
