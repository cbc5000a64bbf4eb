"""What a run leaves: named arrays with axes (ticks, trials, ...), and what happened when."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from sim.faults.timeline import Occurrence
from sim.loop.lost_trials import LostTrial
from sim.plant.batch import SimulationFailed

Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Recording:
    """A run, or what there was of it: named arrays (ticks, trials, ...) and what happened when.

    Channels: `truth/state` [q, omega, wheel speeds], `truth/qpos`, `truth/qvel`, `reading`, `command`, `applied` (N m, wheels),
    `fault` (bool); of each observer NAME: `NAME/mean`, `NAME/sigma` (attitude as a rotation, rad), `NAME/nees`, `NAME/nis`,
    `NAME/dof`, `NAME/statistic`, `NAME/declared`; of one with modes `NAME/modes`, their probabilities; of one that repairs covariances
    `NAME/lost`, how many so far; of a particle filter `NAME/ess`, the effective number of particles; of an adaptive one `NAME/fading`, its
    factor; of one that learns a torque `NAME/learned` (N m in B), beside it `truth/unmodelled`; `control/...`, what a law notes. Of agents
    in the plane that learn `unknown` f + d and `learned` W phi (N), `force` (N), `estimate` [x, v] and `weights` W, row by row.
    `reference/...` has no trial axis. Of several agents `truth/state`, `reading`, `NAME/...` have an axis of agents behind that of trials.
    Figures are of all trials that were flown, (ticks, all trials), where not all are recorded. Findings are what was worked out of a trial
    afterwards, (trials, ...).
    """

    dt: float
    trials: NDArray[np.int64]
    channels: dict[str, Array]
    thresholds: dict[str, tuple[float, float] | None]
    occurrences: tuple[Occurrence, ...] = ()
    findings: dict[str, Array] = field(default_factory=dict)
    figures: dict[str, Array] = field(default_factory=dict)
    flown: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    lost: tuple[LostTrial, ...] = ()
    stamps: Array | None = None  # s since the start, (ticks,), of a log whose rows are not evenly spaced

    @property
    def ticks(self) -> int:
        """Control ticks recorded."""
        return len(next(iter((self.figures or self.channels).values())))

    @property
    def time(self) -> Array:
        """Seconds since the start, (ticks,)."""
        return self.dt * np.arange(self.ticks) if self.stamps is None else self.stamps[: self.ticks]

    @property
    def observers(self) -> tuple[str, ...]:
        """Names of the observers."""
        return tuple(self.thresholds)

    def sound(self) -> Recording:
        """The trials that did not break down, figures included."""
        gone = [one.trial for one in self.lost]
        kept, flown = np.flatnonzero(~np.isin(self.trials, gone)), np.flatnonzero(~np.isin(self.flown, gone))
        figures = {name: array[:, flown] for name, array in self.figures.items()}
        return replace(self.select(kept), figures=figures, flown=self.flown[flown], lost=())

    @property
    def counted(self) -> int:
        """Ticks in which something counts: if all recorded trials broke down, those until the last of them did."""
        ends = {one.trial: one.tick for one in self.lost}
        return max((ends.get(int(trial), self.ticks) for trial in self.trials), default=self.ticks)

    def until(self, ticks: int) -> Recording:
        """The first ticks."""
        channels = {name: array[:ticks] for name, array in self.channels.items()}
        return replace(self, channels=channels, figures={name: array[:ticks] for name, array in self.figures.items()})

    def select(self, keep: NDArray[np.int64]) -> Recording:
        """The trials at positions `keep`."""
        place = {int(old): new for new, old in enumerate(keep)}
        channels = {name: a if name.startswith("reference/") else a[:, keep] for name, a in self.channels.items()}
        occurrences = tuple(o._replace(trial=place[o.trial]) for o in self.occurrences if o.trial in place)
        findings = {name: a[keep] for name, a in self.findings.items()}
        return replace(self, trials=self.trials[keep], channels=channels, occurrences=occurrences, findings=findings)

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
        figures = {name: np.concatenate([part.figures[name] for part in parts], axis=1) for name in first.figures}
        flown = np.concatenate([part.flown for part in parts])
        lost = tuple(one for part in parts for one in part.lost)
        return Recording(first.dt, trials, channels, first.thresholds, tuple(occurrences), findings, figures, flown, lost)


class RecordedRunFailed(SimulationFailed):
    """A simulation that failed, with what was recorded until then."""

    def __init__(self, trial: int, time: float, cause: str, recording: Recording) -> None:
        super().__init__(trial, time, cause)
        self.recording = recording
