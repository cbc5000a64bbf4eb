"""Particle filter: a belief of any shape as weighted states, moved by a model, weighed by readings, resampled when few of them count."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.gaussian import Detection, Modes, cholesky, innovate, no_detection, symmetrize
from estimation.observation import begin, degrees_of_freedom, directly, observe, whole_state
from estimation.proposals import Bootstrap, Likelihood, Optimal, ProcessNoise, Proposal, Through
from estimation.resampling import Resampling, due, effective_sample_size, normalize, systematic
from estimation.scale_mixture import ScaleMixture
from estimation.state_space import Additive, StateSpace
from models.attitude import quaternion
from models.dynamics.measurement import MeasurementModel
from models.dynamics.process import ProcessModel, runge_kutta
from models.dynamics.state_layout import ATTITUDE

Array = NDArray[np.floating]

BLOCK_STATES = 16_384  # moved at a time


class Draws(NamedTuple):
    """Random numbers of one step; leading axes: those of the belief, or broadcast to them."""

    normals: Array  # (..., particles, e) standard normal
    uniforms: Array  # (..., particles) in [0, 1), for resampling
    jitter: Array | None = None  # (..., particles, e) standard normal, for roughening; not needed without
    choices: Array | None = None  # (..., particles) in [0, 1), of the sizes of a mixture; not needed without


class ParticleBelief(NamedTuple):
    """What a particle filter believes after a reading: the parts of a Gaussian filter's `Belief`, and the particles themselves."""

    mean: Array  # (..., n)
    covariance: Array  # (..., e, e) of the state space's error coordinates
    innovation: Array  # (..., d) reading minus prediction of them all; zero where missing
    nis: Array  # (...,) of that, by the covariance of the prediction
    log_likelihood: Array  # (...,) of the reading given the ones before
    dof: Array  # (...,) degrees of freedom of the NIS: components read, a unit quaternion's four counting three
    detection: Detection
    particles: Array  # (..., particles, n)
    log_weights: Array  # (..., particles), normalised
    ess: Array  # (...,) effective number of particles
    elapsed: Array  # (...,) s since the first reading
    steps: NDArray[np.int64]  # (...,) how many since then
    lost: Array | None = None  # as in `Belief`: never any
    modes: Modes | None = None


