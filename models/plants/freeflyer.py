"""A free-flying spacecraft with four reaction wheels: its parameters, each with its provenance, and the compilation of freeflyer.xml."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Literal, Self

import mujoco
import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from models.dynamics.rigid_body import RigidBody
from models.dynamics.state_layout import StateLayout
from models.dynamics.wheel_faults import WheelFault
from models.dynamics.wheeled_body import WheeledBody
from models.plants import inertia as mass_geometry
from models.plants.assembly import Assembly, Carrier, Prepared, assemble, prepare
from models.plants.provenance import known
from models.plants.register.kind import PlantKind
from models.plants.register.parameters import PlantParameters
from models.plants.wheels import FRICTIONS, alike, attached, check_wheel, crossed, joints_of, mount, pyramid
from models.sections import NonNegative, Positive, Sextuple

Array = NDArray[np.floating]

MJCF = Path(__file__).with_name("freeflyer.xml")
WHEELS = ("wheel_1", "wheel_2", "wheel_3", "wheel_4")

# kg m2 as [xx, yy, zz, xy, xz, yz]: the Wilkinson Microwave Anisotropy Probe (Hill et al. 2021, table I)
INERTIA_SETS: dict[str, tuple[float, ...]] = {"wmap": (399.0, 377.0, 377.0, 0.0, 0.0, 0.0)}


class FreeflyerParameters(PlantParameters):
    """Every number of the free flyer."""

    type: Literal["freeflyer"] = "freeflyer"
    inertia_kg_m2: Literal["wmap"] | Sextuple = known(
        "wmap",
        "whole with wheels locked, about its centre of mass: a named set or [xx, yy, zz, xy, xz, yz]",
        "kg m2",
        "published (Hill et al. 2021, table I)",
    )
    wheel_layout: Literal["crossed", "pyramid"] = known(
        "crossed", "spin axes: two wheels in the xy plane and two in the yz plane of B, or a pyramid", "-", "published (eq. 11)"
    )
    wheel_tilt_xy_deg: float = known(45.0, "crossed: of wheels 1 and 2 from y; a = sin, b = cos", "deg", "published (table I: 1/sqrt 2)")
    wheel_tilt_yz_deg: float = known(45.0, "crossed: of wheels 3 and 4 from y; d = sin, c = cos", "deg", "published (table I: 1/sqrt 2)")
    wheel_azimuth_deg: float = known(45.0, "pyramid: alpha", "deg", "chosen: square base")
    wheel_elevation_deg: float = known(45.0, "pyramid: beta", "deg", "chosen: usual")
    wheel_inertia_kg_m2: Positive = known(0.1, "of a wheel about its spin axis", "kg m2", "chosen: disc of 0.38 m; 20 N m s at 2000 rpm")
    wheel_transverse_inertia_kg_m2: Positive = known(0.052, "of a wheel across its spin axis", "kg m2", "chosen: that disc, 66 mm thick")
    wheel_mass_kg: Positive = known(5.5, "of a wheel", "kg", "chosen: that disc")
    wheel_torque_limit_nm: Positive = known(
        3.0,
        "of a motor",
        "N m",
        "chosen: gives 1 N m about each body axis at once, even with one wheel lost; the paper says 1 N m a wheel but limits body axes",
    )
    wheel_coulomb_nm: NonNegative = known(0.0, "dry friction of a wheel bearing", "N m", "chosen: none, as in the paper")
    wheel_viscous_nms: NonNegative = known(0.0, "viscous friction of a wheel bearing", "N m s/rad", "chosen: none, as in the paper")
    mass_kg: Positive = known(840.0, "whole", "kg", "chosen: WMAP's launch mass; no matter for attitude")
    step_s: Positive = known(
        0.05,
        "physics step (RK4)",
        "s",
        "chosen by measurement: momentum to 1e-11, attitude to 2e-9 deg over 15 min; 0.1 s: 2e-10, 1e-8 deg",
    )

    @model_validator(mode="after")
    def _something_is_left_of_the_hull(self) -> Self:
        if 4 * self.wheel_mass_kg >= self.mass_kg:
            raise ValueError(f"mass_kg = {self.mass_kg:g} must exceed that of four wheels together")
        check_wheel(self)
        return self

    @cached_property
    def inertia(self) -> Array:
        """J with wheels locked about the centre of mass, (3, 3) kg m2; physical or not."""
        chosen = self.inertia_kg_m2
        return mass_geometry.tensor(INERTIA_SETS[chosen] if isinstance(chosen, str) else chosen)

    @cached_property
    def wheel_axes(self) -> Array:
        """Spin axes in B, (3, 4): the paper's distribution matrix L."""
        if self.wheel_layout == "crossed":
            return crossed(np.radians(self.wheel_tilt_xy_deg), np.radians(self.wheel_tilt_yz_deg))
        return pyramid(np.radians(self.wheel_azimuth_deg), np.radians(self.wheel_elevation_deg))

    @property
    def torque_limit(self) -> float:
        """N m a wheel."""
        return self.wheel_torque_limit_nm

    def process(self, fault: WheelFault | None = None) -> RigidBody:
        """Analytic model in seven states; its command is the four motor torques and the four wheel speeds as read."""
        motors = (fault or WheelFault.healthy(len(WHEELS))).on_body(self.wheel_axes)
        return RigidBody(self.inertia, motors.torque_map, self.wheel_inertia_kg_m2 * self.wheel_axes, motors.constant_torque_B)

    def full_process(self, coupled: bool = False, wheel_drag: bool = False, fault: WheelFault | None = None) -> WheeledBody:
        """Analytic model in eleven states, wheel speeds among them; its command is the four motor torques."""
        return WheeledBody(
            inertia=self.inertia,
            wheel_axes=self.wheel_axes,
            wheel_inertia=self.wheel_inertia_kg_m2,
            coupled=coupled,
            wheel_coulomb=self.wheel_coulomb_nm if wheel_drag else 0.0,
            wheel_viscous=self.wheel_viscous_nms if wheel_drag else 0.0,
            fault=fault,
        )


