"""Figures of merit of a recording, trial by trial and phase by phase; docs/metrics.md defines every one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from models.attitude import quaternion
from models.attitude.euler_angles import to_euler_313, wrapped_difference
from models.dynamics.state_layout import ATTITUDE, MOTION, WHEELS
from models.plants.assembly import Assembly
from sim.loop.recording import Recording
from sim.metric import Metric
from sim.metrics import windows
from sim.metrics.detection import detections, false_alarms, raised_alarms, visible_faults
from sim.metrics.learned import of_learning, window_flags
from sim.scenario.one_body import Scenario
from sim.scenario.references import EulerRates

Array = NDArray[np.floating]
Flags = NDArray[np.bool_]

STATES = ("q1", "q2", "q3", "q4", "omega1", "omega2", "omega3")


def phases(recording: Recording) -> dict[str, Flags]:
    """Phase name to flags (trials, ticks): before the first fault, while one is active, and otherwise after it."""
    fault = np.ascontiguousarray(recording.channels["fault"].T).astype(bool)
    begun = np.logical_or.accumulate(fault, axis=1)
    named = {"all": np.ones_like(fault), "nominal": ~begun, "fault": fault, "recovery": begun & ~fault}
    return {name: flags for name, flags in named.items() if name == "all" or (fault.any() and flags.any())}


def evaluate(recording: Recording, assembly: Assembly, loop: str = "loop", scenario: Scenario | None = None) -> list[Metric]:
    """All metrics of a recording; each trial's value is the same whatever the batch.

    Args:
      recording: of a closed loop.
      assembly: the plant.
      loop: name of the loop. Of several, each is a subject together with the observer that closes it.
      scenario: of this loop alone.
    """
    truth = _by_trial(recording.channels["truth/state"])
    reading = _by_trial(recording.channels["reading"])
    spins = scenario is not None and isinstance(scenario.reference, EulerRates)
    closing = scenario.law.feedback if scenario is not None and loop != "loop" else None
    limit = (scenario.law.clipped_at_nm if scenario is not None else None) or np.inf
    out: list[Metric] = []
    flagged = phases(recording)
    every = scenario is not None and scenario.phase_metrics == "all"
    if scenario is not None and every:
        flagged |= window_flags(recording, scenario.phases)
    for phase, flags in flagged.items():
        for name in recording.observers:
            subject = name if closing is None else loop if name == closing else f"{loop}/{name}"
            latched = "control/latched" if scenario is not None and name == scenario.law.feedback else ""
            out += [Metric(subject, *row) for row in _estimation(recording, name, phase, flags, truth, reading, latched)]
            out += [Metric(subject, *row) for row in of_learning(recording, name, phase, flags)]
        out += [Metric(loop, *row) for row in _loop(recording, assembly, limit, phase, flags, truth, reading)]
        if spins:
            out += [Metric(loop, *row) for row in _euler_angles(recording, phase, flags, truth)]
    if scenario is not None and scenario.phases and not every:
        out += [Metric(loop, *row) for row in windows.of_the_body(recording, scenario.phases)]
        for name in recording.observers:
            subject = name if closing is None else loop if name == closing else f"{loop}/{name}"
            out += [Metric(subject, *row) for row in windows.of_an_estimate(recording, name, scenario.phases)]
    return out


Row = tuple[str, str, str, Array]


def _estimation(recording: Recording, name: str, phase: str, flags: Flags, truth: Array, reading: Array, latched: str) -> list[Row]:
    """Metrics of an estimator; a latch that its loop's allocation closed for good, the channel `latched` if there is one, declares too."""
    mean = _by_trial(recording.channels[f"{name}/mean"])
    size = mean.shape[-1]
    error, residual = _difference(mean, truth[..., :size]), _difference(reading[..., :size], mean)
    rows: list[Row] = []
    for kind, difference in (("truth", error), ("residual", residual)):
        each = _rms(difference[..., MOTION], flags)
        rows += [
            (f"rmse_{kind}_quaternion", phase, "1", np.sum(each[:, ATTITUDE], axis=-1)),
            (f"rmse_{kind}_rate", phase, "rad/s", np.sum(each[:, 4:], axis=-1)),
            (f"rmse_{kind}_total", phase, "1, rad/s", np.sum(each, axis=-1)),
        ]
        rows += [(f"rmse_{kind}_{state}", phase, "1" if state[0] == "q" else "rad/s", each[:, i]) for i, state in enumerate(STATES)]
    if size > 7:
        rows.append(("rmse_truth_wheel", phase, "rad/s", np.sum(_rms(error[..., WHEELS], flags), axis=-1)))
    angle = quaternion.angle(mean[..., ATTITUDE], truth[..., ATTITUDE])
    rows.append(("attitude_error_deg", phase, "deg", np.degrees(_rms(angle[..., None], flags)[:, 0])))
    for part in ("nees", "nis"):
        rows.append((f"{part}_mean", phase, "1", _mean(_by_trial(recording.channels[f"{name}/{part}"]), flags)))
    if f"{name}/dof" in recording.channels:
        nis, dof = (_by_trial(recording.channels[f"{name}/{part}"]) for part in ("nis", "dof"))
        rows.append(("nis_dof_mean", phase, "1", _mean(np.where(np.isnan(nis), np.nan, dof), flags)))
    limits = recording.thresholds[name]
    if limits is not None:
        ratio = _by_trial(recording.channels[f"{name}/statistic"]) / limits[0]
        rows.append(("peak_statistic", phase, "1", _greatest(ratio, flags)))
        declared = _by_trial(recording.channels[f"{name}/declared"]).astype(float)
        if latched in recording.channels:
            declared = np.maximum(declared, _by_trial(recording.channels[latched]).astype(float))
        fault = _by_trial(recording.channels["fault"]).astype(bool)
        rows += _detection(recording, phase, flags, declared.astype(bool), fault)
    if f"{name}/modes" in recording.channels:
        modes = _by_trial(recording.channels[f"{name}/modes"])
        rows.append(("mode_fault_mean", phase, "1", _mean(1.0 - modes[..., 0], flags)))
        healthy = ~_by_trial(recording.channels["fault"]).astype(bool)
        if (flags & healthy).any():
            rows.append(
                ("false_mode_fraction", phase, "1", _mean(np.where(np.isnan(modes[..., 0]), np.nan, modes[..., 0] < 0.5), flags & healthy))
            )
    if f"{name}/lost" in recording.channels:
        lost = _by_trial(np.diff(recording.channels[f"{name}/lost"], axis=0, prepend=0.0))
        rows.append(("lost_definiteness", phase, "1", np.sum(np.where(flags, lost, 0.0), axis=-1)))
    return rows


