from __future__ import annotations

import numpy as np
import pytest

from models.attitude.quaternion import from_rotation_vector
from models.plants.nacs import compile_nacs
from sim.faults.timeline import Occurrence
from sim.loop.recording import Recording
from sim.metrics.one_body import evaluate, phases

TICKS, TRIALS = 40, 2


def recording(fault: slice | None = slice(10, 20), declared: slice = slice(13, 26)) -> Recording:
    """A run made up by hand: a still body, an observer off by 1 mrad about x and 2 mrad/s about y, a fault in trial 0."""
    truth = np.tile(np.r_[0, 0, 0, 1, np.zeros(7)], (TICKS, TRIALS, 1)).astype(float)
    mean = truth.copy()
    mean[..., :4] = -from_rotation_vector(np.array([1e-3, 0, 0]))  # of the other sign: the same attitude
    mean[..., 5] = 2e-3
    active, alarm = np.zeros((TICKS, TRIALS), bool), np.zeros((TICKS, TRIALS), bool)
    occurrences = ()
    if fault:
        active[fault, 0] = True
        alarm[declared, 0] = True
        occurrences = (Occurrence(0, fault.start, fault.stop, "float", ""),)
    reading = mean.copy()
    reading[..., 4] += 3e-3
    reading[5, 1, 0] = np.nan
    channels = {
        "truth/state": truth,
        "reading": reading,
        "torque_B": np.full((TICKS, TRIALS, 3), 2.0),
        "command": np.zeros((TICKS, TRIALS, 4)),
        "fault": active,
        "reference/q": np.tile([0.0, 0, 0, 1], (TICKS, 1)),
        "hybrid/mean": mean,
        "hybrid/nees": np.full((TICKS, TRIALS), 7.0),
        "hybrid/nis": np.full((TICKS, TRIALS), 11.0),
        "hybrid/declared": alarm,
        "hybrid/statistic": np.where(active, 5.0, 1.0),
    }
    return Recording(0.1, np.arange(TRIALS), channels, {"hybrid": (2.0, 1.0)}, occurrences)


@pytest.fixture(scope="module")
def found():
    return {m[:3]: m.values for m in evaluate(recording(), compile_nacs())}


@pytest.mark.parametrize(
    ("metric", "value"),
    [
        ("rmse_truth_q1", 0.5e-3),
        ("rmse_truth_q2", 0.0),
        ("rmse_truth_omega2", 2e-3),
        ("rmse_truth_quaternion", 0.5e-3 + 1.25e-7),
        ("rmse_truth_rate", 2e-3),
        ("rmse_residual_omega1", 3e-3),
        ("rmse_residual_total", 3e-3),
        ("attitude_error_deg", np.degrees(1e-3)),
        ("nees_mean", 7.0),
        ("nis_mean", 11.0),
    ],
)
def test_metrics_of_a_run_made_by_hand(found, metric: str, value: float) -> None:
    np.testing.assert_allclose(found["hybrid", metric, "all"], value, rtol=1e-6, atol=1e-9)


def test_detection_is_counted_tick_by_tick(found) -> None:
    assert found["hybrid", "detection_delay_s", "all"][0] == pytest.approx(0.3)
    assert np.isnan(found["hybrid", "detection_delay_s", "all"][1])  # that trial has no fault
    assert found["hybrid", "missed_fraction", "fault"][0] == pytest.approx(3 / 10)
    assert found["hybrid", "false_alarm_fraction", "recovery"][0] == pytest.approx(6 / 20)
    assert found["hybrid", "false_alarm_fraction", "nominal"][0] == 0
    np.testing.assert_allclose(found["hybrid", "false_alarm_fraction", "all"], [6 / 30, 0])


def test_the_peak_of_the_statistic_is_relative_to_its_upper_threshold(found) -> None:
    np.testing.assert_allclose(found["hybrid", "peak_statistic", "fault"], [2.5, np.nan])
    np.testing.assert_allclose(found["hybrid", "peak_statistic", "nominal"], 0.5)


def test_loop_metrics(found) -> None:
    np.testing.assert_allclose(found["loop", "control_effort_rms", "all"], np.sqrt(12.0))
    np.testing.assert_array_equal(found["loop", "missing_readings", "all"], [0, 1])
    np.testing.assert_array_equal(found["loop", "saturated_time_s", "all"], 0)


def test_phases_cover_every_tick_once() -> None:
    named = phases(recording())
    assert list(named) == ["all", "nominal", "fault", "recovery"]
    np.testing.assert_array_equal(sum(named[p].astype(int) for p in ("nominal", "fault", "recovery")), 1)


def test_without_faults_there_is_one_phase() -> None:
    assert list(phases(recording(fault=None))) == ["all"]
    assert not any(m.metric in ("missed_fraction", "detection_delay_s") for m in evaluate(recording(fault=None), compile_nacs()))


def test_a_filter_that_copies_its_reading_scores_zero_on_the_residual_alone() -> None:
    copied = recording()
    copied.channels["hybrid/mean"][:] = np.nan_to_num(copied.channels["reading"])
    values = {m[:3]: m.values for m in evaluate(copied, compile_nacs())}
    assert values["hybrid", "rmse_residual_total", "all"][0] == 0
    assert values["hybrid", "rmse_truth_rate", "all"][0] > 3e-3
