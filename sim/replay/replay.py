"""Filters run over a flight log: the closed loop itself, with sensors that read the log and nobody who acts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from control.tracking import Target
from estimation.consistency import average_test, whiteness
from models.dynamics.state_layout import ATTITUDE, StateLayout
from sim.controllers.tracking import target_channels
from sim.faults.timeline import Occurrence
from sim.loop.build import assembly_of, build_estimators, errors_of
from sim.loop.closed_loop import System, run
from sim.loop.recording import Recording
from sim.parts import AnyArray, Snapshot
from sim.replay.flight_log import FlightLog
from sim.replay.log_columns import columns_of
from sim.replay.logged_parts import LoggedCommands, LoggedPlant, LoggedSensors, SilentLaw, nobody, nothing_changes
from sim.replay.time_stamps import without_gaps
from sim.user_code.user_code import UserCode

Array = NDArray[np.floating]

LAGS = 10
INNOVATION = "innovation of "  # before the observer's name, among the channels of the loop


class Replayed(NamedTuple):
    """What the filters made of a block of trials.

    Attributes:
      loop: whose log it was.
      recording: truth and NEES are NaN where nobody knows the truth.
      innovation: of each filter, (ticks, trials, [agents,] e), NaN where a component was missing.
      layout: of the state.
    """

    loop: str
    recording: Recording
    innovation: dict[str, Array]
    layout: StateLayout

    def sound(self) -> Replayed:
        """The trials in which no filter broke down."""
        gone = [one.trial for one in self.recording.lost]
        keep = np.flatnonzero(~np.isin(self.recording.trials, gone))
        return self._replace(recording=self.recording.sound(), innovation=self._of(keep))

    def broken(self) -> list[Replayed]:
        """Each trial in which a filter broke down, as far as it came."""
        found = []
        for one in self.recording.lost:
            if one.tick:
                keep = np.flatnonzero(self.recording.trials == one.trial)
                until = {name: part[: one.tick] for name, part in self._of(keep).items()}
                found.append(self._replace(recording=self.recording.select(keep).until(one.tick), innovation=until))
        return found

    def _of(self, keep: NDArray[np.int64]) -> dict[str, Array]:
        return {name: part[:, keep] for name, part in self.innovation.items()}


def replay(log: FlightLog, scenario: Any, user_code: UserCode, progress: Callable[[int, int], None] = lambda *_: None) -> Replayed:
    """Run the filters of a loop over a block of its trials; those in which one breaks down are named in the recording.

    Random numbers of particle filters are those of the scenario's seed and the log's trials.

    Args:
      log: of the loop; where it has gaps, nothing was read, and the filters predict in steps of about a period.
      scenario: with those filters, as `setting.choose` gives it.
      user_code: the user's own filters.
      progress: called with ticks done and ticks in all.
    """
    written = log
    log, own = without_gaps(written)
    if abs(log.dt / scenario.run.tick_s - 1.0) > 1e-9:  # filters expect the noise of the log's period
        scenario = scenario.model_copy(update={"run": scenario.run.model_copy(update={"tick_s": log.dt})})
    estimators = build_estimators(scenario, log.trials, user_code, log.loop)
    ticks, trials = log.reading.shape[:2]
    fault = np.zeros((ticks, trials), dtype=bool) if log.fault is None else log.fault
    unknown, columns = np.full((ticks, 4), np.nan), columns_of(scenario)

    def channels(tick: int, now: Snapshot) -> dict[str, AnyArray]:
        each = {
            name: part
            for estimator, belief in zip(estimators, now.beliefs, strict=True)
            for name, part in zip(estimator.names, estimator.summary(belief).innovation, strict=True)
        }
        known = {"reading": log.reading[tick], "command": log.known[tick], "applied": log.known[tick], "fault": fault[tick]}
        return known | {"torque_B": now.decision.effort} | {f"{INNOVATION}{name}": part for name, part in each.items()}

    system = System(
        plant=LoggedPlant(log, assembly_of(scenario)),
        sensors=LoggedSensors(log),
        estimators=estimators,
        feedback=nobody,
        law=SilentLaw(trials),
        effectors=LoggedCommands(log, columns),
        change=nothing_changes,
        trials=log.trials,
        ticks=ticks,
        dt=log.dt,
        channels=channels,
        references=target_channels(Target(unknown, unknown[:, :3], unknown[:, :3])),
        occurrences=_occurrences(fault[own]),
        errors=errors_of(scenario),
        intervals=log.intervals,
    )
    recording = _of_the_log(run(system, lambda k, _: progress(k + 1, ticks)), written, own)
    taken = {name: recording.channels.pop(f"{INNOVATION}{name}") for name in recording.observers}
    return Replayed(
        log.loop, recording, {name: _seen(part, written.reading, columns.layout) for name, part in taken.items()}, columns.layout
    )


def _of_the_log(recording: Recording, log: FlightLog, own: NDArray[np.bool_]) -> Recording:
    """A recording with the log's time stamps, without the ticks that fill its gaps; those of `own` (ticks,) are the log's."""
    return replace(
        recording,
        channels={name: array[own] for name, array in recording.channels.items()} | {"time_s": log.time},
        lost=tuple(one._replace(tick=int(np.sum(own[: one.tick]))) for one in recording.lost),
        stamps=None if log.intervals is None else log.time[:, 0] - log.time[0, 0],
    )


def _occurrences(fault: NDArray[np.bool_]) -> tuple[Occurrence, ...]:
    """Spans of ticks with a fault, (ticks, trials); faults that overlap or touch count as one."""
    edge = np.diff(fault.astype(int), axis=0, prepend=0, append=0).T
    starts, ends = np.argwhere(edge > 0), np.argwhere(edge < 0)
    return tuple(
        Occurrence(int(trial), int(start), int(end), "any", "fault") for (trial, start), (_, end) in zip(starts, ends, strict=True)
    )


def _seen(innovation: Array, reading: Array, layout: StateLayout) -> Array:
    """Innovations (ticks, trials, ..., e) with NaN where nothing was read or, at the start, nothing predicted.

    A quaternion of which a component is missing is no attitude: filters leave out all of it.
    """
    missing = np.isnan(reading)
    if layout.errors < layout.size:
        missing[..., ATTITUDE] = missing[..., ATTITUDE].any(axis=-1, keepdims=True)
    missing[0] = True
    size, read = innovation.shape[-1], reading.shape[-1]
    if size < read and size in (6, read - 1):  # a rotation vector; wheel speeds may be no states
        missing = missing[..., 1:]
    if size > read:
        missing = np.concatenate([missing, np.ones((*missing.shape[:-1], size - read), dtype=bool)], axis=-1)
    return np.where(missing[..., :size], np.nan, innovation)


class Consistency(NamedTuple):
    """How a filter's innovations fit what it expects of them."""

    nis_inside: float  # share of ticks whose NIS, averaged over trials, is inside its 95 % bounds
    white: float  # share of the autocorrelations up to LAGS ticks inside the 95 % bounds of white noise


def judge(replayed: Replayed, name: str) -> Consistency:
    """Chi-square test of a filter's NIS, and whiteness of its innovations.

    The degrees of freedom are those of what was read at each tick, as the filter counts them.
    """
    channels, innovation = replayed.recording.channels, replayed.innovation[name]
    nis, dof = channels[f"{name}/nis"], np.nan_to_num(channels[f"{name}/dof"])
    many = nis.reshape(len(nis), -1), dof.reshape(len(dof), -1), innovation.reshape(len(nis), -1, innovation.shape[-1])
    test = average_test(many[0], many[1], axis=1)
    return Consistency(test.fraction_inside, whiteness(np.swapaxes(many[2], 0, 1), LAGS).fraction_inside)
