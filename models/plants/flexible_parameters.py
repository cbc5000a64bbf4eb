"""Parameters of a spacecraft with two sprung panels and four reaction wheels, each with its provenance, and what follows from them."""

from __future__ import annotations

from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from models.dynamics.rigid_body import RigidBody
from models.dynamics.wheel_faults import WheelFault
from models.plants import inertia as mass_geometry
from models.plants.appendage import FlexibleChannel
from models.plants.provenance import known
from models.plants.register.parameters import PlantParameters
from models.plants.wheels import check_wheel, pyramid
from models.sections import NonNegative, Positive, Sextuple

Array = NDArray[np.floating]

_STEP_RAD = 0.1  # of the mode's phase: RK4 takes 1.4e-7 of a ringing's energy per radian

# What differs from boeing702, which is the default of every field.
FLEXIBLE_SETS: dict[str, dict[str, Any]] = {
    "boeing702": {},
    "panelsat": {
        "look": "cubesat",
        "inertia_kg_m2": (0.036, 0.03624, 0.02224, 0.0, 0.0, 0.0),
        "mass_kg": 3.7,
        "panel_mass_kg": 0.1,
        "panel_length_m": 0.3,
        "panel_width_m": 0.12,
        "hinge_offset_m": 0.1,
        "panel_spring_nm_rad": 0.0145,
        "wheel_inertia_kg_m2": 1e-5,
        "wheel_transverse_inertia_kg_m2": 5.4e-6,
        "wheel_mass_kg": 0.05,
        "wheel_torque_limit_nm": 0.01,
        "step_s": 0.002,
    },
}


