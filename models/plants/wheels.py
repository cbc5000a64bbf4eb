"""Reaction-wheel arrays: the spin axes of the wheels in the body frame, as the columns of W (3, wheels)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from models.plants.assembly import Wheels
from models.plants.inertia import point_mass
from models.plants.register.kind import Joint

Array = NDArray[np.floating]


def pyramid(azimuth: float = np.pi / 4, elevation: float = np.pi / 4) -> Array:
    """Spin axes of four wheels in a pyramid (McCafferty-Leroux et al. 2024, eq. 6, signs as printed); rad to (3, 4)."""
    ca, sa, cb, sb = np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation)
    return np.array(
        [
            [ca * cb, ca * cb, -ca * cb, -ca * cb],
            [-sa * cb, sa * cb, -sa * cb, sa * cb],
            [-sb, -sb, -sb, -sb],
        ]
    )


def crossed(tilt_xy: float = np.pi / 4, tilt_yz: float = np.pi / 4) -> Array:
    """Spin axes of two wheels in the xy and two in the yz plane (Hill et al. 2021, eq. 11); tilts from y, rad, to (3, 4).

    The paper's letters are a = sin tilt_xy, b = cos tilt_xy, c = cos tilt_yz, d = sin tilt_yz.
    """
    a, b, c, d = np.sin(tilt_xy), np.cos(tilt_xy), np.cos(tilt_yz), np.sin(tilt_yz)
    return np.array(
        [
            [a, -a, 0.0, 0.0],
            [b, b, c, c],
            [0.0, 0.0, d, -d],
        ]
    )


class WheelParameters(Protocol):
    """What is known of wheels that are all alike."""

    @property
    def wheel_axes(self) -> Array:
        """(3, wheels)."""
        ...

    @property
    def wheel_mass_kg(self) -> float:
        """Of a wheel."""
        ...

    @property
    def wheel_inertia_kg_m2(self) -> float:
        """About its spin axis."""
        ...

    @property
    def wheel_transverse_inertia_kg_m2(self) -> float:
        """Across it."""
        ...

    @property
    def wheel_viscous_nms(self) -> float:
        """Viscous friction of its bearing."""
        ...

    @property
    def wheel_coulomb_nm(self) -> float:
        """Dry friction of its bearing."""
        ...

    @property
    def torque_limit(self) -> float:
        """N m a wheel."""
        ...


def check_wheel(parameters: WheelParameters) -> None:
    """Raise ValueError if no wheel has such moments: that about the axis is at most twice that across it, of a disc without thickness."""
    along, across = parameters.wheel_inertia_kg_m2, parameters.wheel_transverse_inertia_kg_m2
    if along > 2.0 * across:
        raise ValueError(f"wheel_inertia_kg_m2 = {along:g} must not exceed twice wheel_transverse_inertia_kg_m2 = {across:g}")


def joints_of(names: Sequence[str], parameters: WheelParameters) -> dict[str, Joint]:
    """What resists in the bearings of these wheels, all alike."""
    return dict.fromkeys(names, Joint(dry_friction=parameters.wheel_coulomb_nm, damping=parameters.wheel_viscous_nms))


def alike(names: Sequence[str], parameters: WheelParameters, speed_limit: float = np.inf) -> Wheels:
    """Wheels of these names for an assembly."""
    return Wheels(
        names=tuple(names),
        axes=parameters.wheel_axes,
        torque_limit=parameters.torque_limit,
        inertia=parameters.wheel_inertia_kg_m2,
        dry_friction=parameters.wheel_coulomb_nm,
        speed_limit=speed_limit,
    )


def attached(spec: Any, names: Sequence[str], parameters: WheelParameters) -> tuple[Array, Array]:
    """First moment (3,) kg m, and inertia about the origin of B (3, 3) kg m2, of wheels that are locked where `spec` has them."""
    across, along = parameters.wheel_transverse_inertia_kg_m2, parameters.wheel_inertia_kg_m2
    axes, position = parameters.wheel_axes, np.array([spec.body(name).pos for name in names])
    own = across * len(names) * np.eye(3) + (along - across) * axes @ axes.T
    return parameters.wheel_mass_kg * position.sum(0), own + point_mass(parameters.wheel_mass_kg, position).sum(0)


# what a wheel's bearing does, and what switches it off
FRICTIONS: dict[str, dict[str, float]] = {
    "wheel dry friction": {"wheel_coulomb_nm": 0.0},
    "wheel viscous friction": {"wheel_viscous_nms": 0.0},
}


def mount(spec: Any, names: Sequence[str], parameters: WheelParameters) -> None:
    """Set up the bodies, hinges and actuators of these names in a MuJoCo specification as wheels."""
    limit = parameters.torque_limit
    for name, axis in zip(names, parameters.wheel_axes.T, strict=True):
        body, joint = spec.body(name), spec.joint(name)
        body.alt.type, body.alt.zaxis = mujoco.mjtOrientation.mjORIENTATION_ZAXIS, axis
        body.mass = parameters.wheel_mass_kg
        body.inertia = [parameters.wheel_transverse_inertia_kg_m2] * 2 + [parameters.wheel_inertia_kg_m2]
        joint.damping[0] = parameters.wheel_viscous_nms
        joint.frictionloss = parameters.wheel_coulomb_nm
        spec.actuator(name).ctrlrange = [-limit, limit]
