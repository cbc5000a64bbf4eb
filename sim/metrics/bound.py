"""Errors of filters beside the posterior Cramer-Rao bound along the trajectories that were flown; docs/metrics.md says what it assumes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from estimation.posterior_bound import posterior_bound
from estimation.state_space import Euclidean, Multiplicative, StateSpace
from models.dynamics.process import predict
from models.dynamics.state_layout import ATTITUDE, PLANE, POSITION, RATE, VELOCITY, WHEELS
from models.plants.register.entries import kind_of
from sim.estimators.believed import Models
from sim.loop.recording import Recording
from sim.scenario.consensus import ConsensusScenario
from sim.scenario.formation import FormationScenario
from sim.scenario.one_body import Scenario

Array = NDArray[np.floating]

WINDOW_S = 2.0  # over which what the model leaves out is averaged to Q
FIRST_DEVIATION = 1.0  # of what the first reading does not hold
UNBLURRED = ("noise", "delay")  # faults of sensors that R does not know


class Trajectory(NamedTuple):
    """A flight as a filter's model sees it; leading axes: ticks, trials, and agents if there are several."""

    truth: Array  # (ticks, ..., n)
    predicted: Array  # (ticks - 1, ..., n) state that the model makes of the true one before
    transition: Array  # (ticks - 1, ..., e, e) its sensitivity, in error coordinates
    read: Array  # (ticks, ..., e) whether a component is read, one or zero
    information: Array  # (e,) of a reading, one over its variance
    space: StateSpace
    parts: dict[str, tuple[str, slice]]  # of the error: name to unit and place


class Efficiency(NamedTuple):
    """A filter's error beside the least that there can be."""

    observer: str
    part: str
    unit: str
    error: float  # RMS over ticks, trials, agents and axes
    bound: float


def efficiency(scenario: Scenario | FormationScenario | ConsensusScenario, recording: Recording, start_s: float) -> list[Efficiency]:
    """RMS errors of all filters of a flight and the bound on them, from `start_s` on.

    Q is what acts: the square of what the model of filters leaves out in a step, averaged over trials and two seconds. It is taken for
    white; where it is not, as a wrong inertia's torque, nobody can come to the bound. Wheel speeds that are read and not estimated are
    taken as known.

    Args:
      scenario: of this loop alone.
      recording: of all trials.
      start_s: from when on.

    Raises:
      ValueError: a fault changes what readings are worth.
    """
    if hidden := [fault.kind for fault in scenario.faults if fault.kind in UNBLURRED]:
        raise ValueError(f"faults: a bound needs sensors as they are set, and {hidden[0]} changes them")
    flown = TRAJECTORIES[scenario.family](scenario, recording)
    apart = flown.space.difference(flown.truth[1:], flown.predicted)
    square = np.mean(apart[..., :, None] * apart[..., None, :], axis=1, keepdims=True)
    noise = uniform_filter1d(square, max(1, round(WINDOW_S / recording.dt)), axis=0, mode="nearest")
    known = flown.read * flown.information
    size = apart.shape[-1]
    spread = 1.0 / (known[0] + FIRST_DEVIATION**-2)
    bound = posterior_bound(flown.transition, noise, known[1:, ..., None] * np.eye(size), spread[..., None] * np.eye(size))
    ticks = slice(max(1, round(start_s / recording.dt)), None)
    variance = np.diagonal(bound, axis1=-2, axis2=-1)[ticks.start - 1 :]
    found = []
    for observer in recording.observers:
        mean = recording.channels[f"{observer}/mean"][ticks]
        if mean.shape[-1] != flown.truth.shape[-1]:
            continue
        error = flown.space.difference(mean, flown.truth[ticks])
        for part, (unit, place) in flown.parts.items():
            found.append(
                Efficiency(
                    observer, part, unit, float(np.sqrt(np.mean(error[..., place] ** 2))), float(np.sqrt(np.mean(variance[..., place])))
                )
            )
    return found


def _body(scenario: Scenario, recording: Recording) -> Trajectory:
    models, sensors = Models.of(scenario.plant), scenario.sensors
    truth, command = recording.channels["truth/state"], recording.channels["command"]
    reading = recording.channels["reading"]
    size = kind_of(scenario.plant).layout(scenario.plant).size
    known = command if models.speeds_are_states else np.concatenate([command, truth[..., WHEELS]], axis=-1)
    state, space = truth[..., :size], Multiplicative()
    prediction = predict(models.with_drag, state[:-1], known[:-1], recording.dt)
    counts = [3, 3, size - 7]
    seen = np.stack([~np.isnan(reading[..., part]).any(axis=-1) for part in (ATTITUDE, RATE, WHEELS)], axis=-1)
    plain = sensors.model_copy(update={"distribution": type(sensors).model_fields["distribution"].default}).variances
    with np.errstate(divide="ignore"):
        information = sensors.distribution.information / np.repeat(plain, counts)
    return Trajectory(
        state,
        prediction.state,
        space.transition(prediction.transition, state[:-1], prediction.state),
        np.repeat(seen, counts, axis=-1).astype(float),
        information,
        space,
        {"attitude": ("rad", slice(3)), "rate": ("rad/s", slice(3, 6))},
    )


def _formation(scenario: FormationScenario, recording: Recording) -> Trajectory:
    truth, reading = recording.channels["truth/state"], recording.channels["reading"]
    process = kind_of(scenario.plant).believed(scenario.plant, False, None)
    prediction = predict(process, truth[:-1], recording.channels["known"][:-1], recording.dt)
    information = np.repeat([scenario.reading_distribution.information / scenario.reading_deviation**2, 0.0], 3)
    read = np.concatenate([~np.isnan(reading), np.zeros(reading.shape, dtype=bool)], axis=-1).astype(float)
    parts = {"attitude": ("1", slice(3)), "rate": ("1/s", slice(3, 6))}
    return Trajectory(truth, prediction.state, prediction.transition, read, information, Euclidean(), parts)


def _consensus(scenario: ConsensusScenario, recording: Recording) -> Trajectory:
    """Of a filter that knows the force that nobody knows: it has nothing to learn."""
    truth, reading, dt = recording.channels["truth/state"], recording.channels["reading"], recording.dt
    acceleration = (recording.channels["force"] + recording.channels["unknown"])[:-1] / scenario.plant.mass_kg
    before = truth[:-1]
    moved = before[..., POSITION] + dt * before[..., VELOCITY] + 0.5 * dt**2 * acceleration
    predicted = np.concatenate([moved, before[..., VELOCITY] + dt * acceleration], axis=-1)
    transition = np.eye(4) + dt * np.eye(4, k=2)
    sensors = scenario.sensors
    information = sensors.distribution.information / np.repeat([sensors.position_std_m, sensors.speed_std_m_s], 2) ** 2
    parts = {"position": ("m", POSITION), "speed": ("m/s", VELOCITY)}
    return Trajectory(
        truth[..., PLANE],
        predicted,
        np.broadcast_to(transition, (*predicted.shape, 4)),
        (~np.isnan(reading)).astype(float),
        information,
        Euclidean(),
        parts,
    )


TRAJECTORIES: dict[str, Callable[[Any, Recording], Trajectory]] = {"body": _body, "formation": _formation, "consensus": _consensus}
