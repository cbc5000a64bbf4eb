"""The closed loop of a formation, from its scenario: attitudes by modified Rodrigues parameters, messages, drives, and what is recorded."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from control.communication_graph import CommunicationGraph
from control.formation_law import FormationLaw, Gains
from estimation.leader_acceleration import LeaderAccelerationFilter
from estimation.neighbours_residuals import agents_statistic
from estimation.state_space import Euclidean
from models.attitude import modified_rodrigues, quaternion
from models.plants.assembly import Assembly
from models.plants.register.entries import kind_of
from sim.controllers.drives import Effectors as FormationDrives
from sim.controllers.drives import WheelMomentum, effectors
from sim.estimators.formation import agents_filter
from sim.faults.effects import GAINS
from sim.faults.timeline import Timeline, schedule
from sim.loop.body_parts import MASSES, brake_wheels, masses
from sim.loop.closed_loop import System
from sim.network.messages import Messages, Network
from sim.parts import ActuatorOutput, AnyArray, Array, Decision, Estimator, Flags, Snapshot
from sim.plant.formation import AgentsTruth, FormationPlant
from sim.randomness import RandomStream, Stream, Trials
from sim.scenario.formation import FormationScenario
from sim.scenario.surroundings import surroundings
from sim.sensors.agents import AgentsSensors
from sim.user_code.laws import FormationUserLaw
from sim.user_code.user_code import UserCode


class FormationEstimate(NamedTuple):
    """What each agent believes of itself."""

    state: Array  # true [sigma, v], (trials, agents, 6)
    own: Array  # the same as believed, of the shadow set where that is asked for
    innovation: Array | float  # sigma read minus sigma believed, (trials, agents, 3)
    stored: Array | None  # momentum that wheels hold, as believed, (trials, agents, 3) N m s
    read: Array | None  # the same as read


@dataclass(frozen=True, eq=False)
class FormationFeedback:
    """Tells the agents' laws their states: an observer, or the truth.

    Attributes:
      source: an observer's name, or `truth`.
      estimators: all of the loop.
      drives: whose wheels hold momentum.
      shadow: attitudes are taken of the set with |sigma| <= 1.
    """

    source: str
    estimators: tuple[Estimator, ...]
    drives: FormationDrives
    shadow: bool

    def __call__(self, tick: int, beliefs: tuple[Any, ...], truth: AgentsTruth, reading: Array, held: Array) -> FormationEstimate:
        """What each agent acts on; to be called once a tick, since tachometers are read."""
        state, true = truth.state, self.source == "truth"
        believed = state if true else self._believed(beliefs)
        stored: WheelMomentum | None = self.drives.stored(truth)
        return FormationEstimate(
            state=state,
            own=_shorter(believed) if self.shadow else believed,
            innovation=0.0 if true else np.where(np.isnan(reading), 0.0, reading - believed[..., :3]),
            stored=None if stored is None else stored.true if true else stored.read,
            read=None if stored is None else stored.read,
        )

    def _believed(self, beliefs: tuple[Any, ...]) -> Array:
        names = [estimator.names[0] for estimator in self.estimators]
        index = names.index(self.source)
        mean: Array = self.estimators[index].summary(beliefs[index]).mean[0]
        return mean


@dataclass(frozen=True, eq=False)
class NetworkedLaw:
    """The law of a formation, and the filter of the leader's acceleration, which is what it remembers.

    Attributes:
      law: of all agents.
      follow: the filter.
      faults: that change gains.
      gains: of the law while none does.
      leader: [sigma, rate, second derivative], (ticks, 9).
      dt: s.
    """

    law: FormationLaw | FormationUserLaw
    follow: LeaderAccelerationFilter
    faults: Timeline
    gains: Gains
    leader: Array
    dt: float

    def start(self, estimate: FormationEstimate) -> Array:
        """No acceleration, (trials, agents, 3)."""
        return np.zeros((*estimate.own.shape[:-1], 3))

    def says(self, tick: int, estimate: FormationEstimate, memory: Array) -> Array:
        """State and acceleration of the leader and of each agent, (trials, 1 + agents, 9)."""
        spoken = np.concatenate([estimate.own, memory], axis=-1)
        return np.concatenate([np.broadcast_to(self.leader[tick], (len(spoken), 1, 9)), spoken], axis=1)

    def decide(self, tick: int, estimate: FormationEstimate, messages: Messages, memory: Array) -> Decision:
        """Torque on each body, (trials, agents, 3) N m in B."""
        heard, listening, gains = messages.messages, messages.listening, self._gains(tick)
        torque = self.law.step(estimate.own, heard[..., :6], listening, memory, estimate.innovation, gains, estimate.stored)
        return Decision(torque, self.follow.step(memory, heard[..., 6:], listening, self.dt), {})

    def _gains(self, tick: int) -> Gains:
        """Of every agent's law."""
        now = self.faults.at(GAINS, tick)
        return self.gains if now is None else Gains(now[..., :1], now[..., 1:2], now[..., 2:3], now[..., 3:], self.gains.lambda_)


