from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from models.attitude.quaternion import from_rotation_vector
from models.plants.nacs import compile_nacs
from sim.faults.timeline import Occurrence
from sim.loop.recording import Recording
from sim.metrics.detection import censored_median, detections, false_alarms
from sim.metrics.one_body import evaluate, phases
from sim.scenario.files import load

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


def test_detection_is_counted_fault_by_fault(found) -> None:
    """The fault acts on ticks 10 to 19 and shows in the readings of 11 to 20; the alarm stands on 13 to 25."""
    expected = {
        "faults": [1, 0], "faults_detected": [1, 0], "faults_missed": [0, 0], "faults_already_alarmed": [0, 0],
        "missed_fraction": [0, np.nan], "detection_delay_s": [0.3, np.nan], "missed_watch_s": [np.nan, np.nan],
        "alarms": [1, 0], "false_alarms": [0, 0], "silent_fraction": [2 / 10, np.nan], "false_alarm_fraction": [5 / 29, 0],
    }  # fmt: skip
    for metric, values in expected.items():
        np.testing.assert_allclose(found["hybrid", metric, "all"], values, err_msg=metric)
    assert found["hybrid", "false_alarm_fraction", "recovery"][0] == pytest.approx(5 / 19)
    assert found["hybrid", "false_alarm_fraction", "nominal"][0] == 0
    assert ("hybrid", "false_alarm_fraction", "fault") not in found


def test_a_latch_of_the_loops_allocation_declares_too() -> None:
    """The closing observer's alarm stands on ticks 13 to 25; the latch closes at 12 for good. A watcher's alarm is its own."""
    flown = recording()
    channels = {
        name.replace("hybrid", watcher): part for watcher in ("nis-fading", "nis-windowed") for name, part in flown.channels.items()
    }
    latch = np.zeros((TICKS, TRIALS), bool)
    latch[12:, 0] = True
    both = dataclasses.replace(
        flown, channels=channels | {"control/latched": latch}, thresholds={"nis-fading": (2.0, 1.0), "nis-windowed": (2.0, 1.0)}
    )
    found = {m[:3]: m.values for m in evaluate(both, compile_nacs(), scenario=load("nacs/wheel-failure"))}
    for name, delay, false in (("nis-fading", 0.2, 19 / 29), ("nis-windowed", 0.3, 5 / 29)):
        assert found[name, "detection_delay_s", "all"][0] == pytest.approx(delay)
        assert found[name, "false_alarm_fraction", "all"][0] == pytest.approx(false)


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
    metrics = {m.metric for m in evaluate(recording(fault=None), compile_nacs())}
    assert not {"missed_fraction", "detection_delay_s", "silent_fraction", "faults"} & metrics


def test_a_filter_that_copies_its_reading_scores_zero_on_the_residual_alone() -> None:
    copied = recording()
    copied.channels["hybrid/mean"][:] = np.nan_to_num(copied.channels["reading"])
    values = {m[:3]: m.values for m in evaluate(copied, compile_nacs())}
    assert values["hybrid", "rmse_residual_total", "all"][0] == 0
    assert values["hybrid", "rmse_truth_rate", "all"][0] > 3e-3


def alarms(*spans: tuple[int, int], ticks: int = 40) -> np.ndarray:
    """One trial whose alarm stands in some spans of ticks."""
    declared = np.zeros((1, ticks), bool)
    for first, last in spans:
        declared[:, first:last] = True
    return declared


def wheel(start: int, end: int, kind: str = "float", trial: int = 0) -> Occurrence:
    return Occurrence(trial, start, end, kind, "")


