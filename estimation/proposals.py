"""Where a particle filter looks for the next state: importance densities, and the process noise that they spread particles by."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from estimation.gaussian import LOG_TWO_PI, cholesky, symmetrize
from estimation.sigma_points import SigmaPoints
from models.dynamics.state_layout import ATTITUDE, RATE

Array = NDArray[np.floating]


class ProcessNoise(Protocol):
    """What a model leaves out in one step."""

    def root(self, mean: Array, elapsed: Array) -> Array:
        """L with L L' = Q of the next step, (..., e, e), of the estimate (..., n) and the time since the first reading, (...,) s."""
        ...


@dataclass(frozen=True, eq=False)
class ConstantNoise:
    """The same Q at every step.

    Attributes:
      matrix: L with L L' = Q, (..., e, e).
    """

    matrix: Array

    @classmethod
    def of(cls, covariance: Array) -> ConstantNoise:
        """By covariance Q, (..., e, e), which may be singular."""
        values, vectors = np.linalg.eigh(covariance)
        return cls(vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :])

    def root(self, mean: Array, elapsed: Array) -> Array:
        """The matrix as it is."""
        return self.matrix


@dataclass(frozen=True)
class MatchedNoise:
    """Noise of the rates as large as what a wrong inertia does: it grows with their square, which nobody knows in the beginning.

    A step's deviation of each rate is hypot(floor, slope max(|omega|^2, (1 rad/s)^2 e^(-t / fade_s))), of each quaternion component
    `attitude`. That one is no less than the reading's deviation, or the optimal density has nothing to move towards the reading.

    Attributes:
      attitude: of each component of the quaternion, a step.
      floor: rad/s a step.
      slope: s, a step.
      fade_s: how long the first estimate of the rates is not believed, s.
      wheel: rad/s a step, of wheel speeds where these are states.
    """

    attitude: float = 1e-4
    floor: float = 2e-3
    slope: float = 1e-2
    fade_s: float = 1.0
    wheel: float = 0.0

    def root(self, mean: Array, elapsed: Array) -> Array:
        """Diagonal L of the Additive state [q, omega, wheel speeds], (..., n, n)."""
        square = np.maximum(np.sum(mean[..., RATE] ** 2, axis=-1), np.exp(-elapsed / self.fade_s))
        deviation = np.full(mean.shape, self.wheel)
        deviation[..., ATTITUDE] = self.attitude
        deviation[..., RATE] = np.hypot(self.floor, self.slope * square)[..., None]
        return deviation[..., None] * np.eye(mean.shape[-1])


class Through(NamedTuple):
    """How particles are read, if not as the state itself."""

    sensitivity: Array  # H, (..., d, e), at the state from which errors are seen
    innovations: Callable[[Array], Array] | None = None  # of errors (..., particles, e), reading minus h, (..., particles, d); None: linear
    sensitivities: Callable[[Array], Array] | None = None  # H at errors (..., particles, e), (..., particles, d, e); None: linear


class Proposal(Protocol):
    """An importance density of particles that a model has moved; all in error coordinates as seen from one state near them."""

    def propose(
        self, errors: Array, reading: Array, root: Array, noise: Array, normals: Array, through: Through | None = None
    ) -> tuple[Array, Array]:
        """Draw particles and weigh them.

        Args:
          errors: of the particles before process noise, (..., particles, e).
          reading: minus what it would be at the state from which errors are seen, (..., d), NaN where missing.
          root: L with L L' = Q, (..., e, e).
          noise: R, (..., d, d).
          normals: standard normal numbers, (..., particles, e).
          through: how particles are read; None: as they are, H = I.

        Returns:
          Errors of the particles, (..., particles, e), and what is added to their log weights, (..., particles).
        """
        ...


