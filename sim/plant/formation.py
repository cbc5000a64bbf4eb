"""The plants of a formation: several bodies in one world, free or on air bearings, whose inertias may change."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.attitude import modified_rodrigues
from models.plants.assembly import Assembly
from sim.plant.batch import Plant

Array = NDArray[np.floating]


class AgentsTruth(NamedTuple):
    """What is so of several bodies, at one instant."""

    time: float  # s
    q_BN: Array  # (trials, agents, 4) scalar last
    omega_BN_B: Array  # (trials, agents, 3) rad/s
    omega_wheel: Array  # (trials, agents wheels) rad/s, relative to the bodies
    qpos: Array  # (trials, nq) MuJoCo's own state
    qvel: Array  # (trials, nv)
    state: Array  # [sigma, its rate] in the set that each has turned to, (trials, agents, 6)


class FormationPlant(Plant):
    """Trials of a formation; truth has axes (trials, agents, ...), but its wheels' (trials, agents wheels)."""

    def __init__(self, assembly: Assembly, trials: int, threads: int = 1) -> None:
        super().__init__(assembly, trials, threads)
        self.inertia = np.tile(assembly.inertia, (trials, 1, 1, 1))
        self.centre_of_mass = np.tile(assembly.centre_of_mass, (trials, 1, 1))
        joints = [assembly.model.joint(name) for name in assembly.attitude_joints]
        self._bodies = np.array([int(joint.bodyid[0]) for joint in joints])

    def truth(self) -> AgentsTruth:  # type: ignore[override]
        """The present state."""
        plain = super().truth()
        sigma = modified_rodrigues.from_quaternion(plain.q_BN)
        state = np.concatenate([sigma, modified_rodrigues.rate(sigma, plain.omega_BN_B)], axis=-1)
        return AgentsTruth(*plain, state)

    def set_inertias(self, inertia: Array) -> None:
        """Give the agents other inertias, ([trials,] agents, 3, 3) kg m2; rates and centres of mass are kept."""
        self.set_masses(inertia, self.assembly.centre_of_mass)

    def set_masses(self, inertia: Array, centre_of_mass: Array) -> None:
        """Give the agents other inertias, ([trials,] agents, 3, 3) kg m2, and centres of mass, (..., 3) m; rates are kept."""
        properties = self.assembly.reassemble(inertia, centre_of_mass)
        for field, value in (
            ("body_mass", properties.mass),
            ("body_ipos", properties.centre_of_mass),
            ("body_inertia", properties.moments),
            ("body_iquat", properties.axes),
        ):
            self._batch.expand(field)[:, self._bodies] = value
        self._batch.set_const(np.arange(self.trials))
