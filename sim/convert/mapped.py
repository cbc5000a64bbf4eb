"""A laboratory's columns, by a map, as the table of a flight log."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from models.attitude import quaternion
from models.dynamics.state_layout import ATTITUDE, RATE, WHEELS
from sim.bad_input import BadInput
from sim.convert.axes import BODY, WORLD, as_quaternion, axes
from sim.convert.map_file import AttitudeMap, ColumnsMap, CommandMap, LogMap, OneColumn, RateMap, TimeMap
from sim.convert.source import Source
from sim.convert.units import factor, quantity_of
from sim.replay.log_columns import LogColumns
from sim.replay.log_file import METADATA
from sim.scenario import files

Array = NDArray[np.floating]

OF_ONE_BODY = ("attitude", "rate", "wheels", "command")  # parts of a map that only logs of one body have


class Group(NamedTuple):
    """Columns of a flight log that one part of a map is about.

    Attributes:
      key: of the map.
      names: of the log's columns.
      section: what the map says; None: nothing.
      absent: what stands where nobody read anything, or told the drives anything.
    """

    key: str
    names: tuple[str, ...]
    section: Any
    absent: float = np.nan


@dataclass(frozen=True, eq=False)
class Mapping:
    """A file, and how it is to be read.

    Attributes:
      source: the file.
      said: the map.
      label: of the map, for complaints.
      log: the columns that the log needs.
      loop: whose log it is to be.
    """

    source: Source
    said: LogMap
    label: str
    log: LogColumns
    loop: str = "loop"

    @cached_property
    def _flights(self) -> Array | None:
        """Numbers of the rows' flights; None: there is one."""
        return self._column("trial", self.said.trial) if self.said.trial else None

    def table(self) -> pa.Table:
        """The flight log; raises BadInput for what the map lacks, or names and the file has not."""
        trial = self._flights
        found = dict(self._parts())
        first, rows = self._length(found if trial is None else {"trial": trial} | found)
        time = self._time(rows, trial)
        if len(time) != rows:
            raise BadInput(f"{self.label}: time has {len(time)} rows, {first} has {rows}; all columns of a log are of one length")
        head = {"loop": pa.array([self.loop] * rows), "time_s": pa.array(time)}
        if trial is not None:
            head["trial"] = pa.array(trial)
        if self.said.time.period_s is not None:
            head["dt"] = pa.array(np.full(rows, self.said.time.period_s))
        whole = head | {name: pa.array(np.ascontiguousarray(np.broadcast_to(values, (rows,)))) for name, values in found.items()}
        return pa.table(whole).replace_schema_metadata({METADATA: json.dumps(self._about())})

    @property
    def unused(self) -> list[str]:
        """Columns of the file that the map does not name."""
        named = set(_texts(self.said.model_dump()))
        return [name for name in self.source.columns if name not in named]

    def _about(self) -> dict[str, Any]:
        """What the log says of itself: where it comes from, and the scenario if the map names one."""
        about: dict[str, Any] = {"converted": {"from": self.source.path.name, "map": self.said.model_dump(mode="json", exclude_none=True)}}
        if self.said.scenario is not None:
            about |= {"scenario": self.said.scenario, "settings": files.dumped(files.load(self.said.scenario))}
        return about

    def _groups(self) -> tuple[Group, ...]:
        """Of one body; of several, `columns` says all."""
        if not self.log.unit_quaternion:
            return ()
        said, layout = self.said, self.log.layout.names
        truth = tuple(f"truth_{name}" for name in layout)
        return (
            Group("attitude", layout[ATTITUDE], said.attitude),
            Group("rate", layout[RATE], said.rate),
            Group("wheels", layout[WHEELS], said.wheels),
            Group("command", self.log.known, said.command, absent=0.0),
            Group("truth_attitude", truth[ATTITUDE], said.truth_attitude),
            Group("truth_rate", truth[RATE], said.truth_rate),
            Group("truth_wheels", truth[WHEELS], said.truth_wheels),
        )

    def _parts(self) -> Iterator[tuple[str, Any]]:
        """Columns of the log, (rows,) or a number each."""
        groups = self._groups()
        own = {name for group in groups for name in group.names}
        for key in OF_ONE_BODY if not groups else ():
            if getattr(self.said, key) is not None:
                raise BadInput(f"{self.label}: {key}: is of one body; of {self.log.plant} name each column in [columns]")
        for group in groups:
            yield from self._group(group)
        wanted = {*self.log.all(self.log.reading), *self.log.all(self.log.known), *self.log.truth} - own
        for name, one in self.said.columns.items():
            if name not in wanted:
                known = f"there are {', '.join(sorted(wanted))}" if wanted else "attitude, rate, wheels and command say all there is"
                raise BadInput(f"{self.label}: columns.{name}: is no such column of the log; {known}")
            yield name, self._one(name, one)
        needed = [*self.log.all(self.log.reading), *self.log.all(self.log.known)]
        if missing := [name for name in needed if name not in own and name not in self.said.columns]:
            raise BadInput(f"{self.label}: columns: lacks {', '.join(missing)}")
        if self.said.truth_fault is not None:
            yield "truth_fault", self._column("truth_fault", self.said.truth_fault)

    def _group(self, group: Group) -> Iterator[tuple[str, Any]]:
        """The columns of one part of the map."""
        section = group.section
        if section is None and group.names and not group.key.startswith("truth"):
            raise BadInput(f'{self.label}: {group.key}: is missing; name its columns, or say {group.key} = "none" if there are none')
        if section is None or section == "none":
            if section == "none":
                yield from ((name, group.absent) for name in group.names)
            return
        if len(section.columns) != len(group.names):
            said = f"has {len(section.columns)} columns, {self.log.plant} has {len(group.names)}: {', '.join(group.names) or 'none'}"
            raise BadInput(f"{self.label}: {group.key}: {said}")
        yield from zip(group.names, self._values(group, section).T, strict=True)

    def _values(self, group: Group, section: AttitudeMap | ColumnsMap) -> Array:
        """Numbers of a part in the log's units and axes, (rows, columns)."""
        if twice := [name for name in section.columns if section.columns.count(name) > 1]:
            raise BadInput(f"{self.label}: {group.key}.columns: names {twice[0]!r} twice")
        hold = isinstance(section, ColumnsMap) and section.hold
        columns = [self._column(f"{group.key}.columns", name, hold) for name in section.columns]
        if len({len(column) for column in columns}) > 1:
            raise BadInput(f"{self.label}: {group.key}.columns: have {', '.join(str(len(column)) for column in columns)} rows")
        values = np.stack(columns, axis=-1) * np.array(section.sign or 1.0)
        if isinstance(section, AttitudeMap):
            return attitude(section, section.unit * values)
        values = factor(section.quantity, section.unit) * values
        if isinstance(section, RateMap | CommandMap):
            turn = axes(section.body, BODY)
            if isinstance(section, CommandMap) and group.names[0].startswith("command"):
                if (turn != np.eye(3)).any():
                    raise BadInput(f"{self.label}: {group.key}.body: motor torques are about the wheels' own axes; leave it out")
                return values
            return values if (turn == np.eye(3)).all() else values @ turn.T
        return values

    def _one(self, name: str, one: OneColumn) -> Array:
        """A column of the log that has no part of its own."""
        values = self._column(f"columns.{name}.column", one.column, one.hold)
        try:
            return one.sign * (1.0 if one.unit is None else factor(quantity_of(name), one.unit)) * values
        except ValueError as unknown:
            raise BadInput(f"{self.label}: columns.{name}.unit: {unknown}") from None

    def _column(self, key: str, name: str, hold: bool = False) -> Array:
        """Numbers of a column of the file, those that stand for nothing being NaN."""
        try:
            values = self.source.numbers(name)
        except BadInput as absent:
            raise BadInput(f"{self.label}: {key}: {absent}") from None
        values = np.where(np.isin(values, self.said.missing), np.nan, values) if self.said.missing else values
        if hold:
            rows = np.arange(len(values))
            there = np.maximum.accumulate(np.where(np.isnan(values), -1, rows))
            flights = self._flights
            first = 0 if flights is None or len(flights) != len(rows) else _first(flights)  # another length is told later
            values = np.where(there < first, np.nan, values[there])
        return values

    def _length(self, found: dict[str, Any]) -> tuple[str, int]:
        """A column that the file has, and the rows of all."""
        lengths = {name: len(values) for name, values in found.items() if np.ndim(values)}
        if not lengths:
            raise BadInput(f"{self.label}: names no column with a reading")
        first, rows = next(iter(lengths.items()))
        if other := next((name for name, length in lengths.items() if length != rows), None):
            raise BadInput(f"{self.label}: {first} has {rows} rows, {other} has {lengths[other]}; all columns of a log are of one length")
        return first, rows

    def _time(self, rows: int, trial: Array | None) -> Array:
        """Instants of the rows, s."""
        said = self.said.time
        if said.rate_hz is not None:
            return _within(trial, np.arange(rows)) / said.rate_hz
        assert said.column is not None, "a map has the one or the other"
        try:
            stamps = self.source.whole(said.column)
        except BadInput as absent:
            raise BadInput(f"{self.label}: time.column: {absent}") from None
        return seconds(stamps, said, trial)


