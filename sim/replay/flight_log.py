"""Flight logs: readings and commands in a Parquet file, as the twin exports them and as a laboratory can write them (docs/replay.md)."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from models.dynamics.state_layout import ATTITUDE
from sim.bad_input import BadInput
from sim.loop.recording import Recording
from sim.replay.log_columns import LogColumns, columns_of
from sim.replay.log_file import METADATA, LogFile
from sim.replay.time_stamps import intervals, merged, period

Array = NDArray[np.floating]

UNIT = 0.01  # greatest deviation of a quaternion's length from one


@dataclass(frozen=True, eq=False)
class FlightLog:
    """Trials of equal length and equal intervals.

    Attributes:
      loop: of the scenario, whose log it is.
      dt: period, s: the median of the intervals, if the log does not say another.
      trials: their numbers, (trials,).
      time: s, (ticks, trials).
      reading: (ticks, trials, [agents,] m); a missing component is NaN.
      known: what filters are told of the drives from this tick to the next, (ticks, trials, [agents,] k): of a body with wheels torque of
        each motor on its wheel, N m.
      truth: true state (ticks, trials, [agents,] n), NaN where nobody knows it.
      fault: whether a fault is active, (ticks, trials); None: nobody knows.
      intervals: seconds from the tick before to each tick, (ticks,); None: all are the period.
      notes: what was done to the rows that a user would not expect.
    """

    loop: str
    dt: float
    trials: NDArray[np.int64]
    time: Array
    reading: Array
    known: Array
    truth: Array
    fault: NDArray[np.bool_] | None
    intervals: Array | None = None
    notes: tuple[str, ...] = ()


def export(path: Path, recordings: dict[str, Recording], scenario: Any, name: str) -> None:
    """Write readings and commands of all loops' recordings, with the truth and the scenario that they come from."""
    columns = columns_of(scenario)
    tables = [_table(loop, recording, columns) for loop, recording in recordings.items()]
    about = {"scenario": name, "settings": scenario.model_dump(mode="json", exclude_none=True, by_alias=True)}
    pq.write_table(pa.concat_tables(tables).replace_schema_metadata({METADATA: json.dumps(about)}), path)


def _table(loop: str, recording: Recording, columns: LogColumns) -> pa.Table:
    ticks, trials = recording.ticks, len(recording.trials)

    def flat(channel: Array) -> Array:
        """(ticks, trials, ...) as (trials * ticks, ...)."""
        return np.swapaxes(channel, 0, 1).reshape(trials * ticks, -1)

    out: dict[str, Any] = {
        "loop": pa.array([loop] * (trials * ticks)),
        "trial": np.repeat(recording.trials, ticks),
        "tick": np.tile(np.arange(ticks), trials),
        "time_s": np.tile(recording.time, trials),
        "dt": np.full(trials * ticks, recording.dt),
    }
    parts = [
        (columns.all(columns.reading), recording.channels["reading"]),
        (columns.all(columns.known), columns.recorded(recording)),
        (columns.truth, recording.channels["truth/state"]),
    ]
    if "fault" in recording.channels:
        parts.append((("truth_fault",), recording.channels["fault"]))
    for names, channel in parts:
        out |= dict(zip(names, flat(channel).T, strict=True))
    return pa.table(
        {name: pa.array(values) if isinstance(values, pa.Array) else pa.array(np.ascontiguousarray(values)) for name, values in out.items()}
    )


def about(path: Path) -> dict[str, Any]:
    """What a log says of its scenario; nothing if it is a laboratory's.

    Raises:
      BadInput: the file is no log.
    """
    return LogFile.opened(path).about


def read(path: Path | LogFile, columns: LogColumns) -> list[FlightLog]:
    """Trials of a log in blocks of one loop, equal length and equal intervals.

    Raises:
      BadInput: one line with the file, and what is wrong where.
    """
    file = path if isinstance(path, LogFile) else LogFile.opened(path)
    values, loops = file.numbers(columns), file.loops()
    several = len(set(loops.tolist())) > 1
    blocks: dict[tuple[str, int, float, bytes], list[_Trial]] = {}
    for loop in dict.fromkeys(loops.tolist()):
        for trial in np.unique(values["trial"][loops == loop]):
            rows = (values["trial"] == trial) & (loops == loop)
            label = f"{file.path}: trial {trial:g}" + (f" of loop {loop}" if several else "")
            one = _trial(label, {name: column[rows] for name, column in values.items()}, columns)
            each = b"" if one.intervals is None else one.intervals.tobytes()
            blocks.setdefault((loop, len(one.columns["trial"]), one.dt, each), []).append(one)
    return [_block(key[0], trials, columns) for key, trials in blocks.items()]


class _Trial(NamedTuple):
    """What a block is made of."""

    columns: dict[str, Array]
    dt: float
    intervals: Array | None
    notes: tuple[str, ...]


def _trial(label: str, one: dict[str, Array], columns: LogColumns) -> _Trial:
    """One trial's rows, checked; raises BadInput for what cannot be replayed."""
    one, notes = merged(label, one)
    dt, time = period(label, one), one["time_s"]
    each = intervals(label, time, dt)
    if columns.unit_quaternion:
        length = np.sqrt(np.sum(np.stack([one[name] for name in columns.reading[ATTITUDE]]) ** 2, axis=0))
        if (np.abs(length - 1.0) > UNIT).any():
            row = int(np.flatnonzero(np.abs(length - 1.0) > UNIT)[0])
            raise BadInput(f"{label}: q1..q4 has length {length[row]:g} at {time[row]:g} s; needs a unit quaternion, scalar last")
    for name in columns.all(columns.known):
        if np.isnan(one[name][:-1]).any():
            raise BadInput(f"{label}: {name} is missing at {time[int(np.flatnonzero(np.isnan(one[name]))[0])]:g} s; 0 stands for no torque")
    return _Trial(one, dt, each, notes)


def _block(loop: str, trials: list[_Trial], columns: LogColumns) -> FlightLog:
    lead, parts = columns.layout.lead, [trial.columns for trial in trials]

    def stack(names: tuple[str, ...]) -> Array:
        """(ticks, trials, [agents,] columns of one agent), NaN where a column is missing."""
        absent = np.full(len(parts[0]["trial"]), np.nan)
        flat = np.stack([np.stack([part.get(name, absent) for name in names], axis=-1) for part in parts], axis=1)
        return flat.reshape(*flat.shape[:2], *lead, -1)

    return FlightLog(
        loop=loop,
        dt=trials[0].dt,
        trials=np.array([part["trial"][0] for part in parts], dtype=np.int64),
        time=np.stack([part["time_s"] for part in parts], axis=1),
        reading=stack(columns.all(columns.reading)),
        known=stack(columns.all(columns.known)),
        truth=stack(columns.truth),
        fault=np.stack([part["truth_fault"] for part in parts], axis=1) > 0.5 if "truth_fault" in parts[0] else None,
        intervals=trials[0].intervals,
        notes=tuple(note for trial in trials for note in trial.notes),
    )
