"""A compiled plant: its MuJoCo models and the names by which the twin finds bodies, wheels and torques in them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from models.dynamics.process import ProcessModel
from models.plants.inertia import point_mass, principal, why_impossible

Array = NDArray[np.floating]


@dataclass(frozen=True)
class MassProperties:
    """Per-simulation values of one body of the MuJoCo model; leading axis: simulation."""

    body: str
    mass: Array  # (...,) kg
    centre_of_mass: Array  # (..., 3) m, in the body's frame
    moments: Array  # (..., 3) kg m2, principal, about the centre of mass
    axes: Array  # (..., 4) scalar-first quaternion of the principal axes


@dataclass(frozen=True, eq=False)
class Carrier:
    """A body with others attached to it, of which all is known but what it is by itself.

    Attributes:
      name: of its MuJoCo body.
      mass: its own, kg.
      whole: mass of everything, kg.
      moment: first moment of what is attached about the origin of B, (3,) kg m.
      inertia: of what is attached, locked, about the origin of B, (3, 3) kg m2.
      about_mass_centre: whether inertias of the whole are given about its own centre of mass; else about the origin of B.
    """

    name: str
    mass: float
    whole: float
    moment: Array
    inertia: Array
    about_mass_centre: bool

    def reassemble(self, inertia: Array, centre_of_mass: Array) -> MassProperties:
        """What it must be so that the whole has `inertia`, (..., 3, 3) kg m2, and its `centre_of_mass`, (..., 3) m in B."""
        place = np.asarray(centre_of_mass)
        position = (self.whole * place - self.moment) / self.mass
        about_origin = inertia + point_mass(self.whole, place) if self.about_mass_centre else inertia
        moments, axes = principal(about_origin - self.inertia - point_mass(self.mass, position))
        return MassProperties(self.name, np.full(position.shape[:-1], self.mass), position, moments, axes)


class ImpossibleInertia(ValueError):
    """A tensor that no rigid body has."""


class Prepared(NamedTuple):
    """A plant's specification with its parameters, not yet compiled."""

    spec: mujoco.MjSpec
    reassemble: Callable[[Array, Array], MassProperties]


class Whole(Protocol):
    """What is known of a spacecraft as a whole."""

    @property
    def inertia_kg_m2(self) -> Any:
        """As a person gave it."""
        ...

    @property
    def inertia(self) -> Array:
        """(3, 3) kg m2, physical or not."""
        ...

    @property
    def centre_of_mass(self) -> Array:
        """(3,) m in B."""
        ...


def prepare(
    spec: mujoco.MjSpec, whole: Whole, reassemble: Callable[[Array, Array], MassProperties], attached: str | None = None
) -> Prepared:
    """Give the body that carries all others what makes the whole right.

    Args:
      spec: with everything that is attached to that body; it gets the body's mass properties.
      whole: what is wanted.
      reassemble: mass properties of that body for an inertia and centre of mass of the whole.
      attached: what there is besides, for the complaint.

    Raises:
      ImpossibleInertia: no rigid body has the tensor of the whole, or what is left of it for that body.
    """
    if reason := why_impossible(whole.inertia):
        raise ImpossibleInertia(f"inertia_kg_m2 = {whole.inertia_kg_m2!r}: no rigid body has it, {reason}; the analytic model runs it")
    own = reassemble(whole.inertia, whole.centre_of_mass)
    if attached and (reason := why_impossible(np.diag(own.moments))):
        raise ImpossibleInertia(f"inertia_kg_m2 = {whole.inertia_kg_m2!r}: without {attached} no rigid body is left, {reason}")
    body = spec.body(own.body)
    body.mass, body.ipos, body.inertia, body.iquat = float(own.mass), own.centre_of_mass, own.moments, own.axes
    body.fullinertia = np.full(6, np.nan)
    body.explicitinertial = True
    return Prepared(spec, reassemble)


