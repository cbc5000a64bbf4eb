"""A user's own filter, as the loop sees it."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.gaussian import Belief, Detection, LostDefiniteness
from estimation.state_space import Additive, StateSpace
from models.dynamics.state_layout import StateLayout
from sim.parts import Flags, Thresholds
from sim.user_code.real_numbers import real_numbers
from sim.user_code.rehearsal import TRIALS, readings, same_whatever_the_batch
from sim.user_code.surroundings import Surroundings
from sim.user_code.user_class import UserClass

Array = NDArray[np.floating]


class UserBelief(NamedTuple):
    """A user's belief, and the same in the project's form."""

    own: Any
    told: Belief
    tick: int


@dataclass(frozen=True, eq=False)
class UserFilter:
    """A user's filter as an estimator of a loop; what it does not say is NaN.

    Attributes:
      source: its class.
      own: the instance.
      place: how it sits in the loop.
      space: error coordinates of its covariance.
      limits: on, off of its fault detector.
    """

    source: UserClass
    own: Any
    place: Surroundings
    space: StateSpace
    limits: Thresholds

    @classmethod
    def of(cls, source: UserClass, place: Surroundings) -> UserFilter:
        """A fresh one, its first belief telling in which coordinates its covariance is and whether it declares faults."""
        own, layout = source.construct(place.setting), place.setting.layout
        with source.blamed("initial"):
            first: Any = source.construct(place.setting).initial(_never_read(place, readings(layout)))
        covariance: Any = getattr(first, "covariance", None)
        by_components = np.shape(covariance)[-1:] == (layout.size,) and layout.size != layout.errors
        space = Additive() if by_components else place.setting.space
        limits = None
        if getattr(first, "declared", None) is not None:
            with source.blamed("", " (thresholds must be two numbers: on, off)"):
                on, off = map(float, getattr(own, "thresholds", (np.nan, np.nan)))
            limits = (on, off)
        return cls(source, own, place, space, limits)

    @property
    def names(self) -> tuple[str, ...]:
        """Its own."""
        return (self.source.name,)

    @property
    def thresholds(self) -> tuple[Thresholds, ...]:
        """On, off of its fault detector."""
        return (self.limits,)

    def initial(self, reading: Array) -> UserBelief:
        """Belief after the first reading, (trials, [agents,] m)."""
        measurement = self.place.measured(reading)
        with self.source.blamed("initial"):
            own = self.own.initial(measurement.copy())
        return self._adapt(own, measurement, "initial", 0)

    def step(self, belief: UserBelief, known: Any, reading: Array, dt: float) -> UserBelief:
        """Belief after `dt` seconds of what is known of the drives, and a reading, (trials, [agents,] m)."""
        return self._step(belief, self.place.command(known), self.place.measured(reading), dt)

    def summary(self, belief: UserBelief) -> Belief:
        """What it told, (1, trials, [agents,] ...)."""
        return belief.told

    def put_back(self, where: Flags, first: UserBelief, belief: UserBelief) -> UserBelief:
        """The belief as it is: only the user knows what is in it."""
        return belief

    def rewind(self) -> None:
        """Only the user knows what it draws."""

    def blame(self, failure: LostDefiniteness) -> tuple[int, str]:
        """The first trial: a user's filter breaks down as a whole."""
        return 0, f"{self.source.name}: {failure.what} lost definiteness"

    def rehearse(self) -> None:
        """Run a few ticks of three trials, also apart from each other, and with missing readings if there can be any."""
        same_whatever_the_batch(self.source, self._rehearsed)

    def _rehearsed(self, which: slice) -> Array:
        layout = self.place.setting.layout
        fresh = UserFilter(self.source, self.source.construct(self.place.setting), self.place, self.space, self.limits)
        reading = _never_read(self.place, readings(layout))[which]
        command = np.full((TRIALS, *layout.lead, self.place.inputs), 1e-3)[which]
        belief = fresh.begin(reading)
        seen = reading
        for lost in (slice(0), *layout.places.values(), slice(None)) if self.place.gaps else (slice(0), slice(0)):
            seen = reading.copy()
            seen[..., lost] = np.nan
            belief = fresh._step(belief, command, seen, 0.1)
        if self.place.gaps:
            fresh.begin(seen)
        return belief.told.mean[0]

    def begin(self, measurement: Array) -> UserBelief:
        """Belief after the first measurement, (trials, [agents,] n)."""
        with self.source.blamed("initial"):
            own = self.own.initial(measurement.copy())
        return self._adapt(own, measurement, "initial", 0)

    def _step(self, belief: UserBelief, command: Array, measurement: Array, dt: float) -> UserBelief:
        with self.source.blamed("step", f" (at tick {belief.tick + 1})"):
            own = self.own.step(belief.own, command.copy(), measurement.copy(), dt)
        return self._adapt(own, measurement, "step", belief.tick + 1)

    def _adapt(self, own: Any, measurement: Array, method: str, tick: int) -> UserBelief:
        lead, layout = measurement.shape[:-1], self.place.setting.layout
        mean = self._part(own, "mean", measurement.shape, method, None)
        if not np.isfinite(mean).all():
            which = int(np.argwhere(~np.isfinite(mean).all(axis=-1))[0, 0])
            raise self.source.complaint(method, f"mean is not finite at tick {tick} (row {which} of {lead[0]}); a missing reading is NaN")
        e = layout.size if isinstance(self.space, Additive) else layout.errors
        read = _degrees_of_freedom(measurement, layout)
        statistic, declared = self._part(own, "statistic", lead, method), self._part(own, "declared", lead, method, 0.0)
        if np.isnan(declared).any():
            raise self.source.complaint(method, f"declared has no number at tick {tick}; needs true or false, or leave it out altogether")
        told = Belief(
            mean=mean[None],
            covariance=self._part(own, "covariance", (*lead, e, e), method)[None],
            innovation=self._part(own, "innovation", (*lead, e), method)[None],
            nis=self._part(own, "nis", lead, method)[None],
            log_likelihood=np.full((1, *lead), np.nan),
            dof=self._part(own, "dof", lead, method, read)[None],
            detection=Detection(statistic[None], declared[None] > 0.0, ()),
        )
        return UserBelief(own, told, tick)

    def _part(self, own: Any, name: str, shape: tuple[int, ...], method: str, default: Any = np.nan) -> Array:
        """One array of a belief; all but the mean may be left out, and broadcast."""
        with self.source.blamed(method):
            value = getattr(own, name, None)
        if value is None:
            if default is None:
                raise self.source.complaint(method, f"returned {type(own).__name__} without `{name}`")
            value = default
        array: Array = np.zeros(0)
        with self.source.blamed(method, f" (in {name})"), suppress(TypeError, ValueError):
            array = real_numbers(np.asarray(value).astype(int) if np.asarray(value).dtype == bool else value)
            array = array if name == "mean" else np.array(np.broadcast_to(array, shape))
        if array.shape != shape:
            raise self.source.complaint(method, f"{name} has shape {_shape(value)}, needs {shape} of numbers")
        return array


def _degrees_of_freedom(measurement: Array, layout: StateLayout) -> Array:
    """Of a reading (..., n) of states: its components, those of a whole unit quaternion counting three and of a part of one none."""
    known, dof = ~np.isnan(measurement), np.zeros(measurement.shape[:-1])
    for block in layout.blocks:
        own = known[..., layout.places[block.kind]]
        dof += np.where(own.all(axis=-1), block.errors, 0 if block.errors < len(block.names) else np.sum(own, axis=-1))
    return dof


def _never_read(place: Surroundings, states: Array) -> Array:
    """States (3, [agents,] n) as they are read: what is never read is NaN."""
    seen = states.copy()
    for block in place.unread:
        seen[..., place.setting.layout.places[block]] = np.nan
    return seen


def _shape(value: Any) -> tuple[int, ...] | str:
    """Of an array, or the type of what is none."""
    try:
        return np.shape(value)
    except (TypeError, ValueError):
        return type(value).__name__
