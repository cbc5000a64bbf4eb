"""Collects a run tick by tick, and what the filters' covariances say of their errors."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimation.consistency import normalized_squared
from estimation.gaussian import Belief
from estimation.state_space import Multiplicative, StateSpace
from sim.faults.timeline import Occurrence
from sim.loop.recording import Recording
from sim.parts import AnyArray, Array, Estimator, Flags, Snapshot

MULTIPLICATIVE = Multiplicative()
OBSERVED = ("mean", "sigma", "nees", "nis", "dof", "statistic", "declared", "modes", "lost", "ess", "fading", "learned")
REMEMBERED = ("ess", "fading", "learned")
_BLOCK = 25  # ticks whose covariances are kept until they are reduced together


class Recorder:
    """Arrays (ticks, trials, ...) that are filled tick by tick; `finish` gives the Recording."""

    def __init__(
        self,
        dt: float,
        ticks: int,
        trials: NDArray[np.int64],
        estimators: tuple[Estimator, ...],
        keep: NDArray[np.int64] | None = None,
        errors: StateSpace = MULTIPLICATIVE,
    ) -> None:
        """Make room.

        Args:
          dt: of a recorded tick, s.
          ticks: recorded ones.
          trials: numbers of all trials, (trials,).
          estimators: of the loop.
          keep: positions of the trials that are recorded as a whole; None: all.
          errors: coordinates in which estimates are held against the truth.
        """
        self.dt, self.ticks, self.trials, self.estimators, self.done = dt, ticks, trials, estimators, 0
        self._keep: Any = slice(None) if keep is None else keep
        self._errors = errors
        self._arrays: dict[str, Array] = {}
        self._figures: dict[str, Array] = {}
        self._covariance: dict[int, Array] = {}
        self._effective: dict[int, Array] = {}  # particles, of the last block
        self._sparse = keep is not None  # what is not kept of a trial goes into its figures tick by tick
        self._states: dict[int, tuple[Array, Array]] = {}
        self._truth: Array = np.empty(0)
        self._over = False
        self._lost: dict[int, Flags] = {}  # by tick, where any trial is

    @property
    def past(self) -> Array:
        """True states until now, (ticks, trials, ...), those to come being NaN."""
        return self._arrays["truth/state"]

    def array(self, name: str) -> Array:
        """All ticks of a channel, those not yet recorded being NaN."""
        return self._arrays[name]

    def begin(self, tick: int, truth: Any) -> None:
        """Keep the truth of a tick."""
        self._truth = truth.state
        self.put("truth/state", tick, self._truth[self._keep])

    def tick(self, tick: int, now: Snapshot, channels: dict[str, AnyArray], figures: dict[str, AnyArray]) -> None:
        """Keep the rest of a tick; it counts as recorded from now on."""
        self.observe(tick, now.beliefs)
        for name, value in channels.items():
            self.put(name, tick, value[self._keep])
        for name, value in figures.items():
            _put(self._figures, self.ticks, name, tick, value)
        if now.lost.any():
            self._blank(tick, now.lost, now.failed)
        self.done = tick + 1

    def _blank(self, tick: int, lost: Flags, failed: Flags) -> None:
        """Nothing but the truth is known of trials that are lost, and not even that of trials that broke down."""
        self._lost[tick] = lost
        for name, array in self._arrays.items():
            own = (failed if name.startswith("truth/") else lost)[self._keep]
            array[(tick, slice(None), own) if ":" in name else (tick, own)] = np.nan if array.dtype != bool else False
        for array in self._figures.values():
            array[tick, lost] = np.nan

    def put(self, name: str, tick: int, value: AnyArray) -> None:
        """Keep one tick of a channel."""
        _put(self._arrays, self.ticks, name, tick, value)

    def observe(self, tick: int, beliefs: tuple[Any, ...]) -> None:
        """Keep one tick of every estimator; (members, trials, ...)."""
        for index, (estimator, raw) in enumerate(zip(self.estimators, beliefs, strict=True)):
            belief = estimator.summary(raw)
            self.put(f"{index}:mean", tick, belief.mean[:, self._keep])
            self.put(f"{index}:nis", tick, _of_what_was_read(belief)[:, self._keep])
            self.put(f"{index}:dof", tick, belief.dof[:, self._keep])
            self.put(f"{index}:statistic", tick, belief.detection.statistic[:, self._keep])
            self.put(f"{index}:declared", tick, belief.detection.declared[:, self._keep])
            if belief.modes is not None:
                self.put(f"{index}:modes", tick, belief.modes.probabilities[:, self._keep])
            if belief.lost is not None:
                self.put(f"{index}:lost", tick, belief.lost[:, self._keep])
            for part in REMEMBERED:
                if (value := getattr(belief.memory, part, None)) is not None:
                    self.put(f"{index}:{part}", tick, value[:, self._keep])
            self._keep_covariance(index, tick, belief)

    def _keep_covariance(self, index: int, tick: int, belief: Belief) -> None:
        covariances = self._covariance.setdefault(index, np.empty((_BLOCK, *belief.covariance.shape)))
        covariances[tick % _BLOCK] = belief.covariance
        if (ess := getattr(belief.memory, "ess", None)) is not None:
            self._effective.setdefault(index, np.empty((_BLOCK, *ess.shape)))[tick % _BLOCK] = ess
        if self._sparse:
            means, truths = self._states.setdefault(index, (np.empty((_BLOCK, *belief.mean.shape)), np.empty((_BLOCK, *self._truth.shape))))
            means[tick % _BLOCK], truths[tick % _BLOCK] = belief.mean, self._truth
            for member, name in enumerate(self.estimators[index].names):
                _put(self._figures, self.ticks, f"{name}/nis", tick, _mean_of_agents(_of_what_was_read(belief)[member]))
        if tick % _BLOCK == _BLOCK - 1:
            self._reduce(index, tick + 1)

    def _reduce(self, index: int, stop: int) -> None:
        """Turn the covariances of the last block into NEES and standard deviations, in the error coordinates of the state."""
        start = (stop - 1) // _BLOCK * _BLOCK
        space, size = self.estimators[index].space, stop - start
        if self._sparse:
            mean, truth = (block[:size] for block in self._states[index])
        else:
            mean, truth = self._arrays[f"{index}:mean"][start:stop], self._arrays["truth/state"][start:stop]
        covariance = space.reduce(mean, self._covariance[index][:size])
        error = self._errors.difference(truth[:, None, ..., : mean.shape[-1]], mean)
        nees = normalized_squared(error, self._spanned(index, start, stop, covariance))
        if self._sparse:
            for member, name in enumerate(self.estimators[index].names):
                figure = self._figures.setdefault(f"{name}/nees", np.full((self.ticks, len(self.trials)), np.nan))
                figure[start:stop] = _mean_of_agents(nees[:, member])
            nees, covariance = nees[:, :, self._keep], covariance[:, :, self._keep]
        variance = np.diagonal(covariance, axis1=-2, axis2=-1)
        sigma = np.sqrt(np.where(variance < 0.0, np.nan, variance))
        for name, value in (("nees", nees), ("sigma", sigma)):
            array = self._arrays.setdefault(f"{index}:{name}", np.full((self.ticks, *value.shape[1:]), np.nan))
            array[start:stop] = value

    def _spanned(self, index: int, start: int, stop: int, covariance: Array) -> Array:
        """Covariances, NaN where too few particles count to span one."""
        ess = self._effective.get(index)
        if ess is None:
            return covariance
        return np.where((ess[: stop - start] > covariance.shape[-1] + 1)[..., None, None], covariance, np.nan)

    def give_up(self) -> None:
        """Nothing of any trial counts any more: the ticks to come stay without a number."""
        self._over = True

    def finish(self, references: dict[str, Array], occurrences: tuple[Occurrence, ...]) -> Recording:
        """All ticks that were recorded; `references` are arrays (ticks, ...) without an axis of trials, by name."""
        done, length = self.done, self.ticks if self._over else self.done
        channels = {name: array[:length] for name, array in self._arrays.items() if ":" not in name}
        thresholds: dict[str, tuple[float, float] | None] = {}
        for index, estimator in enumerate(self.estimators):
            if done % _BLOCK:
                self._reduce(index, done)
            for tick, lost in self._lost.items():  # covariances are reduced in blocks
                for part in ("sigma", "nees"):
                    self._arrays[f"{index}:{part}"][tick, :, lost[self._keep]] = np.nan
                for name in estimator.names if self._sparse else ():
                    self._figures[f"{name}/nees"][tick, lost] = np.nan
            for member, name in enumerate(estimator.names):
                thresholds[name] = estimator.thresholds[member]
                for part in OBSERVED:
                    if (array := self._arrays.get(f"{index}:{part}")) is not None:
                        channels[f"{name}/{part}"] = array[:length, member]
        channels |= {f"reference/{name}": array[:length] for name, array in references.items()}
        figures = {name: array[:length] for name, array in self._figures.items()}
        positions = np.arange(len(self.trials))[self._keep].tolist()
        kept = tuple(o._replace(trial=positions.index(o.trial)) for o in occurrences if o.trial in positions)
        return Recording(self.dt, self.trials[self._keep], channels, thresholds, kept, {}, figures, self.trials)


def _of_what_was_read(belief: Belief) -> Array:
    """NIS of a belief, NaN where nothing was read: zero would be a surprise too small; (members, trials, ...)."""
    return np.where(belief.dof == 0.0, np.nan, belief.nis)


def _mean_of_agents(values: Array) -> Array:
    """Over the last axis but those of ticks and trials, of what is a number; (..., trials, agents) to (..., trials)."""
    known = ~np.isnan(values)
    count = np.sum(known, axis=-1)
    return np.where(count > 0, np.sum(np.where(known, values, 0.0), axis=-1) / np.maximum(count, 1), np.nan)


def _put(arrays: dict[str, Array], ticks: int, name: str, tick: int, value: AnyArray) -> None:
    array = arrays.get(name)
    if array is None:
        shape = (ticks, *value.shape)
        exact = value.dtype if value.dtype == np.float32 else np.dtype(float)  # what is large may be kept in half the memory
        array = arrays[name] = np.full(shape, np.nan, exact) if value.dtype != bool else np.zeros(shape, bool)
    array[tick] = value
