"""Random numbers: one stream for each purpose of each trial, so that trial i is the same trial whatever the batch."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]
Trials = NDArray[np.int64]


class Stream(IntEnum):
    """Purposes of random numbers; append only, since the numbers are part of what a seed means."""

    START = 0
    ATTITUDE = 1
    GYRO = 2
    GYRO_BIAS = 3
    WHEEL = 4
    TIMING = 5
    DROPOUT = 6
    AIR = 7
    DRIVE = 8
    DISPERSION = 9
    QUATERNION = 10
    TAILS = 11
    FAULT = 1000  # and up: one for each fault of a scenario
    AGENTS_READING = 2000
    MESSAGES = 2001
    AGENTS_AIR = 2002
    AGENTS_DRIVE = 2003
    AGENTS_TACHOMETER = 2004
    AGENTS_TAILS = 2005
    AGENTS_RELATIVE = 2006
    PARTICLES = 1_000_000  # and up: three for each particle filter, by its name
    AGENTS_PARTICLES = 3_000_000  # and up: two for each particle filter of a formation, by its name
    CHOICES = 20_000_000_000  # and up: one for each particle filter whose likelihood is a mixture, by its name


def generator(seed: int, trial: int, stream: int) -> np.random.Generator:
    """Generator of one purpose of one trial; depends on nothing else."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(trial, stream))))


@dataclass(eq=False)
class RandomStream:
    """Numbers of one purpose, tick after tick; how many are drawn at a time is no part of what a seed means.

    Attributes:
      seed: of the run.
      trials: their numbers, (trials,).
      stream: purpose.
      shape: of one tick and trial.
      uniform: in [0, 1) instead of standard normal.
      block: ticks drawn at once.
    """

    seed: int
    trials: Trials
    stream: int
    shape: tuple[int, ...]
    uniform: bool = False
    block: int = 100
    _generators: list[np.random.Generator] = field(init=False)
    _drawn: Array = field(init=False)
    _next: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        self._generators = [generator(self.seed, int(t), self.stream) for t in self.trials]
        self._drawn = np.empty((0, len(self.trials), *self.shape))

    def tick(self) -> Array:
        """Numbers of the next tick, (trials, ...)."""
        if self._next == len(self._drawn):
            self._drawn, self._next = self.ticks(self.block), 0
        self._next += 1
        return self._drawn[self._next - 1]

    def rewind(self) -> None:
        """Give the last tick's numbers again."""
        self._next -= 1

    def ticks(self, count: int) -> Array:
        """Numbers of the next ticks that were not yet drawn, (count, trials, ...)."""
        size = (count, *self.shape)
        return np.stack([g.random(size) if self.uniform else g.standard_normal(size) for g in self._generators], axis=1)


def normals(seed: int, trials: Trials, stream: Stream, ticks: int, size: int) -> Array:
    """Standard normal numbers of a whole run, (ticks, trials, size)."""
    return RandomStream(seed, trials, stream, (size,)).ticks(ticks)


def uniforms(seed: int, trials: Trials, stream: Stream, ticks: int, size: int) -> Array:
    """Uniform numbers in [0, 1) of a whole run, (ticks, trials, size)."""
    return RandomStream(seed, trials, stream, (size,), uniform=True).ticks(ticks)


def gauss_markov(white: Array, std: Array, correlation_s: Array, dt: float) -> Array:
    """First-order Gauss-Markov process from white numbers (ticks, ...), stationary from the first tick (Gelb 1974, sec. 3.6).

    `std` and `correlation_s` (s) are broadcast over trials, (trials, 1).
    """
    fade = np.exp(-dt / correlation_s)
    out = np.empty_like(white)
    out[0] = std * white[0]
    for k in range(1, len(white)):
        out[k] = fade * out[k - 1] + std * np.sqrt(1.0 - fade**2) * white[k]
    return out
