"""Figures of merit of an observer and its loop in the windows of time that a scenario names; docs/metrics.md defines every one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from models.attitude import quaternion
from models.dynamics.state_layout import ATTITUDE, RATE
from sim.loop.recording import Recording

Array = NDArray[np.floating]
Flags = NDArray[np.bool_]
Row = tuple[str, str, str, Array]  # metric, phase, unit, one value a trial
Phases = dict[str, tuple[float, float]]  # name to start and end, s

REGION = (1e-3, 50e-6)  # each component of a quaternion's vector part, and each rate, rad/s (Rososhansky 2017, sec. 3.3.1)
LOST_RAD = 0.1  # an estimate that is farther off in half of the last window follows a mirror image or nothing


def of_the_body(recording: Recording, phases: Phases) -> list[Row]:
    """Where the body comes to, and the extremes of its rate in each window that the run reaches."""
    truth, desired = recording.channels["truth/state"], recording.channels["reference/q"][:, None]
    away, rate = _apart(truth[..., ATTITUDE], desired), truth[..., RATE]
    slip = rate - recording.channels["reference/omega"][:, None]  # in D, which is B in the region
    size = np.linalg.norm(rate, axis=-1)
    rows: list[Row] = [
        ("time_to_region_s", "state", "s", _first(_inside(away, slip), recording.dt)),
        ("final_attitude", "all", "1", np.linalg.norm(away[-1], axis=-1)),
        ("final_scalar", "all", "1", np.sum(truth[-1, :, ATTITUDE] * desired[-1], axis=-1)),
    ]
    for name, span in _spans(recording, phases).items():
        rows += [("rate_least", name, "rad/s", np.min(size[span], axis=0)), ("rate_peak", name, "rad/s", np.max(size[span], axis=0))]
    return rows


def of_an_estimate(recording: Recording, observer: str, phases: Phases) -> list[Row]:
    """Errors of an observer against the truth in each window that the run reaches, and whether it lost the body."""
    truth, mean = recording.channels["truth/state"], recording.channels[f"{observer}/mean"]
    attitude, rate = _apart(mean[..., ATTITUDE], truth[..., ATTITUDE]), mean[..., RATE] - truth[..., RATE]
    rows: list[Row] = [("time_to_region_s", "estimate", "s", _first(_inside(attitude, rate), recording.dt))]
    spans = _spans(recording, phases)
    for name, span in spans.items():
        rows += [("rms_attitude_error", name, "1", _rms(attitude[span])), ("rms_rate_error", name, "rad/s", _rms(rate[span]))]
    last = list(spans.values())[-1] if spans else slice(None)
    angle = quaternion.angle(mean[last, :, ATTITUDE], truth[last, :, ATTITUDE])
    far = np.median(np.where(np.isfinite(angle), angle, np.inf), axis=0) > LOST_RAD
    rows.append(("lost", "all", "1", far.astype(float)))
    if (ess := recording.channels.get(f"{observer}/ess")) is not None:
        rows += [("ess_median", name, "1", np.median(ess[span], axis=0)) for name, span in {"all": slice(None), **spans}.items()]
    return rows


def _spans(recording: Recording, phases: Phases) -> dict[str, slice]:
    """Ticks of each window that has begun."""
    found = {name: slice(*(round(edge / recording.dt) for edge in span)) for name, span in phases.items()}
    return {name: span for name, span in found.items() if span.start < recording.ticks}


def _apart(q: Array, reference: Array) -> Array:
    """Vector part of q * reference^-1, of the sign that is nearer to no turn, (..., 3)."""
    return quaternion.multiply(quaternion.align(quaternion.normalize(q), reference), quaternion.inverse(reference))[..., :3]


def _inside(attitude: Array, rate: Array) -> Flags:
    """Whether all six errors are in the region, (ticks, trials)."""
    return np.all(np.concatenate([np.abs(attitude) <= REGION[0], np.abs(rate) <= REGION[1]], axis=-1), axis=-1)


def _first(inside: Flags, dt: float) -> Array:
    """Time of the first tick at which it is so, NaN if it never is; (ticks, trials) to (trials,)."""
    return np.where(inside.any(axis=0), dt * np.argmax(inside, axis=0), np.nan)


def _rms(errors: Array) -> Array:
    """Root mean square over ticks and axes, (ticks, trials, 3) to (trials,), each trial in a row: the same whatever the batch."""
    squares = np.ascontiguousarray(np.swapaxes(errors, 0, 1)).reshape(errors.shape[1], -1) ** 2
    return np.sqrt(np.mean(squares, axis=-1))
