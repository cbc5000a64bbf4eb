"""How far a model is from the plant: attitude, rate, wheel speed, momentum and energy over time, and when each passes a threshold."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.attitude import quaternion
from models.dynamics.state_layout import ATTITUDE, RATE, WHEELS
from models.dynamics.wheeled_body import WheeledBody
from sim.bad_input import BadInput
from sim.scenario.one_body import Scenario

Array = NDArray[np.floating]


class Quantity(NamedTuple):
    """Something of which plant and model have different opinions."""

    name: str  # as in options and metrics
    label: str
    unit: str


QUANTITIES = (
    Quantity("attitude", "attitude angle", "deg"),
    Quantity("rate", "body rate", "rad/s"),
    Quantity("wheel", "wheel speed", "rad/s"),
    Quantity("momentum", "momentum", "1"),
    Quantity("energy", "energy", "1"),
)
AT_REST = 1e-6  # of the greatest momentum: less than that at the start is none
RELATIVE = 0.01  # threshold of momentum and energy
IDEAL = {"attitude": 0.01, "rate": 1e-3, "wheel": 0.1}  # where a scenario's sensors have no noise, or where there is no sensor


def thresholds(scenario: Scenario, given: list[str]) -> dict[str, float]:
    """Threshold of every quantity in its unit: one standard deviation of the sensor's noise, 1 % of momentum and energy, or as given."""
    sensors = scenario.sensors
    attitude = float(np.hypot(sensors.attitude_noise_rad, 2.0 * sensors.quaternion_noise))  # a component is half a small angle
    noise = {"attitude": np.degrees(attitude), "rate": sensors.gyro_noise_rad_s if sensors.gyro else 0.0}
    if scenario.plant.wheel_axes.shape[1]:
        noise["wheel"] = sensors.wheel_noise_rad_s
    limits = {name: float(value) or IDEAL[name] for name, value in noise.items()} | {"momentum": RELATIVE, "energy": RELATIVE}
    for text in given:
        name, _, value = text.partition("=")
        if name not in limits:
            raise BadInput(f"--threshold {text}: needs QUANTITY=VALUE; quantities are {', '.join(limits)}")
        try:
            limits[name] = float(value)
        except ValueError:
            raise BadInput(f"--threshold {text}: {value!r} is no number") from None
        if not 0 < limits[name] < np.inf:
            raise BadInput(f"--threshold {text}: must be greater than 0")
    return limits


def momentum_N(body: WheeledBody, state: Array) -> Array:
    """Total angular momentum about the centre of rotation in N, N m s; (..., n) to (..., 3)."""
    return (quaternion.attitude_matrix(state[..., ATTITUDE]).swapaxes(-1, -2) @ body.momentum(state)[..., None])[..., 0]


def kinetic_energy(body: WheeledBody, state: Array) -> Array:
    """Of the body without the spin of its wheels and of that spin relative to N, J; (..., n) to (...)."""
    rate, axes = state[..., RATE], body.wheel_axes
    spin = state[..., WHEELS] + (axes.T @ rate[..., None])[..., 0]
    rest = body.inertia - body.wheel_inertia * axes @ axes.T
    return 0.5 * np.einsum("...i,ij,...j->...", rate, rest, rate) + 0.5 * body.wheel_inertia * np.sum(spin**2, axis=-1)


def divergence(body: WheeledBody, plant: Array, model: Array) -> dict[str, Array]:
    """Every quantity over time, (ticks, trials).

    Rate and wheel speed: the greatest of the components' differences. Momentum: length of the difference in N, relative to the greatest
    that the plant's wheels stored in the trial, without wheels to that at the start, or the greatest if it starts at rest; energy:
    relative to the plant's greatest kinetic energy in the trial. Both follow from the states by the plant's mass properties, whatever
    the model takes for these.

    Args:
      body: the plant's mass properties as a body with wheels, of which there may be none.
      plant: its states, (ticks, trials, n).
      model: its states, (ticks, trials, n).
    """
    total, energy, wheels = momentum_N(body, plant), kinetic_energy(body, plant), plant.shape[-1] > 7
    turn = np.linalg.norm(momentum_N(body, model) - total, axis=-1)
    return {
        "attitude": np.degrees(quaternion.angle(model[..., ATTITUDE], plant[..., ATTITUDE])),
        "rate": np.abs(model[..., RATE] - plant[..., RATE]).max(axis=-1),
        **({"wheel": np.abs(model[..., WHEELS] - plant[..., WHEELS]).max(axis=-1)} if wheels else {}),
        "momentum": turn / np.maximum(_stored(body, plant) if wheels else _kept(total), 1e-12),
        "energy": np.abs(kinetic_energy(body, model) - energy) / np.maximum(energy.max(axis=0), 1e-12),
    }


def _stored(body: WheeledBody, plant: Array) -> Array:
    """Greatest momentum in the wheels, (ticks, trials, n) to (trials,) N m s."""
    return np.linalg.norm(body.wheel_inertia * plant[..., WHEELS] @ body.wheel_axes.T, axis=-1).max(axis=0)


def _kept(total: Array) -> Array:
    """Momentum at the start, or the greatest of a trial that starts at rest, (ticks, trials, 3) to (trials,) N m s."""
    size = np.linalg.norm(total, axis=-1)
    return np.where(size[0] > AT_REST * size.max(axis=0), size[0], size.max(axis=0))


def passes(values: Array, threshold: float, tick_s: float) -> Array:
    """First instant, s, at which `values` (ticks, ...) exceed the threshold; (...), NaN if never."""
    beyond = values > threshold
    return np.where(beyond.any(axis=0), tick_s * np.argmax(beyond, axis=0), np.nan)


def rms(values: Array) -> Array:
    """Root mean square over the last axis, the trials."""
    return np.sqrt(np.mean(values**2, axis=-1))
