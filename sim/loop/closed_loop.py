"""The closed loop: read, estimate, hear, decide, give, record, change, advance. One for every body and any number of agents."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.choice import choose
from estimation.gaussian import LostDefiniteness
from estimation.state_space import StateSpace
from sim.faults.timeline import Occurrence
from sim.loop.lost_trials import Flags, LostTrials
from sim.loop.recorder import MULTIPLICATIVE, Recorder
from sim.loop.recording import RecordedRunFailed, Recording
from sim.parts import (
    ActuatorOutput,
    Array,
    Decision,
    Effectors,
    Estimator,
    Feedback,
    Kept,
    Law,
    Loss,
    Network,
    Plant,
    Sensors,
    Silence,
    Snapshot,
)
from sim.plant.batch import SimulationFailed


@dataclass(frozen=True, eq=False)
class System:
    """All parts of a closed loop, for a set of trials.

    Attributes:
      change: carries out the faults that change the plant itself, of a tick.
      trials: their numbers, (trials,).
      ticks: control ticks.
      dt: control period, s.
      intervals: seconds from the tick before to each tick, (ticks,), where they are not all the period: of a log that is not flown.
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
    intervals: Array | None = None

    def interval(self, tick: int) -> float:
        """Seconds from the tick before."""
        return self.dt if self.intervals is None else float(self.intervals[tick])

    def time(self, tick: int) -> float:
        """Seconds since the first tick."""
        return tick * self.dt if self.intervals is None else float(np.sum(self.intervals[1 : tick + 1]))


