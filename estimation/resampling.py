"""Resampling of weighted particles: how often each is copied, so that all weigh the same again (Douc, Cappe & Moulines 2005)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from estimation.gaussian import LostDefiniteness

Array = NDArray[np.floating]
Indices = NDArray[np.int64]

# Which particles to keep, (..., particles), of weights (..., particles) that sum to one and uniform numbers (..., particles) in [0, 1).
Resampling = Callable[[Array, Array], Indices]

_BITS = 40  # of a place in [0, 1) as an integer; 22 more number the trials


def effective_sample_size(log_weights: Array) -> Array:
    """1 / sum w^2, between 1 and the number of particles, of normalised weights (Rososhansky 2017, eq. 2.38); (..., particles) to (...)."""
    return 1.0 / np.sum(np.exp(2.0 * log_weights), axis=-1)


def due(ess: Array, steps: NDArray[np.int64], fewest: float, every: int) -> NDArray[np.bool_]:
    """Whether it is time to resample, (...,): by a deterministic schedule, every so many steps, or where too few particles count.

    Args:
      ess: effective number of particles, (...,).
      steps: since the first reading, (...,).
      fewest: effective number below which particles are resampled where there is no schedule.
      every: steps from one resampling to the next (Rososhansky 2017, sec. 2.8); 0: there is no schedule.
    """
    if every:
        return np.asarray((steps > 0) & (steps % every == 0))
    return np.asarray(ess < fewest)


def normalize(log_weights: Array) -> tuple[Array, Array]:
    """Log weights that sum to one, (..., particles), and the logarithm of what they summed to, (...).

    The greatest is taken off first and the rest of the sum afterwards, for together they lose the rest: 1e16 + log 50 is 1e16.

    Raises:
      LostDefiniteness: no particle of a trial has any weight, or one has no number for it.
    """
    top = np.max(log_weights, axis=-1, keepdims=True)
    if not np.isfinite(top).all():
        raise LostDefiniteness(tuple(map(int, np.argwhere(~np.isfinite(top[..., 0]))[0])), "sum of the particles' weights")
    apart = log_weights - top
    rest = np.log(np.sum(np.exp(apart), axis=-1, keepdims=True))
    return apart - rest, (top + rest)[..., 0]


def multinomial(weights: Array, uniforms: Array) -> Indices:
    """Every copy drawn by itself (Gordon, Salmond & Smith 1993; Rososhansky 2017, table 3.1): the most scatter, P w (1 - w) a particle."""
    return pick(weights, uniforms)


def residual(weights: Array, uniforms: Array) -> Indices:
    """The whole part of P w copies for certain, the rest drawn by what is left of the weights (Liu & Chen 1998)."""
    particles = weights.shape[-1]
    whole = np.floor(particles * weights)
    certain = np.cumsum(whole, axis=-1)
    left = particles * weights - whole
    left = np.where(np.sum(left, axis=-1, keepdims=True) > 0.0, left, weights)  # nothing is left: nothing is drawn from it
    slot = np.arange(particles)
    share = np.where(certain[..., -1:] > 0.0, whole, 1.0)
    place = np.broadcast_to((slot + 0.5) / np.maximum(certain[..., -1:], 1.0), weights.shape)
    copied = pick(share, np.minimum(place, 1.0 - 2.0**-_BITS))
    return np.where(slot < certain[..., -1:], copied, pick(left, uniforms))


def stratified(weights: Array, uniforms: Array) -> Indices:
    """One draw in each of P equal parts of [0, 1) (Kitagawa 1996)."""
    particles = weights.shape[-1]
    return pick(weights, (np.arange(particles) + uniforms) / particles)


def systematic(weights: Array, uniforms: Array) -> Indices:
    """P equidistant places, shifted together by the first uniform number (Kitagawa 1996; Carpenter et al. 1999): within one of P w."""
    return stratified(weights, uniforms[..., :1])


SCHEMES: dict[str, Resampling] = {"multinomial": multinomial, "residual": residual, "stratified": stratified, "systematic": systematic}


def pick(weights: Array, places: Array) -> Indices:
    """Particles on whose stretch of the cumulated weights the places in [0, 1) lie; both (..., particles).

    All trials are searched as one sorted list. They are told apart by integers, because a trial's number added to a fraction would
    round it differently in another company. Raises nothing; weights need not sum to one, but must not all be zero.
    """
    shape, particles = np.broadcast_shapes(weights.shape, places.shape), weights.shape[-1]
    cumulated = np.cumsum(weights, axis=-1)
    stretch = np.broadcast_to(cumulated / cumulated[..., -1:], shape).reshape(-1, particles)
    trial = np.arange(len(stretch))[:, None]
    edges = (stretch * 2.0**_BITS).astype(np.int64) + (trial << (_BITS + 1))
    wanted = (np.broadcast_to(places, shape).reshape(-1, particles) * 2.0**_BITS).astype(np.int64) + (trial << (_BITS + 1))
    found = np.searchsorted(edges.ravel(), wanted.ravel(), side="right").reshape(-1, particles)
    return (found - trial * particles).reshape(shape)
