"""Figures of merit of agents that follow a leader, window by window; docs/metrics.md defines every one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from models.dynamics.state_layout import POSITION, VELOCITY
from sim.loop.recording import Recording
from sim.metric import Metric
from sim.metrics.formation import mean_of_numbers

Array = NDArray[np.floating]

WINDOWS_S = ((0.0, 2.0), (2.0, 10.0), (5.0, 15.0), (10.0, 15.0), (15.0, 20.0))
SETTLED_M = 0.1


def absolute_error(recording: Recording) -> Array:
    """AEM = sqrt(sum_i |x_i - x_d|^2) at every tick, (ticks, trials) m (Rososhansky 2017, eq. 5.27)."""
    apart = _apart(recording)
    return np.sqrt(np.einsum("...ij,...ij->...", apart, apart))


def relative_error(recording: Recording) -> Array:
    """REM = sqrt(sum_i<j |x_i - x_j|^2) at every tick, (ticks, trials) m (eq. 5.28)."""
    apart = _apart(recording)
    pairs = apart[..., :, None, :] - apart[..., None, :, :]
    return np.sqrt(0.5 * np.einsum("...ijk,...ijk->...", pairs, pairs))


def dynamics_error(recording: Recording) -> Array:
    """W phi - (f + d) squared, mean over agents and axes at every tick, (ticks, trials) N2; NaN from the loss of a trial on."""
    wrong = recording.channels["learned"] - recording.channels["unknown"]
    return np.einsum("...ij,...ij->...", wrong, wrong) / (wrong.shape[-2] * wrong.shape[-1])


def evaluate(name: str, recording: Recording) -> list[Metric]:
    """All metrics of a loop; each trial's value is the same whatever the batch."""
    absolute, relative, wrong = (
        np.ascontiguousarray(part.T) for part in (absolute_error(recording), relative_error(recording), dynamics_error(recording))
    )
    force = recording.channels["force"]
    effort = np.ascontiguousarray(np.sqrt(np.einsum("...ij,...ij->...", force, force)).T)
    out = [
        Metric(name, "aem", "start", "m", absolute[:, 0]),
        Metric(name, "rem", "start", "m", relative[:, 0]),
        Metric(name, "settled_s", "all", "s", _settled(absolute, recording.time)),
        Metric(name, "lost_s", "all", "s", _lost(wrong, recording.time)),
    ]
    for label, ticks in windows(recording).items():
        out += [
            Metric(name, "aem", label, "m", np.mean(absolute[:, ticks], axis=-1)),
            Metric(name, "rem", label, "m", np.mean(relative[:, ticks], axis=-1)),
            Metric(name, "dynamics_error", label, "N", np.sqrt(np.mean(wrong[:, ticks], axis=-1))),
            Metric(name, "effort", label, "N", np.mean(effort[:, ticks], axis=-1)),
        ]
        for observer in recording.observers:
            out += _of_an_estimate(name if observer == name else f"{name}/{observer}", recording, observer, label, ticks)
    return out


def _of_an_estimate(subject: str, recording: Recording, observer: str, phase: str, ticks: slice) -> list[Metric]:
    """Errors of an estimate of all agents' motion against the truth, and their consistency."""
    wrong = recording.channels[f"{observer}/mean"][ticks] - recording.channels["truth/state"][ticks]
    out = []
    for metric, unit, place in (("rms_position_error", "m", POSITION), ("rms_velocity_error", "m/s", VELOCITY)):
        squares = np.ascontiguousarray(np.swapaxes(np.sum(wrong[..., place] ** 2, axis=-1), 0, 1))
        out.append(Metric(subject, metric, phase, unit, np.sqrt(mean_of_numbers(squares.reshape(len(squares), -1)))))
    for part in ("nees", "nis"):
        values = np.ascontiguousarray(np.swapaxes(recording.channels[f"{observer}/{part}"][ticks], 0, 1))
        out.append(Metric(subject, f"{part}_mean", phase, "1", mean_of_numbers(values.reshape(len(values), -1))))
    return out


def windows(recording: Recording) -> dict[str, slice]:
    """Ticks of the whole run and of all windows that lie in it."""
    ticks = recording.ticks
    found = {"all": slice(0, ticks)}
    for start, end in WINDOWS_S:
        if round(end / recording.dt) <= ticks:
            found[f"{start:g}-{end:g}s"] = slice(round(start / recording.dt), round(end / recording.dt))
    return found


def _apart(recording: Recording) -> Array:
    return recording.channels["truth/state"][..., :2] - recording.channels["reference/leader"][:, None, None]


def _settled(absolute: Array, time: Array) -> Array:
    """From when on AEM stays below a limit, (trials,) s; NaN: it does not."""
    above = absolute >= SETTLED_M
    after = len(time) - np.argmax(above[:, ::-1], axis=-1)  # the first tick behind the last one above
    after = np.where(above.any(axis=-1), after, 0)
    return np.where(after < len(time), time[np.minimum(after, len(time) - 1)], np.nan)


def _lost(wrong: Array, time: Array) -> Array:
    """When a trial was lost, (trials,) s; NaN: it was not."""
    gone = np.isnan(wrong)
    return np.where(gone.any(axis=-1), time[np.argmax(gone, axis=-1)], np.nan)
