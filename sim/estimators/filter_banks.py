"""Observers of a closed loop: the filters that a scenario's settings stand for, those of one kind stepped as one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from estimation.adaptive_unscented import AdaptiveUnscentedFilter
from estimation.choice import choose
from estimation.extended_kalman import ExtendedFilter
from estimation.gaussian import Belief, Detection, LostDefiniteness, no_detection
from estimation.interacting_multiple_model import InteractingMultipleModel
from estimation.nis_switching import SwitchedGain
from estimation.particle import ParticleFilter
from estimation.stacking import stack, stackable
from estimation.state_space import StateSpace
from estimation.unscented import UnscentedFilter
from sim.estimators.believed import Models
from sim.estimators.learning_observer import LearningObserver
from sim.estimators.observer import ObserverBase, Place
from sim.estimators.particle_draws import ParticleDraws
from sim.estimators.particle_observer import ParticleObserver
from sim.randomness import Trials
from sim.sensors.sensors import SensorSettings

Array = NDArray[np.floating]


class Observer(Protocol):
    """A filter as the loop sees it."""

    @property
    def space(self) -> StateSpace:
        """Error coordinates of its covariance."""
        ...

    def initial(self, measurement: Array) -> Belief:
        """Belief after the first reading, (trials, n)."""
        ...

    def step(self, belief: Belief, command: Array, measurement: Array, dt: float) -> Belief:
        """Belief after `dt` seconds of `command`, (trials, wheels), and a reading, (trials, n)."""
        ...


@dataclass(frozen=True, eq=False)
class FilterBank:
    """Observers of one kind, stepped as one; beliefs are (members, trials, ...).

    Attributes:
      names: one a member.
      filter: steps them all.
      thresholds: on, off of each member's fault detector.
      speeds_are_states: whether they estimate the wheel speeds; otherwise these are read and are inputs beside the torques.
      whole: whether they are told all that is known and read, and take from it what they need.
    """

    names: tuple[str, ...]
    filter: Observer
    thresholds: tuple[tuple[float, float] | None, ...]
    speeds_are_states: bool = True
    whole: bool = False

    @property
    def space(self) -> StateSpace:
        """Error coordinates of its covariance."""
        return self.filter.space

    def initial(self, reading: Array) -> Belief:
        """Belief after the first reading, (trials, 7 + wheels)."""
        return self.filter.initial(reading)

    def step(self, belief: Belief, known: Array, reading: Array, dt: float) -> Belief:
        """Belief after `dt` seconds of what is known of the drives, (trials, 2 wheels) or (trials, 3), and a reading."""
        return self.filter.step(belief, self.inputs(known), reading, dt)

    def summary(self, belief: Belief) -> Belief:
        """The belief as it is."""
        return belief

    def put_back(self, where: NDArray[np.bool_], first: Belief, belief: Belief) -> Belief:
        """The first belief in some trials, (trials,)."""
        whole, nothing = belief.detection, no_detection(np.zeros((1, len(where))))
        parts: Belief = choose(where[None], first._replace(detection=nothing), belief._replace(detection=nothing))
        own = first.detection
        history = tuple(  # of filters that are stacked each has its own, without an axis of members
            choose(where[(None,) * (now.ndim - 2)], then, now) for then, now in zip(own.history, whole.history, strict=True)
        )
        statistic, declared = (choose(where[None], *pair) for pair in ((own.statistic, whole.statistic), (own.declared, whole.declared)))
        return parts._replace(detection=Detection(statistic, declared, history))

    def rewind(self) -> None:
        """Take the last step's random numbers again at the next one."""
        if isinstance(self.filter, ParticleObserver):
            self.filter.draws.rewind()

    def blame(self, failure: LostDefiniteness) -> tuple[int, str]:
        """The trial and the filter whose covariance it is."""
        member, trial = failure.where[-2:]
        return trial, f"{self.names[member]}: its innovation covariance lost definiteness"

    def inputs(self, known: Array) -> Array:
        """What drives its model, of commanded torques and read speeds of the wheels (trials, 2 wheels)."""
        return known[..., : known.shape[-1] // 2] if self.speeds_are_states and not self.whole else known


@dataclass(frozen=True, eq=False)
class Alone:
    """A filter as the only member of its bank."""

    filter: Observer

    @property
    def space(self) -> StateSpace:
        """Error coordinates of its covariance."""
        return self.filter.space

    def initial(self, measurement: Array) -> Belief:
        """Belief (1, trials, ...) after the first reading, (trials, n)."""
        return self.filter.initial(measurement[None])

    def step(self, belief: Belief, command: Array, measurement: Array, dt: float) -> Belief:
        """Belief after `dt` seconds of `command`, (trials, r), and a reading, (trials, n)."""
        return self.filter.step(belief, command[None], measurement[None], dt)


GaussianFilter = ExtendedFilter | UnscentedFilter | AdaptiveUnscentedFilter | InteractingMultipleModel
Single = GaussianFilter | ParticleObserver | LearningObserver


def build_filter_banks(
    observers: Mapping[str, ObserverBase],
    models: Models,
    sensors: SensorSettings,
    wheels: int,
    tick_s: float,
    seed: int = 0,
    trials: Trials | None = None,
) -> tuple[FilterBank, ...]:
    """All observers of a scenario, those of one kind together; random numbers of particle filters are those of the given trials."""
    groups: list[list[tuple[str, Single]]] = []
    for name, settings in observers.items():
        single = settings.build(Place(models, sensors, wheels, tick_s))
        if isinstance(single, ParticleFilter):
            if trials is None:
                raise ValueError(f"{name}: a particle filter needs random numbers, those of numbered trials")
            numbers = ParticleDraws.of_a_filter(
                name, seed, trials, single.particles, single.size, single.roughening > 0.0, single.mixture is not None
            )
            groups.append([(name, ParticleObserver(single, numbers))])
            continue
        for group in groups:
            first = group[0][1]
            if isinstance(first, ExtendedFilter) and isinstance(single, ExtendedFilter) and stackable(first, single):
                group.append((name, single))
                break
        else:
            groups.append([(name, single)])
    return tuple(
        FilterBank(
            names=tuple(name for name, _ in group),
            filter=_as_one([single for _, single in group]),
            thresholds=tuple(thresholds_of(single) for _, single in group),
            speeds_are_states=models.speeds_are_states,
            whole=isinstance(group[0][1], LearningObserver),
        )
        for group in groups
    )


def _as_one(group: list[Single]) -> Observer:
    """Filters of one kind; those that are no extended ones come alone."""
    if alike := [single for single in group if isinstance(single, ExtendedFilter)]:
        return stack(alike)
    return group[0] if isinstance(group[0], ParticleObserver | LearningObserver) else Alone(group[0])


def thresholds_of(single: Single) -> tuple[float, float] | None:
    """Statistic above which a filter declares a fault and below which it withdraws it, if it does."""
    if isinstance(single, InteractingMultipleModel):
        return single.declare_above, single.withdraw_below
    gain = getattr(single, "gain", None)
    return gain.thresholds if isinstance(gain, SwitchedGain) else None
