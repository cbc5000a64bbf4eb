"""Figures of merit of what an observer has learned of the unmodelled torque; docs/metrics.md defines every one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from sim.loop.recording import Recording

Array = NDArray[np.floating]
Flags = NDArray[np.bool_]
Row = tuple[str, str, str, Array]  # metric, phase, unit, one value a trial


def window_flags(recording: Recording, phases: dict[str, tuple[float, float]]) -> dict[str, Flags]:
    """Flags (trials, ticks) of each window of time that has begun."""
    whole = np.zeros((len(recording.trials), recording.ticks), dtype=bool)
    found = {}
    for name, (start, end) in phases.items():
        flags = whole.copy()
        flags[:, round(start / recording.dt) : round(end / recording.dt)] = True
        if flags.any():
            found[name] = flags
    return found


def of_learning(recording: Recording, observer: str, phase: str, flags: Flags) -> list[Row]:
    """What an observer has learned against what acts, and how its NIS is spread; nothing of an observer that learns nothing."""
    if f"{observer}/learned" not in recording.channels:
        return []
    truth, learned = recording.channels["truth/unmodelled"], recording.channels[f"{observer}/learned"]
    error, true = _mean_squares(learned - truth, flags), _mean_squares(truth, flags)
    size, against = np.sqrt(np.mean(error, axis=-1)), np.sqrt(np.mean(true, axis=-1))
    nis, dof = (np.swapaxes(recording.channels[f"{observer}/{part}"], 0, 1) for part in ("nis", "dof"))
    low, high = (chi2.ppf(share, np.maximum(dof, 1.0)) for share in (0.025, 0.975))
    there = flags & ~np.isnan(nis)
    inside = np.sum(there & (nis >= low) & (nis <= high), axis=-1) / np.maximum(np.sum(there, axis=-1), 1)
    return [
        ("learned_torque_error", phase, "N m", size),
        *((f"learned_torque_error_{axis}", phase, "N m", np.sqrt(error[:, i])) for i, axis in enumerate("xyz")),
        ("unmodelled_torque", phase, "N m", against),
        ("learned_torque_relative", phase, "1", size / np.where(against > 0.0, against, np.nan)),
        ("nis_inside_share", phase, "1", np.where(there.any(axis=-1), inside, np.nan)),
    ]


def _mean_squares(values: Array, flags: Flags) -> Array:
    """Over the flagged ticks, (ticks, trials, 3) to (trials, 3); every trial's numbers in a row: the same whatever the batch."""
    squares = np.where(flags[:, None, :], np.ascontiguousarray(np.moveaxis(values, 0, -1)) ** 2, 0.0)
    return np.sum(squares, axis=-1) / np.maximum(np.sum(flags, axis=-1), 1)[:, None]
