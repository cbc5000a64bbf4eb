"""The closed loop of agents in the plane that learn what moves them while they follow a leader, from its scenario."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from control.terminal_sliding_mode import Sliding, TerminalSlidingMode, lumped
from estimation.state_space import Euclidean
from models.chebyshev_network import ChebyshevNetwork
from models.dynamics.planar_agent import PlanarAgent
from models.plants.agents import AgentsParameters, compile_agents
from sim.estimators.consensus import AppliedControl, Learned, learner
from sim.estimators.learner_settings import Adaptive, Exact, Nothing
from sim.faults.effects import DISTURBANCE, DYNAMICS, SLIDING
from sim.faults.timeline import Timeline, schedule
from sim.loop.closed_loop import System
from sim.network.messages import Messages, Network
from sim.parts import ActuatorOutput, AnyArray, Array, Decision, Estimator, Flags, Snapshot
from sim.plant.planar_agents import AgentsPlant, PlanarTruth
from sim.randomness import RandomStream, Stream, Trials
from sim.scenario.consensus import ConsensusScenario
from sim.scenario.surroundings import surroundings
from sim.sensors.agents import AgentsSensors
from sim.user_code.laws import PlanarUserLaw
from sim.user_code.user_code import UserCode

LIMIT = np.array([1e3, 1e3, 4e2, 4e2])  # m, m/s: a trial with an agent beyond that is lost; its network's polynomials would soon overflow
NETWORK = ChebyshevNetwork()


class FlownOff:
    """A trial is lost once one of its agents has flown off."""

    def judge(self, lost: Flags, truth: PlanarTruth) -> Flags:
        """Those that were lost, and those beyond the limit now."""
        return lost | (np.abs(truth.state) > LIMIT).any(axis=(-2, -1))


@dataclass(frozen=True, eq=False)
class UnknownForce:
    """What agents do not know, f + d.

    Attributes:
      plant: whose f it is.
      disturbance: amplitude N, rate rad/s and number of each agent, (agents, 3), while no fault changes it (eq. 5.31).
      faults: that change either.
    """

    plant: AgentsParameters
    disturbance: Array
    faults: Timeline

    def at(self, tick: int, motion: Array, time: float) -> Array:
        """At an instant of a tick, s, of [x, v] (..., agents, 4), to (..., agents, 2) N."""
        gain, changed = self.faults.at(DYNAMICS, tick), self.faults.at(DISTURBANCE, tick)
        now = self.disturbance if changed is None else changed
        angle = now[..., 1] * time * now[..., 2]
        pushed = now[..., :1] * np.stack([np.sin(angle), np.cos(angle)], axis=-1)
        return self.plant.unknown_force(motion, np.ones(2) if gain is None else gain) + pushed


class ConsensusEstimate(NamedTuple):
    """What each agent believes of itself."""

    learned: Learned
    unknown: Array  # f + d as it is, (trials, agents, 2) N
    known: Array  # the same as believed


@dataclass(frozen=True, eq=False)
class ConsensusFeedback:
    """Tells the agents' law their motion and what they have learned.

    Attributes:
      unknown: what acts.
      exact: the law knows f + d.
      dt: control period, s.
      estimators: of the loop, the one that learns being the first.
      source: whose motion counts: a filter's name, or `truth`; None: that of the one that learns.
    """

    unknown: UnknownForce
    exact: bool
    dt: float
    estimators: tuple[Estimator, ...] = ()
    source: str | None = None

    def __call__(self, tick: int, beliefs: tuple[Any, ...], truth: PlanarTruth, reading: Array, held: Array) -> ConsensusEstimate:
        """What each agent acts on."""
        learned: Learned = beliefs[0]
        if self.source == "truth":
            learned = learned._replace(motion=truth.state)
        for estimator, belief in zip(self.estimators, beliefs, strict=True) if self.source is not None else ():
            if self.source in estimator.names:
                learned = learned._replace(motion=estimator.summary(belief).mean[estimator.names.index(self.source)])
        unknown = self.unknown.at(tick, truth.state, tick * self.dt)
        known = unknown if self.exact else NETWORK.output(learned.weights, learned.motion)
        return ConsensusEstimate(learned, unknown, known)


@dataclass(frozen=True, eq=False)
class ConsensusLaw:
    """The terminal sliding mode law of all agents.

    Attributes:
      law: on the graph.
      scenario: whose leader is followed.
      dt: control period, s.
      user: a user's law in its place.
    """

    law: TerminalSlidingMode
    scenario: ConsensusScenario
    dt: float
    user: PlanarUserLaw | None = None

    def start(self, estimate: ConsensusEstimate) -> None:
        """Nothing is remembered."""

    def says(self, tick: int, estimate: ConsensusEstimate, memory: None) -> Array:
        """Motion of the leader and of each agent, as it believes, (trials, 1 + agents, 4)."""
        leader = np.concatenate(leader_motion(self.scenario, np.array(tick * self.dt)))
        motion = estimate.learned.motion
        return np.concatenate([np.broadcast_to(leader, (len(motion), 1, len(leader))), motion], axis=1)

    def decide(self, tick: int, estimate: ConsensusEstimate, messages: Messages, memory: None) -> Decision:
        """Force on each agent, (trials, agents, 2) N."""
        motion = estimate.learned.motion
        if self.user is not None:
            sliding = self.user.step(motion, messages, estimate.known)
        else:
            sliding = self.law.step(lumped(motion, messages.messages, messages.listening), estimate.known)
        return Decision(sliding.force, None, {"sliding": sliding})


@dataclass(frozen=True, eq=False)
class ConsensusEffectors:
    """Commands that are replaced by faults, and forces that nobody knows.

    Attributes:
      unknown: force that acts besides.
      faults: of commands, and forces from outside.
      trials: how many.
    """

    unknown: UnknownForce
    faults: Timeline
    trials: int

    def rest(self) -> ActuatorOutput:
        """No force."""
        nothing = np.zeros((self.trials, len(self.unknown.disturbance), 2))
        return ActuatorOutput(np.zeros((1, 0)), nothing, AppliedControl(nothing, nothing), None, {})

    def give(
        self, tick: int, decision: Decision, estimate: ConsensusEstimate, held: Array, before: ActuatorOutput, lost: Flags
    ) -> ActuatorOutput:
        """The force of every agent until the next tick; in a trial that is lost none acts any more."""
        sliding: Sliding = decision.notes["sliding"]
        force, constant = decision.effort, self.faults.at(SLIDING, tick)
        if constant is not None:
            without = -estimate.known - sliding.robust + constant[..., 1:]
            force = np.where(constant[..., :1] > 0.0, without, force)
        moving, outside = ~lost[:, None, None], self.faults.push(tick)
        applied = self.faults.commanded(tick, force)
        acting = applied if outside is None else applied + outside

        def push(motion: Array, instant: float) -> Array:
            return np.where(moving, self.unknown.at(tick, motion, instant) + acting, 0.0)

        return ActuatorOutput(np.zeros((1, 0)), push, AppliedControl(force, sliding.surface), None, {"force": applied})


def _channels(learns: bool, tick: int, now: Snapshot) -> dict[str, AnyArray]:
    """What is recorded of a tick, (trials, agents, ...); weights, the largest of it, in single precision and of loops that learn."""
    estimate: ConsensusEstimate = now.estimate
    weights: dict[str, AnyArray] = {"weights": estimate.learned.weights.astype(np.float32)} if learns else {}
    return weights | {
        "truth/qpos": now.truth.qpos,
        "reading": now.reading,
        "estimate": estimate.learned.motion,
        "force": now.given.notes["force"],
        "known": np.concatenate([now.given.known.force, now.given.known.surface], axis=-1),
        "unknown": estimate.unknown,
        "learned": estimate.known,
    }


def build_consensus(scenario: ConsensusScenario, name: str, trials: Trials, user_code: UserCode) -> System:
    """All parts of one loop of a scenario, for the given trial numbers."""
    settings, run = scenario.loops[name], scenario.run
    dt = settings.tick_s if isinstance(settings, Adaptive) else run.tick_s
    inner = round(run.tick_s / dt)
    parameters = scenario.plant.model_copy(update={"step_s": min(scenario.plant.step_s, dt)})
    plant = AgentsPlant(compile_agents(parameters), parameters.mass_kg, len(trials))
    graph = scenario.communication()
    losses = RandomStream(run.seed, trials, Stream.MESSAGES, (len(graph.ways),), uniform=True)
    user_law = user_code.control(surroundings(scenario))
    estimators = consensus_estimators(scenario, name, trials, user_code)
    leader, leader_rate = leader_motion(scenario, run.tick_s * np.arange(run.ticks))
    faults = schedule([scenario.faults] * len(trials), scenario.parts, run.seed, trials, run.ticks * inner, dt)
    unknown = UnknownForce(scenario.plant, scenario.parts.disturbance, faults)
    deviation = np.array([scenario.sensors.position_std_m] * 2 + [scenario.sensors.speed_std_m_s] * 2)
    return System(
        plant=plant,
        sensors=AgentsSensors(
            deviation,
            RandomStream(run.seed, trials, Stream.AGENTS_READING, (scenario.plant.agents, 4)),
            np.array([2, 2]),
            faults,
            scenario.sensors.distribution,
            RandomStream(run.seed, trials, Stream.AGENTS_TAILS, (scenario.plant.agents, 2), uniform=True),
        ),
        estimators=estimators,
        feedback=ConsensusFeedback(unknown, isinstance(settings, Exact), dt, estimators, settings.feedback),
        network=Network(graph, faults, losses, skip=False),
        law=ConsensusLaw(scenario.control.build(), scenario, dt, PlanarUserLaw(user_law) if user_law else None),
        effectors=ConsensusEffectors(unknown, faults, len(trials)),
        change=lambda tick: None,
        trials=trials,
        ticks=run.ticks * inner,
        dt=dt,
        channels=partial(_channels, not isinstance(settings, Exact | Nothing)),
        references={"leader": leader, "leader_rate": leader_rate},
        occurrences=tuple(o._replace(start_tick=o.start_tick // inner, end_tick=-(-o.end_tick // inner)) for o in faults.occurrences),
        every=inner,
        errors=Euclidean(),
        loss=FlownOff(),
    )


def leader_motion(scenario: ConsensusScenario, time: Array) -> tuple[Array, Array]:
    """Position and velocity of the leader, (..., 2) each."""
    radius, rate = scenario.leader.radius_m, scenario.leader.rate_rad_s
    cosine, sine = np.cos(rate * time), np.sin(rate * time)
    return radius * np.stack([cosine, sine], axis=-1), radius * rate * np.stack([-sine, cosine], axis=-1)


def consensus_estimators(scenario: ConsensusScenario, name: str, trials: Trials, user_code: UserCode) -> tuple[Estimator, ...]:
    """How one loop of a scenario learns, and the user's filters."""
    process, settings = PlanarAgent(NETWORK, scenario.plant.mass_kg), scenario.loops[name]
    learning = learner(name, settings, scenario.tuning, process, scenario.plant.agents, scenario.run.seed, trials)
    return (learning, *user_code.filters(surroundings(scenario)))