def attitude(section: AttitudeMap, columns: Array) -> Array:
    """q_BN, scalar last, of quaternions as a map says they are; (..., 4) each."""
    q = np.roll(columns, -1, axis=-1) if section.order == "scalar-first" else columns
    q = quaternion.inverse(q) if section.direction == "q_NB" else q
    body, world = axes(section.body, BODY), axes(section.world, WORLD)
    if (body != np.eye(3)).any():
        q = quaternion.multiply(as_quaternion(body), q)
    if (world != np.eye(3)).any():
        q = quaternion.multiply(q, quaternion.inverse(as_quaternion(world)))
    return q


def seconds(stamps: Any, said: TimeMap, trial: Array | None = None) -> Array:
    """Stamps of a clock, (rows,), in seconds after its offset; whole numbers are subtracted as such, so that no digit of them is lost."""
    whole = stamps.dtype.kind in "iu"
    stamps = stamps.astype(np.int64) if whole else stamps
    if said.offset == "first":
        stamps = stamps - (stamps[:1] if trial is None else stamps[_first(trial)])
    elif said.offset:
        exact = whole and abs(said.offset) < 2**63 and said.offset == int(said.offset)
        stamps = stamps - (np.int64(said.offset) if exact else float(said.offset))
    return factor("time", said.unit) * np.asarray(stamps, dtype=float)


def _first(trial: Array) -> NDArray[np.int64]:
    """The first row of each row's trial, (rows,)."""
    _, first, number = np.unique(trial, return_index=True, return_inverse=True)
    return first[number]


def _within(trial: Array | None, rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number of each row in its trial, (rows,)."""
    return rows if trial is None else rows - _first(trial)


def _texts(value: Any) -> Iterator[str]:
    """All texts in a map."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for part in value.values():
            yield from _texts(part)
    elif isinstance(value, list | tuple):
        for part in value:
            yield from _texts(part)