# alarm, faults, and of each fault: detected, standing, delay in ticks
CASES = {
    "an alarm that stood is no detection of the second fault": (alarms((17, 40)), [wheel(10, 40), wheel(25, 35)], [(1, 0, 7), (0, 1, 15)]),
    "one that always stands detects nothing": (alarms((0, 40)), [wheel(10, 20), wheel(30, 35)], [(0, 1, 21), (0, 1, 10)]),
    "a standing alarm that is raised anew": (alarms((5, 12), (15, 20)), [wheel(10, 20)], [(1, 0, 5)]),
    "raised in the tick of the push, which no reading shows": (alarms((10, 20)), [wheel(10, 11)], [(0, 1, 30)]),
    "a push of one tick is found in the next": (alarms((11, 20)), [wheel(10, 11)], [(1, 0, 1)]),
    "a sensor's fault shows at once": (alarms((10, 20)), [wheel(10, 11, "bias")], [(1, 0, 0)]),
    "never": (alarms(), [wheel(10, 20), wheel(30, 40)], [(0, 0, 21), (0, 0, 10)]),
    "before the next can be seen": (alarms((30, 31)), [wheel(10, 20), wheel(30, 40)], [(1, 0, 20), (0, 1, 10)]),
    "two at once are one": (alarms((12, 20)), [wheel(10, 20), wheel(10, 30, "lock")], [(1, 0, 2)]),
    "in the last tick nobody can see it": (alarms(), [wheel(39, 40)], []),
    "of unknown kind as of the plant": (alarms((0, 3)), [wheel(0, 10, "any")], [(0, 1, 40)]),
    "a sensor's fault in the first tick": (alarms((0, 3)), [wheel(0, 10, "noise")], [(1, 0, 0)]),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_alarms_are_set_against_the_faults_that_could_be_seen(case: str) -> None:
    declared, faults, expected = CASES[case]
    found = detections(declared, faults)
    outcome = [tuple(map(int, row)) for row in zip(found.detected, found.standing, found.delay, strict=True)]
    assert outcome == expected
    np.testing.assert_array_equal(found.missed, [not detected and not standing for detected, standing, _ in expected])
    silent = np.concatenate([np.zeros_like(declared), declared])  # the same beside another trial, which has a fault of its own
    both = detections(silent, [wheel(5, 10), *(o._replace(trial=1) for o in faults)])
    assert [tuple(map(int, row)) for row in zip(both.detected, both.standing, both.delay, strict=True)] == [(0, 0, 35), *expected]


def test_faults_missed_faults_found_and_alarms_for_nothing_are_counted_in_one_run() -> None:
    """Alarms at 2 (false), 12 (of the fault of 10), 32 (late, of the one of 25 to 30); none for that of 36."""
    made = recording(fault=slice(10, 15))
    declared = alarms((2, 4), (12, 14), (32, 34))[0]
    made.channels["hybrid/declared"][:, 0] = declared
    for o in (faults := (wheel(10, 15), wheel(25, 30), wheel(36, 40))):
        made.channels["fault"][o.start_tick : o.end_tick, 0] = True
    found = {m[:3]: m.values[0] for m in evaluate(dataclasses.replace(made, occurrences=faults), compile_nacs())}
    expected = {
        "faults": 3, "faults_detected": 2, "faults_missed": 1, "faults_already_alarmed": 0, "missed_fraction": 1 / 3,
        "detection_delay_s": (0.2 + 0.7) / 2, "missed_watch_s": 0.4, "alarms": 3, "false_alarms": 1,
        "false_alarm_fraction": 4 / (40 - 6 - 6 - 4), "silent_fraction": 11 / 13,
    }  # fmt: skip
    for metric, value in expected.items():
        assert found["hybrid", metric, "all"] == pytest.approx(value), metric
    by_phase = {phase: found["hybrid", "alarms", phase] for phase in ("nominal", "fault", "recovery")}
    assert by_phase == {"nominal": 1, "fault": 1, "recovery": 1}


def test_alarms_for_nothing_are_not_those_that_come_late() -> None:
    """Raised at 2, at 6 and again at 36 for nothing, at 32 for the fault of 25 to 30."""
    declared = alarms((2, 4), (6, 7), (32, 34), (36, 40))
    clear = np.ones_like(declared)
    clear[:, 25:31] = False
    raised = false_alarms(declared, clear, detections(declared, [wheel(25, 30)]))
    np.testing.assert_array_equal(np.flatnonzero(raised[0]), [2, 6, 36])


def test_a_filter_without_a_detector_is_not_one_that_never_alarms() -> None:
    made = recording()
    metrics = {m.metric for m in evaluate(dataclasses.replace(made, thresholds={"hybrid": None}), compile_nacs())}
    assert not [
        m for m in metrics if m.startswith(("fault", "alarms", "false", "missed_f", "missed_w", "silent", "detection", "peak_stat"))
    ]
    assert "nis_mean" in metrics


def test_delays_that_nobody_saw_the_end_of_count_as_longer() -> None:
    """By hand: of ten, six found at 1 to 6 s; four watched in vain for 2.5 s and for 20 s."""
    delay = np.array([1.0, 2, 3, 4, 5, 6, 2.5, 20, 20, 20])
    detected = np.array([True] * 6 + [False] * 4)
    # survival 9/10, 8/10, (one leaves) x 6/7, x 5/6, x 4/5, x 3/4: 0.8, 0.686, 0.571, 0.457
    assert censored_median(delay, detected) == 5.0
    assert censored_median(delay[:6], detected[:6]) == 3.0
    assert np.isnan(censored_median(np.array([1.0, 20, 20]), np.array([True, False, False])))  # not 1, the median of the detected
    assert np.isnan(censored_median(np.zeros(0), np.zeros(0, bool)))
    random = np.random.default_rng(3)
    true, watched = random.exponential(1.0, 4000), random.uniform(0.0, 4.0, 4000)
    found = censored_median(np.minimum(true, watched), true <= watched)
    assert found == pytest.approx(np.log(2.0), rel=0.08)  # four standard errors of a median of so many
    assert np.median(true[true <= watched]) < 0.85 * np.log(2.0)  # what leaving them out would say


def test_the_headline_of_a_loop_is_by_the_truth() -> None:
    """The truth is 1 mrad off the reference, the reading elsewhere; one wheel touches its limit, turning backwards."""
    made, assembly = recording(fault=None), compile_nacs()
    limit = assembly.wheel_speed_limit
    made.channels["truth/state"][..., :4] = from_rotation_vector(np.array([0.0, 1e-3, 0]))
    made.channels["reading"][..., :4] = from_rotation_vector(np.array([0.3, 0, 0]))
    made.channels["truth/state"][..., 7:] = [10.0, -20.0, 5.0, 0.0]
    made.channels["truth/state"][7, 0, 8] = -limit
    made.channels["truth/state"][8, 0, 9] = 0.97 * limit  # just below what counts as saturated
    made.channels["command"][20:22, 1, 2] = -assembly.wheel_torque_limit
    made.channels["command"][22, 1, 2] = 0.99 * assembly.wheel_torque_limit
    found = {m[:3]: m.values for m in evaluate(made, assembly)}
    np.testing.assert_allclose(found["loop", "tracking_error_deg", "all"], np.degrees(1e-3), rtol=1e-6)
    np.testing.assert_allclose(found["loop", "peak_wheel_speed", "all"], [limit, 20.0])
    np.testing.assert_allclose(found["loop", "saturated_time_s", "all"], [0.1, 0.2])


def test_what_nobody_knows_of_the_drives_is_no_number() -> None:
    made = recording(fault=None)
    made.channels["command"][:, 1] = np.nan
    made.channels["truth/state"][3, 0, 7:] = np.nan
    made.channels["truth/state"][4, 0, 7:] = 3.0
    found = {m[:3]: m.values for m in evaluate(made, compile_nacs())}
    np.testing.assert_array_equal(found["loop", "saturated_time_s", "all"], [0.0, np.nan])
    np.testing.assert_array_equal(found["loop", "peak_wheel_speed", "all"], [3.0, 0.0])


def test_a_phase_that_a_trial_has_not_is_no_number_there() -> None:
    found = {m[:3]: m.values for m in evaluate(recording(), compile_nacs())}
    for metric in ("tracking_error_deg", "peak_wheel_speed", "saturated_time_s", "control_effort_rms"):
        assert np.isfinite(found["loop", metric, "fault"][0])
        assert np.isnan(found["loop", metric, "fault"][1]), metric