class Bootstrap:
    """The transition density p(x_k | x_k-1) (Gordon, Salmond & Smith 1993; Rososhansky 2017, sec. 3.3): the reading only weighs.

    Where a reading is much better than a prediction, nearly all particles are drawn where it leaves no weight.
    """

    def propose(
        self, errors: Array, reading: Array, root: Array, noise: Array, normals: Array, through: Through | None = None
    ) -> tuple[Array, Array]:
        """Spread by the process noise, then weigh by p(z_k | x_k)."""
        moved = normals @ root.swapaxes(-1, -2) + errors
        whitening, constant = _whitening(noise, ~np.isnan(reading))
        return moved, _log_density(_innovations(moved, reading, through), whitening, constant)


class Optimal:
    """The density of least weight variance, p(x_k | x_k-1, z_k), with weights p(z_k | x_k-1) (Doucet, Godsill & Andrieu 2000, sec. II-D).

    In closed form where the reading is linear in the error: with S = H Q H' + R of what is read the mean moves by Q H' S^-1 times the
    innovation, and the covariance is Q - Q H' S^-1 H Q = L (I + L' H' R^-1 H L)^-1 L'. Where it is not, H is that of the state from which
    errors are seen (their sec. II-D.3), and particles weigh by the ratio p(z_k | x_k) p(x_k | x_k-1) / q(x_k), so that they still come to
    the posterior; but of two humps that a reading leaves, such as those of a square, all may be drawn from one: then use `Bootstrap`.
    """

    def propose(
        self, errors: Array, reading: Array, root: Array, noise: Array, normals: Array, through: Through | None = None
    ) -> tuple[Array, Array]:
        """Weigh by p(z_k | x_k-1), then move towards the reading and spread by what is left of the process noise."""
        seen = ~np.isnan(reading)
        covariance = root @ root.swapaxes(-1, -2)
        read = root if through is None else through.sensitivity @ root  # H L
        shared = covariance if through is None else root @ read.swapaxes(-1, -2)  # Q H'
        whitening, constant = _whitening((covariance if through is None else read @ read.swapaxes(-1, -2)) + noise, seen)
        innovations = _innovations(errors, reading, through)
        gain = shared @ whitening.swapaxes(-1, -2) @ whitening
        of_noise, factor = _whitening(noise, seen)
        inner = of_noise @ read
        left = cholesky(symmetrize(np.eye(root.shape[-1]) + inner.swapaxes(-1, -2) @ inner))  # inverse square root times L: what is left
        moved = normals @ np.linalg.solve(left, root.swapaxes(-1, -2)) + errors + innovations @ gain.swapaxes(-1, -2)
        if through is None or through.innovations is None:
            return moved, _log_density(innovations, whitening, constant)
        # what was drawn as a multiple of L: u = L' H' S^-1 innovation + B^-T normal, where B B' = I + L' H' R^-1 H L
        drawn = innovations @ (read.swapaxes(-1, -2) @ whitening.swapaxes(-1, -2) @ whitening).swapaxes(-1, -2)
        drawn = drawn + normals @ np.linalg.solve(left, np.eye(left.shape[-1]))
        ratio = 0.5 * (_square(normals) - _square(drawn)) - np.sum(np.log(np.diagonal(left, axis1=-2, axis2=-1)), axis=-1)[..., None]
        return moved, _log_density(_innovations(moved, reading, through), of_noise, factor) + ratio


class Likelihood:
    """The likelihood of what is read, and the transition density of the rest given that (Fox, Thrun, Burgard & Dellaert 2001).

    The components y = H x that are read are drawn from N(z, R) whatever was predicted, the others from p(x_k | x_k-1, y), and particles
    weigh by p(y | x_k-1), which needs process noise in all that is read, H Q H' being regular. Good where readings are much better
    than predictions, hopeless where they are worse: then hardly a particle is where the model can have brought it. Where the reading
    is not linear in the error, H is that of the state from which errors are seen, and the ratio of densities makes up for it.
    """

    def propose(
        self, errors: Array, reading: Array, root: Array, noise: Array, normals: Array, through: Through | None = None
    ) -> tuple[Array, Array]:
        """Draw what is read from the reading, then weigh by whether the model can have come there.

        Raises:
          LostDefiniteness: H Q H' is not positive definite.
        """
        seen = ~np.isnan(reading)
        read = root if through is None else through.sensitivity @ root  # H L
        whitening, _ = _whitening(read @ read.swapaxes(-1, -2), seen)
        towards = whitening @ read  # W H L, whose rows are orthonormal
        gain = towards.swapaxes(-1, -2) @ whitening  # of multiples of L
        both = seen[..., :, None] & seen[..., None, :]
        keep = np.eye(root.shape[-1]) - towards.swapaxes(-1, -2) @ towards  # its square, as in Joseph's form: nothing small is a difference
        covariance = keep @ keep.swapaxes(-1, -2) + gain @ np.where(both, noise, 0.0) @ gain.swapaxes(-1, -2)
        innovations = _innovations(errors, reading, through)
        mean = innovations @ gain.swapaxes(-1, -2)
        return _drawn(errors, reading, root, noise, normals, through, mean, cholesky(symmetrize(covariance))[..., None, :, :])


