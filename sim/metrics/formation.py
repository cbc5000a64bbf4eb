"""Figures of merit of a flown formation, trial by trial and phase by phase; docs/metrics.md defines every one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.loop.recording import Recording
from sim.metric import Metric
from sim.metrics.isolation import isolation
from sim.scenario.formation import FormationScenario

Array = NDArray[np.floating]

SETTLED = 0.1  # FKAE below which a formation is kept


def phases(scenario: FormationScenario) -> dict[str, slice]:
    """The whole run and the scenario's windows, as ticks."""
    dt, ticks = scenario.run.tick_s, scenario.run.ticks
    windows = {name: slice(round(start / dt), min(ticks, round(end / dt))) for name, (start, end) in scenario.phases.items()}
    return {"all": slice(0, ticks)} | windows


def evaluate(loop: str, recording: Recording, scenario: FormationScenario) -> list[Metric]:
    """All metrics of one loop; the subjects are the loop, and loop/observer for estimates, or the loop where that observer closes it."""
    feedback = scenario.loops[loop].feedback
    figures = {
        name: np.ascontiguousarray(values.T) for name, values in recording.figures.items()
    }  # sums over ticks alike whatever the batch
    out = []
    for phase, ticks in phases(scenario).items():
        within = {name: values[:, ticks] for name, values in figures.items()}
        out += [
            Metric(loop, "skae", phase, "1", np.mean(within["skae"], axis=-1)),
            Metric(loop, "fkae", phase, "1", np.mean(within["fkae"], axis=-1)),
            Metric(loop, "skae_start", phase, "1", within["skae"][:, 0]),
            Metric(loop, "fkae_start", phase, "1", within["fkae"][:, 0]),
            Metric(loop, "fkae_end", phase, "1", within["fkae"][:, -1]),
            Metric(loop, "station_angle_deg", phase, "deg", np.degrees(_rms(within["station_angle"]))),
            Metric(loop, "formation_angle_deg", phase, "deg", np.degrees(_rms(within["formation_angle"]))),
            Metric(loop, "peak_torque", phase, "N m", np.max(within["peak_torque"], axis=-1)),
            Metric(loop, "leader_acceleration_error", phase, "1/s2", _rms(within["acceleration_error"])),
        ]
        if "peak_wheel_speed" in within:
            out.append(Metric(loop, "peak_wheel_speed", phase, "rad/s", np.max(within["peak_wheel_speed"], axis=-1)))
            out.append(Metric(loop, "saturated_share", phase, "1", np.mean(within["saturated"], axis=-1)))
        for name, values in within.items():
            observer, _, what = name.rpartition("/")
            subject = loop if observer == feedback else f"{loop}/{observer}"
            if what == "velocity_squared":
                out.append(Metric(subject, "rms_velocity_error", phase, "1/s", np.sqrt(np.mean(values, axis=-1))))
            elif what in ("nees", "nis"):
                out.append(Metric(subject, f"{what}_mean", phase, "1", mean_of_numbers(values)))
            elif what == "lost":
                out.append(Metric(subject, "lost_filters", phase, "1", np.sum(values, axis=-1)))
    out.append(Metric(loop, "settling_time_s", "all", "s", settling_time(figures["fkae"], recording.dt)))
    return out + isolation(loop, recording, scenario)


def mean_of_numbers(values: Array) -> Array:
    """Over ticks, of what is a number; (trials, ticks) to (trials,), NaN where nothing is."""
    known = ~np.isnan(values)
    count = np.sum(known, axis=-1)
    return np.where(count > 0, np.sum(np.where(known, values, 0.0), axis=-1) / np.maximum(count, 1), np.nan)


def settling_time(fkae: Array, dt: float) -> Array:
    """When FKAE falls below 0.1 for good, (trials, ticks) to (trials,) s; NaN where it never does."""
    above = ~(fkae < SETTLED)
    last = fkae.shape[-1] - np.argmax(above[:, ::-1], axis=-1)  # ticks until the last one above has passed
    settled = np.where(above.any(axis=-1), last, 0)
    return np.where(settled < fkae.shape[-1], dt * settled, np.nan)


def _rms(values: Array) -> Array:
    return np.sqrt(np.mean(values**2, axis=-1))