class FlexibleParameters(PlantParameters):
    """Every number of the flexible spacecraft, of a named set unless given.

    Azimuth is about z of B, along the panels, and elevation about x, along their hinges. Panels along y would not do: whatever its shape, a
    mode with coupling 0.5 to 15 000 kg m2 takes 7500 kg m2 of panels about x, and those along y have as much about z, more than 6000.
    """

    type: Literal["flexible"] = "flexible"
    set: Literal["boeing702", "panelsat"] = known(
        "boeing702",
        "named set that gives whatever is not given",
        "-",
        "chosen: after the satellite of Tsao et al.; one of a testbed's size",
    )
    look: Literal["comsat", "cubesat"] = known("comsat", "what is drawn", "-", "chosen: as the set")
    inertia_kg_m2: Sextuple = known(
        (15000.0, 14000.0, 6000.0, 0.0, 0.0, 0.0),
        "whole with panels and wheels locked, about its centre of mass: [xx, yy, zz, xy, xz, yz]",
        "kg m2",
        "chosen: of a communication satellite; panelsat: a hub of 0.022 about each axis, and panels",
    )
    mass_kg: Positive = known(3500.0, "whole", "kg", "chosen: of a communication satellite; no matter for attitude")
    panel_mass_kg: Positive = known(50.0, "of a panel, a thin uniform plate from its hinge on", "kg", "chosen: with its size, coupling 0.5")
    panel_length_m: Positive = known(12.0, "of a panel, along z", "m", "chosen: with its mass, coupling 0.5; panelsat 0.375")
    panel_width_m: Positive = known(2.5, "of a panel, along x", "m", "chosen: no matter for the mode")
    hinge_offset_m: Positive = known(2.0, "of a hinge from the origin of B, along z", "m", "chosen: just off the bus")
    panel_spring_nm_rad: Positive = known(
        464.266191,
        "of a hinge, about x; undamped",
        "N m/rad",
        "chosen: 0.070 Hz with the hub held; panelsat 0.35 Hz; zero damping published (Tsao et al., sec. 3)",
    )
    mode_frequency_factor: Positive = known(
        1.0, "on the frequency of the mode; its square on the springs", "-", "chosen; 25 % or more is usual (Tsao et al., sec. 1)"
    )
    wheel_azimuth_deg: float = known(45.0, "pyramid about z: alpha", "deg", "chosen: square base")
    wheel_cant_deg: float = known(54.7356, "pyramid: of a spin axis from z", "deg", "chosen: serves all axes alike, arccos 1/sqrt 3")
    wheel_inertia_kg_m2: Positive = known(0.1, "of a wheel about its spin axis", "kg m2", "chosen: disc of 0.38 m; 20 N m s at 2000 rpm")
    wheel_transverse_inertia_kg_m2: Positive = known(0.052, "of a wheel across its spin axis", "kg m2", "chosen: that disc; panelsat 40 mm")
    wheel_mass_kg: Positive = known(5.5, "of a wheel", "kg", "chosen: that disc")
    wheel_torque_limit_nm: Positive = known(
        5.0,
        "of a motor",
        "N m",
        "chosen: cuts of 1 deg in 40 s with corners of 10 s take 1.6 N m a wheel; three times that for control, so that it stays linear",
    )
    wheel_coulomb_nm: NonNegative = known(0.0, "dry friction of a wheel bearing", "N m", "chosen: none, as in the paper")
    wheel_viscous_nms: NonNegative = known(0.0, "viscous friction of a wheel bearing", "N m s/rad", "chosen: none, as in the paper")
    step_s: Positive = known(
        0.05,
        "physics step (RK4)",
        "s",
        "chosen by measurement: in 300 s the ringing keeps its energy to 4e-8, the hub its way to 4e-7 of the swing; 0.1 s: 1e-6, 6e-6",
    )

    @model_validator(mode="before")
    @classmethod
    def _fill_from_set(cls, given: Any) -> Any:
        if not isinstance(given, dict):
            return given
        name = given.get("set", "boeing702")
        return FLEXIBLE_SETS.get(name, {}) | given if isinstance(name, str) else given

    @model_validator(mode="after")
    def _can_be_built_and_stepped(self) -> Self:
        if 4 * self.wheel_mass_kg + 2 * self.panel_mass_kg >= self.mass_kg:
            raise ValueError(f"mass_kg = {self.mass_kg:g} must exceed that of four wheels and two panels together")
        check_wheel(self)
        channel = self.linear_channel(0)
        if channel.coupling < 1 and (longest := _STEP_RAD / channel.free_frequency) < self.step_s:
            mode = channel.free_frequency / (2 * np.pi)
            raise ValueError(f"step_s = {self.step_s:g} would damp the mode of {mode:.4g} Hz; at most {longest:.4g}")
        return self

    @property
    def inertia(self) -> Array:
        """J with panels and wheels locked about the centre of mass, (3, 3) kg m2; physical or not."""
        return mass_geometry.tensor(self.inertia_kg_m2)

    @property
    def wheel_axes(self) -> Array:
        """Spin axes in B, (3, 4)."""
        return pyramid(np.radians(self.wheel_azimuth_deg), np.radians(90.0 - self.wheel_cant_deg))

    @property
    def torque_limit(self) -> float:
        """N m a wheel."""
        return self.wheel_torque_limit_nm

    @property
    def spring(self) -> float:
        """Of each hinge, N m/rad, with the factor on its mode's frequency."""
        return self.panel_spring_nm_rad * self.mode_frequency_factor**2

    @property
    def panel_inertia(self) -> Array:
        """Principal moments of a panel about its own centre of mass, [across z in its plane, normal, along z], (3,) kg m2."""
        across, along = (self.panel_mass_kg * size**2 / 12.0 for size in (self.panel_length_m, self.panel_width_m))
        return np.array([across, across + along, along])

    def linear_channel(self, axis: int, wheels_locked: bool = False) -> FlexibleChannel:
        """Small rotations about one axis of B, 0, 1, 2, under torque on the hub; q: both panels alike about their hinges.

        Exact for a diagonal inertia and wheels at rest; free wheels do not turn with the hub about their spin axes.
        """
        about_hinge = 2.0 * self.panel_mass_kg * self.panel_length_m**2 / 3.0
        with_hub = about_hinge + self.panel_mass_kg * self.panel_length_m * self.hinge_offset_m if axis == 0 else 0.0
        spinning = 0.0 if wheels_locked else self.wheel_inertia_kg_m2 * float(np.sum(self.wheel_axes[axis] ** 2))
        mass = np.array([[self.inertia[axis, axis] - spinning, with_hub], [with_hub, about_hinge]])
        return FlexibleChannel(mass, np.diag([0.0, 2.0 * self.spring]))

    def process(self, fault: WheelFault | None = None) -> RigidBody:
        """Analytic model in seven states that believes the panels locked; its command: four motor torques, four wheel speeds as read."""
        motors = (fault or WheelFault.healthy(self.wheel_axes.shape[1])).on_body(self.wheel_axes)
        return RigidBody(self.inertia, motors.torque_map, self.wheel_inertia_kg_m2 * self.wheel_axes, motors.constant_torque_B)