class Extended:
    """One step of an extended Kalman filter for every particle (van der Merwe, Doucet, de Freitas & Wan 2000; Doucet et al. 2000, II-D.3).

    As `Optimal`, but the reading is linearised where each particle is expected, not at one state for all: of particles that lie far
    apart each looks its own way. A particle being a state and no Gaussian, what is spread is the process noise alone. Where the filter
    of a particle also carries its covariance from step to step, as in the cited paper, the density is wider than that of what it is
    to find, p(x_k | x_k-1, z_k): with a linear reading it is not the optimal one any more. It is `Optimal` itself here.
    """

    def propose(
        self, errors: Array, reading: Array, root: Array, noise: Array, normals: Array, through: Through | None = None
    ) -> tuple[Array, Array]:
        """Correct every particle by the reading, spread it by what is left of the process noise, and weigh by the ratio of densities."""
        if through is None or through.innovations is None or through.sensitivities is None:
            return OPTIMAL.propose(errors, reading, root, noise, normals, through)
        read = through.sensitivities(errors) @ root[..., None, :, :]  # H L of each
        return _corrected(
            errors, reading, root, noise, normals, through, _innovations(errors, reading, through), read, noise[..., None, :, :]
        )


class Unscented:
    """One step of an unscented Kalman filter for every particle: the unscented particle filter (van der Merwe et al. 2000).

    As `Extended`, but the process noise of each particle goes through the reading by sigma points, without a Jacobian: the linearisation
    is that of least squares over the spread, and what it leaves over widens R. Where the reading is linear it is `Optimal`.

    Attributes:
      points: how sigma points are drawn.
    """

    def __init__(self, points: SigmaPoints | None = None) -> None:
        self.points = points or SigmaPoints(alpha=1.0)

    def propose(
        self, errors: Array, reading: Array, root: Array, noise: Array, normals: Array, through: Through | None = None
    ) -> tuple[Array, Array]:
        """Correct every particle by the reading, spread it by what is left of the process noise, and weigh by the ratio of densities."""
        if through is None or through.innovations is None:
            return OPTIMAL.propose(errors, reading, root, noise, normals, through)
        offsets = self.points.offsets(root)[..., None, :, :]  # the same for all particles
        cloud = errors[..., :, None, :] + offsets
        flat = cloud.reshape(*cloud.shape[:-3], -1, cloud.shape[-1])
        innovations = _innovations(flat, reading, through).reshape(*cloud.shape[:-1], reading.shape[-1])
        centre, size = innovations[..., 0, :], root.shape[-1]
        apart = centre[..., None, :] - innovations[..., 1:, :]  # h there minus h at the particle
        mean, spread = self.points.moments(apart)
        slope = (apart[..., :size, :] - apart[..., size:, :]) / (2.0 * self.points.alpha * np.sqrt(size + self.points.kappa))  # (H L)'
        read = slope.swapaxes(-1, -2)
        beyond = spread - read @ slope
        return _corrected(errors, reading, root, noise, normals, through, centre - mean, read, noise[..., None, :, :] + beyond)


