"""Filters run over a flight log: the same filters, step by step, as in the closed loop."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from control.tracking import Target
from estimation.consistency import average_test, whiteness
from sim.bad_input import BadInput
from sim.controllers.tracking import target_channels
from sim.estimators.filter_banks import Models, build_banks
from sim.estimators.learning_settings import Learning
from sim.estimators.settings import ObserverSettings
from sim.estimators.tunings import TUNINGS
from sim.faults.timeline import Occurrence
from sim.loop.closed_loop import System, run
from sim.loop.recording import Recording
from sim.parts import AnyArray, Estimator, Snapshot
from sim.plant.kinds import compile_plant
from sim.replay.flight_log import STATES, FlightLog
from sim.replay.logged_parts import LoggedCommands, LoggedPlant, LoggedSensors, SilentLaw, nobody, nothing_changes
from sim.scenario import files
from sim.scenario.one_body import Scenario
from sim.user_code.surroundings import surroundings
from sim.user_code.user_code import UserCode

Array = NDArray[np.floating]

DEFAULT = "nacs/fault-free"  # whose plant, sensors and filters a laboratory's log is taken to come from
LAGS = 10
INNOVATION = "innovation of "  # before the observer's name, among the channels of the loop
_SIGMAS = tuple(f"sigma_{name}" for name in ("rotation1", "rotation2", "rotation3", *STATES[4:]))


class Replayed(NamedTuple):
    """What the filters made of a block of trials."""

    recording: Recording  # truth and NEES are NaN where nobody knows the truth
    innovation: dict[str, Array]  # of each filter, (ticks, trials, e), NaN where a component was missing


def setting(about: dict[str, Any], label: str, tuning: str | None, overrides: dict[str, Any]) -> Scenario:
    """The scenario that a log's filters are built from: the log's own, or the NACS's defaults.

    Args:
      about: what the log says of itself.
      label: of the log, for complaints.
      tuning: of all filters, in place of their own.
      overrides: dotted key to value.
    """
    if tuning is not None and tuning not in TUNINGS:
        raise BadInput(f"--tuning {tuning}: no such set; there are {', '.join(TUNINGS)}")
    nacs = files.load(DEFAULT).model_dump(mode="json", exclude_none=True)
    try:
        data: dict[str, Any] = dict(about.get("settings", nacs))
        observers = nacs["observers"] | data["observers"]
        common = data["tuning"]
        data |= {"faults": [], "control": data["control"] | {"feedback": "truth"}}  # nothing of this happens again
        # a tuning that was the scenario's is its own no longer, so that `--set tuning=...` means all of them, as in `nacs run`
        data["observers"] = {n: {k: v for k, v in o.items() if k != "tuning" or (v != common and not tuning)} for n, o in observers.items()}
    except (KeyError, TypeError, ValueError, AttributeError):
        raise BadInput(f"{label}: its metadata are not what the twin writes") from None
    data["tuning"] = tuning or common
    if "sensors.set" in overrides:
        data["sensors"] = {}
    return files.check(data, label, overrides)


def choose(scenario: Scenario, wanted: list[str]) -> dict[str, ObserverSettings]:
    """Filters by name, or by type where all its settings have defaults; raises BadInput for what there is not."""
    chosen = {}
    for name in wanted:
        try:
            plain = {"type": name, "tuning": scenario.tuning}
            chosen[name] = scenario.observers.get(name) or TypeAdapter[ObserverSettings](ObserverSettings).validate_python(plain)
        except ValidationError:
            raise BadInput(f"--filter {name}: no such filter; there are {', '.join(scenario.observers)}") from None
        if isinstance(chosen[name], Learning):
            raise BadInput(f"--filter {name}: is of type learning, which takes wheel speeds as known; replayed are filters of all states")
    return chosen


def replay(log: FlightLog, scenario: Scenario, chosen: dict[str, ObserverSettings], user_code: UserCode) -> Replayed:
    """Run filters over a block of trials: the closed loop, with sensors that read the log and nobody who acts.

    Raises:
      SimulationFailed: a filter lost definiteness.
    """
    models, wheels = Models.of(scenario.plant), scenario.plant.wheel_axes.shape[1]
    banks: tuple[Estimator, ...] = (*build_banks(chosen, models, scenario.sensors, wheels), *user_code.filters(surroundings(scenario)))
    ticks, trials = log.reading.shape[:2]
    fault = np.zeros((ticks, trials), dtype=bool) if log.fault is None else log.fault
    unknown = np.full((ticks, 4), np.nan)

    def channels(tick: int, now: Snapshot) -> dict[str, AnyArray]:
        each = {
            name: part
            for bank, belief in zip(banks, now.beliefs, strict=True)
            for name, part in zip(bank.names, bank.summary(belief).innovation, strict=True)
        }
        known = {"reading": log.reading[tick], "command": log.command[tick], "applied": log.command[tick], "fault": fault[tick]}
        return known | {"torque_B": now.decision.effort} | {f"{INNOVATION}{name}": part for name, part in each.items()}

    system = System(
        plant=LoggedPlant(log, compile_plant(scenario.plant)),
        sensors=LoggedSensors(log),
        estimators=banks,
        feedback=nobody,
        law=SilentLaw(trials),
        effectors=LoggedCommands(log),
        change=nothing_changes,
        trials=log.trials,
        ticks=ticks,
        dt=log.dt,
        channels=channels,
        references=target_channels(Target(unknown, unknown[:, :3], unknown[:, :3])),
        occurrences=_occurrences(fault),
    )
    recording = run(system)
    innovation = {name: _seen(recording.channels.pop(f"{INNOVATION}{name}"), log.reading) for name in recording.observers}
    return Replayed(recording, innovation)


def _occurrences(fault: NDArray[np.bool_]) -> tuple[Occurrence, ...]:
    """Spans of ticks with a fault, (ticks, trials); faults that overlap or touch count as one."""
    edge = np.diff(fault.astype(int), axis=0, prepend=0, append=0).T
    starts, ends = np.argwhere(edge > 0), np.argwhere(edge < 0)
    return tuple(
        Occurrence(int(trial), int(start), int(end), "any", "fault") for (trial, start), (_, end) in zip(starts, ends, strict=True)
    )


def _seen(innovation: Array, reading: Array) -> Array:
    """Innovations (ticks, trials, e) with NaN where nothing was read or, at the start, nothing predicted."""
    missing = np.isnan(reading)
    missing[0] = True
    if innovation.shape[-1] < reading.shape[-1]:  # a rotation vector is missing if any of the quaternion is
        missing = np.concatenate([np.repeat(missing[..., :4].any(axis=-1, keepdims=True), 3, axis=-1), missing[..., 4:]], axis=-1)
    return np.where(missing, np.nan, innovation)


class Consistency(NamedTuple):
    """How a filter's innovations fit what it expects of them."""

    nis_inside: float  # share of ticks whose NIS, averaged over trials, is inside its 95 % bounds
    white: float  # share of the autocorrelations up to LAGS ticks inside the 95 % bounds of white noise


