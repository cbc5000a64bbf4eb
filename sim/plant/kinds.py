"""The plants that a scenario can fly, as its file says them: made of the register of plants."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Union

import numpy as np
from pydantic import Field, GetCoreSchemaHandler
from pydantic_core import CoreSchema

from models.plants.assembly import Assembly
from models.plants.inertia import why_impossible
from models.plants.register.entries import KINDS, kind_of
from models.plants.register.kind import Family
from models.plants.register.parameters import BodyParameters, Parameters, SeveralParameters
from sim.faults.bodies import InertiaChange
from sim.faults.kinds import Fault


@dataclass(frozen=True)
class Registered:
    """Of an annotation: parameters of any plant of a family that is in the register, told apart by their `type`."""

    family: Family

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """The union of their classes."""
        classes = tuple(kind.parameters for kind in KINDS.values() if kind.family == self.family)
        if len(classes) == 1:
            return handler.generate_schema(classes[0])
        return handler.generate_schema(Annotated[Union[classes], Field(discriminator="type")])  # noqa: UP007


PlantSettings = Annotated[BodyParameters, Registered("body")]
FormationSettings = Annotated[SeveralParameters, Registered("formation")]


def compile_plant(plant: Parameters) -> Assembly:
    """Compile a plant's MuJoCo model; raises ImpossibleInertia."""
    return kind_of(plant).compile(plant)


def check_masses(plant: BodyParameters, faults: tuple[Fault, ...]) -> None:
    """Raise ValueError if the plant, or what a fault makes of it, is no rigid body."""
    reassemble = kind_of(plant).prepare(plant).reassemble
    for number, fault in enumerate(faults):
        if isinstance(fault, InertiaChange):
            said = f"inertia_kg_m2 = {list(fault.inertia_kg_m2)}" if fault.inertia_kg_m2 else "its inertia with add_kg_m2"
            for whole in fault.wholes(plant.inertia, plant.centre_of_mass):
                if reason := why_impossible(whole.inertia) or why_impossible(np.diag(reassemble(*whole).moments)):
                    raise ValueError(f"faults.{number} (inertia): no rigid body has {said}, {reason}")
