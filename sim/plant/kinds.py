"""The plants that a scenario can fly: each kind's settings, and its compilation."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from models.plants.assembly import Assembly, Prepared
from models.plants.flexible import compile_flexible, prepare_flexible
from models.plants.flexible_parameters import FlexibleParameters
from models.plants.freeflyer import FreeflyerParameters, compile_freeflyer, prepare_freeflyer
from models.plants.inertia import why_impossible
from models.plants.monolithic import MonolithicParameters, compile_monolithic, prepare_monolithic
from models.plants.nacs import NacsParameters, compile_nacs, prepare_nacs
from sim.faults.kinds import Fault, InertiaChange


class NacsPlant(NacsParameters):
    """The air-bearing testbed; every parameter of models/plants/nacs.py is a key."""

    type: Literal["nacs"]


class FreeflyerPlant(FreeflyerParameters):
    """A free-flying spacecraft with four wheels; every parameter of models/plants/freeflyer.py is a key."""

    type: Literal["freeflyer"]


class FlexiblePlant(FlexibleParameters):
    """A spacecraft with two sprung panels; every parameter of models/plants/flexible_parameters.py is a key."""

    type: Literal["flexible"]


class MonolithicPlant(MonolithicParameters):
    """A spacecraft without wheels under torques on its body; every parameter of models/plants/monolithic.py is a key."""

    type: Literal["monolithic"]


Parameters = NacsParameters | FreeflyerParameters | FlexibleParameters | MonolithicParameters
PlantSettings = Annotated[NacsPlant | FreeflyerPlant | FlexiblePlant | MonolithicPlant, Field(discriminator="type")]


def compile_plant(plant: Parameters) -> Assembly:
    """Compile a plant's MuJoCo model; raises ImpossibleInertia."""
    match plant:
        case NacsParameters():
            return compile_nacs(plant)
        case FreeflyerParameters():
            return compile_freeflyer(plant)
        case FlexibleParameters():
            return compile_flexible(plant)
        case MonolithicParameters():
            return compile_monolithic(plant)


def prepare_plant(plant: Parameters) -> Prepared:
    """A plant's specification, not yet compiled; raises ImpossibleInertia."""
    match plant:
        case NacsParameters():
            return prepare_nacs(plant)
        case FreeflyerParameters():
            return prepare_freeflyer(plant)
        case FlexibleParameters():
            return prepare_flexible(plant)
        case MonolithicParameters():
            return prepare_monolithic(plant)


def complain_of_masses(plant: Parameters, faults: tuple[Fault, ...]) -> None:
    """Raise ValueError if the plant, or what a fault makes of it, is no rigid body."""
    reassemble = prepare_plant(plant).reassemble
    for number, fault in enumerate(faults):
        if isinstance(fault, InertiaChange):
            whole, bus = fault.properties.inertia, np.diag(reassemble(*fault.properties).moments)
            if reason := why_impossible(whole) or why_impossible(bus):
                raise ValueError(f"faults.{number} (inertia): no rigid body has inertia_kg_m2 = {list(fault.inertia_kg_m2)}, {reason}")