def _loop(recording: Recording, assembly: Assembly, axis_limit: float, phase: str, flags: Flags, truth: Array, reading: Array) -> list[Row]:
    desired = recording.channels["reference/q"]
    angle = quaternion.angle(truth[..., ATTITUDE], desired[None])
    torque = _by_trial(recording.channels["torque_B"])
    effort = np.sqrt(_mean(np.sum(torque**2, axis=-1), flags))
    command, speed = np.abs(_by_trial(recording.channels["command"])), np.abs(truth[..., WHEELS])
    limit = assembly.wheel_torque_limit if assembly.wheel_joints else axis_limit
    saturated = np.any(command >= 0.999 * limit, axis=-1) | np.any(speed > 0.98 * assembly.wheel_speed_limit, axis=-1)
    known = flags & ~np.isnan(command).any(axis=-1) & ~np.isnan(speed).any(axis=-1)
    absent = np.isnan(reading)
    due = _by_trial(recording.channels["due"]) if "due" in recording.channels else np.True_
    each = _rms(torque, flags)
    tracking = np.degrees(_rms(angle[..., None], flags)[:, 0])
    return [
        ("tracking_error_deg", phase, "deg", tracking),
        ("control_effort_rms", phase, "N m", effort),
        *((f"effort_rms_{axis}", phase, "N m", each[:, i]) for i, axis in enumerate("xyz")),
        ("peak_wheel_speed", phase, "rad/s", _greatest(np.max(speed, axis=-1, initial=0.0), flags)),
        ("saturated_time_s", phase, "s", np.where(known.any(axis=-1), recording.dt * np.sum(saturated & known, axis=-1), np.nan)),
        ("missing_readings", phase, "1", np.sum(np.any(absent & due, axis=-1) & flags, axis=-1).astype(float)),
        ("incomplete_readings", phase, "1", np.sum(np.any(absent, axis=-1) & flags, axis=-1).astype(float)),
    ]


