"""What is said of a metric over trials: intervals that cover as often as they say, by simulation and by hand; detection over trials."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom, binomtest

from sim.campaign.summary import Distribution, detection, mean_interval, summarize
from sim.metric import Metric
from sim.metrics.results import rows
from sim.tables import one_body as tables


def distribution(subject: str, metric: str, values: list[float]) -> Distribution:
    return Distribution(0, subject, metric, "all", "1", np.arange(len(values)), np.array(values))


def coverage(draw, size: int, repetitions: int, mean: float) -> float:
    generator = np.random.default_rng(20)
    samples = [draw(generator, size) for _ in range(repetitions)]
    found = [mean_interval(values, 3) for values in samples]
    return float(np.mean([one.low <= mean <= one.high for one in found]))


@pytest.mark.parametrize("size", [2, 3, 5, 10, 29])
def test_the_interval_of_a_mean_of_few_covers_it_as_often_as_it_says(size: int) -> None:
    share = coverage(lambda generator, n: generator.normal(7.0, 2.0, n), size, 2000, 7.0)
    assert binomtest(round(2000 * share), 2000, 0.95).pvalue > 1e-3


@pytest.mark.parametrize(("size", "repetitions"), [(60, 400), (400, 200), (1000, 2000)])
def test_the_interval_of_a_mean_of_something_skewed_covers_it_as_often_as_it_says(size: int, repetitions: int) -> None:
    share = coverage(lambda generator, n: generator.exponential(size=n), size, repetitions, 1.0)
    assert binomtest(round(repetitions * share), repetitions, 0.95).pvalue > 1e-3


def test_intervals_by_hand() -> None:
    """Student's t of 1, 2, 6: mean 3, deviation sqrt(7), 4.30265 of two degrees of freedom (any table of it)."""
    few = mean_interval(np.array([1.0, 2.0, 6.0]), 0)
    half = 4.302653 * np.sqrt(7.0 / 3.0)
    assert (few.low, few.high, few.method) == (pytest.approx(3.0 - half, rel=1e-6), pytest.approx(3.0 + half, rel=1e-6), "Student t")
    values = np.random.default_rng(4).exponential(size=50)
    more = mean_interval(values, 5)
    assert more.method == "BCa"
    assert more.high - values.mean() > 1.1 * (values.mean() - more.low)  # the mean of what is skewed to the right is, too
    # Clopper & Pearson of none and of all of ten: 1 - 0.025^(1/10)
    none, every = (mean_interval(np.full(10, value), 0, of_share=True) for value in (0.0, 1.0))
    assert (none.low, none.high) == (0.0, pytest.approx(1.0 - 0.025**0.1))
    assert (every.low, every.high) == (pytest.approx(0.025**0.1), 1.0)


def test_the_interval_of_a_share_is_never_too_short() -> None:
    trials = 12
    intervals = [mean_interval(np.repeat([1.0, 0.0], [k, trials - k]), 0, of_share=True) for k in range(trials + 1)]
    for truth in np.linspace(0.01, 0.99, 99):
        inside = [one.low <= truth <= one.high for one in intervals]
        assert binom.pmf(np.arange(trials + 1), trials, truth)[inside].sum() >= 0.95


def test_one_trial_has_neither_interval_nor_deviation() -> None:
    row = summarize(distribution("a", "nees_mean", [3.0]), 1)
    assert (row["mean"], row["n"]) == (3.0, 1)
    assert [row[key] for key in ("std", "mean_low", "mean_high", "mean_interval")] == [None] * 4
    assert rows([Metric("a", "m", "all", "1", np.array([3.0, np.nan]))])[0].std is None
    lost = summarize(distribution("a", "lost", [0.0]), 1)
    assert (lost["mean_low"], lost["mean_high"], lost["mean_interval"]) == (0.0, pytest.approx(0.975), "Clopper-Pearson")
    said = {"point": 0, "settings": {}, "beats_both": [], "worst": {}, "failed_trials": [], "detection": {}}
    shown = tables.campaign([row], said)
    assert [next(iter(column.cells)) for column in shown.columns][2:5] == ["1", "3", "-"]


def test_faults_of_all_trials_are_counted_and_those_missed_delay_longer() -> None:
    """Trials with one fault each but the last, which has two: found after 1, 2 and twice 3 s; one watched for 5 s; one alarmed before."""

    def told(metric: str, values: list[float]) -> Distribution:
        there = np.flatnonzero(np.isfinite(values))
        return Distribution(0, "h", metric, "all", "1", there, np.array(values)[there])

    nan = np.nan
    found = [
        told("faults", [1, 1, 1, 1, 2]),
        told("faults_detected", [1, 1, 0, 0, 2]),
        told("faults_missed", [0, 0, 1, 0, 0]),
        told("faults_already_alarmed", [0, 0, 0, 1, 0]),
        told("detection_delay_s", [1.0, 2.0, nan, nan, 3.0]),
        told("missed_watch_s", [nan, nan, 5.0, nan, nan]),
    ]
    said = detection(found, "h")
    counts = {"faults": 6, "faults_detected": 4, "faults_missed": 1, "faults_already_alarmed": 1}
    assert said == counts | {"median_delay_s": 3.0}  # of 1, 2, 3, 3 and longer than 5; of the detected alone 2.5
    assert "4 of 6 faults detected, 1 missed, 1 with an alarm that already stood; median delay 3 s" in tables.detected(said)
    assert detection([], "h")["median_delay_s"] is None
