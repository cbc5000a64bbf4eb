"""Random numbers of formations, drawn for each trial in blocks of ticks, so that trial i is the same trial whatever the batch."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from estimation.particle import Draws
from sim.randomness import Trials, generator

Array = NDArray[np.floating]


class FormationStream(IntEnum):
    """Purposes of random numbers; append only, since the numbers are part of what a seed means."""

    READING = 2000
    MESSAGES = 2001
    AIR = 2002
    DRIVE = 2003
    TACHOMETER = 2004
    PARTICLES = 3_000_000  # and up: two for each particle filter, by its name


@dataclass(eq=False)
class Blocks:
    """Numbers of one purpose, tick after tick; the block's length is no part of what a seed means.

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
            size = (self.block, *self.shape)
            self._drawn = np.stack([g.random(size) if self.uniform else g.standard_normal(size) for g in self._generators], axis=1)
            self._next = 0
        self._next += 1
        return self._drawn[self._next - 1]

    def rewind(self) -> None:
        """Give the last tick's numbers again."""
        self._next -= 1


@dataclass(eq=False)
class ParticleDraws:
    """What a particle filter is given at each tick; the same in every loop that it watches."""

    normals: Blocks
    uniforms: Blocks

    @classmethod
    def of(cls, name: str, seed: int, trials: Trials, agents: int, particles: int, size: int) -> ParticleDraws:
        """Streams of the filter of that name."""
        first = FormationStream.PARTICLES + 2 * (zlib.crc32(name.encode()) % 1_000_000)
        return cls(
            Blocks(seed, trials, first, (agents, particles, size), block=20),
            Blocks(seed, trials, first + 1, (agents, 1), uniform=True),
        )

    def rewind(self) -> None:
        """Give the last tick's numbers again."""
        self.normals.rewind()
        self.uniforms.rewind()

    def tick(self) -> Draws:
        """Of the next tick; leading axes (trials, agents)."""
        return Draws(self.normals.tick(), self.uniforms.tick())
