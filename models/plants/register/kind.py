"""A kind of plant: all that differs between plants, in one entry, so that nothing else needs to ask which plant it has."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, Literal, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from models.dynamics.process import ProcessModel
from models.dynamics.rigid_body import RigidBody
from models.dynamics.state_layout import StateLayout
from models.dynamics.unmodelled_torque import UnmodelledTorque
from models.dynamics.wheel_faults import WheelFault
from models.plants.appendage import FlexibleChannel
from models.plants.assembly import Assembly, Prepared
from models.plants.register.parameters import Parameters

Array = NDArray[np.floating]
P = TypeVar("P", bound=Parameters)

Family = Literal["body", "formation", "consensus"]


class DriveErrors(NamedTuple):
    """How a wheel's drive carries out what it is told."""

    command_bits: int = 0  # resolution of its torque set-point; 0: none
    torque_noise_nm: float = 0.0  # standard deviation of its torque, anew each control tick


class AirTorque(NamedTuple):
    """A torque of flowing air about each body axis, a first-order Gauss-Markov process."""

    deviation_nm: float
    correlation_s: float


class Joint(NamedTuple):
    """What resists in a joint, numbers or, of several trials, arrays (trials,); None: as compiled."""

    dry_friction: Any = None  # N m
    damping: Any = None  # N m s/rad
    stiffness: Any = None  # N m/rad


class Learnable(NamedTuple):
    """What a filter can learn of a plant while it flies."""

    body: Callable[[Any], RigidBody]  # that the filter believes in, under the torques of the wheels' motors
    torque: Callable[[Sequence[Any]], UnmodelledTorque]  # that the plants of some trials have besides


@dataclass(frozen=True, eq=False)
class PlantKind(Generic[P]):
    """An entry of the register `models.plants.register.entries`: a module of `models/plants` has it under the name PLANT_KIND.

    Attributes:
      parameters: their class; its field `type`, a Literal, names the kind in files.
      says: what it is, in a few words.
      compile: to a plant ready to be stepped, with its scene; raises ImpossibleInertia.
      prepare: its specification and how it is weighed, without compiling it; raises ImpossibleInertia.
      believed: the analytic model of filters, with the wheels' friction or without, and with a fault of the wheels or none; what the plant
        does not have, or the filter reads, changes nothing.
      layout: of that model's state; wheel speeds that are not in it are read and taken as known.
      family: which closed loop it flies in.
      believed_inertia: what control laws take it for, (3, 3) kg m2; None: its own with wheels locked.
      drives: how its wheels' drives err.
      air: torque of the air; None: there is none.
      tilt_limit_deg: greatest angle between z of B and the vertical, where a stop is met; None: it turns freely.
      no_load_speed: greatest speed that its drives can give a wheel, rad/s; None: nothing limits it.
      wheel_momentum: greatest that one of its wheels can hold, N m s; None: nothing limits it.
      filled_s: time after which outer torques that it always has have filled its wheels, s.
      holds: set-points of actuators other than the wheels', by name, as they are at the start.
      joints: what resists in joints that `dispersible` parameters change, by name.
      dispersible: parameters that can differ between the trials of one batch; the others are part of the compiled model.
      effects: what it has beyond the exact equations of a rigid body with balanced wheels, each with parameters that switch it off.
      learnable: what a filter can learn of it; None: nothing.
      any_tensor: whether it is stepped with an inertia that no rigid body has.
      warnings: what may be meant but deserves a word, a line each.
      linear_channel: the linear model of small rotations about an axis, 0, 1, 2, of a body with a flexible appendage.
      variant: which named set of parameters it has, if they come in sets.
    """

    parameters: type[P]
    says: str
    compile: Callable[[P], Assembly]
    prepare: Callable[[P], Prepared]
    believed: Callable[[P, bool, WheelFault | None], ProcessModel]
    layout: Callable[[P], StateLayout]
    family: Family = "body"
    believed_inertia: Callable[[P], Array] | None = None
    drives: Callable[[P], DriveErrors] | None = None
    air: Callable[[P], AirTorque] | None = None
    tilt_limit_deg: float | None = None
    no_load_speed: Callable[[P], float] | None = None
    wheel_momentum: Callable[[P], float] | None = None
    filled_s: Callable[[P], float] = lambda _: np.inf
    holds: Callable[[P], Mapping[str, float]] = lambda _: {}
    joints: Callable[[P], Mapping[str, Joint]] = lambda _: {}
    dispersible: tuple[str, ...] = ()
    effects: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    learnable: Learnable | None = None
    any_tensor: Callable[[P], bool] = lambda _: False
    warnings: Callable[[P], list[str]] = lambda _: []
    linear_channel: Callable[[P, int], FlexibleChannel] | None = None
    variant: Callable[[P], str] | None = None

    @property
    def type(self) -> str:
        """Its name in files."""
        named: Any = self.parameters
        return str(named.model_fields["type"].default)
