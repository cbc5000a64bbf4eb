"""A flight log that nothing of the twin made: SciPy integrates the body, the wheels and the attitude, and draws the noise.

Of the twin it takes only what a laboratory would know of its filter: the noise that the filter says it expects.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

Array = NDArray[np.floating]


class Body(NamedTuple):
    """A rigid body with wheels, of numbers alone."""

    inertia: Array  # (3, 3) kg m2
    axes: Array  # (3, wheels)
    wheel_inertia: float  # kg m2


class Expected(NamedTuple):
    """Variances that a filter expects, [rotation vector, rate, wheel speed] each component, (6 + wheels,)."""

    process: Array  # added in a tick, half of it before the motion and half after
    reading: Array


class Flight(NamedTuple):
    """True motion and readings of many trials, (ticks, trials, ...)."""

    time: Array  # (ticks,) s
    quaternion: Array  # scalar last, from N to B
    rate: Array
    wheel: Array
    command: Array
    reading: Array  # [quaternion of either sign, rate, wheel]


def motion(body: Body, rotation: Rotation, rate: Array, wheel: Array, command: Array, seconds: float) -> tuple[Rotation, Array, Array]:
    """After some time of constant motor torques, by DOP853: dC/dt = C [omega x], J domega/dt = -omega x h - W tau, J_w dOmega/dt = tau."""
    trials, wheels = command.shape
    inverse, push = np.linalg.inv(body.inertia), command @ body.axes.T

    def derivative(_: float, flat: Array) -> Array:
        state = flat.reshape(trials, -1)
        matrix, omega, speed = state[:, :9].reshape(-1, 3, 3), state[:, 9:12], state[:, 12:]
        skew = np.cross(omega[:, None, :], np.eye(3)).swapaxes(-1, -2)
        momentum = omega @ body.inertia.T + body.wheel_inertia * speed @ body.axes.T
        turning = (-np.cross(omega, momentum) - push) @ inverse.T
        return np.concatenate([(matrix @ skew).reshape(trials, 9), turning, command / body.wheel_inertia], axis=1).ravel()

    start = np.concatenate([rotation.as_matrix().reshape(trials, 9), rate, wheel], axis=1)
    end = solve_ivp(derivative, (0.0, seconds), start.ravel(), "DOP853", rtol=1e-10, atol=1e-11).y[:, -1].reshape(trials, 12 + wheels)
    return Rotation.from_matrix(end[:, :9].reshape(-1, 3, 3)), end[:, 9:12], end[:, 12:]


def fly(body: Body, expected: Expected, speed: float, *, ticks: int, trials: int, tick_s: float, seed: int) -> Flight:
    """Bodies that turn at `speed` rad/s about axes of their own, with small random torques, noise of both kinds, and gaps.

    Each tick's process noise is put on the state before the motion and after; signs of quaternions are drawn; of the readings behind the
    first a tenth of the quaternions and of the components of rates and wheels are missing.
    """
    random, wheels = np.random.default_rng(seed), body.axes.shape[1]
    half, noise = np.sqrt(0.5 * expected.process), np.sqrt(expected.reading)
    direction = random.standard_normal((trials, 3))
    rotation = Rotation.random(trials, rng=random)
    rate = speed * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    wheel = random.uniform(-50.0, 50.0, (trials, wheels))
    rows: list[tuple[Array, ...]] = []
    for tick in np.arange(ticks):
        error = noise * random.standard_normal((trials, 6 + wheels))
        seen = (rotation * Rotation.from_rotvec(error[:, :3])).as_quat() * random.choice([-1.0, 1.0], (trials, 1))
        rest = np.concatenate([rate, wheel], axis=1) + error[:, 3:]
        if tick:
            seen[random.random(trials) < 0.1] = np.nan
            rest[random.random(rest.shape) < 0.1] = np.nan
        command = 1e-4 * random.standard_normal((trials, wheels))
        rows.append((rotation.as_quat(), rate, wheel, command, np.concatenate([seen, rest], axis=1)))
        state = motion(body, *_pushed(rotation, rate, wheel, half * random.standard_normal((trials, 6 + wheels))), command, tick_s)
        rotation, rate, wheel = _pushed(*state, half * random.standard_normal((trials, 6 + wheels)))
    return Flight(tick_s * np.arange(ticks), *(np.stack(part) for part in zip(*rows, strict=True)))


def _pushed(rotation: Rotation, rate: Array, wheel: Array, push: Array) -> tuple[Rotation, Array, Array]:
    return rotation * Rotation.from_rotvec(push[:, :3]), rate + push[:, 3:6], wheel + push[:, 6:]


def write(path: Path, flight: Flight) -> Path:
    """As a laboratory that knows the truth would write it."""
    ticks, trials = flight.rate.shape[:2]
    columns = {"trial": np.repeat(np.arange(trials), ticks), "time_s": np.tile(flight.time, trials)}
    wheels = [f"{i + 1}" for i in np.arange(flight.wheel.shape[-1])]
    states = [*(f"q{i}" for i in (1, 2, 3, 4)), *(f"omega{i}" for i in (1, 2, 3)), *(f"wheel{i}" for i in wheels)]
    truth = np.concatenate([flight.quaternion, flight.rate, flight.wheel], axis=-1)
    for names, array in (
        (states, flight.reading),
        ([f"command{i}" for i in wheels], flight.command),
        ([f"truth_{name}" for name in states], truth),
    ):
        columns |= dict(zip(names, np.moveaxis(array, -1, 0).swapaxes(-1, -2).reshape(len(names), -1), strict=True))
    pq.write_table(pa.table({name: pa.array(np.ascontiguousarray(values)) for name, values in columns.items()}), path)
    return path
