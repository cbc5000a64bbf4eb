"""The closed loop of a formation, tick by tick: measure, observe, tell the neighbours, command, inject faults, step, record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from control.formation_law import FormationLaw
from estimation.gaussian import LostDefiniteness
from estimation.leader_acceleration import LeaderAccelerationFilter
from models.attitude import modified_rodrigues, quaternion
from models.plants.assembly import Assembly
from sim.controllers.drives import Given, effectors
from sim.estimators.formation import Observer, Watched, observer
from sim.faults.formation import FormationFaults, Occurrence, schedule
from sim.formation_randomness import Blocks, FormationStream
from sim.network.messages import Network
from sim.plant.batch import SimulationFailed, Truth
from sim.plant.formation import FormationPlant, formation_plant
from sim.randomness import Trials
from sim.scenario.formation import FormationScenario, LoopSettings

Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Flown:
    """What one loop left: figures of every trial at every tick, and all of the recorded trials.

    Attributes:
      loop: its name.
      dt: of a tick, s.
      trials: numbers of all trials, (trials,).
      recorded: numbers of the recorded ones.
      places: of the agents, (agents, 3) m.
      ways: receiver and sender (0: the leader) of each message, (messages, 2).
      weights: of each message, (messages,).
      leader: [sigma, rate, second derivative], (ticks, 9).
      occurrences: events.
      figures: by name, (ticks, trials).
      channels: of the recorded trials by name, (ticks, recorded, ...).
    """

    loop: str
    dt: float
    trials: Trials
    recorded: Trials
    places: Array
    ways: NDArray[np.int64]
    weights: Array
    leader: Array
    occurrences: tuple[Occurrence, ...]
    figures: dict[str, Array] = field(default_factory=dict)
    channels: dict[str, Array] = field(default_factory=dict)

    @property
    def time(self) -> Array:
        """Of every tick, (ticks,) s."""
        return self.dt * np.arange(len(self.leader))


def fly(
    scenario: FormationScenario,
    name: str,
    assembly: Assembly,
    trials: Trials,
    recorded: Trials,
    on_tick: Callable[[int], None] | None = None,
) -> Flown:
    """Fly one loop of a scenario.

    Raises:
      SimulationFailed: the physics or a filter broke down; says trial, time and cause.
    """
    loop, graph, ticks, dt = scenario.loops[name], scenario.communication(), scenario.run.ticks, scenario.run.tick_s
    faults = schedule(scenario.faults, ticks, dt, graph, loop.law.gains, scenario.reading_deviation, scenario.wheels)
    leader = scenario.leader.motion(dt * np.arange(ticks))
    weights = graph.listening[graph.ways[:, 0], graph.ways[:, 1]]
    flown = Flown(name, dt, trials, recorded, scenario.plant.places, graph.ways, weights, leader, faults.occurrences)
    try:
        _fly(scenario, loop, faults, formation_plant(scenario.plant, assembly, len(trials)), flown, on_tick)
    except SimulationFailed as failure:
        failure.trial = int(trials[failure.trial])
        raise
    return flown


def _fly(
    scenario: FormationScenario,
    loop: LoopSettings,
    faults: FormationFaults,
    plant: FormationPlant,
    flown: Flown,
    on_tick: Callable[[int], None] | None,
) -> None:
    """The loop itself; a trial's number in an exception is its position."""
    run, parameters, trials = scenario.run, scenario.plant, flown.trials
    steps, agents = round(run.tick_s / plant.step_s), parameters.agents
    law = FormationLaw(parameters.believed_inertia, loop.law.gains, parameters.torque_limit_nm)
    follow = LeaderAccelerationFilter(loop.law.acceleration_gain, float(loop.law.acceleration_sign))
    noise = Blocks(run.seed, trials, FormationStream.READING, (agents, 3))
    losses = Blocks(run.seed, trials, FormationStream.MESSAGES, (len(flown.ways),), uniform=True)
    drives = effectors(parameters, agents, faults, run.seed, trials, run.tick_s)
    network = Network(scenario.communication(), faults, losses, scenario.graph.when_lost == "skip")
    watching = [o for o in dict.fromkeys((loop.feedback, *loop.watching)) if o != "truth"]
    observers = {o: observer(o, scenario.observers[o], parameters, run.seed, trials) for o in watching}
    beliefs: dict[str, Any] = dict.fromkeys(watching)
    lost: dict[str, NDArray[np.bool_]] = {}
    kept = np.isin(trials, flown.recorded)

    first = modified_rodrigues.shorter(scenario.starts) if loop.shadow else scenario.starts
    plant.start(modified_rodrigues.to_quaternion(first), np.zeros(3), np.zeros(()))
    told: Array = np.zeros((len(trials), agents, 3))  # to filters, of the tick before
    acceleration: Array = np.zeros((len(trials), agents, 3))
    for k in range(run.ticks):
        truth = plant.truth()
        state = state_of(truth)
        reading = state[..., :3] + faults.bias[k] + faults.deviation[k] * noise.tick()
        for o in watching:
            beliefs[o], lost[o] = _observe(observers[o], beliefs[o], told, reading, run.tick_s, o, k)
        believed = state if loop.feedback == "truth" else beliefs[loop.feedback].mean
        surprise = 0.0 if loop.feedback == "truth" else reading - believed[..., :3]

        own = _shorter(believed) if loop.shadow else believed
        spoken = np.concatenate([own, acceleration], axis=-1)
        said = np.broadcast_to(flown.leader[k], (len(trials), 1, 9))
        heard = network.carry(k, np.concatenate([said, spoken], axis=1))
        gains = faults.gains_at(k)
        held = drives.stored(truth)
        stored = None if held is None else held.true if loop.feedback == "truth" else held.read
        torque = law.step(own, heard.messages[..., :6], heard.listening, acceleration, surprise, gains, stored)
        applied = np.where(np.isnan(faults.command[k]), torque, faults.command[k])
        given = drives.give(k, applied, push(faults.disturbance[k], k * run.tick_s))
        told = torque if held is None else np.concatenate([torque, held.read], axis=-1)

        _record(flown, k, kept, state, reading, beliefs, lost, torque, applied, acceleration, heard.received, loop.shadow)
        if scenario.wheels:
            _record_wheels(flown, k, kept, truth, given, torque, parameters.torque_limit_nm)
        if on_tick:
            on_tick(k)
        if np.any(faults.inertia[k] != (faults.inertia[k - 1] if k else 0.0)):
            plant.set_inertias(parameters.inertia + np.diag(faults.inertia[k]))
        plant.advance(given.wheel, given.body, steps)
        acceleration = follow.step(acceleration, heard.messages[..., 6:], heard.listening, run.tick_s)