@dataclass(frozen=True, eq=False)
class FormationEffectors:
    """Commands that are replaced by faults, and the drives that carry them out.

    Attributes:
      drives: of all agents.
      faults: of commands, and torques from outside.
      shape: (trials, agents).
      wheels: of each agent.
    """

    drives: FormationDrives
    faults: Timeline
    shape: tuple[int, int]
    wheels: int

    def rest(self) -> ActuatorOutput:
        """No torque."""
        trials, agents = self.shape
        known = np.zeros((trials, agents, 6 if self.wheels else 3))
        return ActuatorOutput(np.zeros((trials, agents * self.wheels)), np.zeros((trials, agents, 3)), known, None, {})

    def give(
        self, tick: int, decision: Decision, estimate: FormationEstimate, held: Array, before: ActuatorOutput, lost: Flags
    ) -> ActuatorOutput:
        """Carry out the torques; filters know those of the laws, and the momentum that was read in wheels."""
        torque = decision.effort
        applied, outside = self.faults.commanded(tick, torque), self.faults.push(tick)
        given = self.drives.give(tick, applied, 0.0 if outside is None else outside)
        known = torque if estimate.read is None else np.concatenate([torque, estimate.read], axis=-1)
        return ActuatorOutput(given.wheel, given.body, known, None, {"applied": applied})


@dataclass(frozen=True, eq=False)
class Sight:
    """What agents see of those whom they hear: attitudes relative to their own.

    Attributes:
      ways: who sees whom, counted from zero, (ways, 2).
      deviation: about each axis, rad.
      noise: standard normal, (trials, ways, 3) a tick.
      reading_deviation: of each component of sigma.
    """

    ways: NDArray[np.int64]
    deviation: float
    noise: RandomStream
    reading_deviation: float

    def statistic(self, q_BN: Array, reading: Array) -> Array:
        """How unlikely each agent's error is, of true attitudes (trials, agents, 4) and readings of sigma (trials, agents, 3)."""
        who, whom = self.ways.T
        said = modified_rodrigues.to_quaternion(reading)
        relative = quaternion.multiply(q_BN[:, whom], quaternion.inverse(q_BN[:, who]))
        seen = quaternion.multiply(quaternion.from_rotation_vector(self.deviation * self.noise.tick()), relative)
        residual = quaternion.error(said[:, whom], quaternion.multiply(seen, said[:, who]))
        scale = 4.0 / (1.0 + np.nan_to_num(_squares_of(reading)))  # of a small turn, rad, to a change of sigma
        own = (self.reading_deviation * scale) ** 2
        return agents_statistic(residual, whom, own, own[:, who] + self.deviation**2)


