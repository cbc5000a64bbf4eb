"""Flight logs: readings and commands in a Parquet file, as the twin exports them and as a laboratory can write them (docs/replay.md)."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from models.dynamics.state_layout import ATTITUDE
from sim.bad_input import BadInput
from sim.loop.recording import Recording
from sim.replay.log_columns import LogColumns, columns_of

Array = NDArray[np.floating]

METADATA = b"nacs"
UNEVEN = 0.05  # greatest deviation of an interval from the period, as a share of it
UNIT = 0.01  # greatest deviation of a quaternion's length from one


@dataclass(frozen=True, eq=False)
class FlightLog:
    """Trials of equal length and period.

    Attributes:
      loop: of the scenario, whose log it is.
      dt: period, s.
      trials: their numbers, (trials,).
      time: s, (ticks, trials).
      reading: (ticks, trials, [agents,] m); a missing component is NaN.
      known: what filters are told of the drives from this tick to the next, (ticks, trials, [agents,] k): of a body with wheels torque of
        each motor on its wheel, N m.
      truth: true state (ticks, trials, [agents,] n), NaN where nobody knows it.
      fault: whether a fault is active, (ticks, trials); None: nobody knows.
    """

    loop: str
    dt: float
    trials: NDArray[np.int64]
    time: Array
    reading: Array
    known: Array
    truth: Array
    fault: NDArray[np.bool_] | None


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
    return _read(path)[1]


def read(path: Path, columns: LogColumns) -> list[FlightLog]:
    """Trials of a log in blocks of one loop, equal length and period.

    Raises:
      BadInput: one line with the file, and what is wrong where.
    """
    table, _ = _read(path)
    reading, known, truth = columns.all(columns.reading), columns.all(columns.known), columns.truth
    missing = [name for name in ("time_s", *reading, *known) if name not in table.column_names]
    if missing:
        raise BadInput(f"{path}: lacks columns {', '.join(missing)}; docs/replay.md says what a log holds")
    if not table.num_rows:
        raise BadInput(f"{path}: is empty")
    wanted = {"trial", "time_s", "dt", "truth_fault", *reading, *known, *truth}
    values = {name: _column(path, table, name, (*reading, *known)) for name in table.column_names if name in wanted}
    values.setdefault("trial", np.zeros(table.num_rows))
    loops = np.array(table["loop"].to_pylist()) if "loop" in table.column_names else np.full(table.num_rows, "loop")
    blocks: dict[tuple[str, int, float], list[dict[str, Array]]] = {}
    for loop in dict.fromkeys(loops.tolist()):
        for trial in np.unique(values["trial"][loops == loop]):
            rows = (values["trial"] == trial) & (loops == loop)
            one = {name: column[rows] for name, column in values.items()}
            label = f"{path}: trial {trial:g}" + (f" of loop {loop}" if len(set(loops.tolist())) > 1 else "")
            blocks.setdefault((loop, len(one["trial"]), _checked_period(label, one, columns)), []).append(one)
    return [_block(loop, dt, parts, columns) for (loop, _, dt), parts in blocks.items()]


def _read(path: Path) -> tuple[pa.Table, dict[str, Any]]:
    try:
        table = pq.read_table(path)
        return table, dict(json.loads((table.schema.metadata or {}).get(METADATA, b"{}")))
    except (OSError, pa.ArrowInvalid, ValueError, TypeError) as broken:
        raise BadInput(f"{path}: cannot be read as a log in Parquet: {str(broken).splitlines()[0]}") from None


def _column(path: Path, table: pa.Table, name: str, may_be_missing: tuple[str, ...]) -> Array:
    """A column as numbers, null being NaN."""
    try:
        values = table[name].cast(pa.float64()).to_numpy()
    except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
        raise BadInput(f"{path}: column {name} holds {table[name].type}, not numbers") from None
    wrong = np.isinf(values) if name in may_be_missing else ~np.isfinite(values) & (not name.startswith("truth_"))
    if wrong.any():
        raise BadInput(f"{path}: column {name}, row {int(np.flatnonzero(wrong)[0])}: must be a finite number")
    return np.asarray(values, dtype=float)


def _checked_period(label: str, one: dict[str, Array], columns: LogColumns) -> float:
    """Period of a trial, s; raises BadInput for what cannot be replayed."""
    time = one["time_s"]
    if len(time) < 2:
        raise BadInput(f"{label}: has a single row; needs two or more")
    interval = np.diff(time)
    if (interval <= 0.0).any():
        row = int(np.flatnonzero(interval <= 0.0)[0])
        raise BadInput(f"{label}: time_s does not grow: {time[row]:g} s is followed by {time[row + 1]:g} s")
    dt = float(one["dt"][0]) if "dt" in one else round(float(np.median(interval)), 9)  # times are sums of rounded numbers
    uneven = np.abs(interval - dt) > UNEVEN * dt
    if "dt" in one and (one["dt"] != dt).any():
        raise BadInput(f"{label}: dt changes from {dt:g} s to {one['dt'][one['dt'] != dt][0]:g} s; a filter is run at one period")
    if uneven.any():
        row = int(np.flatnonzero(uneven)[0])
        raise BadInput(
            f"{label}: interval of {interval[row]:g} s at {time[row]:g} s, the period is {dt:g} s; "
            f"intervals may differ by {100 * UNEVEN:g} % (a tick without reading is a row of NaN)"
        )
    if columns.unit_quaternion:
        length = np.sqrt(np.sum(np.stack([one[name] for name in columns.reading[ATTITUDE]]) ** 2, axis=0))
        if (np.abs(length - 1.0) > UNIT).any():
            row = int(np.flatnonzero(np.abs(length - 1.0) > UNIT)[0])
            raise BadInput(f"{label}: q1..q4 has length {length[row]:g} at {time[row]:g} s; needs a unit quaternion, scalar last")
    for name in columns.all(columns.known):
        if np.isnan(one[name][:-1]).any():
            raise BadInput(f"{label}: {name} is missing at {time[int(np.flatnonzero(np.isnan(one[name]))[0])]:g} s; 0 stands for no torque")
    return dt


def _block(loop: str, dt: float, parts: list[dict[str, Array]], columns: LogColumns) -> FlightLog:
    lead = columns.layout.lead

    def stack(names: tuple[str, ...]) -> Array:
        """(ticks, trials, [agents,] columns of one agent), NaN where a column is missing."""
        absent = np.full(len(parts[0]["trial"]), np.nan)
        flat = np.stack([np.stack([part.get(name, absent) for name in names], axis=-1) for part in parts], axis=1)
        return flat.reshape(*flat.shape[:2], *lead, -1)

    return FlightLog(
        loop=loop,
        dt=dt,
        trials=np.array([part["trial"][0] for part in parts], dtype=np.int64),
        time=np.stack([part["time_s"] for part in parts], axis=1),
        reading=stack(columns.all(columns.reading)),
        known=stack(columns.all(columns.known)),
        truth=stack(columns.truth),
        fault=np.stack([part["truth_fault"] for part in parts], axis=1) > 0.5 if "truth_fault" in parts[0] else None,
    )
