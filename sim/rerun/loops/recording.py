"""Several closed loops on the same trials as one Rerun recording, written by columns."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import rerun as rr

from sim.loop.recording import Recording
from sim.plant.kinds import compile_plant
from sim.rerun.blueprint import blueprint
from sim.rerun.loops.antenna import AntennaLayout, outlook, pictures
from sim.rerun.loops.blueprint import LoopsLayout
from sim.rerun.loops.scene import TRAIL_SHARE, Stage, camera, log_stage, motion, path_of, stage
from sim.rerun.recording_file import recording_file
from sim.rerun.sink import APPLICATION, columns, describe, entity, style, time_column
from sim.scenario.one_body import Scenario
from sim.series.antenna import (
    PASSED,
    SHUT,
    AntennaFlight,
    antenna_curves,
    antenna_events,
    antenna_flights,
    antenna_lanes,
    is_antenna,
)
from sim.series.channels import Curve
from sim.series.events import events, state_timelines
from sim.series.learned import learned_curves, learners
from sim.series.loops import GAIN_NAMES, GAIN_UNITS, Flight, curves, edges, flights, torque_unit, window, with_particles
from sim.series.palette import ALERT, CALM, HEALTHY, REFERENCE

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
        prefix = f"trial_{number}/" if len(numbers) > 1 else ""
        if is_antenna(scenario, recordings):
            mapping = antenna_flights(scenario, recordings, position)
            shown = (*curves(mapping, edges(mapping), window(mapping)), *antenna_curves(mapping))
            trials[f"Trial {number}"] = Trial(prefix, mapping, stage(mapping, assembly, outlook(mapping)), shown, mapping)
        else:
            several = flights(scenario, recordings, position)
            shown = (*curves(several, edges(several), window(several)), *learned_curves(several))
            trials[f"Trial {number}"] = Trial(prefix, several, stage(several, assembly), shown)
    with recording_file(path, APPLICATION, blueprint({label: layout(trial) for label, trial in trials.items()})) as stream:
        describe(stream, name, configuration)
        for trial in trials.values():
            _write_trial(stream, trial, name)


class Trial(NamedTuple):
    """One trial of all loops, as it is drawn."""

    prefix: str
    several: tuple[Flight, ...]
    stage: Stage
    curves: tuple[Curve, ...]
    mapping: tuple[AntennaFlight, ...] = ()  # the same flights, if all are of antenna mapping

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
    titles = {"pd": "PD", "sliding-mode": "Sliding mode", "unfalsified": "Unfalsified control", "output-feedback": "Output feedback"}
    kind = partial(AntennaLayout, mapped=trial.mapping[0].name, panels=tuple(trial.mapping[0].panels)) if trial.mapping else LoopsLayout
    return kind(
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
        wheeled=bool(trial.stage.assembly.wheel_joints),
        particles=bool(with_particles(trial.several)),
        learners=tuple(flight.name for flight in learners(trial.several)),
        ranges=_ranges(trial),
        trails=tuple(f"{path_of(flight.name)}/trail" for flight in trial.several),
        trail_s=TRAIL_SHARE * trial.duration,
        about="; ".join(filter(None, [str(trial.stage), f"poses every {trial.stage.stride * trial.dt:g} s"])),
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
        elif trial.mapping and curve.path.startswith("wheels/"):  # the loops' axes alike
            kind = curve.path.rpartition("/")[0]
            most = max(float(np.nanmax(np.abs(other.values))) for other in trial.curves if other.path.startswith(kind))
            ranges[curve.path] = (-1.05 * most, 1.05 * most) if most > 0.0 else (-1.0, 1.0)
        elif curve.path.startswith("gains/"):
            ranges[curve.path] = (0.0, 1.5 * float(np.nanmax(curve.values)))  # room for the legend
    return ranges


def _write_trial(stream: Any, trial: Trial, name: str) -> None:
    prefix, calm = trial.prefix, {"none": CALM, "healthy": HEALTHY, SHUT: CALM, PASSED: HEALTHY}
    log_stage(stream, prefix, trial.stage, trial.several)
    for lane, changed in (antenna_lanes(trial.mapping) if trial.mapping else state_timelines(trial.several)).items():
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
    for picture, image, controller in pictures(trial.mapping) if trial.mapping else ():
        stream.log(prefix + picture, image, static=True)
        if controller:
            since, places = controller
            stream.log(f"{prefix}{picture}/now", rr.Points2D.from_fields(colors=[REFERENCE], radii=rr.Radius.ui_points(6.0)), static=True)
            stream.send_columns(f"{prefix}{picture}/now", [time_column(trial.dt * since)], rr.Points2D.columns(positions=places))
    first, *others = events(trial.several, name)
    happened = [first, *sorted([*others, *antenna_events(trial.mapping)], key=lambda event: event[0])]
    ticks, levels, texts = zip(*happened, strict=True)
    stream.send_columns(f"{prefix}events", [time_column(trial.dt * np.array(ticks))], rr.TextLog.columns(text=texts, level=levels))