def judge(replayed: Replayed, name: str) -> Consistency:
    """Chi-square test of a filter's NIS, and whiteness of its innovations.

    A unit quaternion has three degrees of freedom, whatever the filter's coordinates; missing components have none.
    """
    channels = replayed.recording.channels
    there = ~np.isnan(channels["reading"])
    dof = 3 * there[..., :4].all(axis=-1) + np.sum(there[..., 4:], axis=-1)
    test = average_test(channels[f"{name}/nis"], dof, axis=1)
    return Consistency(test.fraction_inside, whiteness(np.swapaxes(replayed.innovation[name], 0, 1), LAGS).fraction_inside)


def estimates(replayed: Replayed) -> pa.Table:
    """What the filters believed, one row a filter, trial and tick; docs/replay.md defines the columns."""
    recording = replayed.recording
    ticks, trials, tables = recording.ticks, len(recording.trials), []

    def flat(channel: str) -> Array:
        """(ticks, trials, ...) as (columns, trials * ticks)."""
        return np.swapaxes(recording.channels[channel], 0, 1).reshape(trials * ticks, -1).T

    for name in recording.observers:
        columns: dict[str, Any] = {
            "trial": np.repeat(recording.trials, ticks),
            "tick": np.tile(np.arange(ticks), trials),
            "filter": pa.array([name] * (trials * ticks)),
        }
        columns |= dict(zip(STATES, flat(f"{name}/mean"), strict=True)) | dict(zip(_SIGMAS, flat(f"{name}/sigma"), strict=True))
        columns |= {part: flat(f"{name}/{part}")[0] for part in ("nis", "dof", "statistic", "declared")}
        tables.append(pa.table(columns))
    return pa.concat_tables(tables)
