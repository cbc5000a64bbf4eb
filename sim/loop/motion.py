"""How a plant moves in one loop of a scenario: its poses tick by tick, for a viewer."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.loop.build import build
from sim.loop.closed_loop import run_whole
from sim.scenario.files import AnyScenario

FIRST = np.zeros(1, dtype=np.int64)  # the trial that is shown


class Motion(NamedTuple):
    """What a window needs of a flight that is over."""

    scene: Any  # MuJoCo model with everything that a person looks at
    qpos: NDArray[np.floating]  # (ticks, nq)
    dt: float  # s a tick


def motion(scenario: AnyScenario, loop: str) -> Motion:
    """Fly one loop of the first trial.

    Raises:
      SimulationFailed: with trial, time and cause.
    """
    system = build(scenario, FIRST, loop=loop)
    return Motion(system.plant.assembly.scene, run_whole(system).channels["truth/qpos"][:, 0], scenario.run.tick_s)
