"""A particle filter in the loop: its random numbers, and its belief in the form of the other filters'."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.gaussian import Belief
from estimation.particle import ParticleBelief, ParticleFilter
from estimation.state_space import StateSpace
from sim.estimators.particle_draws import ParticleDraws

Array = NDArray[np.floating]


class ParticleMemory(NamedTuple):
    """What a particle filter keeps besides a Gaussian belief, as `Belief.memory`."""

    belief: ParticleBelief
    ess: Array  # (1, trials)


@dataclass(frozen=True, eq=False)
class ParticleObserver:
    """A particle filter as the only member of its bank; beliefs are (1, trials, ...)."""

    filter: ParticleFilter
    draws: ParticleDraws = field(repr=False)

    @property
    def space(self) -> StateSpace:
        """Error coordinates of its covariance."""
        return self.filter.space

    def initial(self, measurement: Array) -> Belief:
        """Belief after the first reading, (trials, n)."""
        return _gaussian(self.filter.initial(measurement[None], self.draws.step()))

    def step(self, belief: Belief, command: Array, measurement: Array, dt: float) -> Belief:
        """Belief after `dt` seconds of `command`, (trials, r), and a reading, (trials, n)."""
        memory: ParticleMemory = belief.memory
        return _gaussian(self.filter.step(memory.belief, command[None], measurement[None], dt, self.draws.step()))


def _gaussian(belief: ParticleBelief) -> Belief:
    """The first two moments, and the particles as what is remembered."""
    b = belief
    memory = ParticleMemory(b, b.ess)
    return Belief(b.mean, b.covariance, b.innovation, b.nis, b.log_likelihood, b.dof, b.detection, memory=memory)
