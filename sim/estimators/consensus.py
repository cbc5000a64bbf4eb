"""How a loop of agents learns what moves them: exactly, not at all, by the adaptive law, or by a filter of state and weights."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from control.adaptive_network_law import AdaptiveNetworkLaw
from estimation.adaptive_unscented import AdaptiveUnscentedFilter
from estimation.fading import ConstantFading
from estimation.marginalised_unscented import MarginalisedUnscentedFilter
from estimation.proposals import ConstantNoise
from estimation.rao_blackwellised import BlockDraws
from estimation.resampling import SCHEMES
from estimation.state_space import Euclidean
from estimation.unscented import UnscentedFilter
from models.dynamics.measurement import PartOfState
from models.dynamics.planar_agent import PlanarAgent, runge_kutta_of_motion
from models.plants.agents import AGENTS
from sim.estimators.particle_observer import DrawBlocks
from sim.randomness import Trials
from sim.scenario.consensus import Adaptive, ConsensusScenario, Exact, LoopSettings, Marginalised, Nothing, TuningSettings, Unscented

Array = NDArray[np.floating]


class Learned(NamedTuple):
    """What an agent knows at a tick."""

    motion: Array  # (trials, agents, 4) m, m/s
    weights: Array  # (trials, agents, weights)
    memory: Any


class Acted(NamedTuple):
    """What a loop did since the last tick."""

    force: Array  # (trials, agents, 2) N
    surface: Array  # (trials, agents, 2) that it was made of


class Learner(Protocol):
    """A way to learn: settings, its memory handed in and out."""

    def start(self, reading: Array) -> Learned:
        """What is known after the first reading of the motion, (trials, agents, 4)."""
        ...

    def step(self, learned: Learned, acted: Acted, reading: Array, dt: float) -> Learned:
        """What is known `dt` seconds later, after a reading."""
        ...


class Untaught:
    """Believes readings and learns nothing."""

    def __init__(self, process: PlanarAgent) -> None:
        self._size = process.network.size

    def start(self, reading: Array) -> Learned:
        """Weights are zero."""
        return Learned(reading, np.zeros((*reading.shape[:-1], self._size)), None)

    def step(self, learned: Learned, acted: Acted, reading: Array, dt: float) -> Learned:  # noqa: ARG002
        """The reading."""
        return learned._replace(motion=reading)


class ByAdaptiveLaw(Untaught):
    """Believes readings, and drives the weights by the sliding surface."""

    def __init__(self, process: PlanarAgent, law: AdaptiveNetworkLaw) -> None:
        super().__init__(process)
        self._network, self._law = process.network, law

    def step(self, learned: Learned, acted: Acted, reading: Array, dt: float) -> Learned:
        """The reading, and weights moved by the surface at the one before."""
        weights = self._law.step(learned.weights, acted.surface, self._network.basis(learned.motion), dt)
        return Learned(reading, weights, None)


class ByFilter:
    """State and weights by an adaptive unscented filter."""

    def __init__(self, joint: AdaptiveUnscentedFilter) -> None:
        self.filter = joint

    def start(self, reading: Array) -> Learned:
        """The filter's first belief."""
        return self._learned(self.filter.initial(reading))

    def step(self, learned: Learned, acted: Acted, reading: Array, dt: float) -> Learned:
        """The filter's next belief."""
        return self._learned(self.filter.step(learned.memory, acted.force, reading, dt))

    def _learned(self, belief: Any) -> Learned:
        return Learned(belief.mean[..., :4], belief.mean[..., 4:], belief)


class ByParticles:
    """State and weights by the marginalised unscented particle filter."""

    def __init__(self, marginalised: MarginalisedUnscentedFilter, draws: DrawBlocks) -> None:
        self.filter, self._draws = marginalised, draws

    def start(self, reading: Array) -> Learned:
        """The filter's first belief."""
        return self._learned(self.filter.initial(reading, self._following()))

    def step(self, learned: Learned, acted: Acted, reading: Array, dt: float) -> Learned:
        """The filter's next belief."""
        return self._learned(self.filter.step(learned.memory, acted.force, reading, dt, self._following()))

    def _following(self) -> BlockDraws:
        draws = self._draws.following()
        each = (len(draws.uniforms), AGENTS, self.filter.particles)
        return BlockDraws(draws.normals.reshape(*each, self.filter.size), draws.uniforms.reshape(each))

    def _learned(self, belief: Any) -> Learned:
        return Learned(self.filter.motion(belief), self.filter.parameters(belief), belief)


def learner(name: str, settings: LoopSettings, scenario: ConsensusScenario, process: PlanarAgent, trials: Trials) -> Learner:
    """How a loop learns, for these trials."""
    tuning = scenario.tuning
    match settings:
        case Exact() | Nothing():
            return Untaught(process)
        case Adaptive():
            return ByAdaptiveLaw(process, AdaptiveNetworkLaw(settings.rate))
        case Unscented():
            return ByFilter(joint_filter(process, tuning, settings))
        case Marginalised():
            marginalised = marginalised_filter(process, tuning, settings)
            draws = DrawBlocks(f"consensus/{name}", scenario.run.seed, trials, AGENTS * settings.particles, marginalised.size, False)
            return ByParticles(marginalised, draws)


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
    )
    return AdaptiveUnscentedFilter(unscented, noise, ConstantFading(settings.fading))


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
        integrate=runge_kutta_of_motion,
    )
