"""Filters without a rate gyro and those of agents: what a step costs for one of many, and what of it is the model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.measure import cpu_seconds, interleave, one_core
from benchmarks.show import figure, table
from estimation.adaptive_unscented import AdaptiveUnscentedFilter
from estimation.fading import StrongTracking
from estimation.particle import Draws, ParticleFilter
from estimation.proposals import MatchedNoise
from estimation.unscented import UnscentedFilter
from models.attitude.quaternion import IDENTITY, normalize
from models.dynamics.planar_agent import PlanarAgent
from models.dynamics.process import runge_kutta
from models.plants.agents import AgentsParameters
from models.plants.monolithic import MonolithicParameters
from sim.estimators.consensus import AppliedControl, learner
from sim.estimators.formation import agents_filter
from sim.loop.consensus import NETWORK
from sim.scenario.files import load

Array = NDArray[np.floating]
Steps = Callable[[], object]

ROUNDS = 5
STEPS = 8
AGENTS = AgentsParameters().agents
TRIALS = 64
TICK_S = 0.01
NOISE = MatchedNoise()
PROCESS = MonolithicParameters().process()
READ = np.diag([1e-8] * 4 + [1.0] * 3)
PRIOR, VARIANCE = np.concatenate([IDENTITY, np.zeros(3)]), np.array([1e-8] * 4 + [1e-2] * 3)


def attitudes(random: np.random.Generator, trials: int) -> Array:
    """Readings of a body at rest whose rate is not read, (trials, 7)."""
    noisy = normalize(IDENTITY + 1e-4 * random.standard_normal((trials, 4)))
    return np.concatenate([noisy, np.full((trials, 3), np.nan)], axis=-1)


def unscented(random: np.random.Generator, trials: int) -> Steps:
    """Adaptive unscented filter of a rigid body, seven states."""
    filter_ = AdaptiveUnscentedFilter(UnscentedFilter(PROCESS, np.eye(7), READ, PRIOR, VARIANCE, alpha=0.1), NOISE, StrongTracking())
    readings = [attitudes(random, trials) for _ in range(STEPS)]
    start, command = filter_.initial(readings[0]), np.zeros((trials, 3))
    return partial(_again, start, [partial(_step, filter_.step, command, reading) for reading in readings])


def particle(random: np.random.Generator, particles: int) -> tuple[Steps, Steps, Steps]:
    """Particle filter of the same body, optimal density; the model at its particles; the random numbers that it needs."""
    filter_ = ParticleFilter(PROCESS, NOISE, READ, PRIOR, VARIANCE, particles=particles)
    readings = [attitudes(random, TRIALS) for _ in range(STEPS)]

    def draw() -> Draws:
        return Draws(random.standard_normal((TRIALS, particles, filter_.size)), random.random((TRIALS, particles)))

    draws, command = [draw() for _ in readings], np.zeros((TRIALS, 3))
    start = filter_.initial(readings[0], draws[0])
    work = [partial(_step, filter_.step, command, reading, drawn) for reading, drawn in zip(readings, draws, strict=True)]
    for _ in range(5):  # until as many trials resample as usual
        start = _again(start, work)
    model = partial(runge_kutta, PROCESS, start.particles, command[:, None], TICK_S)
    return partial(_again, start, work), partial(_times, model), partial(_times, draw)


def formation(name: str, random: np.random.Generator) -> Steps:
    """A filter of six spacecraft in formation, six states each."""
    scenario: Any = load("formation/fault-free", {})
    filter_ = agents_filter(name, scenario.observers[name], scenario.plant, 1, np.arange(TRIALS))
    readings = scenario.starts + 1e-4 * random.standard_normal((STEPS, TRIALS, AGENTS, 3))
    torque = np.zeros((TRIALS, AGENTS, 3))
    start = filter_.initial(readings[0])

    def go() -> None:
        watched = start
        for reading in readings:
            watched = filter_.step(watched, torque, reading, TICK_S)

    return go


def consensus(name: str, random: np.random.Generator) -> Steps:
    """A learner of six agents in the plane: four states and twenty-six weights each."""
    scenario: Any = load("consensus/fault-free", {})
    learning = learner(name, scenario.loops[name], scenario.tuning, PlanarAgent(NETWORK, 1.0), AGENTS, 1, np.arange(TRIALS))
    readings = random.uniform(-1.0, 1.0, (TRIALS, AGENTS, 4)) + 1e-4 * random.standard_normal((STEPS, TRIALS, AGENTS, 4))
    acted = AppliedControl(np.zeros((TRIALS, AGENTS, 2)), np.zeros((TRIALS, AGENTS, 2)))
    start = learning.initial(readings[0])

    def go() -> None:
        learned = start
        for reading in readings:
            learned = learning.step(learned, acted, reading, TICK_S)

    return go


def _step(step: Callable[..., Any], command: Array, reading: Array, *drawn: Draws, belief: Any) -> Any:
    return step(belief, command, reading, TICK_S, *drawn)


def _again(belief: Any, work: Sequence[Callable[..., Any]]) -> Any:
    for step in work:
        belief = step(belief=belief)
    return belief


def _times(work: Steps) -> None:
    for _ in range(STEPS):
        work()


def particles() -> None:
    """Print the table."""
    random = np.random.default_rng(1)
    few, many = particle(random, 100), particle(random, 1000)
    rows: list[tuple[str, Steps, int]] = [
        ("AUKF, 7 states", unscented(random, TRIALS), 1),
        ("AUKF, 7 states, 384 trials", unscented(random, AGENTS * TRIALS), AGENTS),
        ("particle filter, 7 states, 100 particles", few[0], 1),
        ("  of it the model", few[1], 1),
        ("  besides, its random numbers", few[2], 1),
        ("particle filter, 7 states, 1000 particles", many[0], 1),
        ("  of it the model, if not in blocks", many[1], 1),
        ("  besides, its random numbers", many[2], 1),
        ("formation: AUKF, 6 states", formation("aukf", random), AGENTS),
        ("formation: particle filter, 100 particles", formation("pf", random), AGENTS),
        ("consensus: AUKF, 30 states", consensus("aukf", random), AGENTS),
        ("consensus: mupf-b, 100 particles on the state", consensus("mupf-b", random), AGENTS),
        ("consensus: mupf-a, 100 particles on the weights", consensus("mupf-a", random), AGENTS),
    ]
    with one_core():
        taken = interleave(ROUNDS, [partial(cpu_seconds, steps) for _, steps, _ in rows])
    cells = []
    for (name, _, agents), seconds in zip(rows, taken, strict=True):
        scale = 1e6 / (STEPS * TRIALS * agents)
        cells.append((name, figure(scale * min(seconds)), figure(scale * median(seconds))))
    table(
        f"Filters without a rate gyro and of agents, {TRIALS} trials: us a step of one agent",
        ("", "least", "median"),
        cells,
        f"CPU time on one core, of {ROUNDS} interleaved rounds of {STEPS} steps. The body's attitude alone is read; optimal density, "
        f"systematic resampling. Formations and consensus are of {AGENTS} agents; their particle filters draw their random numbers within.",
    )


if __name__ == "__main__":
    particles()
