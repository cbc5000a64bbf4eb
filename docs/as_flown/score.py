"""Runs of the four scenarios held against the printed tables: `python -m docs.as_flown score FOLDER SEED ...`, of FOLDER/SEED-CASE."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from numpy.typing import NDArray

from docs.as_flown.causes import TABLES
from docs.as_flown.emulator import COMPARED, printed
from docs.as_flown.flights import FILTERS, STATES

Array = NDArray[np.floating]

OF_SUMS, OF_VALUES, OF_ORDER = 0.20, 0.30, 0.06  # relative: what is near, and what printed sums must differ by to have an order


def means(path: Path) -> dict[tuple[str, str], float]:
    """Mean over the trials of every metric of a run, by subject and metric."""
    table = pq.read_table(path / "trials.parquet").to_pydict()
    each: dict[tuple[str, str], list[float]] = {}
    for subject, metric, phase, value in zip(*(table[key] for key in ("subject", "metric", "phase", "value")), strict=True):
        if phase == "all" and value is not None and np.isfinite(value):
            each.setdefault((subject, metric), []).append(value)
    return {key: float(np.mean(values)) for key, values in each.items()}


def pairs_in_order(sums: Array, as_printed: Array) -> tuple[int, int, list[str]]:
    """Pairs that stand as printed, of how many whose printed sums (filters,) differ by more than OF_ORDER; and those that do not."""
    right, count, wrong = 0, 0, []
    for one, other in combinations(np.argsort(as_printed), 2):
        if as_printed[other] > (1.0 + OF_ORDER) * as_printed[one]:
            count += 1
            right += int(sums[other] > sums[one])
            wrong += [] if sums[other] > sums[one] else [f"{FILTERS[one]} < {FILTERS[other]}"]
    return right, count, wrong


def score(folder: Path, seeds: Sequence[str]) -> Iterator[str]:
    """Lines: of every seed and case sums, errors against the truth, saturation; and how many are near print."""
    for seed in seeds:
        near_sums = near_values = ordered = pairs = 0
        for case, as_printed in zip(TABLES, printed(), strict=True):
            found = means(folder / f"{seed}-{case}")
            values = np.array([[found[f, f"rmse_residual_{state}"] for state in STATES] for f in FILTERS])
            sums, wanted = values.sum(axis=-1), as_printed.sum(axis=-1)
            truth = [1e3 * sum(found[f, f"rmse_truth_omega{i}"] for i in (1, 2, 3)) for f in FILTERS]
            near = np.abs(values / as_printed - 1.0)[:, COMPARED] < OF_VALUES
            right, count, wrong = pairs_in_order(sums, wanted)
            near_sums, near_values = near_sums + int(np.sum(np.abs(sums / wanted - 1.0) < OF_SUMS)), near_values + int(near.sum())
            ordered, pairs = ordered + right, pairs + count
            alarms = " ".join(f"{100.0 * found.get((f, 'false_alarm_fraction'), np.nan):.1f}" for f in FILTERS[2:])
            yield (
                f"{seed} {case}: sums {_list(1e3 * sums)} over print {_list(sums / wanted)}; values near {near.sum()} of 24; "
                f"order {right} of {count} {wrong}; truth, mrad/s {_list(np.array(truth), 1)}; "
                f"saturated {found['loop', 'saturated_time_s']:.1f} s; false alarms, % {alarms}"
            )
        yield f"{seed}: {near_sums} of 16 sums, {near_values} of 96 values, {ordered} of {pairs} pairs in order"


def _list(values: Array, digits: int = 2) -> str:
    return " ".join(f"{value:.{digits}f}" for value in values)