@dataclass(frozen=True, eq=False)
class FormationRecord:
    """What is recorded of a tick.

    Attributes:
      leader: (ticks, 9).
      estimators: of the loop.
      shadow: errors are those of the set with |sigma| <= 1.
      wheels: of each agent.
      limit_nm: of the torque about each body axis.
      sight: of those who see others, if a faulty one is looked for.
    """

    leader: Array
    estimators: tuple[Estimator, ...]
    shadow: bool
    wheels: int
    limit_nm: float
    sight: Sight | None = None

    def channels(self, tick: int, now: Snapshot) -> dict[str, AnyArray]:
        """Of the trials that are recorded, (trials, agents, ...)."""
        state, received = now.estimate.state, now.messages.received
        out: dict[str, AnyArray] = {
            "truth/q_BN": modified_rodrigues.to_quaternion(state[..., :3]),
            "reading": now.reading,
            "torque_B": now.decision.effort,
            "known": now.given.known,
            "applied": now.given.notes["applied"],
            "control/acceleration": now.memory,
            "messages/received": np.broadcast_to(received, (len(state), received.shape[-1])),
            "truth/qpos": now.truth.qpos,
        }
        if self.wheels:
            lead = state.shape[:2]
            out |= {"truth/wheel_speed": now.truth.omega_wheel.reshape(*lead, -1), "wheel_torque": now.given.wheel.reshape(*lead, -1)}
        return out

    def figures(self, tick: int, now: Snapshot) -> dict[str, AnyArray]:
        """Of all trials, (trials,)."""
        state, torque, leader = now.estimate.state, now.decision.effort, self.leader[tick]
        shown = modified_rodrigues.shorter(state[..., :3]) if self.shadow else state[..., :3]
        q_BN = modified_rodrigues.to_quaternion(state[..., :3])
        q_0 = modified_rodrigues.to_quaternion(leader[:3])
        row = {
            "skae": np.sqrt(_squares(shown - leader[:3])),
            "fkae": np.sqrt(apart_squared(shown)),
            "station_angle": np.sqrt(np.mean(quaternion.angle(q_BN, q_0) ** 2, axis=-1)),
            "formation_angle": formation_angle(q_BN),
            "peak_torque": np.max(np.abs(torque), axis=(-2, -1)),
            "acceleration_error": np.sqrt(_squares(now.memory - leader[6:])),
        }
        for estimator, belief in zip(self.estimators, now.beliefs, strict=True):
            summary = estimator.summary(belief)
            wrong = summary.mean[0, ..., 3:] - state[..., 3:]
            row[f"{estimator.names[0]}/velocity_squared"] = _squares(wrong) / state.shape[-2]
            if summary.memory is not None:
                row[f"{estimator.names[0]}/lost"] = np.sum(summary.memory.restarted[0], axis=-1, dtype=float)
        if self.sight is not None:
            statistic = self.sight.statistic(q_BN, now.reading)
            row |= {f"isolation/{agent}": own for agent, own in enumerate(statistic.T, 1)}
        if self.wheels:
            row |= {
                "peak_wheel_speed": np.max(np.abs(now.truth.omega_wheel), axis=-1),
                "saturated": np.mean((np.abs(torque) >= self.limit_nm).reshape(len(torque), -1), axis=-1),
            }
        return row


@dataclass(frozen=True, eq=False)
class FormationChange:
    """Carries out faults that change the bodies.

    Attributes:
      plant: of all trials.
      faults: that lock wheels or change inertia.
    """

    plant: FormationPlant
    faults: Timeline

    def __call__(self, tick: int) -> None:
        """What changes at a tick."""
        brake_wheels(self.plant, self.faults, tick)
        if self.faults.changes_at(tick, *MASSES):
            own = self.plant.assembly
            now, before = (masses(self.faults, k, own.inertia, own.centre_of_mass) for k in (tick, tick - 1))
            if any(np.any(part != part_before) for part, part_before in zip(now, before, strict=True)):
                self.plant.set_masses(*now)