def state_of(truth: Truth) -> Array:
    """[sigma, v] of all agents, in the set that each has turned to; (trials, agents, 6)."""
    sigma = modified_rodrigues.from_quaternion(truth.q_BN)
    return np.concatenate([sigma, modified_rodrigues.rate(sigma, truth.omega_BN_B)], axis=-1)


def push(size: float, time: float) -> Array:
    """Disturbance torque, (3,) N m in B (Rososhansky 2017, eq. 4.16, table 4.5)."""
    return size * np.array([np.sin(time), np.cos(time), np.sin(2.0 * time)])


def _shorter(state: Array) -> Array:
    """The same motion in the set with |sigma| <= 1, (..., 6)."""
    sigma = modified_rodrigues.shorter(state[..., :3])
    return np.concatenate([sigma, modified_rodrigues.rate(sigma, modified_rodrigues.body_rate(state[..., :3], state[..., 3:]))], axis=-1)


def _observe(observer: Observer, belief: Any, torque: Array, reading: Array, dt: float, name: str, tick: int) -> Watched:
    """One step of a filter; one that breaks down ends the run, saying which and where."""
    try:
        return observer.step(belief, torque, reading, dt)
    except LostDefiniteness as lost:
        agent = f" of agent {lost.where[1] + 1}" if len(lost.where) > 1 else ""
        raise SimulationFailed(lost.where[0] if lost.where else 0, tick * dt, f"filter {name}{agent}: {lost.what}") from None


