"""Readings of position and velocity of agents in the plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.formation_randomness import Blocks
from sim.plant.planar_agents import PlanarTruth

Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class PlanarSensors:
    """Every agent reads its own position and velocity at every tick.

    Attributes:
      deviation: of [x, v], (4,) m, m/s.
      noise: standard normal, (trials, agents, 4) a tick.
    """

    deviation: Array
    noise: Blocks

    def rest(self) -> Array:
        """Zero until something has been read, (trials, agents, 4)."""
        return np.zeros((len(self.noise.trials), *self.noise.shape))

    def read(self, tick: int, truth: PlanarTruth, past: Array) -> Array:  # noqa: ARG002
        """Reading of [x, v], (trials, agents, 4)."""
        return truth.state + self.deviation * self.noise.tick()
