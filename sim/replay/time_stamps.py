"""Time stamps of a log as they are: even, jittering, with gaps, or twice the same."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.bad_input import BadInput
from sim.text.table_style import counted

Array = NDArray[np.floating]

ROUNDING = 1e-6  # share of the period by which intervals differ because stamps are rounded, and are still even
GAP = 1.5  # periods; a longer interval is predicted in several steps
LONGEST_GAP = 10_000  # periods, beyond which nothing of a prediction is left
AGREEING = 0.05  # greatest deviation of the median interval from a period that the log names, as a share of it


def merged(label: str, one: dict[str, Array]) -> tuple[dict[str, Array], tuple[str, ...]]:
    """A trial's columns with rows of the same instant made one, and what is to be said of it.

    Of two readings of a component the later one is taken; what only one of the rows has is kept.

    Raises:
      BadInput: time runs backwards.
    """
    time = one["time_s"]
    back = np.flatnonzero(np.diff(time) < 0.0)
    if len(back):
        row = int(back[0])
        raise BadInput(
            f"{label}: time_s runs backwards: {time[row]:.12g} s is followed by {time[row + 1]:.12g} s; "
            "sort the rows by time, and give flights of their own clock numbers in a column `trial`"
        )
    again = np.flatnonzero(np.diff(time) == 0.0)
    if not len(again):
        return one, ()
    first = np.concatenate([[True], np.diff(time) > 0.0])
    group = np.cumsum(first) - 1
    note = (
        f"{label}: {counted(len(again), 'row')} with the time stamp of the row before, first at {time[again[0]]:.12g} s; "
        "such rows are taken as one reading, of each component the latest"
    )
    return {name: _latest(column, group, int(group[-1]) + 1) for name, column in one.items()}, (note,)


def _latest(column: Array, group: NDArray[np.int64], groups: int) -> Array:
    """The last number of each group of rows, NaN where it has none; (rows,) to (groups,)."""
    out = np.full(groups, np.nan)
    there = np.flatnonzero(~np.isnan(column))
    out[group[there]] = column[there]  # of indices that come again the last one counts
    return out


def period(label: str, one: dict[str, Array]) -> float:
    """Nominal interval of a trial, s: what the log says, or the median of its intervals.

    Raises:
      BadInput: there is none, or it is not that of the time stamps.
    """
    time = one["time_s"]
    if len(time) < 2:
        raise BadInput(f"{label}: has a single row; needs two or more")
    resolution = max(1e-9, 4.0 * float(np.spacing(np.max(np.abs(time)))))  # times are sums of rounded numbers
    median = round(float(np.median(np.diff(time))), int(-np.log10(resolution)))
    if "dt" not in one:
        if median <= 0.0:
            raise BadInput(f"{label}: time_s grows by less than {resolution:.0e} s a row; it is to be in seconds")
        return median
    dt = float(one["dt"][0])
    if (one["dt"] != dt).any():
        raise BadInput(f"{label}: dt changes from {dt:g} s to {one['dt'][one['dt'] != dt][0]:g} s; it is one period, and may be left out")
    if dt <= 0.0 or abs(median - dt) > AGREEING * dt:
        raise BadInput(f"{label}: dt says {dt:g} s, but time_s grows by {median:g} s; both are to be in seconds, and dt may be left out")
    return dt


def intervals(label: str, time: Array, dt: float) -> Array | None:
    """Seconds from each row's predecessor to it, (rows,), the first being the period; None: all are the period.

    Raises:
      BadInput: a gap is too long to be predicted.
    """
    each = np.diff(time)
    rounding = ROUNDING * dt + 4.0 * float(np.spacing(np.max(np.abs(time))))
    if (np.abs(each - dt) <= rounding).all():
        return None
    if (each > LONGEST_GAP * dt).any():
        row = int(np.flatnonzero(each > LONGEST_GAP * dt)[0])
        raise BadInput(
            f"{label}: nothing was read for {each[row]:g} s after {time[row]:.12g} s, {each[row] / dt:.0f} periods; "
            "give what follows a `trial` number of its own"
        )
    return np.concatenate([[dt], each])


def without_gaps(log: Any) -> tuple[Any, NDArray[np.bool_]]:
    """A log with rows of nothing read where intervals are longer than the period, and which of its rows, (ticks,), are the log's own.

    The models are so stepped about as far at a time as in between; commands are held.
    """
    steps = np.ones(len(log.time), dtype=int) if log.intervals is None else np.maximum(1, np.round(log.intervals / log.dt).astype(int))
    if log.intervals is not None:
        steps[log.intervals <= GAP * log.dt] = 1
    if (steps == 1).all():
        return log, np.ones(len(log.time), dtype=bool)
    own = np.zeros(int(np.sum(steps)), dtype=bool)
    own[np.cumsum(steps) - 1] = True
    before = np.maximum(0, np.cumsum(own) - 1)  # the row whose command is held
    before[own] = np.arange(len(steps))

    def spread(array: Array) -> Array:
        out = np.full((len(own), *array.shape[1:]), np.nan)
        out[own] = array
        return out

    filled = replace(
        log,
        time=spread(log.time),
        reading=spread(log.reading),
        known=log.known[before],
        truth=spread(log.truth),
        fault=None if log.fault is None else log.fault[before],
        intervals=np.repeat(log.intervals / steps, steps),
    )
    return filled, own