def _record(
    flown: Flown,
    k: int,
    kept: NDArray[np.bool_],
    state: Array,
    reading: Array,
    beliefs: dict[str, Any],
    lost: dict[str, NDArray[np.bool_]],
    torque: Array,
    applied: Array,
    acceleration: Array,
    received: NDArray[np.bool_],
    shadow: bool,
) -> None:
    """Put away a tick."""
    shown = modified_rodrigues.shorter(state[..., :3]) if shadow else state[..., :3]
    q_BN = modified_rodrigues.to_quaternion(state[..., :3])
    q_0 = modified_rodrigues.to_quaternion(flown.leader[k, :3])
    row = {
        "skae": np.sqrt(_squares(shown - flown.leader[k, :3])),
        "fkae": np.sqrt(apart_squared(shown)),
        "station_angle": np.sqrt(np.mean(quaternion.angle(q_BN, q_0) ** 2, axis=-1)),
        "formation_angle": formation_angle(q_BN),
        "peak_torque": np.max(np.abs(torque), axis=(-2, -1)),
        "acceleration_error": np.sqrt(_squares(acceleration - flown.leader[k, 6:])),
    }
    row |= {f"{name}/velocity_squared": _squares(b.mean[..., 3:] - state[..., 3:]) / state.shape[-2] for name, b in beliefs.items()}
    row |= {f"{name}/lost": np.sum(flags, axis=-1, dtype=float) for name, flags in lost.items()}
    channels = {"state": state, "q_BN": q_BN, "reading": reading, "applied": applied, "acceleration": acceleration}
    channels |= {"received": np.broadcast_to(received, (len(state), received.shape[-1]))}
    channels |= {f"{name}/mean": b.mean for name, b in beliefs.items()}
    if kept.any():
        _put(flown.channels, {name: values[kept] for name, values in channels.items()}, k, len(flown.leader))
    _put(flown.figures, row, k, len(flown.leader))


def _record_wheels(flown: Flown, k: int, kept: NDArray[np.bool_], truth: Truth, given: Given, torque: Array, limit: float) -> None:
    """Put away what wheels do at a tick, and the pose of everything that moves."""
    trials, agents = torque.shape[:2]
    row = {
        "peak_wheel_speed": np.max(np.abs(truth.omega_wheel), axis=-1),
        "saturated": np.mean((np.abs(torque) >= limit).reshape(trials, -1), axis=-1),
    }
    channels = {"wheel_speed": truth.omega_wheel.reshape(trials, agents, -1), "wheel_torque": given.wheel.reshape(trials, agents, -1)}
    channels |= {"qpos": truth.qpos}
    if kept.any():
        _put(flown.channels, {name: values[kept] for name, values in channels.items()}, k, len(flown.leader))
    _put(flown.figures, row, k, len(flown.leader))


def _put(kept: dict[str, Array], row: dict[str, Array], k: int, ticks: int) -> None:
    for name, values in row.items():
        if name not in kept:
            kept[name] = np.zeros((ticks, *values.shape), dtype=values.dtype)
        kept[name][k] = values


def _squares(vectors: Array) -> Array:
    """Sum over agents and components, (trials, agents, 3) to (trials,)."""
    return np.sum((vectors**2).reshape(len(vectors), -1), axis=-1)


def apart_squared(sigma: Array) -> Array:
    """Sum over all pairs of |sigma_i - sigma_j|^2, (..., agents, 3) to (...): agents times the squares about their mean."""
    about = sigma - np.mean(sigma, axis=-2, keepdims=True)
    return sigma.shape[-2] * np.sum((about**2).reshape(*about.shape[:-2], -1), axis=-1)


def formation_angle(q_BN: Array) -> Array:
    """Root mean square over all pairs of the angle between two agents, rad; (..., agents, 4) to (...)."""
    i, j = np.triu_indices(q_BN.shape[-2], 1)
    cosine = np.minimum(np.abs(np.sum(np.take(q_BN, i, axis=-2) * np.take(q_BN, j, axis=-2), axis=-1)), 1.0)
    return np.sqrt(np.sum((2.0 * np.arccos(cosine)) ** 2, axis=-1) / max(len(i), 1))
