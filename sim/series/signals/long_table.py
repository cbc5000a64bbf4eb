"""Signals as a long table in a Parquet file: a row for each loop, trial, agent and instant, a column for each number."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from sim.bad_input import BadInput
from sim.parts import AnyArray
from sim.series.signals.signal import AGENT, TIME, TRIAL, Axis, LoopSignals, Signal, Signals

LOOP, TIME_S = "loop", "time_s"
METADATA = b"nacs_signals"
ROWS = 1 << 16  # of a row group, at most


def write(path: Path, signals: Signals, name: str) -> None:
    """Write all signals of a run, which is of the scenario `name`; one trial after another, so that no more than one is in memory twice."""
    schema = table_schema(signals, name)
    options: dict[str, Any] = {"compression": "zstd", "use_dictionary": [LOOP], "write_statistics": [LOOP, TRIAL, TIME_S]}
    with pq.ParquetWriter(path, schema, **options) as file:
        for table in tables(signals, schema):
            file.write_table(table, row_group_size=ROWS)


def tables(signals: Signals, schema: pa.Schema) -> Iterator[pa.Table]:
    """The long table in pieces of a few trials each."""
    for loop in signals.loops.values():
        yield from _batches(loop, schema)


def table_schema(signals: Signals, name: str) -> pa.Schema:
    """Columns of the long table, with unit, frame and meaning of each."""
    agents = any(loop.agents is not None for loop in signals.loops.values())
    keys = [
        pa.field(LOOP, pa.string(), metadata={"meaning": "closed loop"}),
        pa.field(TRIAL, pa.int64(), metadata={"meaning": "number of the trial"}),
        *([pa.field(AGENT, pa.int64(), metadata={"meaning": "number of the agent, from one"})] if agents else []),
        pa.field(TIME_S, pa.float64(), metadata={"unit": "s", "meaning": "since the start"}),
    ]
    columns = [
        pa.field(
            column,
            pa.bool_() if signal.values.dtype == bool else pa.float64(),
            metadata={"unit": signal.unit, "frame": signal.frame, "meaning": signal.meaning, "signal": signal.name},
        )
        for column, signal in signals.columns.items()
    ]
    return pa.schema([*keys, *columns], metadata={METADATA: json.dumps(_about(signals, name))})


def _about(signals: Signals, name: str) -> dict[str, Any]:
    """What is needed to put signals together again."""
    loops = {
        loop.loop: {
            "trials": loop.trials.tolist(),
            "agents": loop.agents,
            "ticks": len(loop.time),
            "signals": {one.name: _said(one) for one in loop},
        }
        for loop in signals.loops.values()
    }
    return {"scenario": name, "family": signals.family, "loops": loops}


def _said(signal: Signal) -> dict[str, Any]:
    axes = {axis.name: axis.labels for axis in signal.axes}
    own = {key: getattr(signal, key) for key in ("dims", "stem", "unit", "frame", "meaning", "channel")}
    return {**own, "axes": axes}


def _batches(loop: LoopSignals, schema: pa.Schema) -> Iterator[pa.Table]:
    """Tables of as many trials as fill a row group."""
    ticks, agents = len(loop.time), max(1, len(loop.agent_numbers))
    each = max(1, ROWS // max(1, ticks * agents))
    for trials in np.split(np.arange(len(loop.trials)), np.arange(each, len(loop.trials), each)):
        shape = (len(trials), agents, ticks)
        keys: dict[str, Any] = {
            LOOP: pa.DictionaryArray.from_arrays(pa.array(np.zeros(np.prod(shape), dtype=np.int32)), pa.array([loop.loop])).cast(
                pa.string()
            ),
            TRIAL: np.broadcast_to(loop.trials[trials, None, None], shape).ravel(),
            AGENT: np.broadcast_to(np.maximum(1, loop.agent_numbers[None, :, None]) if loop.agents else 1, shape).ravel(),
            TIME_S: np.broadcast_to(loop.time, shape).ravel(),
        }
        numbers = {column: _rows(signal, values, trials, shape) for signal in loop for column, values in signal.scalars()}
        found = keys | numbers
        yield pa.table([found.get(field.name, pa.nulls(int(np.prod(shape)), field.type)) for field in schema], schema=schema)


def _rows(signal: Signal, values: AnyArray, trials: NDArray[np.int64], shape: tuple[int, ...]) -> NDArray[Any]:
    """Values of a column by trial, agent and time, (rows,); what has no axis of trials or agents is the same for all."""
    if TRIAL in signal.dims:
        values = values[trials]
        values = values if AGENT in signal.dims else values[:, None]
    return np.broadcast_to(values, shape).ravel()


def read(path: Path) -> Signals:
    """All signals of a file that `write` made.

    Raises:
      BadInput: the file is none.
    """
    try:
        table = pq.read_table(path)
        about = json.loads((table.schema.metadata or {})[METADATA])
    except (OSError, pa.ArrowException, KeyError, ValueError) as wrong:
        raise BadInput(f"{path}: is no file of signals that `nacs run` wrote ({_first_line(wrong)})") from None
    columns = {name: table[name] for name in table.column_names}
    loops, start = {}, 0
    for name, one in about["loops"].items():
        shape = (len(one["trials"]), one["agents"] or 1, one["ticks"])
        rows = slice(start, start + int(np.prod(shape)))
        own = {column: values.slice(rows.start, rows.stop - rows.start) for column, values in columns.items()}
        if rows.stop > table.num_rows:
            raise BadInput(f"{path}: has {table.num_rows} rows, which end within loop {name}; it is not as `nacs run` wrote it")
        time = own[TIME_S].to_numpy().reshape(shape)[0, 0]
        signals = {signal: _put_together(signal, said, own, shape) for signal, said in one["signals"].items()}
        loops[name] = LoopSignals(name, time, np.array(one["trials"], dtype=np.int64), one["agents"], signals)
        start = rows.stop
    return Signals(about["family"], loops)


def _put_together(name: str, said: dict[str, Any], columns: dict[str, pa.ChunkedArray], shape: tuple[int, ...]) -> Signal:
    axes, dims = tuple(Axis(axis, tuple(labels)) for axis, labels in said["axes"].items()), tuple(said["dims"])
    frame = Signal(name, np.empty(0), dims, axes, said["stem"], said["unit"], said["frame"], said["meaning"], said["channel"])
    whole = np.stack([columns[column].to_numpy().reshape(shape) for column in frame.columns], axis=-1)
    values = whole if AGENT in dims else whole[:, 0]
    if TRIAL not in dims:
        values = values[0]
    values = values.reshape(*values.shape[: dims.index(TIME) + 1], *(len(axis.labels) for axis in axes))
    return Signal(name, values, dims, axes, said["stem"], said["unit"], said["frame"], said["meaning"], said["channel"])


def _first_line(wrong: Exception) -> str:
    return "it lacks the description of its signals" if isinstance(wrong, KeyError) else str(wrong).splitlines()[0]
