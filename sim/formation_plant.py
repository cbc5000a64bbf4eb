"""The plant of a formation: several free bodies in one world, whose inertias may change."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from models.assembly import Assembly
from sim.plant import Plant

Array = NDArray[np.floating]


class FormationPlant(Plant):
    """Trials of a formation; truth has axes (trials, agents, ...)."""

    def __init__(self, assembly: Assembly, trials: int, threads: int = 1) -> None:
        super().__init__(assembly, trials, threads)
        self.inertia = np.tile(assembly.inertia, (trials, 1, 1, 1))
        self.centre_of_mass = np.tile(assembly.centre_of_mass, (trials, 1, 1))
        joints = [assembly.model.joint(name) for name in assembly.attitude_joints]
        self._bodies = np.array([int(joint.bodyid[0]) for joint in joints])

    def set_inertias(self, inertia: Array) -> None:
        """Give the agents other inertias, (agents, 3, 3) kg m2, in all trials; rates are kept."""
        properties = self.assembly.reassemble(inertia, np.zeros((len(inertia), 3)))
        for field, value in (("body_inertia", properties.moments), ("body_iquat", properties.axes)):
            self._batch.expand(field)[:, self._bodies] = value
        self._batch.set_const(np.arange(self.trials))
