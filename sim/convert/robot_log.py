"""Columns of an MCAP log whose messages are JSON: the numbers of every topic, a row at each instant at which any was written."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.bad_input import BadInput
from sim.convert.map_file import FileMap

STAMP = "log_time"


def columns(path: Path, file: FileMap) -> dict[str, NDArray[Any]]:  # noqa: ARG001  # readers share one signature
    """`/imu.gyro.x` is a number of the messages of `/imu`, NaN where it said nothing; `log_time` is in ns. Raises BadInput."""
    from mcap.exceptions import McapError  # noqa: PLC0415  # of an extra
    from mcap.reader import make_reader  # noqa: PLC0415

    found: dict[str, dict[int, float]] = {}
    foreign = set[str]()
    try:
        with path.open("rb") as log:
            for _, channel, message in make_reader(log).iter_messages():
                if channel.message_encoding != "json":
                    foreign.add(f"{channel.topic} ({channel.message_encoding})")
                    continue
                for name, number in _numbers(channel.topic, json.loads(message.data)):
                    found.setdefault(name, {})[message.log_time] = number
    except (McapError, ValueError, RecursionError, OverflowError) as broken:
        raise BadInput(f"{path}: cannot be read as MCAP: {(str(broken).splitlines() or [type(broken).__name__])[0]}") from None
    if not found and foreign:
        raise BadInput(f"{path}: its messages are not JSON: {', '.join(sorted(foreign))}; convert them, or write CSV")
    stamps = np.array(sorted({stamp for column in found.values() for stamp in column}), dtype=np.int64)
    out: dict[str, NDArray[Any]] = {STAMP: stamps} if found else {}
    for name, column in found.items():
        out[name] = np.full(len(stamps), np.nan)
        out[name][np.searchsorted(stamps, np.fromiter(column, dtype=np.int64))] = np.fromiter(column.values(), dtype=float)
    return out


def _numbers(name: str, value: Any) -> Iterator[tuple[str, float]]:
    """All numbers in a message; of a list each, counted from one."""
    if isinstance(value, dict):
        for key, part in value.items():
            yield from _numbers(f"{name}.{key}", part)
    elif isinstance(value, list):
        for number, part in enumerate(value, 1):
            yield from _numbers(f"{name}({number})", part)
    elif isinstance(value, int | float):
        yield name, float(value)
