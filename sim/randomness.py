"""Random numbers: one stream for each purpose of each trial, so that trial i is the same trial whatever the batch."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]
Trials = NDArray[np.int64]


class Stream(IntEnum):
    """Purposes of random numbers; append only, since the numbers are part of what a seed means."""

    START = 0
    ATTITUDE = 1
    GYRO = 2
    GYRO_BIAS = 3
    WHEEL = 4
    TIMING = 5
    DROPOUT = 6
    AIR = 7
    DRIVE = 8
    DISPERSION = 9
    QUATERNION = 10
    FAULT = 1000  # and up: one for each fault of a scenario
    PARTICLES = 1_000_000  # and up: three for each particle filter, by its name


def generator(seed: int, trial: int, stream: int) -> np.random.Generator:
    """Generator of one purpose of one trial; depends on nothing else."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(trial, stream))))


def normals(seed: int, trials: Trials, stream: Stream, ticks: int, size: int) -> Array:
    """Standard normal numbers of a whole run, (ticks, trials, size)."""
    return np.stack([generator(seed, int(t), stream).standard_normal((ticks, size)) for t in trials], axis=1)


def uniforms(seed: int, trials: Trials, stream: Stream, ticks: int, size: int) -> Array:
    """Uniform numbers in [0, 1) of a whole run, (ticks, trials, size)."""
    return np.stack([generator(seed, int(t), stream).random((ticks, size)) for t in trials], axis=1)


def gauss_markov(white: Array, std: Array, correlation_s: Array, dt: float) -> Array:
    """First-order Gauss-Markov process from white numbers (ticks, ...), stationary from the first tick (Gelb 1974, sec. 3.6).

    `std` and `correlation_s` (s) are broadcast over trials, (trials, 1).
    """
    fade = np.exp(-dt / correlation_s)
    out = np.empty_like(white)
    out[0] = std * white[0]
    for k in range(1, len(white)):
        out[k] = fade * out[k - 1] + std * np.sqrt(1.0 - fade**2) * white[k]
    return out
