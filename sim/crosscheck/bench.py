"""A plant on the bench: compiled with some parameters changed, freed of what physics checks leave out, and flown under held torques."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Generic, NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.plants.assembly import Assembly
from sim.crosscheck.open_loop import Alteration, Dynamics, P, altered
from sim.plant.batch import Plant, Truth

Array = NDArray[np.floating]

TURNING = np.array([0.05, -0.03, 0.08])  # rad/s
NO_TORQUE = np.zeros(3)


class Check(NamedTuple):
    """A figure that must not exceed its tolerance."""

    name: str
    measure: str  # what the figure is
    figure: float
    tolerance: float
    unit: str

    @property
    def passed(self) -> bool:
        """Whether it does not; a figure that is no number fails."""
        return self.figure <= self.tolerance


@dataclass(frozen=True, eq=False)
class Bench(Generic[P]):
    """How a kind of plant is put to the test.

    Attributes:
      compile: its MuJoCo model from its parameters.
      exact: equations of the plant without any of its effects.
      bare: parameters without friction, gravity and the like.
      free: takes away what would stop it.
      clamp: fixes what moves besides the wheels.
      clamped: whether it is fixed even in checks that what moves little hardly disturbs.
      asymmetric: parameters of a body with three different moments, taken if the plant's own are not.
      turning: rate at which it is tried, (3,) rad/s.
    """

    compile: Callable[[P], Assembly]
    exact: Callable[[P], Dynamics]
    bare: dict[str, Any]
    asymmetric: dict[str, Any]
    free: Alteration = lambda _: None
    clamp: Alteration = lambda _: None
    clamped: bool = False
    turning: Array = field(default_factory=TURNING.copy)

    def made(self, parameters: P, clamped: bool = False, **changes: Any) -> tuple[P, Assembly]:
        """The plant with some parameters changed, compiled; nothing stops it."""
        chosen = altered(parameters, **changes)
        assembly = self.compile(chosen)
        self.free(assembly)
        if clamped:
            self.clamp(assembly)
        return chosen, assembly


def advance(plant: Plant, seconds: float, every_s: float, motor: Array | float = 0.0, torque_B: Array = NO_TORQUE) -> list[Truth]:
    """Truth at the start and every `every_s` (a whole number of steps, one at least) under held torques of motors and on the body."""
    steps = max(1, round(every_s / plant.step_s))
    path = [plant.truth()]
    while path[-1].time < seconds - 1e-9:
        plant.advance(np.broadcast_to(motor, (plant.trials, len(plant.assembly.wheel_joints))), torque_B, steps)
        path.append(plant.truth())
    return path


def column(path: list[Truth], name: str) -> Array:
    """A part of the truth over time, (instants, ...)."""
    return np.array([getattr(truth, name) for truth in path])


def without_spin(made: Assembly) -> Array:
    """J of what turns with the body when its wheels are free: J - J_w W W', (3, 3) kg m2."""
    return made.inertia - made.wheel_inertia * made.wheel_axes @ made.wheel_axes.T
