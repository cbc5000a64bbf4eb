"""A spacecraft with two sprung panels and four reaction wheels: compilation of flexible.xml."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from models.plants import inertia as mass_geometry
from models.plants.assembly import Assembly, MassProperties, Prepared, prepare
from models.plants.flexible_parameters import FlexibleParameters
from models.plants.flexible_picture import draw_to_size
from models.plants.wheels import mount

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
    attached = _attached(spec, parameters)

    def reassemble(inertia: Array, centre_of_mass: Array) -> MassProperties:
        return _hub(parameters, attached, inertia, centre_of_mass)

    return prepare(spec, parameters, reassemble, "panels and wheels")


def compile_flexible(parameters: FlexibleParameters | None = None) -> Assembly:
    """Compile the flexible spacecraft; raises ImpossibleInertia as `prepare_flexible` does."""
    parameters = parameters or FlexibleParameters()
    spec, reassemble = prepare_flexible(parameters)

    def draw() -> mujoco.MjModel:
        return prepare_flexible(parameters).spec.compile()

    spec.compiler.discardvisual = True
    return Assembly(
        model=spec.compile(),
        draw=draw,
        attitude_joints=("hub",),
        wheel_joints=WHEELS,
        wheel_actuators=WHEELS,
        wheel_axes=parameters.wheel_axes,
        wheel_torque_limit=parameters.torque_limit,
        wheel_speed_limit=np.inf,
        wheel_inertia=parameters.wheel_inertia_kg_m2,
        inertia=parameters.inertia,
        centre_of_mass=parameters.centre_of_mass,
        wheel_friction=parameters.wheel_coulomb_nm,
        process=parameters.process(),
        reassemble=reassemble,
        keyframe="rest",
    )


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


def _hub(parameters: FlexibleParameters, attached: tuple[Array, Array], inertia: Array, centre_of_mass: Array) -> MassProperties:
    """What the hub alone must be so that the whole has `inertia` about its own centre of mass, which is at `centre_of_mass`."""
    moment, beside = attached
    mass = parameters.mass_kg - len(WHEELS) * parameters.wheel_mass_kg - len(PANELS) * parameters.panel_mass_kg
    position = (parameters.mass_kg * np.asarray(centre_of_mass) - moment) / mass
    about_origin = inertia + mass_geometry.point_mass(parameters.mass_kg, np.asarray(centre_of_mass))
    moments, axes = mass_geometry.principal(about_origin - beside - mass_geometry.point_mass(mass, position))
    return MassProperties("hub", np.full(position.shape[:-1], mass), position, moments, axes)
