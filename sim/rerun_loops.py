"""Several closed loops on the same trials as one Rerun recording, written by columns."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import rerun as rr

from sim.loop_series import GAIN_NAMES, GAIN_UNITS, Flight, curves, edges, events, flights, lanes, torque_unit, window
from sim.palette import ALERT, CALM, HEALTHY
from sim.plants import compile_plant
from sim.recording import Recording
from sim.rerun_blueprint import blueprint
from sim.rerun_loops_blueprint import LoopsLayout
from sim.rerun_loops_scene import TRAIL_SHARE, Stage, camera, log_stage, motion, path_of, stage
from sim.rerun_sink import APPLICATION, columns, describe, entity, style, time_column
from sim.scenario import Scenario
from sim.series import Curve

CROWDED = 4.0  # times what comes later: a start that would hide the rest


def write_loops(path: Path, name: str, scenario: Scenario, recordings: dict[str, Recording], configuration: dict[str, Any]) -> None:
    """Write a run of several loops as a self-contained .rrd that opens laid out.

    Curves have a row for every tick; poses are thinned out to 20 Hz and 3000 rows.

    Args:
      path: file to be written.
      name: of the scenario; the recording's name in the viewer.
      scenario: with all its loops.
      recordings: of one trial or more, by loop; several trials go under /trial_<number> each.
      configuration: nested settings, kept as a property of the recording.
    """
    assembly = compile_plant(scenario.plant)
    numbers = next(iter(recordings.values())).trials
    trials = {}
    for position, number in enumerate(numbers):
        several = flights(scenario, recordings, position)
        shown = tuple(curves(several, edges(several), window(several)))
        trials[f"Trial {number}"] = Trial(f"trial_{number}/" if len(numbers) > 1 else "", several, stage(several, assembly), shown)
    with rr.RecordingStream(APPLICATION) as stream:
        stream.save(path, default_blueprint=blueprint({label: layout(trial) for label, trial in trials.items()}))
        describe(stream, name, configuration)
        for trial in trials.values():
            _write_trial(stream, trial, name)


class Trial(NamedTuple):
    """One trial of all loops, as it is drawn."""

    prefix: str
    several: tuple[Flight, ...]
    stage: Stage
    curves: tuple[Curve, ...]

    @property
    def dt(self) -> float:
        """Of a tick, s."""
        return self.several[0].recording.dt

    @property
    def duration(self) -> float:
        """Of the longest flight, s."""
        return max(float(flight.recording.time[-1]) for flight in self.several)


def layout(trial: Trial) -> LoopsLayout:
    """What the tabs of one trial are made of."""
    laws = {flight.scenario.law.type: flight.gains for flight in trial.several}
    titles = {"pd": "PD", "sliding-mode": "Sliding mode"}
    return LoopsLayout(
        prefix=trial.prefix,
        duration_s=trial.duration,
        loops=tuple(flight.name for flight in trial.several),
        axes=trial.several[0].axes,
        gains={
            f"gains/{law}/{key}": f"{titles[law]}: {GAIN_NAMES[key]}, blended [{GAIN_UNITS[key]}]" for law, of in laws.items() for key in of
        },
        laws={law: titles[law] for law in laws},
        torque=torque_unit(trial.several)[1],
        modal={flight.name: len(flight.modes) for flight in trial.several if flight.probabilities is not None},
        ranges=_ranges(trial),
        trails=tuple(f"{path_of(flight.name)}/trail" for flight in trial.several),
        trail_s=TRAIL_SHARE * trial.duration,
        about=f"{trial.stage}, poses every {trial.stage.stride * trial.dt:g} s",
        eye=camera(trial.stage),
    )


def _ranges(trial: Trial) -> dict[str, tuple[float, float]]:
    """Axes (low, high) by entity, for plots whose start is far larger than all from the first fault (or half time) on, and of gains."""
    ranges: dict[str, tuple[float, float]] = {}
    first = next(iter(edges(trial.several)), trial.several[0].recording.ticks // 2)
    for curve in trial.curves:
        if curve.path.startswith(("tracking/", "estimation/attitude", "estimation/rate")) and np.isfinite(curve.values[first:]).any():
            low, high = np.nanmin(curve.values[first:]), np.nanmax(curve.values[first:])
            if np.nanmax(np.abs(curve.values)) > CROWDED * max(high, -low) > 0.0:
                ranges[curve.path] = (1.4 * min(float(low), 0.0), 1.4 * float(high))
        elif curve.path.startswith("gains/"):
            ranges[curve.path] = (0.0, 1.5 * float(np.nanmax(curve.values)))  # room for the legend
    return ranges


def _write_trial(stream: Any, trial: Trial, name: str) -> None:
    prefix, calm = trial.prefix, {"none": CALM, "healthy": HEALTHY}
    log_stage(stream, prefix, trial.stage, trial.several)
    for lane, changed in lanes(trial.several).items():
        ticks, states = zip(*changed, strict=True)
        there = list(dict.fromkeys(states))
        colours = rr.StateConfiguration(values=there, colors=[calm.get(state, ALERT) for state in there])
        stream.log(prefix + entity(f"state/{lane}"), colours, static=True)
        time = time_column(trial.dt * np.array(ticks))
        stream.send_columns(prefix + entity(f"state/{lane}"), [time], rr.StateChange.columns(state=states))
    for flight in trial.several:
        for path, rows, moved in motion(trial.stage, flight):
            stream.send_columns(prefix + path, [time_column(trial.dt * rows)], moved)
    for curve in trial.curves:
        time = time_column(trial.dt * np.arange(len(curve.values)))
        stream.log(prefix + entity(curve.path), style(curve), static=True)
        stream.send_columns(prefix + entity(curve.path), [time], columns(curve))
    ticks, levels, texts = zip(*events(trial.several, name), strict=True)
    stream.send_columns(f"{prefix}events", [time_column(trial.dt * np.array(ticks))], rr.TextLog.columns(text=texts, level=levels))
