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
from scipy.stats import binomtest, bootstrap, chi2, t

from sim.campaign.shard import FIXED_POINT
from sim.metrics.detection import censored_median

Array = NDArray[np.floating]

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
RESAMPLES = 2000
FEW, MANY = 30, 500  # trials from which, and up to which, the mean's interval is by the bootstrap
COUNTS = ("faults", "faults_detected", "faults_missed", "faults_already_alarmed")  # added up over the trials
BESIDE = (*COUNTS, "missed_watch_s", "nis_dof_mean")  # what other metrics are read with: not drawn for themselves
SHARES = ("failed", "lost", "missed_fraction")  # of a trial they are zero or one, as a rule: their mean is a share of trials
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


class Interval(NamedTuple):
    """A 95 % interval of a mean, and how it was found; None where there is none."""

    low: float | None
    high: float | None
    method: str | None


def mean_interval(values: Array, seed: int, of_share: bool = False) -> Interval:
    """The 95 % interval of a mean over trials, (n,); of one trial there is none.

    Few are taken to be normal (Student's t, Student 1908); of more the bias-corrected and accelerated bootstrap heeds their skewness
    (BCa, Efron 1987); of many the mean is normal whatever they are, and Student's t says it again. A share of trials has the interval of
    Clopper & Pearson (1934), which is never too short: ten of ten trials do not say "certainly".

    Args:
      values: finite.
      seed: of the bootstrap.
      of_share: they are zeros and ones, and their mean is the share of the ones.
    """
    if of_share:
        share = binomtest(int(values.sum()), len(values)).proportion_ci(0.95, "exact")
        return Interval(float(share.low), float(share.high), "Clopper-Pearson")
    if len(values) < 2:
        return Interval(None, None, None)
    if FEW <= len(values) <= MANY and np.ptp(values) > 0.0:
        found = bootstrap((values,), np.mean, n_resamples=RESAMPLES, batch=50, method="BCa", rng=seed).confidence_interval
        return Interval(float(found.low), float(found.high), "BCa")
    half = t.ppf(0.975, len(values) - 1) * values.std(ddof=1) / np.sqrt(len(values))
    return Interval(float(values.mean() - half), float(values.mean() + half), "Student t")


def summarize(found: Distribution, seed: int) -> dict[str, Any]:
    """A row of `summary.json`: statistics, quantiles and the 95 % interval of the mean; None for what one trial has not."""
    values = found.values
    row: dict[str, Any] = {"point": found.point, "subject": found.subject, "metric": found.metric, "phase": found.phase, "unit": found.unit}
    row |= {"mean": float(values.mean()), "std": float(values.std(ddof=1)) if len(values) > 1 else None}
    row |= {"min": float(values.min()), "max": float(values.max()), "n": len(values)}
    row |= {f"q{100 * q:02.0f}": float(v) for q, v in zip(QUANTILES, np.quantile(values, QUANTILES), strict=True)}
    interval = mean_interval(values, seed, found.metric in SHARES and bool(np.isin(values, (0.0, 1.0)).all()))
    return row | {"mean_low": interval.low, "mean_high": interval.high, "mean_interval": interval.method}


class Watched(NamedTuple):
    """What became of all faults that a subject could see, over the trials.

    A trial with several faults counts with their mean delay, as often as it has them.
    """

    delay: Array  # s, (events,) from a fault's beginning to its alarm; of one that was missed as long as it was watched
    detected: NDArray[np.bool_]  # (events,)
    counts: dict[str, int]  # by metric


def watched(found: list[Distribution], subject: str) -> Watched:
    """Of a subject; without any events if their metrics were not kept. Faults before which an alarm already stood are only counted."""
    of = {d.metric: dict(zip(d.trials.tolist(), d.values.tolist(), strict=True)) for d in found if (d.subject, d.phase) == (subject, "all")}
    delay, detected = list[float](), list[bool]()
    for times, number, hit in (("detection_delay_s", "faults_detected", True), ("missed_watch_s", "faults_missed", False)):
        for trial, value in of.get(times, {}).items():
            many = round(of.get(number, {}).get(trial, 1.0))
            delay += [value] * many
            detected += [hit] * many
    return Watched(np.array(delay), np.array(detected, dtype=bool), {name: round(sum(of.get(name, {}).values())) for name in COUNTS})


def detection(found: list[Distribution], subject: str) -> dict[str, Any]:
    """How many faults a subject detected and missed, and the median delay, for which missed ones count as longer than they were watched."""
    seen = watched(found, subject)
    median = censored_median(seen.delay, seen.detected)
    return seen.counts | {"median_delay_s": median if np.isfinite(median) else None}


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
    """A share of trials and its 95 % interval by Clopper & Pearson."""
    interval = mean_interval(hits.astype(float), 0, of_share=True)
    return {
        "who": who,
        "metric": metric,
        "share": float(hits.mean()),
        "low": interval.low,
        "high": interval.high,
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
    """Share of the ticks at which the NEES or NIS averaged over trials lies inside its 95 % bounds.

    NEES has as many degrees of freedom as filters have error coordinates, `errors`; NIS those of what was read at each tick.
    """
    rows = []
    names, kinds = np.asarray(sums["observer"]), np.asarray(sums["statistic"])
    total, count = np.asarray(sums["total"]), np.asarray(sums["count"])
    for name in dict.fromkeys(names):
        for kind in ("nees", "nis"):
            use = (names == name) & (kinds == kind) & (count > 0)
            if not use.any():
                continue
            average = total[use] / FIXED_POINT / count[use]
            freedom = (errors * count if kind == "nees" else sums["freedom"].to_numpy())[use]
            low, high = (chi2.ppf(p, freedom) / count[use] for p in (0.025, 0.975))
            inside = float(np.mean((low < average) & (average < high)))
            dof = float(freedom.sum() / count[use].sum())
            rows.append({"observer": str(name), "statistic": kind, "mean": float(average.mean()), "dof": dof, "ticks_inside": inside})
    return rows


def worst(found: list[Distribution], metric: str, subject: str, count: int = 5) -> list[tuple[int, float]]:
    """Trials with the most of a metric."""
    for d in found:
        if (d.metric, d.subject, d.phase) == (metric, subject, "all"):
            order = np.argsort(d.values, kind="stable")[::-1][:count]
            return [(int(d.trials[i]), float(d.values[i])) for i in order]
    return []
