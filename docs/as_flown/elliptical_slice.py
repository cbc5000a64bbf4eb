"""Samples of a density whose prior is standard normal: elliptical slices (Murray, Adams & MacKay 2010), many chains at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]


def sample(log_likelihood: Callable[[Array], Array], start: Array, steps: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Places (steps, chains, dimensions) and logarithms of the likelihood (steps, chains) of chains that begin at `start`.

    A step draws an ellipse through the place and a draw of the prior, and shrinks a bracket of angles until a place on it is likely enough.

    Args:
      log_likelihood: of places (n, dimensions), (n,); minus infinity where nothing can be.
      start: (chains, dimensions), all of them possible.
      steps: of each chain.
      rng: random numbers.
    """
    places, heights = start.copy(), log_likelihood(start)
    path, likelihoods = np.empty((steps, *start.shape)), np.empty((steps, len(start)))
    for step in range(steps):
        other, level = rng.standard_normal(places.shape), heights + np.log(rng.random(len(places)))
        angle = 2.0 * np.pi * rng.random(len(places))
        low, high = angle - 2.0 * np.pi, angle.copy()
        left = np.arange(len(places))
        here = places.copy()
        while len(left):
            turned = here[left] * np.cos(angle[left])[:, None] + other[left] * np.sin(angle[left])[:, None]
            there = log_likelihood(turned)
            likely = there > level[left]
            places[left[likely]], heights[left[likely]] = turned[likely], there[likely]
            left = left[~likely]
            below = angle[left] < 0.0
            low[left], high[left] = np.where(below, angle[left], low[left]), np.where(below, high[left], angle[left])
            angle[left] = low[left] + (high[left] - low[left]) * rng.random(len(left))
        path[step], likelihoods[step] = places, heights
    return path, likelihoods


def effective(places: Array) -> Array:
    """How many independent samples (steps, chains, dimensions) are worth, of each dimension (Sokal 1997, window of five times).

    The autocorrelation is the mean of the chains' about the mean of all, so that chains that stay apart count as few samples.
    """
    steps, many, _ = places.shape
    apart = places - places.mean(axis=(0, 1))
    spectrum = np.abs(np.fft.rfft(apart, 2 * steps, axis=0)) ** 2
    correlation = np.fft.irfft(spectrum, axis=0)[:steps].mean(axis=1)
    times = 2.0 * np.cumsum(correlation / correlation[0], axis=0) - 1.0
    enough = np.arange(steps)[:, None] > 5.0 * times
    window = np.where(enough.any(axis=0), np.argmax(enough, axis=0), steps - 1)
    return steps * many / np.take_along_axis(times, window[None], axis=0)[0]