def build_formation(scenario: FormationScenario, name: str, assembly: Assembly, trials: Trials, user_code: UserCode) -> System:
    """All parts of one loop of a scenario, for the given trial numbers."""
    loop, run, parameters, graph = scenario.loops[name], scenario.run, scenario.plant, scenario.communication()
    ticks, dt, agents = run.ticks, run.tick_s, parameters.agents
    parts = replace(scenario.parts, gains=loop.law.gains[:-1])
    faults = schedule([scenario.faults] * len(trials), parts, run.seed, trials, ticks, dt)
    leader = scenario.leader.motion(dt * np.arange(ticks))
    plant = FormationPlant(assembly, len(trials))
    for actuator, setpoint in kind_of(parameters).holds(parameters).items():
        plant.hold(actuator, setpoint)
    first = modified_rodrigues.shorter(scenario.starts) if loop.shadow else scenario.starts
    plant.start(modified_rodrigues.to_quaternion(first), np.zeros(3), np.zeros(()))
    drives = effectors(parameters, assembly, faults, run.seed, trials, dt)
    estimators = formation_estimators(scenario, name, trials, user_code)
    user_law = user_code.control(surroundings(scenario))
    law = FormationLaw(parameters.believed_inertia, loop.law.gains, parameters.torque_limit_nm)
    record = FormationRecord(leader, estimators, loop.shadow, scenario.wheels, parameters.torque_limit_nm, _sight(scenario, graph, trials))
    losses = RandomStream(run.seed, trials, Stream.MESSAGES, (len(graph.ways),), uniform=True)
    return System(
        plant=plant,
        sensors=AgentsSensors(
            scenario.reading_deviation,
            RandomStream(run.seed, trials, Stream.AGENTS_READING, (agents, 3)),
            np.array([3]),
            faults,
            scenario.reading_distribution,
            RandomStream(run.seed, trials, Stream.AGENTS_TAILS, (agents, 1), uniform=True),
        ),
        estimators=estimators,
        feedback=FormationFeedback(loop.feedback, estimators, drives, loop.shadow),
        network=Network(graph, faults, losses, scenario.graph.when_lost == "skip"),
        law=NetworkedLaw(
            FormationUserLaw(user_law) if user_law else law,
            LeaderAccelerationFilter(loop.law.acceleration_gain, float(loop.law.acceleration_sign)),
            faults,
            loop.law.gains,
            leader,
            dt,
        ),
        effectors=FormationEffectors(drives, faults, (len(trials), agents), scenario.wheels),
        change=FormationChange(plant, faults),
        trials=trials,
        ticks=ticks,
        dt=dt,
        channels=record.channels,
        figures=record.figures,
        references={"leader": leader},
        occurrences=faults.occurrences,
        errors=Euclidean(),
    )


def formation_estimators(scenario: FormationScenario, name: str, trials: Trials, user_code: UserCode) -> tuple[Estimator, ...]:
    """The observers of one loop of a scenario, and the user's filters."""
    loop, seed = scenario.loops[name], scenario.run.seed
    watching = [o for o in dict.fromkeys((loop.feedback, *loop.watching)) if o in scenario.observers]
    own = (agents_filter(o, scenario.observers[o], scenario.plant, seed, trials) for o in watching)
    return (*own, *user_code.filters(surroundings(scenario)))


def _shorter(state: Array) -> Array:
    """The same motion in the set with |sigma| <= 1, (..., 6)."""
    sigma = modified_rodrigues.shorter(state[..., :3])
    return np.concatenate([sigma, modified_rodrigues.rate(sigma, modified_rodrigues.body_rate(state[..., :3], state[..., 3:]))], axis=-1)


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


def _sight(scenario: FormationScenario, graph: CommunicationGraph, trials: Trials) -> Sight | None:
    """Of those who hear others, if a faulty one is looked for."""
    if scenario.isolation is None:
        return None
    ways = np.argwhere(graph.weights > 0.0)
    noise = RandomStream(scenario.run.seed, trials, Stream.AGENTS_RELATIVE, (len(ways), 3))
    return Sight(ways, scenario.isolation.deviation_rad, noise, scenario.reading_deviation)


def _squares_of(vector: Array) -> Array:
    """Length squared of each, (..., 3) to (...)."""
    squares: Array = np.vecdot(vector, vector)
    return squares
