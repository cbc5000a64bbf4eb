"""The plant of the agents: forces that depend on their motion, evaluated anew for every physics step."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.plants.assembly import Assembly
from sim.plant.batch import Plant

Array = NDArray[np.floating]


class PlanarTruth(NamedTuple):
    """What is so of agents in the plane, at one instant."""

    time: float  # s
    state: Array  # [x, v], (trials, agents, 4) m, m/s
    qpos: Array  # (trials, nq) MuJoCo's own state
    qvel: Array  # (trials, nv)


class AgentsPlant(Plant):
    """Trials of several agents; all their joints slide, so that generalised forces are forces."""

    def __init__(self, assembly: Assembly, mass: float, trials: int) -> None:
        super().__init__(assembly, trials)
        self._mass = mass
        self._place, self._speed = self._batch.bind("qpos"), self._batch.bind("qvel")
        self._force = self._batch.bind("qfrc_applied")

    def motion(self) -> Array:
        """[x, v] of every agent, (trials, agents, 4)."""
        place, speed = (part.reshape(self.trials, -1, 2) for part in (self._place, self._speed))
        return np.concatenate([place, speed], axis=-1)

    def truth(self) -> PlanarTruth:  # type: ignore[override]
        """The present state."""
        return PlanarTruth(self._steps_done * self.step_s, self.motion(), self._place.copy(), self._speed.copy())

    def advance(  # type: ignore[override]
        self,
        wheel_torque: Array,  # noqa: ARG002
        force: Callable[[Array, float], Array],
        steps: int,
    ) -> None:
        """Advance by whole physics steps.

        MuJoCo holds an applied force over its step, so the force is that of the middle of the step, where it is second order accurate;
        the motion until there is extrapolated.

        Args:
          wheel_torque: of no wheels, (trials, 0).
          force: of [x, v] (trials, agents, 4) and time, s, to (trials, agents, 2) N.
          steps: physics steps.

        Raises:
          SimulationFailed: MuJoCo raised, warned, or produced a number that is not finite.
        """
        half, causes, start = 0.5 * self.step_s, dict[int, str](), self._steps_done * self.step_s
        for _ in range(steps):
            time = self._steps_done * self.step_s
            motion = self.motion()
            speed = motion[..., 2:] + half / self._mass * force(motion, time)
            middle = np.concatenate([motion[..., :2] + half * motion[..., 2:], speed], axis=-1)
            self._force[:] = force(middle, time + half).reshape(self.trials, -1)
            found = self._step(1)
            self._steps_done += 1
            if found:  # the others still have the rest of the steps to go
                causes = found | causes
                self.put_back(np.isin(np.arange(self.trials), list(found)))
        self._raise(causes, start)
