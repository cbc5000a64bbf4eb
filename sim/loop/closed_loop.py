"""The closed loop: read, estimate, hear, decide, give, record, change, advance. One for every body and any number of agents."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimation.choice import choose
from estimation.gaussian import LostDefiniteness
from estimation.state_space import StateSpace
from sim.faults.timeline import Occurrence
from sim.loop.recorder import MULTIPLICATIVE, Recorder
from sim.loop.recording import RecordedRunFailed, Recording
from sim.parts import Array, Effectors, Estimator, Feedback, Kept, Law, Loss, Network, Plant, Sensors, Silence, Snapshot
from sim.plant.batch import SimulationFailed


@dataclass(frozen=True, eq=False)
class System:
    """All parts of a closed loop, for a set of trials.

    Attributes:
      change: carries out the faults that change the plant itself, of a tick.
      trials: their numbers, (trials,).
      ticks: control ticks.
      dt: control period, s.
      channels: what is recorded of a tick besides truth, reading and beliefs.
      figures: what is recorded of a tick in every trial, however few are recorded as a whole; None: all trials are.
      references: what is recorded without an axis of trials, (ticks, ...).
      occurrences: events.
      errors: coordinates in which estimates are held against the truth.
      every: ticks from one that is recorded to the next.
      loss: which trials are given up; None: none is.
    """

    plant: Plant
    sensors: Sensors
    estimators: tuple[Estimator, ...]
    feedback: Feedback
    law: Law
    effectors: Effectors
    change: Callable[[int], None]
    trials: NDArray[np.int64]
    ticks: int
    dt: float
    channels: Kept
    figures: Kept | None = None
    references: dict[str, Array] = field(default_factory=dict)
    occurrences: tuple[Occurrence, ...] = ()
    network: Network = field(default_factory=Silence)
    every: int = 1
    errors: StateSpace = MULTIPLICATIVE
    loss: Loss | None = None


def run(system: System, on_tick: Callable[[int, Recorder], None] | None = None, recorded: NDArray[np.int64] | None = None) -> Recording:
    """Run the loop and return what it recorded.

    Args:
      system: all parts.
      on_tick: called after every recorded tick, with its place among them.
      recorded: numbers of the trials that are recorded as a whole, if the system keeps figures of all; None: all.

    Raises:
      RecordedRunFailed: a SimulationFailed, with the recording until then.
    """
    keep = None if recorded is None or system.figures is None else np.flatnonzero(np.isin(system.trials, recorded))
    recorder = Recorder(system.dt * system.every, -(-system.ticks // system.every), system.trials, system.estimators, keep, system.errors)
    try:
        _run(system, recorder, on_tick)
    except SimulationFailed as failure:
        recording = recorder.finish(system.references, system.occurrences)
        raise RecordedRunFailed(int(system.trials[failure.trial]), failure.time, failure.cause, recording) from None
    return recorder.finish(system.references, system.occurrences)


def _run(s: System, recorder: Recorder, on_tick: Callable[[int, Recorder], None] | None) -> None:
    """The loop itself; a trial's number in an exception is its position."""
    steps = round(s.dt / s.plant.step_s)
    rest = given = s.effectors.rest()
    held, lost = s.sensors.rest(), np.zeros(len(s.trials), dtype=bool)
    beliefs: tuple[Any, ...] = ()
    first: tuple[tuple[Any, ...], Array] | None = None
    memory = None
    for k in range(s.ticks):
        truth = s.plant.truth()
        if k % s.every == 0:
            recorder.begin(k // s.every, truth)
        reading = s.sensors.read(k, truth, recorder.past)
        known = given.known
        if s.loss is not None:
            lost = s.loss.judge(lost, truth)
            if first is not None and lost.any():  # what a lost trial's filter does is of no interest, but must not fail
                beliefs = tuple(e.put_back(lost, one, b) for e, one, b in zip(s.estimators, first[0], beliefs, strict=True))
                known, reading = choose(lost, rest.known, known), choose(lost, first[1], reading)
        beliefs = _observe(s, beliefs, known, reading, k)
        first = first or (beliefs, reading)
        held = np.where(np.isnan(reading), held, reading)
        estimate = s.feedback(k, beliefs, truth, reading, held)
        memory = s.law.start(estimate) if k == 0 else memory
        messages = s.network.carry(k, s.law.says(k, estimate, memory))
        decision = s.law.decide(k, estimate, messages, memory)
        given = s.effectors.give(k, decision, estimate, held, given, lost)
        if k % s.every == 0:
            now = Snapshot(truth, reading, beliefs, estimate, messages, memory, decision, given, lost)
            recorder.tick(k // s.every, now, s.channels(k, now), s.figures(k, now) if s.figures else {})
            if on_tick:
                on_tick(k // s.every, recorder)
        s.change(k)
        s.plant.advance(given.wheel, given.push, steps)
        memory = decision.memory


def _observe(s: System, beliefs: tuple[Any, ...], known: Any, reading: Array, tick: int) -> tuple[Any, ...]:
    """One step of every estimator; one that breaks down ends the run, saying which filter and trial."""
    if tick == 0:
        return tuple(estimator.initial(reading) for estimator in s.estimators)
    after = []
    for estimator, belief in zip(s.estimators, beliefs, strict=True):
        try:
            after.append(estimator.step(belief, known, reading, s.dt))
        except LostDefiniteness as failure:
            trial, cause = estimator.blame(failure)
            raise SimulationFailed(trial, tick * s.dt, cause) from None
    return tuple(after)
