"""A particle filter in the loop: every trial's random numbers, drawn in blocks, and its belief in the form of the other filters'."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.gaussian import Belief
from estimation.particle import Draws, ParticleBelief, ParticleFilter
from estimation.state_space import StateSpace
from sim.randomness import Stream, Trials, generator

Array = NDArray[np.floating]

BLOCK_NUMBERS = 4_000_000  # drawn at a time, of all trials together: 32 MB


@dataclass(eq=False)
class DrawBlocks:
    """Random numbers of a particle filter, one step after another.

    Each array of each trial has a generator of its own, named by the filter, so that no number depends on how many are drawn at a time,
    nor on the company of trial and filter.
    """

    name: str
    seed: int
    trials: Trials
    particles: int
    size: int
    roughening: bool
    _block: tuple[Array, ...] = ()
    _next: int = 0

    def __post_init__(self) -> None:
        first = Stream.PARTICLES + 3 * zlib.crc32(self.name.encode())
        self._generators = [[generator(self.seed, int(trial), first + purpose) for trial in self.trials] for purpose in range(3)]
        self._steps = max(1, BLOCK_NUMBERS // (len(self.trials) * self.particles * (2 * self.size + 1)))

    def following(self) -> Draws:
        """Numbers of the next step, (trials, particles, ...)."""
        if not self._block or self._next == self._steps:
            self._block, self._next = self._draw(), 0
        step, self._next = self._next, self._next + 1
        return Draws(*(array[:, step] for array in self._block))

    def rewind(self) -> None:
        """Give the last step's numbers again."""
        self._next -= 1

    def _draw(self) -> tuple[Array, ...]:
        lead = (len(self.trials), self._steps, self.particles)
        normals, uniforms = np.empty((*lead, self.size)), np.empty(lead)
        arrays = [(normals, "standard_normal"), (uniforms, "random")]
        if self.roughening:
            arrays.append((np.empty((*lead, self.size)), "standard_normal"))
        for (array, kind), generators in zip(arrays, self._generators, strict=False):
            for row, source in zip(array, generators, strict=True):
                getattr(source, kind)(out=row)
        return tuple(array for array, _ in arrays)


class ParticleMemory(NamedTuple):
    """What a particle filter keeps besides a Gaussian belief, as `Belief.memory`."""

    belief: ParticleBelief
    ess: Array  # (1, trials)


@dataclass(frozen=True, eq=False)
class ParticleObserver:
    """A particle filter as the only member of its bank; beliefs are (1, trials, ...)."""

    filter: ParticleFilter
    draws: DrawBlocks = field(repr=False)

    @property
    def space(self) -> StateSpace:
        """Error coordinates of its covariance."""
        return self.filter.space

    def initial(self, measurement: Array) -> Belief:
        """Belief after the first reading, (trials, n)."""
        return _gaussian(self.filter.initial(measurement[None], self.draws.following()))

    def step(self, belief: Belief, command: Array, measurement: Array, dt: float) -> Belief:
        """Belief after `dt` seconds of `command`, (trials, r), and a reading, (trials, n)."""
        memory: ParticleMemory = belief.memory
        return _gaussian(self.filter.step(memory.belief, command[None], measurement[None], dt, self.draws.following()))


def _gaussian(belief: ParticleBelief) -> Belief:
    """The first two moments, and the particles as what is remembered."""
    b = belief
    memory = ParticleMemory(b, b.ess)
    return Belief(b.mean, b.covariance, b.innovation, b.nis, b.log_likelihood, b.dof, b.detection, memory=memory)
