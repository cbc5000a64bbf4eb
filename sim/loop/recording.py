"""What a run leaves behind while it runs: arrays with axes (ticks, trials, ...), and derived consistency of every observer."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from control.tracking import Target
from estimation.consistency import normalized_squared
from estimation.gaussian import Belief
from estimation.state_space import Multiplicative
from sim.estimators.filter_banks import Bank
from sim.faults.timeline import Occurrence

Array = NDArray[np.floating]
AnyArray = NDArray[np.floating] | NDArray[np.bool_]

MULTIPLICATIVE = Multiplicative()
OBSERVED = ("mean", "sigma", "nees", "nis", "dof", "statistic", "declared", "modes", "lost", "ess", "fading", "learned")
REMEMBERED = ("ess", "fading", "learned")
_BLOCK = 25  # ticks whose covariances are kept until they are reduced together


@dataclass(frozen=True, eq=False)
class Recording:
    """A run, or what there was of it: named arrays (ticks, trials, ...) and what happened when.

    Channels: `truth/state` [q, omega, wheel speeds], `truth/qpos`, `truth/qvel`, `reading`, `command`, `applied` (N m, wheels),
    `fault` (bool); of each observer NAME: `NAME/mean`, `NAME/sigma` (attitude as a rotation, rad), `NAME/nees`, `NAME/nis`,
    `NAME/dof`, `NAME/statistic`, `NAME/declared`; of one with modes `NAME/modes`, their probabilities; of one that repairs covariances
    `NAME/lost`, how many so far; of a particle filter `NAME/ess`, the effective number of particles; of an adaptive one `NAME/fading`, its
    factor; of one that learns a torque `NAME/learned` (N m in B), beside it `truth/unmodelled`; `control/...`, what a law notes.
    `reference/...` has no trial axis. Findings are what was worked out of a trial afterwards, (trials, ...).
    """

    dt: float
    trials: NDArray[np.int64]
    channels: dict[str, Array]
    thresholds: dict[str, tuple[float, float] | None]
    occurrences: tuple[Occurrence, ...] = ()
    findings: dict[str, Array] = field(default_factory=dict)

    @property
    def ticks(self) -> int:
        """Control ticks recorded."""
        return len(self.channels["truth/state"])

    @property
    def time(self) -> Array:
        """Seconds since the start, (ticks,)."""
        return self.dt * np.arange(self.ticks)

    @property
    def observers(self) -> tuple[str, ...]:
        """Names of the observers."""
        return tuple(self.thresholds)

    def select(self, keep: NDArray[np.int64]) -> Recording:
        """The trials at positions `keep`."""
        place = {int(old): new for new, old in enumerate(keep)}
        channels = {name: a if name.startswith("reference/") else a[:, keep] for name, a in self.channels.items()}
        occurrences = tuple(o._replace(trial=place[o.trial]) for o in self.occurrences if o.trial in place)
        findings = {name: a[keep] for name, a in self.findings.items()}
        return Recording(self.dt, self.trials[keep], channels, self.thresholds, occurrences, findings)

    @staticmethod
    def join(parts: list[Recording]) -> Recording:
        """Recordings of the same run of different trials as one."""
        first = parts[0]
        channels = {
            name: array if name.startswith("reference/") else np.concatenate([part.channels[name] for part in parts], axis=1)
            for name, array in first.channels.items()
        }
        occurrences, before = [], 0
        for part in parts:
            occurrences += [o._replace(trial=o.trial + before) for o in part.occurrences]
            before += len(part.trials)
        findings = {name: np.concatenate([part.findings[name] for part in parts]) for name in first.findings}
        trials = np.concatenate([part.trials for part in parts])
        return Recording(first.dt, trials, channels, first.thresholds, tuple(occurrences), findings)


@dataclass(eq=False)
class Recorder:
    """Collects a run tick by tick; `finish` gives the Recording."""

    dt: float
    ticks: int
    trials: NDArray[np.int64]
    banks: tuple[Bank, ...]
    done: int = 0
    _arrays: dict[str, Array] = field(default_factory=dict)
    _covariance: dict[int, Array] = field(default_factory=dict)

    def put(self, name: str, tick: int, value: AnyArray) -> None:
        """Keep one tick of a channel."""
        array = self._arrays.get(name)
        if array is None:
            array = self._arrays[name] = (
                np.full((self.ticks, *value.shape), np.nan) if value.dtype != bool else np.zeros((self.ticks, *value.shape), bool)
            )
        array[tick] = value

    def array(self, name: str) -> Array:
        """All ticks of a channel, those not yet recorded being NaN."""
        return self._arrays[name]

    def tick(self, tick: int, channels: dict[str, AnyArray]) -> None:
        """Keep the rest of a tick; it counts as recorded from now on."""
        for name, value in channels.items():
            self.put(name, tick, value)
        self.done = tick + 1

    def observe(self, tick: int, beliefs: tuple[Belief, ...]) -> None:
        """Keep one tick of every bank of observers; (members, trials, ...)."""
        for index, belief in enumerate(beliefs):
            for part in ("mean", "nis", "dof"):
                self.put(f"{index}:{part}", tick, getattr(belief, part))
            self.put(f"{index}:statistic", tick, belief.detection.statistic)
            self.put(f"{index}:declared", tick, belief.detection.declared)
            if belief.modes is not None:
                self.put(f"{index}:modes", tick, belief.modes.probabilities)
            if belief.lost is not None:
                self.put(f"{index}:lost", tick, belief.lost)
            for part in REMEMBERED:
                if (value := getattr(belief.memory, part, None)) is not None:
                    self.put(f"{index}:{part}", tick, value)
            covariances = self._covariance.setdefault(index, np.empty((_BLOCK, *belief.covariance.shape)))
            covariances[tick % _BLOCK] = belief.covariance
            if tick % _BLOCK == _BLOCK - 1:
                self._reduce(index, tick + 1)

    def _reduce(self, index: int, stop: int) -> None:
        """Turn the covariances of the last block into NEES and standard deviations, in the multiplicative error coordinates."""
        start = (stop - 1) // _BLOCK * _BLOCK
        space = self.banks[index].filter.space
        mean = self._arrays[f"{index}:mean"][start:stop]
        truth = self._arrays["truth/state"][start:stop, None, ..., : mean.shape[-1]]
        covariance = space.reduce(mean, self._covariance[index][: stop - start])
        error = MULTIPLICATIVE.difference(truth, mean)
        nees = normalized_squared(error, self._spanned(index, start, stop, covariance))
        variance = np.diagonal(covariance, axis1=-2, axis2=-1)
        sigma = np.sqrt(np.where(variance < 0.0, np.nan, variance))
        for name, value in (("nees", nees), ("sigma", sigma)):
            array = self._arrays.setdefault(f"{index}:{name}", np.full((self.ticks, *value.shape[1:]), np.nan))
            array[start:stop] = value

    def _spanned(self, index: int, start: int, stop: int, covariance: Array) -> Array:
        """Covariances, NaN where too few particles count to span one."""
        ess = self._arrays.get(f"{index}:ess")
        if ess is None:
            return covariance
        return np.where((ess[start:stop] > covariance.shape[-1] + 1)[..., None, None], covariance, np.nan)

    def finish(self, target: Target, occurrences: tuple[Occurrence, ...]) -> Recording:
        """All ticks that were recorded."""
        done = self.done
        channels = {name: array[:done] for name, array in self._arrays.items() if ":" not in name}
        thresholds: dict[str, tuple[float, float] | None] = {}
        for index, bank in enumerate(self.banks):
            if done % _BLOCK:
                self._reduce(index, done)
            for member, name in enumerate(bank.names):
                thresholds[name] = bank.thresholds[member]
                for part in OBSERVED:
                    if (array := self._arrays.get(f"{index}:{part}")) is not None:
                        channels[f"{name}/{part}"] = array[:done, member]
        channels |= {
            "reference/q": target.q_DN[:done],
            "reference/omega": target.omega_DN_D[:done],
            "reference/alpha": target.alpha_DN_D[:done],
        }
        return Recording(self.dt, self.trials, channels, thresholds, occurrences)