@dataclass(frozen=True)
class Assembly:
    """A plant ready to be stepped.

    Attributes:
      model: what is stepped: no visual geoms.
      draw: compiles the same plant with everything that a person looks at; the same state layout.
      attitude_joints: ball or free joints whose rotation is q_BN, one for each agent; none for planar agents.
      wheel_joints: hinges of the reaction wheels, in the order of the wheel numbers.
      wheel_actuators: torque actuators of those wheels.
      wheel_axes: spin axes in B, (3, wheels).
      wheel_torque_limit: N m a wheel; the drive's command range.
      wheel_speed_limit: rad/s, where back-EMF has used up the supply voltage; inf where nothing limits it.
      wheel_inertia: about the spin axis, kg m2.
      inertia: of the whole with wheels locked, about the centre of rotation, (3, 3) kg m2.
      centre_of_mass: of the whole from the centre of rotation, (3,) m in B.
      wheel_friction: dry friction of a wheel's bearing, N m.
      process: the analytic model of the same plant.
      reassemble: mass properties that give the whole another locked-wheel inertia (..., 3, 3) kg m2 and centre of mass (..., 3) m.
      keyframe: named start of the model.
    """

    model: mujoco.MjModel
    draw: Callable[[], mujoco.MjModel]
    attitude_joints: tuple[str, ...]
    wheel_joints: tuple[str, ...]
    wheel_actuators: tuple[str, ...]
    wheel_axes: Array
    wheel_torque_limit: float
    wheel_speed_limit: float
    wheel_inertia: float
    inertia: Array
    centre_of_mass: Array
    wheel_friction: float
    process: ProcessModel
    reassemble: Callable[[Array, Array], MassProperties]
    keyframe: str

    @cached_property
    def scene(self) -> mujoco.MjModel:
        """What a person looks at; compiled when somebody does."""
        return self.draw()


@dataclass(frozen=True)
class Wheels:
    """A body's reaction wheels, all alike.

    Attributes:
      names: of their bodies, hinges and actuators.
      axes: in B, (3, wheels).
      torque_limit: N m a wheel.
      inertia: about the spin axis, kg m2.
      dry_friction: of a bearing, N m.
      speed_limit: rad/s.
    """

    names: tuple[str, ...] = ()
    axes: Array = field(default_factory=lambda: np.zeros((3, 0)))
    torque_limit: float = 0.0
    inertia: float = 0.0
    dry_friction: float = 0.0
    speed_limit: float = np.inf


def assemble(
    prepared: Callable[[], Prepared], whole: Whole, joint: str, process: ProcessModel, wheels: Wheels | None = None, keyframe: str = "rest"
) -> Assembly:
    """Compile one body.

    Args:
      prepared: makes its specification anew; once for what is stepped, again for what is drawn.
      whole: its mass properties.
      joint: ball or free joint that it turns in.
      process: its analytic model.
      wheels: None: it has none.
      keyframe: named start.

    Raises:
      ImpossibleInertia: as `prepared` does.
    """

    def draw() -> mujoco.MjModel:
        return prepared().spec.compile()

    spec, reassemble = prepared()
    spec.compiler.discardvisual = True
    momentum = mujoco.mjtSensor.mjSENS_SUBTREEANGMOM
    if not any(sensor.type == momentum for sensor in spec.sensors):  # without it MuJoCo does not work the momentum out
        spec.add_sensor(type=momentum, objtype=mujoco.mjtObj.mjOBJ_BODY, objname=spec.joint(joint).parent.name)
    own = wheels or Wheels()
    return Assembly(
        model=spec.compile(),
        draw=draw,
        attitude_joints=(joint,),
        wheel_joints=own.names,
        wheel_actuators=own.names,
        wheel_axes=own.axes,
        wheel_torque_limit=own.torque_limit,
        wheel_speed_limit=own.speed_limit,
        wheel_inertia=own.inertia,
        inertia=whole.inertia,
        centre_of_mass=whole.centre_of_mass,
        wheel_friction=own.dry_friction,
        process=process,
        reassemble=reassemble,
        keyframe=keyframe,
    )