@dataclass(frozen=True, eq=False)
class ParticleFilter:
    """Sequential importance resampling of a state, readings being NaN where nothing is read (Rososhansky 2017, sec. 2.8, 3.3).

    Particles are weighed by the reading's likelihood: of the state itself, or of what `measurement` makes of it.

    All but the particles' motion is reckoned in error coordinates as seen from the heaviest of them. That is exact for `Euclidean` and
    `Additive` ones, where the estimate is the weighted mean of quaternions of one sign, scaled to unit length, which to second order in
    their spread is the average of Markley et al. (2007); for `Multiplicative` ones it errs in second order of the spread.

    It holds no random numbers: every step is given its own, so that a trial depends on nothing but its numbers. Particles whose
    effective number fell below the threshold are resampled before they are moved, after they have been used for the estimate, and only in
    the trials where it did. A wholly missing reading predicts only.

    Attributes:
      process: model dx/dt = f(x, u) of the state, (..., n).
      process_noise: of one step.
      measurement_noise: R of a reading of the whole state, in error coordinates, (..., e, e); None where `measurement` is given.
      prior: state (n,) that fills what the first reading misses.
      prior_variance: variance of that, in error coordinates, (e,).
      particles: how many.
      proposal: importance density.
      resampling: scheme.
      threshold: effective share of the particles below which they are resampled.
      every: steps after which they are resampled whatever their weights, in place of the threshold; 0: there is no such schedule.
      roughening: K of Gordon, Salmond & Smith (1993, sec. 3): after resampling each error coordinate is jittered with the deviation
        K (range of the copies) particles^(-1/e); 0: not at all.
      space: error coordinates of the state.
      integrate: discretisation, `process.runge_kutta` or `unscented.euler`.
      measurement: model of the reading and its noise.
      mixture: how the reading's noise is distributed, R being its covariance; None: normally.
      start: where particles begin: around the first reading, half of them with the other sign of the fourth component (which a vector
        part does not tell), or with attitudes evenly everywhere.
      annealing: by how much larger than it is the reading's deviation is taken at first (Cheng & Crassidis 2004); 1: not at all.
      annealing_s: after how long it is taken as it is, falling geometrically till then, s.

    Raises:
      ValueError: settings out of range, or that do not fit together.
    """

    process: ProcessModel
    process_noise: ProcessNoise
    measurement_noise: Array | None
    prior: Array
    prior_variance: Array
    particles: int = 100
    proposal: Proposal = field(default_factory=Optimal)
    resampling: Resampling = systematic
    threshold: float = 0.5
    every: int = 0
    roughening: float = 0.0
    space: StateSpace = field(default_factory=Additive)
    integrate: Callable[[ProcessModel, Array, Array, float], Array] = runge_kutta
    measurement: MeasurementModel | None = None
    mixture: ScaleMixture | None = None
    start: Literal["reading", "mirrored", "anywhere"] = "reading"
    annealing: float = 1.0
    annealing_s: float = 0.0

    def __post_init__(self) -> None:
        if not (self.particles >= 2 and 0.0 <= self.threshold <= 1.0 and self.every >= 0 and self.roughening >= 0.0):
            settings = (
                f"particles = {self.particles}, threshold = {self.threshold:g}, every = {self.every}, roughening = {self.roughening:g}"
            )
            raise ValueError(f"{settings}: need particles >= 2, 0 <= threshold <= 1, every >= 0, roughening >= 0")
        model = self.measurement_model  # so that bad settings are refused here
        if self.mixture is not None and not isinstance(self.proposal, Bootstrap) and not self._reads_linearly(model):
            raise ValueError("a mixture and a reading that is not linear in the state's errors need the bootstrap proposal")
        if self.mixture is not None and isinstance(self.proposal, Likelihood):
            raise ValueError("a mixture cannot be drawn from by the likelihood proposal: its weights depend on what was drawn")
        if self.start != "reading" and self.space.attitude == "rotation":
            raise ValueError(f"particles that start {self.start} need errors of an attitude by components")

    def _reads_linearly(self, model: MeasurementModel) -> bool:
        """Whether residuals are linear in the state's errors."""
        return directly(model, self.space) or model.linear(self.space.attitude) is not None

    @cached_property
    def measurement_model(self) -> MeasurementModel:
        """What is read."""
        return whole_state(self.measurement, self.measurement_noise, self.space)

    @property
    def size(self) -> int:
        """Error coordinates e of the state: random numbers a particle and step."""
        return int(self.prior_variance.shape[-1])

    def initial(self, measurement: Array, draws: Draws) -> ParticleBelief:
        """Start around the first reading (..., m) with its noise; what it misses comes from the prior."""
        first = begin(self.measurement_model, self.space, measurement, self.prior, self.prior_variance)
        errors = draws.normals @ cholesky(first.covariance).swapaxes(-1, -2)
        lead = first.nis.shape
        log_weights = np.full((*lead, self.particles), -np.log(self.particles))
        particles = self.space.displace(first.mean[..., None, :], errors)
        if self.start == "mirrored":
            sign = np.where(np.broadcast_to(draws.uniforms, log_weights.shape) < 0.5, 1.0, -1.0)
            particles[..., 3] *= sign
        elif self.start == "anywhere":
            scattered = np.broadcast_to(quaternion.normalize(draws.normals[..., ATTITUDE]), particles[..., ATTITUDE].shape)
            particles = np.concatenate([scattered, particles[..., 4:]], axis=-1)
        ess = np.full(lead, float(self.particles))
        return ParticleBelief(*first[:-3], particles, log_weights, ess, np.zeros(lead), np.zeros(lead, dtype=np.int64))

    def step(self, belief: ParticleBelief, command: Array, measurement: Array, dt: float, draws: Draws) -> ParticleBelief:
        """Predict over `dt` seconds of `command` (..., r), then correct with `measurement` (..., m).

        Raises:
          LostDefiniteness: the innovation covariance is not positive definite.
        """
        particles, log_weights = self._resample(belief, draws)
        particles = self._move(particles, command[..., None, :], dt)
        heaviest = np.argmax(log_weights, axis=-1)[..., None, None]
        centre = np.take_along_axis(particles, heaviest, axis=-2)
        errors = self.space.difference(particles, centre)
        centre = centre[..., 0, :]
        residual, noise, sensitivity = observe(self.measurement_model, self.space, measurement, centre)
        if self.annealing > 1.0:
            left = np.maximum(0.0, 1.0 - belief.elapsed / self.annealing_s)[..., None, None]
            noise = noise * self.annealing ** (2.0 * left)

        root = self.process_noise.root(belief.mean, belief.elapsed)
        mean, covariance = moments(np.exp(log_weights), errors)
        through = None if sensitivity is None else self._through(measurement, centre, sensitivity)
        apart: Array
        if through is None:
            apart = residual - mean
        elif through.innovations is None:
            apart = residual - (through.sensitivity @ mean[..., None])[..., 0]
        else:
            apart = through.innovations(mean[..., None, :])[..., 0, :]
        innovation = innovate(covariance + root @ root.swapaxes(-1, -2), apart, noise, sensitivity)

        if self.mixture is None:
            errors, gained = self.proposal.propose(errors, residual, root, noise, draws.normals, through)
        else:
            if draws.choices is None:
                raise ValueError("a mixture needs uniform numbers of its own: Draws.choices")
            errors, gained = self.mixture.propose(self.proposal, errors, residual, root, noise, draws.normals, through, draws.choices)
        log_weights, log_likelihood = normalize(log_weights + gained)
        mean, covariance = moments(np.exp(log_weights), errors)
        return ParticleBelief(
            mean=self.space.displace(centre, mean),
            covariance=covariance,
            innovation=innovation.residual,
            nis=innovation.nis,
            log_likelihood=log_likelihood,
            dof=degrees_of_freedom(self.measurement_model, self.space, apart),
            detection=no_detection(innovation.nis),
            particles=self.space.displace(centre[..., None, :], errors),
            log_weights=log_weights,
            ess=effective_sample_size(log_weights),
            elapsed=belief.elapsed + dt,
            steps=belief.steps + 1,
        )

    def _through(self, reading: Array, centre: Array, sensitivity: Array) -> Through:
        """How particles whose errors are seen from `centre` (..., n) are read."""
        model, space = self.measurement_model, self.space
        if model.linear(space.attitude) is not None:
            return Through(sensitivity)

        def innovations(errors: Array) -> Array:
            return model.residual(reading[..., None, :], model.predict(space.displace(centre[..., None, :], errors)))

        def sensitivities(errors: Array) -> Array:
            states = space.displace(centre[..., None, :], errors)
            return space.sensitivity(model.jacobian(states), states)

        return Through(sensitivity, innovations, sensitivities)

    def _move(self, particles: Array, command: Array, dt: float) -> Array:
        """Particles after `dt` seconds of `command`; in blocks, so that intermediate states stay in the processor's cache."""
        states = np.prod(np.broadcast_shapes(particles.shape[:-1], (*command.shape[:-2], 1)))
        blocks = np.array_split(particles, max(1, int(states) // BLOCK_STATES), axis=-2)
        return np.concatenate([self.integrate(self.process, block, command, dt) for block in blocks], axis=-2)

    def _resample(self, belief: ParticleBelief, draws: Draws) -> tuple[Array, Array]:
        """Particles and log weights, resampled in those trials where too few count."""
        few = due(belief.ess, belief.steps, self.threshold * self.particles, self.every)
        if not few.any():
            return belief.particles, belief.log_weights
        shape = belief.log_weights.shape
        chosen = np.broadcast_to(np.arange(self.particles), shape).copy()
        chosen[few] = self.resampling(np.exp(belief.log_weights[few]), np.broadcast_to(draws.uniforms, shape)[few])
        first = self.particles * np.arange(belief.ess.size).reshape(*belief.ess.shape, 1)
        copies = belief.particles.reshape(-1, belief.particles.shape[-1]).take(first + chosen, axis=0)
        if self.roughening:
            copies[few] = self._roughen(copies[few], belief.mean[few], draws.jitter, few)
        return copies, np.where(few[..., None], -np.log(self.particles), belief.log_weights)

    def _roughen(self, copies: Array, mean: Array, jitter: Array | None, few: NDArray[np.bool_]) -> Array:
        """Copies (resampled trials, particles, n) moved apart a little, since the model would keep them together."""
        if jitter is None:
            raise ValueError("roughening needs normal numbers of its own: Draws.jitter")
        errors = self.space.difference(copies, mean[..., None, :])
        width = self.roughening * self.particles ** (-1.0 / self.size) * np.ptp(errors, axis=-2, keepdims=True)
        normals = np.broadcast_to(jitter, (*few.shape, *jitter.shape[-2:]))[few]
        return self.space.displace(mean[..., None, :], errors + width * normals)


def moments(weights: Array, errors: Array) -> tuple[Array, Array]:
    """Mean (..., e) and covariance (..., e, e) of errors (..., particles, e) by weights (..., particles) that sum to one."""
    mean = (weights[..., None, :] @ errors)[..., 0, :]
    apart = errors - mean[..., None, :]
    apart *= np.sqrt(weights)[..., None]
    return mean, symmetrize(apart.swapaxes(-1, -2) @ apart)
