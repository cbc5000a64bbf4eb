"""How several agents move in one loop of a scenario: their poses tick by tick, for a viewer."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.plants.agents import compile_agents as compile_planar
from models.plants.assembly import Assembly
from sim.loop import consensus as consensus_loop
from sim.loop import formation as formation_loop
from sim.plant.formation import compile_agents, formation_plant
from sim.scenario.consensus import ConsensusScenario
from sim.scenario.formation import FormationScenario

Array = NDArray[np.floating]

FIRST = np.zeros(1, dtype=np.int64)  # the trial that is shown


class Motion(NamedTuple):
    """What a viewer needs."""

    scene: Any  # MuJoCo model with everything that a person looks at
    qpos: Array  # (ticks, nq)
    dt: float  # s a tick


def motion(scenario: FormationScenario | ConsensusScenario, loop: str) -> Motion:
    """Fly one loop of the first trial.

    Raises:
      SimulationFailed: with trial, time and cause.
    """
    if isinstance(scenario, ConsensusScenario):
        planar = compile_planar(scenario.plant)
        truth = consensus_loop.fly(loop, scenario.loops[loop], scenario, FIRST).channels["truth"][:, 0]
        return Motion(planar.scene, truth[..., :2].reshape(len(truth), -1), scenario.run.tick_s)
    assembly = compile_agents(scenario.plant)
    channels = formation_loop.fly(scenario, loop, assembly, FIRST, FIRST).channels
    poses = channels["qpos"][:, 0] if "qpos" in channels else _turned(scenario, assembly, channels["q_BN"][:, 0])
    return Motion(assembly.scene, poses, scenario.run.tick_s)


def _turned(scenario: FormationScenario, assembly: Assembly, q_BN: Array) -> Array:
    """Poses of agents in their places, of whom only the attitudes (ticks, agents, 4) are known; the plant knows MuJoCo's order."""
    plant = formation_plant(scenario.plant, assembly, 1)
    poses = np.empty((len(q_BN), assembly.model.nq))
    for tick, attitudes in enumerate(q_BN):
        plant.start(attitudes, np.zeros(3), np.zeros(()))
        poses[tick] = plant.truth().qpos[0]
    return poses
