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

from sim.bad_input import BadInput
from sim.loop.recording import Recording
from sim.scenario.one_body import Scenario

Array = NDArray[np.floating]

WHEELS = 4
STATES = ("q1", "q2", "q3", "q4", "omega1", "omega2", "omega3", *(f"wheel{i + 1}" for i in range(WHEELS)))
COMMANDS = tuple(f"command{i + 1}" for i in range(WHEELS))
TRUTHS = tuple(f"truth_{name}" for name in STATES)
METADATA = b"nacs"
UNEVEN = 0.05  # greatest deviation of an interval from the period, as a share of it
UNIT = 0.01  # greatest deviation of a quaternion's length from one


@dataclass(frozen=True, eq=False)
class FlightLog:
    """Trials of equal length and period.

    Attributes:
      dt: period, s.
      trials: their numbers, (trials,).
      time: s, (ticks, trials).
      reading: (ticks, trials, n); a missing component is NaN.
      command: torque of each motor on its wheel from this tick to the next, (ticks, trials, wheels) N m.
      truth: true state (ticks, trials, n), NaN where nobody knows it.
      fault: whether a fault is active, (ticks, trials); None: nobody knows.
    """

    dt: float
    trials: NDArray[np.int64]
    time: Array
    reading: Array
    command: Array
    truth: Array
    fault: NDArray[np.bool_] | None


def export(path: Path, recording: Recording, scenario: Scenario, name: str) -> None:
    """Write the readings and commands of a recording, with the truth and the scenario that they come from."""
    ticks, trials = recording.ticks, len(recording.trials)

    def flat(channel: Array) -> Array:
        """(ticks, trials, ...) as (trials * ticks, ...)."""
        return np.swapaxes(channel, 0, 1).reshape(trials * ticks, -1)

    columns: dict[str, Array] = {
        "trial": np.repeat(recording.trials, ticks),
        "tick": np.tile(np.arange(ticks), trials),
        "time_s": np.tile(recording.time, trials),
        "dt": np.full(trials * ticks, recording.dt),
    }
    for names, channel in ((STATES, "reading"), (COMMANDS, "command"), (TRUTHS, "truth/state"), (("truth_fault",), "fault")):
        columns |= dict(zip(names, flat(recording.channels[channel]).T, strict=True))
    about = {"scenario": name, "settings": scenario.model_dump(mode="json", exclude_none=True)}
    table = pa.table({name: pa.array(np.ascontiguousarray(values)) for name, values in columns.items()})
    pq.write_table(table.replace_schema_metadata({METADATA: json.dumps(about)}), path)


def read(path: Path) -> tuple[list[FlightLog], dict[str, Any]]:
    """Trials of a log in blocks of equal length and period, and what the log says of its scenario (nothing if it is a laboratory's).

    Raises:
      BadInput: one line with the file, and what is wrong where.
    """
    try:
        table = pq.read_table(path)
        about = dict(json.loads((table.schema.metadata or {}).get(METADATA, b"{}")))
    except (OSError, pa.ArrowInvalid, ValueError, TypeError) as broken:
        raise BadInput(f"{path}: cannot be read as a log in Parquet: {str(broken).splitlines()[0]}") from None
    missing = [name for name in ("time_s", *STATES, *COMMANDS) if name not in table.column_names]
    if missing:
        raise BadInput(f"{path}: lacks columns {', '.join(missing)}; docs/replay.md says what a log holds")
    if not table.num_rows:
        raise BadInput(f"{path}: is empty")
    columns = {name: _column(path, table, name) for name in table.column_names if name in _KNOWN}
    columns.setdefault("trial", np.zeros(table.num_rows))
    blocks: dict[tuple[int, float], list[dict[str, Array]]] = {}
    for trial in np.unique(columns["trial"]):
        rows = columns["trial"] == trial
        one = {name: values[rows] for name, values in columns.items()}
        blocks.setdefault((len(one["trial"]), _checked_period(f"{path}: trial {trial:g}", one)), []).append(one)
    return [_block(dt, parts) for (_, dt), parts in blocks.items()], about


_KNOWN = {"trial", "time_s", "dt", *STATES, *COMMANDS, *TRUTHS, "truth_fault"}


def _column(path: Path, table: pa.Table, name: str) -> Array:
    """A column as numbers, null being NaN."""
    try:
        values = table[name].cast(pa.float64()).to_numpy()
    except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
        raise BadInput(f"{path}: column {name} holds {table[name].type}, not numbers") from None
    wrong = np.isinf(values) if name in (*STATES, *COMMANDS) else ~np.isfinite(values) & (not name.startswith("truth_"))
    if wrong.any():
        raise BadInput(f"{path}: column {name}, row {int(np.flatnonzero(wrong)[0])}: must be a finite number")
    return np.asarray(values, dtype=float)


def _checked_period(label: str, one: dict[str, Array]) -> float:
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
    length = np.sqrt(np.sum(np.stack([one[name] for name in STATES[:4]]) ** 2, axis=0))
    if (np.abs(length - 1.0) > UNIT).any():
        row = int(np.flatnonzero(np.abs(length - 1.0) > UNIT)[0])
        raise BadInput(f"{label}: q1..q4 has length {length[row]:g} at {time[row]:g} s; needs a unit quaternion, scalar last")
    for name in COMMANDS:
        if np.isnan(one[name][:-1]).any():
            raise BadInput(f"{label}: {name} is missing at {time[int(np.flatnonzero(np.isnan(one[name]))[0])]:g} s; 0 stands for no torque")
    return dt


def _block(dt: float, parts: list[dict[str, Array]]) -> FlightLog:
    def stack(names: tuple[str, ...]) -> Array:
        """(ticks, trials, len(names)), NaN where a column is missing."""
        absent = np.full(len(parts[0]["trial"]), np.nan)
        return np.stack([np.stack([part.get(name, absent) for name in names], axis=-1) for part in parts], axis=1)

    return FlightLog(
        dt=dt,
        trials=np.array([part["trial"][0] for part in parts], dtype=np.int64),
        time=stack(("time_s",))[..., 0],
        reading=stack(STATES),
        command=stack(COMMANDS),
        truth=stack(TRUTHS),
        fault=stack(("truth_fault",))[..., 0] > 0.5 if "truth_fault" in parts[0] else None,
    )