OPTIMAL = Optimal()
PROPOSALS: dict[str, Proposal] = {
    "bootstrap": Bootstrap(),
    "optimal": OPTIMAL,
    "likelihood": Likelihood(),
    "extended": Extended(),
    "unscented": Unscented(),
}


def _corrected(
    errors: Array,
    reading: Array,
    root: Array,
    noise: Array,
    normals: Array,
    through: Through | None,
    innovations: Array,
    read: Array,
    own: Array,
) -> tuple[Array, Array]:
    """Particles by a linearisation of their own: H L (..., particles, d, e) and noise (..., particles, d, d) of each, and innovations."""
    seen = ~np.isnan(reading)[..., None, :]
    across, _ = _whitening(read @ read.swapaxes(-1, -2) + own, seen)
    mean = _times(read.swapaxes(-1, -2) @ across.swapaxes(-1, -2) @ across, innovations)
    inner = _whitening(own, seen)[0] @ read
    left = cholesky(symmetrize(np.eye(root.shape[-1]) + inner.swapaxes(-1, -2) @ inner))
    return _drawn(errors, reading, root, noise, normals, through, mean, np.linalg.inv(left).swapaxes(-1, -2))


def _drawn(
    errors: Array, reading: Array, root: Array, noise: Array, normals: Array, through: Through | None, mean: Array, factor: Array
) -> tuple[Array, Array]:
    """Particles displaced by L u, u being Gaussian, weighed by p(z_k | x_k) p(x_k | x_k-1) / q(x_k).

    Args:
      errors: as for `Proposal.propose`.
      reading: likewise.
      root: likewise.
      noise: likewise.
      normals: likewise.
      through: likewise.
      mean: of u, (..., particles, e).
      factor: of its covariance C C', triangular, (..., particles or 1, e, e).
    """
    drawn = mean + (normals @ factor[..., 0, :, :].swapaxes(-1, -2) if factor.shape[-3] == 1 else _times(factor, normals))
    moved = errors + drawn @ root.swapaxes(-1, -2)
    log_det = np.sum(np.log(np.diagonal(factor, axis1=-2, axis2=-1)), axis=-1)
    ratio = 0.5 * (_square(normals) - _square(drawn)) + log_det
    whitening, constant = _whitening(noise, ~np.isnan(reading))
    return moved, _log_density(_innovations(moved, reading, through), whitening, constant) + ratio


def _times(matrix: Array, vector: Array) -> Array:
    return (matrix @ vector[..., None])[..., 0]


def _innovations(errors: Array, reading: Array, through: Through | None) -> Array:
    """Reading minus what it would be at each particle, (..., particles, d); finite where the reading is missing, to be whitened to zero."""
    if through is None:
        return np.nan_to_num(reading, nan=0.0)[..., None, :] - errors
    if through.innovations is None:
        return np.nan_to_num(reading, nan=0.0)[..., None, :] - errors @ through.sensitivity.swapaxes(-1, -2)
    return np.nan_to_num(through.innovations(errors), nan=0.0)


def _square(vector: Array) -> Array:
    return np.einsum("...i,...i->...", vector, vector)


def _whitening(covariance: Array, seen: NDArray[np.bool_]) -> tuple[Array, Array]:
    """W with W' W = S^-1 on what is seen, zero elsewhere, (..., e, e), and the log of the density's factor, (...)."""
    size = covariance.shape[-1]
    both = seen[..., :, None] & seen[..., None, :]
    root = cholesky(np.where(both, covariance, np.eye(size)))
    whitening = np.linalg.solve(root, seen[..., None] * np.eye(size))
    log_det = 2.0 * np.sum(np.log(np.diagonal(root, axis1=-2, axis2=-1)), axis=-1)
    return whitening, -0.5 * (log_det + np.sum(seen, axis=-1) * LOG_TWO_PI)


def _log_density(innovations: Array, whitening: Array, constant: Array) -> Array:
    """Log of the normal density of innovations (..., particles, e); (..., particles)."""
    white = innovations @ whitening.swapaxes(-1, -2)
    return constant[..., None] - 0.5 * np.einsum("...i,...i->...", white, white)