class Flight:
    """A run of the loop, tick by tick: whoever iterates lets it run, whoever calls `send` decides instead of the law.

    Args:
      system: all parts.
      on_tick: called after every recorded tick, with its place among them.
      recorded: numbers of the trials that are recorded as a whole, if the system keeps figures of all; None: all.
    """

    def __init__(
        self, system: System, on_tick: Callable[[int, Recorder], None] | None = None, recorded: NDArray[np.int64] | None = None
    ) -> None:
        keep = None if recorded is None or system.figures is None else np.flatnonzero(np.isin(system.trials, recorded))
        ticks = -(-system.ticks // system.every)
        self.system, self.lost = system, LostTrials(system.trials)
        self.recorder = Recorder(system.dt * system.every, ticks, system.trials, system.estimators, keep, system.errors)
        self._ticks = _run(system, self.recorder, self.lost, on_tick)

    def __iter__(self) -> Flight:
        return self

    def __next__(self) -> Sensed:
        """Act as the law decides, and sense the next tick; the first call senses the first tick."""
        return self.send(None)

    def send(self, effort: Array | None) -> Sensed:
        """Act by `effort`, (trials, [agents,] axes) N m or N, in place of the law's, and sense the next tick.

        Raises:
          StopIteration: the last tick is over, or no trial is left.
        """
        try:
            return self._ticks.send(effort)
        except (LostDefiniteness, np.linalg.LinAlgError) as failure:  # in a first belief or a control law: nobody can say in which trial
            done = self.recorder.done
            self.lost.add_all(done, self.system.time(done * self.system.every), str(failure))
            self.recorder.give_up()
            raise StopIteration from None

    def recording(self) -> Recording:
        """What was recorded until now; trials in which a filter or the physics broke down are named in there."""
        return replace(self.recorder.finish(self.system.references, self.system.occurrences), lost=self.lost.all)


def run(system: System, on_tick: Callable[[int, Recorder], None] | None = None, recorded: NDArray[np.int64] | None = None) -> Recording:
    """Run the loop to its end and return what it recorded; the arguments are those of `Flight`."""
    flight = Flight(system, on_tick, recorded)
    for _ in flight:
        pass
    return flight.recording()


def run_whole(system: System, on_tick: Callable[[int, Recorder], None] | None = None) -> Recording:
    """The same where every trial is needed; raises RecordedRunFailed if one broke down."""
    recording = run(system, on_tick)
    if recording.lost:
        first = min(recording.lost, key=lambda lost: lost.tick)
        raise RecordedRunFailed(first.trial, first.time_s, first.cause, recording)
    return recording


class Sensed(NamedTuple):
    """What is known at a tick before anything acts.

    Attributes:
      tick: its number.
      truth: what is so.
      reading: NaN where nothing is read, (trials, [agents,] m).
      beliefs: of the estimators.
      estimate: what the law acts on.
      messages: what agents hear.
      decision: the law's.
    """

    tick: int
    truth: Any
    reading: Array
    beliefs: tuple[Any, ...]
    estimate: Any
    messages: Any
    decision: Decision


def _run(
    s: System, recorder: Recorder, broken: LostTrials, on_tick: Callable[[int, Recorder], None] | None
) -> Generator[Sensed, Array | None, None]:
    """The loop itself; at every tick it is told what is to act on the bodies in place of the law's decision, or None."""
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
        reading, known = s.sensors.read(k, truth, recorder.past), given.known
        lost = broken.failed | (lost if s.loss is None else s.loss.judge(lost, truth))
        if first is not None and lost.any():  # what a lost trial's filter does is of no interest, but must not fail
            beliefs = tuple(e.put_back(lost, one, b) for e, one, b in zip(s.estimators, first[0], beliefs, strict=True))
            known, reading = choose(lost, rest.known, known), choose(lost, first[1], reading)
        beliefs = _observe(s, beliefs, first, Told(known, reading, rest.known), k, broken)
        first, lost = first or (beliefs, reading), lost | broken.failed
        held = np.where(np.isnan(reading), held, reading)
        estimate = s.feedback(k, beliefs, truth, reading, held)
        memory = s.law.start(estimate) if k == 0 else memory
        messages = s.network.carry(k, s.law.says(k, estimate, memory))
        decision = s.law.decide(k, estimate, messages, memory)
        told = yield Sensed(k, truth, reading, beliefs, estimate, messages, decision)
        decision = decision if told is None else decision._replace(effort=told)
        given = s.effectors.give(k, decision, estimate, held, given, lost)
        if k % s.every == 0:
            now = Snapshot(truth, reading, beliefs, estimate, messages, memory, decision, given, lost, broken.failed)
            recorder.tick(k // s.every, now, s.channels(k, now), s.figures(k, now) if s.figures else {})
            if on_tick:
                on_tick(k // s.every, recorder)
        if broken.failed.all():
            recorder.give_up()
            return
        s.change(k)
        try:
            s.plant.advance(*_acting(s, given, broken), steps)
        except SimulationFailed as failure:
            for position, cause in failure.causes.items():
                broken.add(position, (k + 1) // s.every, failure.time, cause)
            s.plant.put_back(broken.failed)
        memory = decision.memory


class Told(NamedTuple):
    """What estimators are told at a tick."""

    known: Any  # of the drives since the tick before
    reading: Array
    rest: Any  # what would be known if nothing had acted


def _observe(s: System, beliefs: tuple[Any, ...], first: Any, told: Told, tick: int, broken: LostTrials) -> tuple[Any, ...]:
    """One step of every estimator; a trial in which one breaks down is given up, and the step taken again without it."""
    if first is None:
        return tuple(estimator.initial(told.reading) for estimator in s.estimators)
    after = []
    for estimator, start, before in zip(s.estimators, first[0], beliefs, strict=True):
        belief, known, reading = before, told.known, told.reading
        position: int | None
        while True:
            try:
                after.append(estimator.step(belief, known, reading, s.interval(tick)))
                break
            except (LostDefiniteness, np.linalg.LinAlgError) as failure:
                if isinstance(failure, LostDefiniteness):
                    position, cause = estimator.blame(failure)
                else:
                    position = _culprit(s, estimator, (start, before), told, tick, first[1], broken.failed)
                    cause = f"{', '.join(estimator.names)}: {failure}"
                if position is None or broken.failed[position]:  # it breaks down even without that trial: nothing of the batch can be saved
                    broken.add_all(tick // s.every, s.time(tick), cause)
                    after.append(before)
                    break
                broken.add(position, tick // s.every, s.time(tick), cause)
                estimator.rewind()
                belief = estimator.put_back(broken.failed, start, belief)
                known, reading = choose(broken.failed, told.rest, known), choose(broken.failed, first[1], reading)
    return tuple(after)


def _culprit(s: System, estimator: Estimator, before: tuple[Any, Any], told: Told, tick: int, first: Array, failed: Flags) -> int | None:
    """The first trial in which a step breaks down whatever the others do; None: there is none.

    LAPACK says of a stack of matrices only that something in it is wrong, so each trial that has not `failed` is tried by itself, among
    others at their start. `before` are the beliefs at the start and before the tick, `first` is the first reading.
    """
    start, belief = before
    for position in np.flatnonzero(~failed).tolist():
        others = np.arange(len(failed)) != position
        known, reading = choose(others, told.rest, told.known), choose(others, first, told.reading)
        estimator.rewind()
        try:
            estimator.step(estimator.put_back(others, start, belief), known, reading, s.interval(tick))
        except (LostDefiniteness, np.linalg.LinAlgError):
            return int(position)
    return None


def _acting(s: System, given: ActuatorOutput, broken: LostTrials) -> tuple[Array, Any]:
    """Torques of motors, and what pushes the bodies; in trials that broke down nothing does, and they are put back to their start."""
    wheel, push = given.wheel, given.push
    if broken:
        s.plant.put_back(broken.failed)
        if not callable(push):
            return choose(broken.failed, np.zeros_like(wheel), wheel), choose(broken.failed, np.zeros_like(push), push)
    return wheel, push
