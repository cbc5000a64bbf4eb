"""A monolithic spacecraft without wheels, turned by torques on its body: its parameters, with provenance, and its compilation."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from models.dynamics.rigid_body import RigidBody
from models.dynamics.state_layout import StateLayout
from models.plants import inertia as mass_geometry
from models.plants.assembly import Assembly, MassProperties, Prepared, assemble, prepare
from models.plants.provenance import known
from models.plants.register.kind import PlantKind
from models.plants.register.parameters import PlantParameters
from models.sections import Positive, Sextuple

Array = NDArray[np.floating]

MJCF = Path(__file__).with_name("monolithic.xml")

# kg m2 as [xx, yy, zz, xy, xz, yz] (Rososhansky 2017, sec. 3.3): of the spacecraft, and what its filters and its control law believe
INERTIA_SETS: dict[str, tuple[float, ...]] = {
    "true": (20.0, 17.0, 15.0, 1.2, 0.9, 1.4),
    "believed": (20.0, 17.0, 15.0, 0.0, 0.0, 0.0),
}


class MonolithicParameters(PlantParameters):
    """Every number of the spacecraft."""

    type: Literal["monolithic"] = "monolithic"
    inertia_kg_m2: Literal["true", "believed"] | Sextuple = known(
        "true",
        "about the centre of mass: a named set or [xx, yy, zz, xy, xz, yz]",
        "kg m2",
        "published (Rososhansky 2017, sec. 3.3, after Wong 2001)",
    )
    believed_inertia_kg_m2: Literal["true", "believed"] | Sextuple = known(
        "believed",
        "what filters and control law take it for, whatever happens to it",
        "kg m2",
        "published (sec. 3.3): without products",
    )
    mass_kg: Positive = known(95.0, "whole", "kg", "chosen: bus of 0.7 x 0.8 x 0.9 m with wings of that inertia; no matter for attitude")
    step_s: Positive = known(0.01, "physics step (RK4)", "s", "published (sec. 3.3): its integration step")

    @cached_property
    def inertia(self) -> Array:
        """J about the centre of mass, (3, 3) kg m2; physical or not."""
        return _tensor(self.inertia_kg_m2)

    @cached_property
    def believed_inertia(self) -> Array:
        """J_m of filters and control law, (3, 3) kg m2."""
        return _tensor(self.believed_inertia_kg_m2)

    def process(self, believed: bool = False) -> RigidBody:
        """Analytic model in seven states, true or as believed; its command is the torque on the body, (..., 3) N m in B."""
        return RigidBody(self.believed_inertia if believed else self.inertia, np.eye(3), self.wheel_axes)


def _tensor(chosen: str | Sextuple) -> Array:
    return mass_geometry.tensor(INERTIA_SETS[chosen] if isinstance(chosen, str) else chosen)


def prepare_monolithic(parameters: MonolithicParameters) -> Prepared:
    """Fill monolithic.xml with parameters.

    Raises:
      ImpossibleInertia: no rigid body has the tensor.
    """
    spec = mujoco.MjSpec.from_file(str(MJCF))
    spec.option.timestep = parameters.step_s

    def reassemble(inertia: Array, centre_of_mass: Array) -> MassProperties:
        moments, axes = mass_geometry.principal(inertia)
        position = np.asarray(centre_of_mass, dtype=float)
        return MassProperties("hull", np.full(position.shape[:-1], parameters.mass_kg), position, moments, axes)

    return prepare(spec, parameters, reassemble)


def compile_monolithic(parameters: MonolithicParameters | None = None) -> Assembly:
    """Compile the spacecraft; raises ImpossibleInertia as `prepare_monolithic` does."""
    chosen = parameters or MonolithicParameters()
    return assemble(lambda: prepare_monolithic(chosen), chosen, "hull", chosen.process())


PLANT_KIND = PlantKind(
    parameters=MonolithicParameters,
    says="a rigid spacecraft without wheels under torques on its body",
    compile=compile_monolithic,
    prepare=prepare_monolithic,
    believed=lambda parameters, *_: parameters.process(believed=True),
    layout=lambda _: StateLayout.of_a_body(0),
    believed_inertia=lambda parameters: parameters.believed_inertia,
    dispersible=("inertia_kg_m2",),
)
