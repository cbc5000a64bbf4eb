"""Readings of the attitudes of several agents, by modified Rodrigues parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.faults.formation import FormationFaults
from sim.formation_randomness import Blocks
from sim.plant.formation import AgentsTruth

Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class RodriguesSensors:
    """White noise and bias on each component of sigma; no rate is read.

    Attributes:
      faults: that change them.
      noise: standard normal, (trials, agents, 3) a tick.
    """

    faults: FormationFaults
    noise: Blocks

    def rest(self) -> Array:
        """Zero until something has been read, (trials, agents, 3)."""
        return np.zeros((len(self.noise.trials), *self.noise.shape))

    def read(self, tick: int, truth: AgentsTruth, past: Array) -> Array:  # noqa: ARG002
        """Reading of sigma, (trials, agents, 3)."""
        return truth.state[..., :3] + self.faults.bias[tick] + self.faults.deviation[tick] * self.noise.tick()
