"""Trials that are not alike: plant, sensors, faults and start of each, while filters and controllers believe in the scenario's own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.faults.kinds import Fault
from sim.plant.batch import Dispersion
from sim.plant.kinds import Parameters
from sim.scenario.one_body import Scenario, StartSettings
from sim.sensors.sensors import SensorSettings

Array = NDArray[np.floating]

# parameters of the plant that can differ from trial to trial in one batch; the others are part of the compiled model
DISPERSIBLE = (
    "inertia_kg_m2",
    "centre_of_mass_um",
    "balance_position_mm",
    "wheel_coulomb_nm",
    "wheel_viscous_nms",
    "bearing_viscous_nms",
    "drive_torque_noise_nm",
    "air_torque_nm",
    "air_torque_correlation_s",
)


class Variants(NamedTuple):
    """One entry a trial."""

    plants: Sequence[Parameters]
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

    def plant_values(self, name: str) -> Array:
        """A parameter of all trials' plants, (trials, ...)."""
        return np.array([getattr(plant, name) for plant in self.plants], dtype=float)

    def dispersion(self, compiled: Parameters) -> Dispersion | None:
        """What the plant must be told, or None if all trials have the plant that was compiled."""
        if all(plant is compiled for plant in self.plants):
            return None
        return Dispersion(
            inertia=np.stack([plant.inertia for plant in self.plants]),
            centre_of_mass=1e-6 * self.plant_values("centre_of_mass_um"),
            wheel_coulomb=self.plant_values("wheel_coulomb_nm"),
            wheel_viscous=self.plant_values("wheel_viscous_nms"),
            bearing_viscous=self.plant_values("bearing_viscous_nms"),
        )