def _euler_angles(recording: Recording, phase: str, flags: Flags, truth: Array) -> list[Row]:
    """Tracking error by 3-1-3 Euler angles of the true attitude, each wrapped, as Hill et al. (2021, table II) judge it."""
    desired = to_euler_313(recording.channels["reference/q"])
    apart = np.degrees(wrapped_difference(to_euler_313(truth[..., ATTITUDE]), desired))
    each = _rms(apart, flags)
    angle = quaternion.angle(truth[..., ATTITUDE], recording.channels["reference/q"][None])
    return [
        *((f"rmse_{name}_deg", phase, "deg", each[:, i]) for i, name in enumerate(("phi", "theta", "psi"))),
        ("rmse_body_deg", phase, "deg", np.degrees(_rms(angle[..., None], flags)[:, 0])),
    ]


def _detection(recording: Recording, phase: str, flags: Flags, declared: Flags, fault: Flags) -> list[Row]:
    """Alarms against the faults that begin in a phase, and against its ticks; `declared` and `fault` are (trials, ticks)."""
    visible = visible_faults(fault, recording.occurrences)
    clear, found = flags & ~fault & ~visible, detections(declared, recording.occurrences)
    rows: list[Row] = [("alarms", phase, "1", np.sum(raised_alarms(declared) & flags, axis=-1).astype(float))]
    if clear.any():
        rows.append(("false_alarm_fraction", phase, "1", _mean(declared.astype(float), clear)))
        raised = np.sum(false_alarms(declared, clear, found), axis=-1).astype(float)
        rows.append(("false_alarms", phase, "1", np.where(clear.any(axis=-1), raised, np.nan)))
    if (flags & visible).any():
        rows.append(("silent_fraction", phase, "1", _mean(1.0 - declared, flags & visible)))
    here = flags[found.trial, found.start]

    def count(which: Flags, weight: Array | None = None) -> Array:
        """Of events in this phase, or the sum of their weights, trial by trial."""
        own = which & here
        return np.bincount(found.trial[own], None if weight is None else weight[own], len(flags)).astype(float)

    if not here.any():
        return rows
    hits, misses = count(found.detected), count(found.missed)
    judged = hits + misses
    delay = recording.dt * found.delay
    return [
        *rows,
        ("faults", phase, "1", count(np.ones_like(here))),
        ("faults_detected", phase, "1", hits),
        ("faults_missed", phase, "1", misses),
        ("faults_already_alarmed", phase, "1", count(found.standing)),
        ("missed_fraction", phase, "1", misses / np.where(judged, judged, np.nan)),
        ("detection_delay_s", phase, "s", count(found.detected, delay) / np.where(hits, hits, np.nan)),
        ("missed_watch_s", phase, "s", count(found.missed, delay) / np.where(misses, misses, np.nan)),
    ]


def _by_trial(channel: Array) -> Array:
    """(ticks, trials, ...) as contiguous (trials, ticks, ...), so that sums over ticks do not depend on the number of trials."""
    return np.ascontiguousarray(np.swapaxes(channel, 0, 1))


def _difference(state: Array, reference: Array) -> Array:
    """Component by component, the quaternion of the sign nearer to the reference's; (..., n)."""
    attitude = quaternion.align(state[..., ATTITUDE], reference[..., ATTITUDE]) - reference[..., ATTITUDE]
    return np.concatenate([attitude, state[..., 4:] - reference[..., 4:]], axis=-1)


def _rms(values: Array, flags: Flags) -> Array:
    """Root mean square over flagged ticks with a number; (trials, ticks, n) to (trials, n), NaN where there is none."""
    use = flags[..., None] & ~np.isnan(values)
    squares = np.ascontiguousarray(np.swapaxes(np.where(use, values, 0.0) ** 2, 1, 2))
    count = np.sum(use, axis=1)
    return np.sqrt(np.sum(squares, axis=-1) / np.where(count, count, np.nan))


def _greatest(values: Array, flags: Flags) -> Array:
    """Greatest over flagged ticks with a number; (trials, ticks) to (trials,), NaN where there is none."""
    use = flags & ~np.isnan(values)
    return np.where(use.any(axis=-1), np.max(np.where(use, values, -np.inf), axis=-1), np.nan)


def _mean(values: Array, flags: Flags) -> Array:
    """Mean over flagged ticks with a number; (trials, ticks) to (trials,), NaN where there is none."""
    use = flags & ~np.isnan(values)
    count = np.sum(use, axis=-1)
    return np.sum(np.where(use, values, 0.0), axis=-1) / np.where(count, count, np.nan)
