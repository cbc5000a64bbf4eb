"""How a loop of agents learns what moves them: exactly, not at all, by the adaptive law, or by a filter of state and weights."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from control.adaptive_network_law import AdaptiveNetworkLaw
from estimation.adaptive_unscented import AdaptiveUnscentedFilter
from estimation.choice import choose
from estimation.gaussian import Belief, LostDefiniteness, no_detection
from estimation.marginalised_unscented import MarginalisedUnscentedFilter
from estimation.proposals import ConstantNoise
from estimation.rao_blackwellised import BlockDraws
from estimation.resampling import SCHEMES
from estimation.state_space import Euclidean
from estimation.unscented import UnscentedFilter
from models.dynamics.measurement import PartOfState
from models.dynamics.planar_agent import PlanarAgent, runge_kutta_of_motion
from sim.estimators.learner_settings import Adaptive, Exact, LoopSettings, Marginalised, Nothing, TuningSettings, Unscented
from sim.estimators.particle_draws import ParticleDraws
from sim.randomness import Trials

Array = NDArray[np.floating]
Flags = NDArray[np.bool_]

MOTION = 4  # components of position and velocity, before the weights


class Learned(NamedTuple):
    """What an agent knows at a tick."""

    motion: Array  # (trials, agents, 4) m, m/s
    weights: Array  # (trials, agents, weights)
    memory: Any


class AppliedControl(NamedTuple):
    """What a loop did since the last tick."""

    force: Array  # (trials, agents, 2) N
    surface: Array  # (trials, agents, 2) that it was made of


class LearningMemory(NamedTuple):
    """What is recorded of a learner beside its motion, as `Belief.memory`."""

    ess: Array | None  # (1, trials, agents) of one with particles


class NoLearning:
    """Believes readings and learns nothing; also what all learners have in common."""

    space = Euclidean()
    thresholds = (None,)

    def __init__(self, name: str, process: PlanarAgent) -> None:
        self.names = (name,)
        self._size = process.network.size

    def initial(self, reading: Array) -> Learned:
        """What is known after the first reading of the motion, (trials, agents, 4): weights are zero, and what is not read."""
        return Learned(np.where(np.isnan(reading), 0.0, reading), np.zeros((*reading.shape[:-1], self._size)), None)

    def step(self, belief: Learned, known: AppliedControl, reading: Array, dt: float) -> Learned:  # noqa: ARG002
        """What is known `dt` seconds later, after a reading: the reading, or what was known where nothing is read."""
        return belief._replace(motion=np.where(np.isnan(reading), belief.motion, reading))

    def summary(self, belief: Learned) -> Belief:
        """Moments of the motion, (1, trials, agents, ...); without a filter there is no covariance."""
        motion, inner = belief.motion[None], belief.memory
        unknown = np.full(motion.shape[:-1], np.nan)
        if inner is None:
            none = np.full((*motion.shape, motion.shape[-1]), np.nan)
            return Belief(motion, none, np.full(motion.shape, np.nan), unknown, unknown, unknown, no_detection(unknown))
        covariance, nis, dof = self._moments(inner)
        memory = LearningMemory(inner.ess[None]) if hasattr(inner, "ess") else None
        return Belief(
            motion, covariance[None], np.full(motion.shape, np.nan), nis[None], unknown, dof[None], no_detection(nis[None]), memory=memory
        )

    def put_back(self, where: Flags, first: Learned, belief: Learned) -> Learned:
        """The first belief in some trials, (trials,)."""
        chosen: Learned = choose(where, first, belief)
        return chosen

    def rewind(self) -> None:
        """It draws no random numbers."""

    def blame(self, failure: LostDefiniteness) -> tuple[int, str]:
        """The trial, and the loop's name and agent."""
        trial, agent = failure.where[:2]
        return trial, f"{self.names[0]}: the {failure.what} of agent {agent + 1} lost definiteness"

    def _moments(self, inner: Any) -> tuple[Array, Array, Array]:
        """Covariance of the motion, NIS and degrees of freedom of a filter's belief."""
        return inner.covariance[..., :MOTION, :MOTION], inner.nis, inner.dof


class ByAdaptiveLaw(NoLearning):
    """Believes readings, and drives the weights by the sliding surface."""

    def __init__(self, name: str, process: PlanarAgent, law: AdaptiveNetworkLaw) -> None:
        super().__init__(name, process)
        self._network, self._law = process.network, law

    def step(self, belief: Learned, known: AppliedControl, reading: Array, dt: float) -> Learned:
        """The reading, and weights moved by the surface at the one before."""
        weights = self._law.step(belief.weights, known.surface, self._network.basis(belief.motion), dt)
        return Learned(np.where(np.isnan(reading), belief.motion, reading), weights, None)


