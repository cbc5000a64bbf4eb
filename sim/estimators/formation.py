"""Filters of a formation: each agent's own estimate of its attitude and its rate, stepped for all agents at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.adaptive_unscented import AdaptiveUnscentedFilter
from estimation.choice import choose
from estimation.gaussian import Belief, LostDefiniteness, no_detection
from estimation.particle import ParticleFilter
from estimation.proposals import PROPOSALS, ConstantNoise
from estimation.resampling import SCHEMES
from estimation.state_space import Euclidean, StateSpace
from estimation.unscented import UnscentedFilter
from models.dynamics.attitude_by_rodrigues import AttitudeByRodrigues
from models.dynamics.measurement import PartOfState
from models.plants.register.parameters import SeveralParameters
from sim.estimators.particle_draws import ParticleDraws
from sim.estimators.rodrigues_settings import AukfSettings, PfSettings
from sim.randomness import Trials

Array = NDArray[np.floating]
Flags = NDArray[np.bool_]


LOST = 2.0  # of a component of sigma
LOST_RATE = 50.0  # 1/s


class FormationMemory(NamedTuple):
    """What is recorded of a filter beside its moments, as `Belief.memory`."""

    restarted: Flags  # (1, trials, agents) whether an agent's filter began anew
    ess: Array | None  # (1, trials, agents) of a particle filter


class FilterStep(NamedTuple):
    """What an observer says at a tick."""

    belief: Any  # its mean is [sigma, v], (trials, agents, 6)
    lost: Flags  # (trials, agents) whether an agent's filter began anew


@dataclass(frozen=True, eq=False)
class AgentsFilter:
    """A filter of either kind, stepped for all agents at once, and where its random numbers come from.

    Attributes:
      name: of the observer.
      filter: of all agents at once.
      draws: of a particle filter.
    """

    name: str
    filter: AdaptiveUnscentedFilter | ParticleFilter
    draws: ParticleDraws | None

    @property
    def names(self) -> tuple[str, ...]:
        """Its own."""
        return (self.name,)

    @property
    def thresholds(self) -> tuple[None, ...]:
        """It declares no faults."""
        return (None,)

    @property
    def space(self) -> StateSpace:
        """Error coordinates of its covariance."""
        return self.filter.space

    def initial(self, reading: Array) -> FilterStep:
        """Begin with a reading of sigma, (trials, agents, 3)."""
        return self._step(None, None, reading, 0.0)

    def step(self, belief: FilterStep, known: Array, reading: Array, dt: float) -> FilterStep:
        """Believe on after `dt` seconds of torques, (trials, agents, 3) N m, or with stored momentum (..., 6), and a reading of sigma.

        An agent's filter that is lost, whose particles or estimate are further than `LOST` from what is read, begins anew.
        """
        return self._step(belief.belief, known, reading, dt)

    def summary(self, belief: FilterStep) -> Belief:
        """Its moments, (1, trials, agents, ...)."""
        own = belief.belief
        memory = FormationMemory(belief.lost[None], own.ess[None] if hasattr(own, "ess") else None)
        mean, covariance, innovation, nis, likelihood, dof = (part[None] for part in own[:6])
        return Belief(mean, covariance, innovation, nis, likelihood, dof, no_detection(nis), memory=memory)

    def put_back(self, where: Flags, first: FilterStep, belief: FilterStep) -> FilterStep:
        """The first belief in some trials, (trials,)."""
        chosen: FilterStep = choose(where, first, belief)
        return chosen

    def rewind(self) -> None:
        """Take the last step's random numbers again at the next one."""
        if self.draws is not None:
            self.draws.rewind()

    def blame(self, failure: LostDefiniteness) -> tuple[int, str]:
        """The trial, and the filter's name and agent."""
        agent = f" of agent {failure.where[1] + 1}" if len(failure.where) > 1 else ""
        return failure.where[0] if failure.where else 0, f"filter {self.name}{agent}: {failure.what}"

    def _step(self, belief: Any, torque: Any, reading: Array, dt: float) -> FilterStep:
        """Believe on from `belief`, or begin if it is None, of a reading of sigma (trials, agents, 3)."""
        lead = reading.shape[:-1]
        if isinstance(self.filter, ParticleFilter):
            assert self.draws is not None
            draws = self.draws.step()
            first: Any = self.filter.initial(reading, draws)
            if belief is None:
                return FilterStep(first, np.zeros(lead, dtype=bool))
            after: Any = self.filter.step(belief, torque, reading, dt, draws)
            lost = _lost(after.particles, reading[..., None, :]).any(axis=-1) | _lost(after.mean, reading)
        else:
            if belief is None:
                return FilterStep(self.filter.initial(reading), np.zeros(lead, dtype=bool))
            after = self.filter.step(belief, torque, reading, dt)
            lost = _lost(after.mean, reading)
            first = self.filter.initial(reading) if lost.any() else after
        return FilterStep(choose(lost, first, after) if lost.any() else after, lost)


def _lost(state: Array, reading: Array) -> Flags:
    """Whether states (..., 6) are beyond what can be; (...). Where nothing is read, rates alone tell."""
    attitude = np.where(np.isnan(reading), 0.0, state[..., :3] - reading)
    near = (np.abs(attitude) < LOST).all(axis=-1)
    return np.logical_not(near & (np.abs(state[..., 3:]) < LOST_RATE).all(axis=-1))


def agents_filter(name: str, settings: AukfSettings | PfSettings, plant: SeveralParameters, seed: int, trials: Trials) -> AgentsFilter:
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
            every=settings.resample_every,
            space=Euclidean(),
            measurement=sigma,
            mixture=settings.likelihood.mixture,
        )
        mixed = filtered.mixture is not None
        return AgentsFilter(name, filtered, ParticleDraws.of_agents(name, seed, trials, plant.agents, settings.particles, 6, mixed))
    spread = settings.alpha, settings.beta, settings.kappa
    covariance = noise.matrix @ noise.matrix.T
    unscented = UnscentedFilter(
        process, covariance, None, prior, variance, Euclidean(), *spread, measurement=sigma, outlier_tail=settings.outlier_tail
    )
    return AgentsFilter(name, AdaptiveUnscentedFilter(unscented, noise, settings.fading.law), None)
