"""Filters of a formation: each agent's own estimate of its attitude and its rate, stepped for all agents at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.adaptive_unscented import AdaptiveUnscentedFilter
from estimation.choice import choose
from estimation.fading import ConstantFading, FadingLaw, StrongTracking
from estimation.particle import ParticleFilter
from estimation.proposals import PROPOSALS, ConstantNoise
from estimation.resampling import SCHEMES
from estimation.state_space import Euclidean
from estimation.unscented import UnscentedFilter
from models.dynamics.attitude_by_rodrigues import AttitudeByRodrigues
from models.dynamics.measurement import PartOfState
from sim.formation_randomness import ParticleDraws
from sim.plant.formation import Parameters
from sim.randomness import Trials
from sim.scenario.formation import AukfSettings, PfSettings

Array = NDArray[np.floating]
Flags = NDArray[np.bool_]


LOST = 2.0  # of a component of sigma
LOST_RATE = 50.0  # 1/s


class Watched(NamedTuple):
    """What an observer says at a tick."""

    belief: Any  # its mean is [sigma, v], (trials, agents, 6)
    lost: Flags  # (trials, agents) whether an agent's filter began anew


@dataclass(frozen=True, eq=False)
class Observer:
    """A filter of either kind and where its random numbers come from.

    Attributes:
      filter: of all agents at once.
      draws: of a particle filter.
    """

    filter: AdaptiveUnscentedFilter | ParticleFilter
    draws: ParticleDraws | None

    def step(self, belief: Any, torque: Array, reading: Array, dt: float) -> Watched:
        """Believe on from `belief`, or begin if it is None, of a reading of sigma (trials, agents, 3).

        An agent's filter that is lost, whose particles or estimate are further than `LOST` from what is read, begins anew.
        """
        lead = reading.shape[:-1]
        if isinstance(self.filter, ParticleFilter):
            assert self.draws is not None
            draws = self.draws.tick()
            first: Any = self.filter.initial(reading, draws)
            if belief is None:
                return Watched(first, np.zeros(lead, dtype=bool))
            after: Any = self.filter.step(belief, torque, reading, dt, draws)
            lost = _lost(after.particles, reading[..., None, :]).any(axis=-1) | _lost(after.mean, reading)
        else:
            if belief is None:
                return Watched(self.filter.initial(reading), np.zeros(lead, dtype=bool))
            after = self.filter.step(belief, torque, reading, dt)
            lost = _lost(after.mean, reading)
            first = self.filter.initial(reading) if lost.any() else after
        return Watched(choose(lost, first, after) if lost.any() else after, lost)


def _lost(state: Array, reading: Array) -> Flags:
    """Whether states (..., 6) are beyond what can be; (...)."""
    near = (np.abs(state[..., :3] - reading) < LOST).all(axis=-1)
    return np.logical_not(near & (np.abs(state[..., 3:]) < LOST_RATE).all(axis=-1))


def observer(name: str, settings: AukfSettings | PfSettings, plant: Parameters, seed: int, trials: Trials) -> Observer:
    """The filter that a scenario describes; it believes in the formation's inertias on board."""
    process = AttitudeByRodrigues(plant.believed_inertia[:, None])  # one more axis: sigma points or particles
    rate = settings.rate_process_deviation or settings.process_deviation
    noise = ConstantNoise(np.diag(np.repeat([settings.process_deviation, rate], 3)))
    sigma = PartOfState(range(3), 6, settings.reading_deviation**2 * np.eye(3))
    prior, variance = np.zeros(6), np.full(6, settings.start_rate_deviation**2)
    if isinstance(settings, PfSettings):
        filtered = ParticleFilter(
            process,
            noise,
            None,
            prior,
            variance,
            particles=settings.particles,
            proposal=PROPOSALS[settings.proposal],
            resampling=SCHEMES[settings.resampling],
            threshold=settings.threshold,
            space=Euclidean(),
            measurement=sigma,
        )
        return Observer(filtered, ParticleDraws.of(name, seed, trials, plant.agents, settings.particles, 6))
    law: FadingLaw = ConstantFading(settings.value) if settings.fading == "constant" else StrongTracking(settings.forgetting, settings.cap)
    spread = settings.alpha, settings.beta, settings.kappa
    covariance = noise.matrix @ noise.matrix.T
    unscented = UnscentedFilter(process, covariance, None, prior, variance, Euclidean(), *spread, measurement=sigma)
    return Observer(AdaptiveUnscentedFilter(unscented, noise, law), None)
