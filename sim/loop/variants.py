"""Trials that are not alike: plant, sensors, faults and start of each, while filters and controllers believe in the scenario's own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.plants.register.entries import kind_of
from models.plants.register.kind import Joint
from models.plants.register.parameters import BodyParameters
from sim.faults.kinds import Fault
from sim.plant.batch import Dispersion
from sim.scenario.one_body import Scenario, StartSettings
from sim.sensors.sensors import SensorSettings


class Variants(NamedTuple):
    """One entry a trial."""

    plants: Sequence[BodyParameters]
    sensors: Sequence[SensorSettings]
    faults: Sequence[tuple[Fault, ...]]
    starts: Sequence[StartSettings]

    @classmethod
    def alike(cls, scenario: Scenario, trials: int) -> Variants:
        """All as the scenario says."""
        return cls([scenario.plant] * trials, [scenario.sensors] * trials, [scenario.faults] * trials, [scenario.start] * trials)

    def only(self, positions: NDArray[np.int64]) -> Variants:
        """Some of the trials."""
        chosen = [int(i) for i in positions]
        return Variants(
            [self.plants[i] for i in chosen],
            [self.sensors[i] for i in chosen],
            [self.faults[i] for i in chosen],
            [self.starts[i] for i in chosen],
        )

    def dispersion(self, compiled: BodyParameters) -> Dispersion | None:
        """What the plant must be told, or None if all trials have the plant that was compiled."""
        if all(plant is compiled for plant in self.plants):
            return None
        joints = kind_of(compiled).joints
        each = [joints(plant) for plant in self.plants]
        return Dispersion(
            inertia=np.stack([plant.inertia for plant in self.plants]),
            centre_of_mass=np.stack([plant.centre_of_mass for plant in self.plants]),
            joints={name: _of_trials([own[name] for own in each]) for name in each[0]},
        )

    def of_loop(self, single: Scenario) -> Variants:
        """The same trials in one of several loops, which may be spared the faults."""
        return self if single.faults else self._replace(faults=[()] * len(self.faults))


def _of_trials(joints: Sequence[Joint]) -> Joint:
    """What resists in a joint, an entry a trial."""
    return Joint(*(None if part[0] is None else np.array(part, dtype=float) for part in zip(*joints, strict=True)))
