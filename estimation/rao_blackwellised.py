"""Rao-Blackwellised particle filter: particles for one block of the state, and for the other a Gaussian given each of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from estimation.block_reading import Block, BlockReading, linear_reading, linearised_reading
from estimation.gaussian import LOG_TWO_PI, cholesky, symmetrize, weighted
from estimation.particle import moments
from estimation.resampling import Resampling, due, effective_sample_size, normalize, systematic
from models.dynamics.measurement import MeasurementModel

Array = NDArray[np.floating]
Flags = NDArray[np.bool_]


class Joint(NamedTuple):
    """Both blocks a step later, of each particle: one Gaussian, its covariances alike for all particles where an axis has length one."""

    sampled: Array  # (..., particles, s) mean
    conditional: Array  # (..., particles, c) mean
    spread: Array  # (..., particles, s, s) covariance of the sampled block, process noise and ignorance of the other block in it
    cross: Array  # (..., particles, c, s)
    covariance: Array  # (..., particles, c, c) of the conditional block


class ConditionalModel(Protocol):
    """What becomes of a particle and its Gaussian in one step."""

    def joint(self, sampled: Array, mean: Array, covariance: Array, command: Array, dt: float) -> Joint:
        """Both blocks after `dt` seconds, before the reading.

        Args:
          sampled: of each particle, (..., particles, s).
          mean: of its Gaussian, (..., particles, c).
          covariance: of its Gaussian, (..., particles, c, c).
          command: (..., 1, r).
          dt: s.
        """
        ...


class BlockDraws(NamedTuple):
    """Random numbers of one step."""

    normals: Array  # (..., particles, s) standard normal
    uniforms: Array  # (..., particles) in [0, 1), for resampling


class BlockBelief(NamedTuple):
    """What the filter believes after a reading."""

    sampled: Array  # (..., particles, s)
    mean: Array  # (..., particles, c) of the conditional block, given the particle
    covariance: Array  # (..., particles, c, c)
    log_weights: Array  # (..., particles), normalised
    ess: Array  # (...,) effective number of particles
    log_likelihood: Array  # (...,) of the reading given the ones before
    steps: NDArray[np.int64]  # (...,) since the first reading

    @property
    def sampled_mean(self) -> Array:
        """Of the sampled block, (..., s)."""
        return _average(self.log_weights, self.sampled)

    @property
    def conditional_mean(self) -> Array:
        """Of the conditional block, (..., c)."""
        return _average(self.log_weights, self.mean)

    @property
    def sampled_covariance(self) -> Array:
        """Of the sampled block, (..., s, s)."""
        return moments(np.exp(self.log_weights), self.sampled - self.sampled_mean[..., None, :])[1]

    @property
    def conditional_covariance(self) -> Array:
        """Of the conditional block, within and between particles, (..., c, c)."""
        weights = np.exp(self.log_weights)
        between = moments(weights, self.mean - self.conditional_mean[..., None, :])[1]
        size = self.mean.shape[-1]
        flat = self.covariance.reshape(*weights.shape, size * size)
        return between + _average(self.log_weights, flat).reshape(*between.shape)


@dataclass(frozen=True, eq=False)
class RaoBlackwellisedFilter:
    """p(s_1:k, c_k | z) = p(c_k | s_1:k, z) p(s_1:k | z): the first factor by a Kalman filter a particle, the second by particles.

    Doucet, de Freitas, Murphy & Russell (2000); Schoen, Gustafsson & Nordlund (2005); Rososhansky (2017, appendix B). A particle that has
    been drawn says something of the other block, as if it had been read: the Gaussian is corrected by s_k and then by the reading.
    The reading is z = H_s s + H_c c + v, or what `measurement` says, then linearised at every particle. It holds no random numbers: every
    step is given its own. NaN is a missing component.

    With the optimal proposal particles are drawn from p(s_k | s_1:k-1, z_1:k) and weighed by p(z_k | s_1:k-1, z_1:k-1), both in closed
    form; with the prior one they are drawn from p(s_k | s_1:k-1, z_1:k-1) and weighed by p(z_k | s_1:k, z_1:k-1). Where the reading is not
    linear the optimal one is but near: particles then weigh by p(z_k | s_1:k, z_1:k-1) times what they were drawn too seldom. It is
    linearised at every particle, by an extended Kalman filter's step. With the likelihood what is read of s_k is drawn from N(z, R)
    whatever was predicted, the rest as the model has it then: of a reading of the sampled block alone.

    Attributes:
      model: of both blocks.
      by_sampled: H_s, (z, s); None where `measurement` is given.
      by_conditional: H_c, (z, c); None: the reading is of the sampled block alone.
      measurement_noise: R, (z, z); None where `measurement` is given.
      particles: how many.
      proposal: importance density.
      resampling: scheme.
      threshold: effective share of the particles below which they are resampled.
      every: steps after which they are resampled whatever their weights, in place of the threshold; 0: there is no such schedule.
      measurement: model of the reading and its noise, of blocks whose errors are counted by components.
      measured: what it is a model of, a block or both.

    Raises:
      ValueError: settings out of range, or neither H_s and R nor `measurement`, or both; the likelihood of a reading of both blocks.
    """

    model: ConditionalModel
    by_sampled: Array | None
    by_conditional: Array | None
    measurement_noise: Array | None
    particles: int = 100
    proposal: Literal["optimal", "prior", "likelihood"] = "optimal"
    resampling: Resampling = systematic
    threshold: float = 0.5
    every: int = 0
    measurement: MeasurementModel | None = None
    measured: Block = "both"

    def __post_init__(self) -> None:
        if not (self.particles >= 2 and 0.0 <= self.threshold <= 1.0 and self.every >= 0):
            settings = f"particles = {self.particles}, threshold = {self.threshold:g}, every = {self.every}"
            raise ValueError(f"{settings}: need particles >= 2, 0 <= threshold <= 1, every >= 0")
        given = (self.by_sampled is not None, self.measurement_noise is not None)
        if given != ((self.measurement is None),) * 2:
            raise ValueError("the filter needs one of the two: by_sampled and measurement_noise, or measurement, a model of the reading")
        of_sampled = self.by_conditional is None if self.measurement is None else self.measured == "sampled"
        if self.proposal == "likelihood" and not of_sampled:
            raise ValueError("the likelihood proposal needs a reading of the sampled block alone")

    def initial(self, sampled: Array, spread: Array, mean: Array, covariance: Array, draws: BlockDraws) -> BlockBelief:
        """Particles around `sampled` (..., s) with covariance `spread`, each with the Gaussian `mean` (..., c), `covariance`."""
        particles = sampled[..., None, :] + draws.normals @ cholesky(spread).swapaxes(-1, -2)
        lead = particles.shape[:-1]
        size = mean.shape[-1]
        return BlockBelief(
            sampled=particles,
            mean=np.array(np.broadcast_to(mean[..., None, :], (*lead, size))),
            covariance=np.array(np.broadcast_to(covariance[..., None, :, :], (*lead, size, size))),
            log_weights=np.full(lead, -np.log(self.particles)),
            ess=np.full(lead[:-1], float(self.particles)),
            log_likelihood=np.zeros(lead[:-1]),
            steps=np.zeros(lead[:-1], dtype=np.int64),
        )

    def step(self, belief: BlockBelief, command: Array, reading: Array, dt: float, draws: BlockDraws) -> BlockBelief:
        """Predict over `dt` seconds of `command` (..., r), then correct with `reading` (..., z).

        Raises:
          LostDefiniteness: the covariance of an innovation or of a particle's next state is not positive definite.
        """
        belief = self._resample(belief, draws.uniforms)
        joint = self.model.joint(belief.sampled, belief.mean, belief.covariance, command[..., None, :], dt)
        seen = self._read(reading, joint.sampled, joint.conditional)
        linear = self.measurement is None or self.measurement.linear("components") is not None

        root: Array | None = None
        if self.proposal == "optimal":
            sampled, gained, root = _look_ahead(joint, seen, draws.normals)
        elif self.proposal == "likelihood":
            sampled, root = _as_read(joint, seen, draws.normals)
        else:
            sampled = joint.sampled + _times(cholesky(joint.spread), draws.normals)
        mean, covariance = _given_sampled(joint, sampled)
        value, missing, by_sampled, by_conditional, noise = seen if linear else self._read(reading, sampled, mean)
        if by_conditional is None:
            residual = np.where(missing, 0.0, value - _times(by_sampled, sampled))
            seen_late = _log_density(residual, noise, missing)
        else:
            residual = np.where(missing, 0.0, value - _times(by_sampled, sampled) - _times(by_conditional, mean))
            mean, covariance, seen_late = _correct(mean, covariance, residual, missing, by_conditional, noise)
        if root is None:
            gained = seen_late
        elif not linear or self.proposal == "likelihood":
            gained = seen_late + _log_ratio(joint, sampled, root, draws.normals)
        log_weights, log_likelihood = normalize(belief.log_weights + gained)
        return BlockBelief(sampled, mean, covariance, log_weights, effective_sample_size(log_weights), log_likelihood, belief.steps + 1)

    def _read(self, reading: Array, sampled: Array, conditional: Array) -> BlockReading:
        """A reading (..., m), linearised at both blocks where it must be."""
        if self.measurement is not None:
            return linearised_reading(reading, self.measurement, self.measured, sampled, conditional)
        assert self.by_sampled is not None
        assert self.measurement_noise is not None
        return linear_reading(reading, self.by_sampled, self.by_conditional, self.measurement_noise)

    def _resample(self, belief: BlockBelief, uniforms: Array) -> BlockBelief:
        """Particles with their Gaussians, resampled in those trials where too few count."""
        few = due(belief.ess, belief.steps, self.threshold * self.particles, self.every)
        if not few.any():
            return belief
        shape = belief.log_weights.shape
        chosen = np.broadcast_to(np.arange(self.particles), shape).copy()
        chosen[few] = self.resampling(np.exp(belief.log_weights[few]), np.broadcast_to(uniforms, shape)[few])
        from_all = chosen + self.particles * np.arange(few.size).reshape(*few.shape, 1)

        def copied(part: Array) -> Array:
            return part.reshape(-1, *part.shape[len(shape) :]).take(from_all, axis=0)

        sampled, mean, covariance = copied(belief.sampled), copied(belief.mean), copied(belief.covariance)
        log_weights = np.where(few[..., None], -np.log(self.particles), belief.log_weights)
        return belief._replace(sampled=sampled, mean=mean, covariance=covariance, log_weights=log_weights)


def _look_ahead(joint: Joint, reading: BlockReading, normals: Array) -> tuple[Array, Array, Array]:
    """Sampled blocks drawn with the reading in view, (..., particles, s), and the log density of the reading before, (..., particles).

    The last is the factor of the covariance that they were drawn with, (..., particles, s, s).
    """
    value, missing, by_sampled, by_conditional, noise = reading
    shared = joint.spread @ by_sampled.swapaxes(-1, -2)  # covariance of the sampled block with the reading
    predicted = _times(by_sampled, joint.sampled)
    innovation: Array = by_sampled @ shared + noise
    if by_conditional is not None:
        swapped = by_conditional.swapaxes(-1, -2)
        other = joint.cross.swapaxes(-1, -2) @ swapped
        both = by_sampled @ other
        innovation = innovation + both + both.swapaxes(-1, -2) + by_conditional @ joint.covariance @ swapped
        shared, predicted = shared + other, predicted + _times(by_conditional, joint.conditional)
    residual = np.where(missing, 0.0, value - predicted)
    innovation = symmetrize(innovation)
    gain = weighted(innovation, shared.swapaxes(-1, -2)).swapaxes(-1, -2)
    left = symmetrize(joint.spread - gain @ shared.swapaxes(-1, -2))
    root = cholesky(left)
    drawn = joint.sampled + _times(gain, residual) + _times(root, normals)
    return drawn, _log_density(residual, innovation, missing), root


def _as_read(joint: Joint, reading: BlockReading, normals: Array) -> tuple[Array, Array]:
    """Sampled blocks whose read part is drawn from the reading, (..., particles, s), and the factor of their covariance."""
    value, missing, by_sampled, _, noise = reading
    shared = joint.spread @ by_sampled.swapaxes(-1, -2)
    predicted = symmetrize(by_sampled @ shared) + missing[..., None] * np.eye(value.shape[-1])
    gain = weighted(predicted, shared.swapaxes(-1, -2)).swapaxes(-1, -2)
    residual = np.where(missing, 0.0, value - _times(by_sampled, joint.sampled))
    keep = np.eye(normals.shape[-1]) - gain @ by_sampled
    root = cholesky(symmetrize(keep @ joint.spread @ keep.swapaxes(-1, -2) + gain @ noise @ gain.swapaxes(-1, -2)))
    return joint.sampled + _times(gain, residual) + _times(root, normals), root


def _log_ratio(joint: Joint, sampled: Array, root: Array, normals: Array) -> Array:
    """Log density of sampled blocks by the model over that of the Gaussian that they were drawn from, (..., particles)."""
    before = cholesky(joint.spread)
    white = np.linalg.solve(before, (sampled - joint.sampled)[..., None])[..., 0]
    squares = np.einsum("...i,...i->...", normals, normals) - np.einsum("...i,...i->...", white, white)
    diagonals = (np.diagonal(one, axis1=-2, axis2=-1) for one in (root, before))
    narrow, wide = (np.sum(np.log(one), axis=-1) for one in diagonals)
    return 0.5 * squares + narrow - wide


def _given_sampled(joint: Joint, sampled: Array) -> tuple[Array, Array]:
    """The conditional block once the sampled one has been drawn: as if that had been read without noise."""
    whitening = np.linalg.solve(cholesky(joint.spread), np.eye(sampled.shape[-1]))  # once where all particles share it
    gain = (joint.cross @ whitening.swapaxes(-1, -2)) @ whitening
    mean = joint.conditional + _times(gain, sampled - joint.sampled)
    known = gain @ joint.cross.swapaxes(-1, -2)
    return mean, np.subtract(joint.covariance, known, out=known)  # in place: these are the largest arrays of all


def _correct(
    mean: Array, covariance: Array, residual: Array, missing: Flags, by_conditional: Array, noise: Array
) -> tuple[Array, Array, Array]:
    """Kalman's correction of every Gaussian in Joseph's form, and the log density of its residual."""
    shared = covariance @ by_conditional.swapaxes(-1, -2)
    innovation = symmetrize(by_conditional @ shared + noise)
    gain = weighted(innovation, shared.swapaxes(-1, -2)).swapaxes(-1, -2)
    keep = np.eye(mean.shape[-1]) - gain @ by_conditional
    after = symmetrize(keep @ covariance @ keep.swapaxes(-1, -2) + gain @ noise @ gain.swapaxes(-1, -2))
    return mean + _times(gain, residual), after, _log_density(residual, innovation, missing)


def _times(matrix: Array, vector: Array) -> Array:
    return (matrix @ vector[..., None])[..., 0]


def _average(log_weights: Array, values: Array) -> Array:
    return (np.exp(log_weights)[..., None, :] @ values)[..., 0, :]


def _log_density(residual: Array, covariance: Array, missing: Flags) -> Array:
    """Log of the normal density of residuals (..., particles, z), those that are missing being zero with unit variance."""
    root = cholesky(covariance)
    white = np.linalg.solve(root, residual[..., None])[..., 0]
    log_det = 2.0 * np.sum(np.log(np.diagonal(root, axis1=-2, axis2=-1)), axis=-1)
    dof = np.sum(~missing, axis=-1)
    return -0.5 * (np.einsum("...i,...i->...", white, white) + log_det + dof * LOG_TWO_PI)
