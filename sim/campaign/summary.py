"""What a campaign says: distributions, who beats whom, detection against false alarm, consistency, the worst trials."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray
from scipy.stats import binomtest, bootstrap, chi2

from sim.campaign.shard import FIXED_POINT

Array = NDArray[np.floating]

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
RESAMPLES = 500
ROWS_AT_ONCE = 5_000_000


class Distribution(NamedTuple):
    """A metric over the trials of a point to which it applies."""

    point: int
    subject: str
    metric: str
    phase: str
    unit: str
    trials: NDArray[np.int64]
    values: Array


def distributions(trials: Path, point: int) -> Iterator[Distribution]:
    """Metrics of a point, in the order in which trials have them; some at a time, so that memory does not grow with the trials."""
    here = [("point", "=", point)]
    names = pq.read_table(trials, columns=["subject", "metric", "phase", "unit"], filters=here)
    keys = names.group_by(names.column_names, use_threads=False).aggregate([]).to_pylist()
    subjects = list(dict.fromkeys(row["subject"] for row in keys))
    passes = [subjects] if len(names) <= ROWS_AT_ONCE else [[subject] for subject in subjects]
    for some in passes:
        table = pq.read_table(trials, columns=["trial", "subject", "metric", "phase", "value"], filters=[*here, ("subject", "in", some)])
        codes = [table[name].combine_chunks().dictionary_encode() for name in ("subject", "metric", "phase")]
        code = np.zeros(len(table), dtype=np.int64)
        for one in codes:
            code = code * len(one.dictionary) + np.asarray(one.indices)
        order = np.argsort(code, kind="stable")
        edges = np.flatnonzero(np.diff(code[order], prepend=-1, append=np.iinfo(np.int64).max))
        found = {}
        number, value = np.asarray(table["trial"])[order], np.asarray(table["value"])[order]
        for start, stop in itertools.pairwise(edges):
            first = order[start]
            found[tuple(one.dictionary[int(one.indices[int(first)].as_py())].as_py() for one in codes)] = slice(start, stop)
        for row in keys:
            if row["subject"] in some:
                part = found[row["subject"], row["metric"], row["phase"]]
                yield Distribution(point=point, **row, trials=number[part], values=value[part])


def summarize(found: Distribution, seed: int) -> dict[str, Any]:
    """A row of `summary.json`: statistics, quantiles and the 95 % bootstrap interval of the mean."""
    values = found.values
    row: dict[str, Any] = {"point": found.point, "subject": found.subject, "metric": found.metric, "phase": found.phase, "unit": found.unit}
    row |= {"mean": float(values.mean()), "std": float(values.std(ddof=1)) if len(values) > 1 else 0.0}
    row |= {"min": float(values.min()), "max": float(values.max()), "n": len(values)}
    row |= {f"q{100 * q:02.0f}": float(v) for q, v in zip(QUANTILES, np.quantile(values, QUANTILES), strict=True)}
    low = high = row["mean"]
    if np.ptp(values) > 0:
        interval = bootstrap((values,), np.mean, n_resamples=RESAMPLES, batch=50, method="percentile", rng=seed).confidence_interval
        low, high = float(interval.low), float(interval.high)
    return row | {"mean_low": low, "mean_high": high}


def duels(found: list[Distribution], metric: str) -> list[dict[str, Any]]:
    """For each pair of subjects, in which share of the trials the first has less of a metric, with its 95 % interval (Clopper-Pearson)."""
    of = {d.subject: d for d in found if d.metric == metric and d.phase == "all" and d.subject not in ("draw", "loop")}
    rows = []
    for left in of.values():
        for right in of.values():
            both, i, j = np.intersect1d(left.trials, right.trials, return_indices=True)
            if left is not right and len(both):
                rows.append(_share(f"{left.subject} < {right.subject}", metric, left.values[i] < right.values[j]))
    return rows


def beats_both(found: list[Distribution], subject: str, metric: str, others: tuple[str, str]) -> dict[str, Any]:
    """In which share of the trials `subject` has less of a metric than both others."""
    of = {d.subject: d for d in found if d.metric == metric and d.phase == "all"}
    return _share(f"{subject} < {' and '.join(others)}", metric, beats_both_by_trial(of, subject, others)[1])


def beats_both_by_trial(of: dict[str, Distribution], subject: str, others: tuple[str, str]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Trials that have all three, and whether `subject` has less than both others in them."""
    common = of[subject].trials
    for other in others:
        common = np.intersect1d(common, of[other].trials)
    value = {name: of[name].values[np.isin(of[name].trials, common)] for name in (subject, *others)}
    return common, (value[subject] < value[others[0]]) & (value[subject] < value[others[1]])


def _share(who: str, metric: str, hits: NDArray[np.bool_]) -> dict[str, Any]:
    interval = binomtest(int(hits.sum()), len(hits)).proportion_ci()
    return {
        "who": who,
        "metric": metric,
        "share": float(hits.mean()),
        "low": float(interval.low),
        "high": float(interval.high),
        "n": len(hits),
    }


def operating_characteristic(found: list[Distribution], subject: str) -> dict[str, Array] | None:
    """Detection against false alarm as the threshold moves: shares of trials whose statistic peaks above it in and before the fault."""
    of = {d.phase: d for d in found if d.subject == subject and d.metric == "peak_statistic"}
    if not {"nominal", "fault"} <= of.keys():
        return None
    threshold = np.geomspace(0.3, 10.0, 200)
    share = {phase: np.mean(of[phase].values[None] >= threshold[:, None], axis=1) for phase in ("nominal", "fault")}
    return {"threshold": threshold, "false_alarm": share["nominal"], "detection": share["fault"]}


def ensemble_consistency(sums: pa.Table, errors: int) -> list[dict[str, Any]]:
    """Share of the ticks at which the NEES or NIS averaged over trials lies inside its 95 % bounds, those of as many `errors`.

    `errors` counts the error coordinates of the filters, all of which readings carry.
    """
    rows = []
    names, kinds = np.asarray(sums["observer"]), np.asarray(sums["statistic"])
    total, count = np.asarray(sums["total"]), np.asarray(sums["count"])
    for name in dict.fromkeys(names):
        for kind in ("nees", "nis"):
            use = (names == name) & (kinds == kind) & (count > 0)
            average = total[use] / FIXED_POINT / count[use]
            low, high = (chi2.ppf(p, errors * count[use]) / count[use] for p in (0.025, 0.975))
            inside = float(np.mean((low < average) & (average < high)))
            rows.append({"observer": str(name), "statistic": kind, "mean": float(average.mean()), "ticks_inside": inside})
    return rows


def worst(found: list[Distribution], metric: str, subject: str, count: int = 5) -> list[tuple[int, float]]:
    """Trials with the most of a metric."""
    for d in found:
        if (d.metric, d.subject, d.phase) == (metric, subject, "all"):
            order = np.argsort(d.values, kind="stable")[::-1][:count]
            return [(int(d.trials[i]), float(d.values[i])) for i in order]
    return []
