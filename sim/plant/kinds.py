"""The plants that a scenario can fly, as its file says them: made of the register of plants."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Union

import numpy as np
from numpy.typing import NDArray
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


Array = NDArray[np.floating]

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


def tilt_deg(q_BN: Array) -> Array:
    """Angle between z of B and z of N, the vertical; (..., 4) to (...)."""
    return np.degrees(2.0 * np.arcsin(np.clip(np.hypot(q_BN[..., 0], q_BN[..., 1]), 0.0, 1.0)))


def check_tilt(plant: Parameters, q_BN: Array, what: str) -> None:
    """Raise ValueError if attitudes (..., 4) lie beyond a plant's stop."""
    limit = kind_of(plant).tilt_limit_deg
    if limit is not None and (greatest := float(np.max(tilt_deg(q_BN)))) > limit:
        raise ValueError(f"{what}: is tilted by {greatest:.4g} deg, and the stop is at {limit:g} deg")


def check_speeds(plant: Parameters, speeds: tuple[float, ...], what: str) -> None:
    """Raise ValueError if wheels turn faster at the start than their drives can make them."""
    no_load_speed = kind_of(plant).no_load_speed
    if no_load_speed is not None and (greatest := max(map(abs, speeds))) > no_load_speed(plant):
        raise ValueError(f"{what}: {greatest:g} rad/s is beyond the no-load speed of the drives, {no_load_speed(plant):.4g} rad/s")


def beyond_wheels(plant: BodyParameters, rates_B: Array, what: str) -> list[str]:
    """A line if a body's wheels cannot hold what it would have at rates (..., 3) rad/s in B, shared as evenly as squares add up least."""
    wheel_momentum = kind_of(plant).wheel_momentum
    if wheel_momentum is None:
        return []
    shares = np.abs(rates_B @ plant.inertia @ np.linalg.pinv(plant.wheel_axes).T)  # N m s
    greatest, held = float(np.max(shares)), wheel_momentum(plant)
    if greatest <= held:
        return []
    return [f"{what}: stopping it, or making it turn so, asks {greatest:.3g} N m s of a wheel, which holds {held:.3g}; nothing can follow"]


def filled(plant: Parameters, duration_s: float) -> list[str]:
    """A line if a run is so long that outer torques fill the wheels."""
    after = kind_of(plant).filled_s(plant)
    if duration_s <= after:
        return []
    return [
        f"run: lasts {duration_s:g} s, and after about {after:.0f} s gravity on the centre of mass (plant.centre_of_mass_um) has filled the"
        " wheels: from then on every metric is that of wheels at their limit"
    ]
