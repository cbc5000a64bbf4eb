"""Samples of a density from an ensemble of walkers that stretch along each other (Goodman & Weare 2010)."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]

STRETCH = 2.0  # greatest, Goodman & Weare's a


class Chain(NamedTuple):
    """What an ensemble went through."""

    places: Array  # (steps, walkers, dimensions)
    densities: Array  # logarithms, (steps, walkers)
    accepted: float  # share of the proposals


def sample(log_density: Callable[[Array], Array], start: Array, steps: int, rng: np.random.Generator) -> Chain:
    """Let walkers (walkers, dimensions), an even number, take steps; `log_density` takes (n, dimensions) and gives (n,)."""
    places, densities = start.copy(), log_density(start)
    many, dimensions = start.shape
    halves = np.arange(many // 2), np.arange(many // 2, many)
    path, heights, accepted = np.empty((steps, many, dimensions)), np.empty((steps, many)), 0
    for step in range(steps):
        for own, other in (halves, halves[::-1]):
            stretch = ((STRETCH - 1.0) * rng.random(len(own)) + 1.0) ** 2 / STRETCH
            towards = places[rng.choice(other, len(own))]
            proposed = towards + stretch[:, None] * (places[own] - towards)
            there = log_density(proposed)
            taken = np.log(rng.random(len(own))) < (dimensions - 1) * np.log(stretch) + there - densities[own]
            places[own[taken]], densities[own[taken]] = proposed[taken], there[taken]
            accepted += int(np.sum(taken))
        path[step], heights[step] = places, densities
    return Chain(path, heights, accepted / (steps * many))


def effective(places: Array) -> Array:
    """How many independent samples (steps, walkers, dimensions) are worth, of each dimension (Sokal 1997, window of five times).

    The autocorrelation is the mean of the walkers' about the mean of all, so that walkers that stay apart count as few samples.
    """
    steps, many, _ = places.shape
    apart = places - places.mean(axis=(0, 1))
    spectrum = np.abs(np.fft.rfft(apart, 2 * steps, axis=0)) ** 2
    correlation = np.fft.irfft(spectrum, axis=0)[:steps].mean(axis=1)
    times = 2.0 * np.cumsum(correlation / correlation[0], axis=0) - 1.0
    enough = np.arange(steps)[:, None] > 5.0 * times
    window = np.where(enough.any(axis=0), np.argmax(enough, axis=0), steps - 1)
    return steps * many / np.take_along_axis(times, window[None], axis=0)[0]