def prepare_freeflyer(parameters: FreeflyerParameters) -> Prepared:
    """Fill freeflyer.xml with parameters.

    Raises:
      ImpossibleInertia: no rigid body has the tensor of the whole, or what is left of it for the hull.
    """
    spec = mujoco.MjSpec.from_file(str(MJCF))
    spec.option.timestep = parameters.step_s
    mount(spec, WHEELS, parameters)
    own = parameters.mass_kg - len(WHEELS) * parameters.wheel_mass_kg
    hull = Carrier("hull", own, parameters.mass_kg, *attached(spec, WHEELS, parameters), about_mass_centre=True)
    return prepare(spec, parameters, hull.reassemble, "wheels")


def compile_freeflyer(parameters: FreeflyerParameters | None = None) -> Assembly:
    """Compile the free flyer; raises ImpossibleInertia as `prepare_freeflyer` does."""
    chosen = parameters or FreeflyerParameters()
    return assemble(lambda: prepare_freeflyer(chosen), chosen, "hull", chosen.full_process(), alike(WHEELS, chosen))


PLANT_KIND = PlantKind(
    parameters=FreeflyerParameters,
    says="a free-flying spacecraft with four reaction wheels",
    compile=compile_freeflyer,
    prepare=prepare_freeflyer,
    believed=lambda parameters, _, fault: parameters.process(fault),  # wheel speeds are read, whatever slows them
    layout=lambda _: StateLayout.of_a_body(0),
    joints=lambda parameters: joints_of(WHEELS, parameters),
    dispersible=("inertia_kg_m2", "wheel_coulomb_nm", "wheel_viscous_nms"),
    effects=FRICTIONS,
)