class ByFilter(NoLearning):
    """State and weights by an adaptive unscented filter."""

    def __init__(self, name: str, process: PlanarAgent, joint: AdaptiveUnscentedFilter) -> None:
        super().__init__(name, process)
        self.filter = joint

    def initial(self, reading: Array) -> Learned:
        """The filter's first belief."""
        return self._learned(self.filter.initial(reading))

    def step(self, belief: Learned, known: AppliedControl, reading: Array, dt: float) -> Learned:
        """The filter's next belief."""
        return self._learned(self.filter.step(belief.memory, known.force, reading, dt))

    def _learned(self, belief: Any) -> Learned:
        return Learned(belief.mean[..., :MOTION], belief.mean[..., MOTION:], belief)


class ByParticles(NoLearning):
    """State and weights by the marginalised unscented particle filter."""

    def __init__(
        self, name: str, process: PlanarAgent, marginalised: MarginalisedUnscentedFilter, agents: int, draws: ParticleDraws
    ) -> None:
        super().__init__(name, process)
        self.filter, self._agents, self._draws = marginalised, agents, draws

    def initial(self, reading: Array) -> Learned:
        """The filter's first belief."""
        return self._learned(self.filter.initial(reading, self._following()))

    def step(self, belief: Learned, known: AppliedControl, reading: Array, dt: float) -> Learned:
        """The filter's next belief."""
        return self._learned(self.filter.step(belief.memory, known.force, reading, dt, self._following()))

    def rewind(self) -> None:
        """Take the last step's random numbers again at the next one."""
        self._draws.rewind()

    def _following(self) -> BlockDraws:
        draws = self._draws.step()
        each = (len(draws.uniforms), self._agents, self.filter.particles)
        return BlockDraws(draws.normals.reshape(*each, self.filter.size), draws.uniforms.reshape(each))

    def _moments(self, inner: Any) -> tuple[Array, Array, Array]:
        """Covariance of the motion; the filter says nothing of its innovations."""
        unknown = np.full(inner.ess.shape, np.nan)
        return inner.sampled_covariance if self.filter.sampled == "state" else inner.conditional_covariance, unknown, unknown

    def _learned(self, belief: Any) -> Learned:
        return Learned(self.filter.motion(belief), self.filter.parameters(belief), belief)


def learner(
    name: str, settings: LoopSettings, tuning: TuningSettings, process: PlanarAgent, agents: int, seed: int, trials: Trials
) -> NoLearning:
    """How a loop of so many agents learns, for these trials."""
    match settings:
        case Exact() | Nothing():
            return NoLearning(name, process)
        case Adaptive():
            return ByAdaptiveLaw(name, process, AdaptiveNetworkLaw(settings.rate))
        case Unscented():
            return ByFilter(name, process, joint_filter(process, tuning, settings))
        case Marginalised():
            marginalised = marginalised_filter(process, tuning, settings)
            draws = ParticleDraws.of_a_filter(f"consensus/{name}", seed, trials, agents * settings.particles, marginalised.size)
            return ByParticles(name, process, marginalised, agents, draws)


def joint_filter(process: PlanarAgent, tuning: TuningSettings, settings: Unscented) -> AdaptiveUnscentedFilter:
    """The adaptive unscented filter of state and weights."""
    weights = process.network.size
    noise = ConstantNoise(np.diag([tuning.state_std] * 4 + [tuning.weight_std] * weights))
    first = np.array([tuning.reading_std**2] * 4 + [tuning.first_weight_std**2] * weights)
    unscented = UnscentedFilter(
        process=process,
        process_noise=noise.matrix**2,
        measurement_noise=None,
        prior=np.zeros(process.size),
        prior_variance=first,
        space=Euclidean(),
        alpha=settings.alpha,
        beta=settings.beta,
        kappa=settings.kappa,
        integrate=runge_kutta_of_motion,
        measurement=PartOfState(range(4), process.size, tuning.reading_std**2 * np.eye(4)),
        outlier_tail=settings.outlier_tail,
    )
    return AdaptiveUnscentedFilter(unscented, noise, settings.fading.law)


def marginalised_filter(process: PlanarAgent, tuning: TuningSettings, settings: Marginalised) -> MarginalisedUnscentedFilter:
    """The marginalised unscented particle filter of state and weights."""
    weights = process.network.size
    return MarginalisedUnscentedFilter(
        process=process,
        motion_noise=tuning.state_std**2 * np.eye(4),
        parameter_noise=np.full(weights, tuning.weight_std**2),
        measurement_noise=tuning.reading_std**2 * np.eye(4),
        parameter_variance=np.full(weights, (settings.first_weight_std or tuning.first_weight_std) ** 2),
        sampled="state" if settings.sampled == "state" else "parameters",
        particles=settings.particles,
        proposal=settings.proposal,
        resampling=SCHEMES[settings.resampling],
        threshold=settings.threshold,
        every=settings.resample_every,
        integrate=runge_kutta_of_motion,
    )
