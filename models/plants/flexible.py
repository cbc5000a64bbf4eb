"""A spacecraft with two sprung panels and four reaction wheels: compilation of flexible.xml."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from models.dynamics.state_layout import StateLayout
from models.plants import inertia as mass_geometry
from models.plants.assembly import Assembly, Carrier, Prepared, assemble, prepare
from models.plants.flexible_parameters import FlexibleParameters
from models.plants.flexible_picture import draw_to_size
from models.plants.register.kind import Joint, PlantKind
from models.plants.wheels import FRICTIONS, alike, joints_of, mount

Array = NDArray[np.floating]

MJCF = Path(__file__).with_name("flexible.xml")
WHEELS = ("wheel_1", "wheel_2", "wheel_3", "wheel_4")
PANELS = ("panel_1", "panel_2")  # their hinges too: turning with the hub about x is positive for both

_PANEL_SIDE = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])  # towards which each stretches, in B


def prepare_flexible(parameters: FlexibleParameters) -> Prepared:
    """Fill flexible.xml with parameters.

    Raises:
      ImpossibleInertia: no rigid body has the tensor of the whole, or what is left of it for the hub.
    """
    spec = mujoco.MjSpec.from_file(str(MJCF))
    spec.option.timestep = parameters.step_s
    size = np.array([parameters.panel_width_m, parameters.hinge_offset_m, parameters.panel_length_m])
    draw_to_size(spec, PANELS, size, parameters.look)
    mount(spec, WHEELS, parameters)
    _set_panels(spec, parameters)
    wheels, panels = len(WHEELS) * parameters.wheel_mass_kg, len(PANELS) * parameters.panel_mass_kg
    own = parameters.mass_kg - wheels - panels
    hub = Carrier("hub", own, parameters.mass_kg, *_attached(spec, parameters), about_mass_centre=True)
    return prepare(spec, parameters, hub.reassemble, "panels and wheels")


def compile_flexible(parameters: FlexibleParameters | None = None) -> Assembly:
    """Compile the flexible spacecraft; raises ImpossibleInertia as `prepare_flexible` does."""
    chosen = parameters or FlexibleParameters()
    return assemble(lambda: prepare_flexible(chosen), chosen, "hub", chosen.process(), alike(WHEELS, chosen))


def _set_panels(spec: mujoco.MjSpec, parameters: FlexibleParameters) -> None:
    for name in PANELS:
        body = spec.body(name)
        body.mass = parameters.panel_mass_kg
        body.ipos = [0.0, 0.0, parameters.panel_length_m / 2.0]
        body.inertia = parameters.panel_inertia
        spec.joint(name).stiffness[0] = parameters.spring


def _attached(spec: mujoco.MjSpec, parameters: FlexibleParameters) -> tuple[Array, Array]:
    """First moment (3,) kg m and inertia about the origin of B (3, 3) kg m2 of wheels and panels, locked."""
    across, along = parameters.wheel_transverse_inertia_kg_m2, parameters.wheel_inertia_kg_m2
    axes = parameters.wheel_axes
    wheels = np.array([spec.body(name).pos for name in WHEELS])
    panels = (parameters.hinge_offset_m + parameters.panel_length_m / 2.0) * _PANEL_SIDE
    own = across * len(WHEELS) * np.eye(3) + (along - across) * axes @ axes.T + len(PANELS) * np.diag(parameters.panel_inertia)
    placed = mass_geometry.point_mass(parameters.wheel_mass_kg, wheels).sum(0) + mass_geometry.point_mass(
        parameters.panel_mass_kg, panels
    ).sum(0)
    return parameters.wheel_mass_kg * wheels.sum(0), own + placed


def _joints(parameters: FlexibleParameters) -> dict[str, Joint]:
    """What resists in wheels' bearings and panels' hinges."""
    return joints_of(WHEELS, parameters) | dict.fromkeys(PANELS, Joint(stiffness=parameters.spring))


PLANT_KIND = PlantKind(
    parameters=FlexibleParameters,
    says="a spacecraft with two sprung panels and four reaction wheels",
    compile=compile_flexible,
    prepare=prepare_flexible,
    believed=lambda parameters, _, fault: parameters.process(fault),  # wheel speeds are read, whatever slows them
    layout=lambda _: StateLayout.of_a_body(0),
    joints=_joints,
    dispersible=("inertia_kg_m2", "wheel_coulomb_nm", "wheel_viscous_nms", "panel_spring_nm_rad", "mode_frequency_factor"),
    effects=FRICTIONS,
    linear_channel=lambda parameters, axis: parameters.linear_channel(axis),
    variant=lambda parameters: parameters.set,
)
