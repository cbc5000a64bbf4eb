"""The loop of agents that follow a leader: read, learn, command, push, record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from estimation.choice import choose
from estimation.gaussian import LostDefiniteness
from models.dynamics.chebyshev_network import ChebyshevNetwork
from models.dynamics.planar_agent import PlanarAgent
from models.plants.agents import AGENTS, compile_agents, disturbance
from sim.estimators.consensus import Acted, learner
from sim.plant.batch import SimulationFailed
from sim.plant.planar_agents import AgentsPlant
from sim.randomness import Trials, generator
from sim.scenario.consensus import Adaptive, CommandFault, ConsensusScenario, DisturbanceFault, DynamicsFault, Exact, LoopSettings

Array = NDArray[np.floating]

PUSHES = ("force", "unknown", "learned")
LOST = np.array([1e3, 1e3, 4e2, 4e2])  # m, m/s: a trial with an agent beyond that is lost; its network's polynomials would soon overflow
NETWORK = ChebyshevNetwork()


class Stream(IntEnum):
    """Purposes of random numbers of this family."""

    READING = 2000


@dataclass(frozen=True, eq=False)
class Flown:
    """What one loop left behind: arrays (ticks, trials, agents, ...), and the leader (ticks, 2).

    Channels: `truth` [x, v], `estimate` [x, v], `force` (the command), `unknown` (f + d as applied), `learned` (W phi). A trial in which
    an agent flew off is lost: from then on no force acts in it, and everything but `truth` is NaN.
    """

    dt: float
    trials: Trials
    leader: Array
    leader_rate: Array
    channels: dict[str, Array]

    @property
    def time(self) -> Array:
        """Of every tick, (ticks,) s."""
        return self.dt * np.arange(len(self.leader))

    def of(self, kept: NDArray[np.int64]) -> Flown:
        """The same of some trials, by position."""
        return Flown(self.dt, self.trials[kept], self.leader, self.leader_rate, {k: v[:, kept] for k, v in self.channels.items()})


def leader_motion(scenario: ConsensusScenario, time: Array) -> tuple[Array, Array]:
    """Position and velocity of the leader, (..., 2) each."""
    radius, rate = scenario.leader.radius_m, scenario.leader.rate_rad_s
    cosine, sine = np.cos(rate * time), np.sin(rate * time)
    return radius * np.stack([cosine, sine], axis=-1), radius * rate * np.stack([-sine, cosine], axis=-1)


def unknown_force(scenario: ConsensusScenario, motion: Array, time: float) -> Array:
    """What an agent does not know, f + d, at an instant; [x, v] (..., agents, 4) to (..., agents, 2) N."""
    gain, (amplitude, rate), numbered = np.ones(2), scenario.disturbance, True
    for fault in scenario.faults:
        if time >= fault.start_s - 1e-9:
            if isinstance(fault, DynamicsFault):
                gain = np.array(fault.gain)
            elif isinstance(fault, DisturbanceFault):
                amplitude, rate, numbered = fault.amplitude_n, fault.rate_rad_s, fault.by_agent
    pushed = disturbance(time, amplitude, rate) if numbered else amplitude * np.array([np.sin(rate * time), np.cos(rate * time)])
    return scenario.plant.unknown_force(motion, gain) + pushed


def fly(
    name: str, settings: LoopSettings, scenario: ConsensusScenario, trials: Trials, on_tick: Callable[[int], None] | None = None
) -> Flown:
    """Fly one loop, all trials together.

    Raises:
      SimulationFailed: the physics or a filter broke down; says which trial, when and why.
    """
    ticks, tick_s = scenario.run.ticks, scenario.run.tick_s
    dt = settings.tick_s if isinstance(settings, Adaptive) else tick_s
    inner = round(tick_s / dt)
    step_s = min(scenario.plant.step_s, dt)
    parameters = scenario.plant.model_copy(update={"step_s": step_s})
    plant = AgentsPlant(compile_agents(parameters), parameters.mass_kg, len(trials))
    process, law = PlanarAgent(NETWORK, parameters.mass_kg), scenario.control.build(scenario.graph.build())
    learning = learner(name, settings, scenario, process, trials)
    commanded = [fault for fault in scenario.faults if isinstance(fault, CommandFault)]
    time = tick_s * np.arange(ticks)
    leader, leader_rate = leader_motion(scenario, time)
    deviation = np.array([scenario.sensors.position_std_m] * 2 + [scenario.sensors.speed_std_m_s] * 2)
    sources = [generator(scenario.run.seed, int(trial), Stream.READING) for trial in trials]
    shape = (ticks, len(trials), AGENTS)
    channels = {key: np.full((*shape, size), np.nan) for key, size in (("truth", 4), ("estimate", 4), *((k, 2) for k in PUSHES))}

    acted = Acted(np.zeros((len(trials), AGENTS, 2)), np.zeros((len(trials), AGENTS, 2)))
    learned, first, lost = None, None, np.zeros(len(trials), dtype=bool)
    for k in range(ticks * inner):
        now = k * dt
        truth: Array = plant.motion()
        reading = truth + deviation * np.stack([source.standard_normal((AGENTS, 4)) for source in sources])
        lost = lost | (np.abs(truth) > LOST).any(axis=(-2, -1))
        if lost.any() and first is not None:  # what the learner of a lost trial does is of no interest, but must not fail
            learned, reading = choose(lost, first, learned), choose(lost, first.motion, reading)
            acted = choose(lost, Acted(np.zeros_like(acted.force), np.zeros_like(acted.surface)), acted)
        try:
            learned = learning.start(reading) if learned is None else learning.step(learned, acted, reading, dt)
            first = first or learned
        except LostDefiniteness as failure:
            trial, agent = failure.where[:2]
            raise SimulationFailed(int(trials[trial]), now, f"{name}: the {failure.what} of agent {agent + 1} lost definiteness") from None
        place, speed = leader_motion(scenario, np.array(now))
        unknown = unknown_force(scenario, truth, now)
        known = unknown if isinstance(settings, Exact) else NETWORK.output(learned.weights, learned.motion)
        sliding = law.step(learned.motion[..., :2] - place, learned.motion[..., 2:] - speed, known)
        force = sliding.force
        for fault in commanded:
            if fault.start_s - 1e-9 <= now < fault.end_s - 1e-9:
                force = -known - sliding.robust + fault.constant_n
        acted = Acted(force, sliding.surface)
        if k % inner == 0:
            row = k // inner
            for key, value in zip(channels, (truth, learned.motion, force, unknown, known), strict=True):
                channels[key][row] = value if key == "truth" else choose(lost, np.full_like(value, np.nan), value)
            if on_tick:
                on_tick(row)
        moving = ~lost[:, None, None]

        def push(motion: Array, instant: float, held: Array = force, moving: NDArray[np.bool_] = moving) -> Array:
            return np.where(moving, unknown_force(scenario, motion, instant) + held, 0.0)

        plant.slide(push, round(dt / step_s))
    return Flown(tick_s, trials, leader, leader_rate, channels)
