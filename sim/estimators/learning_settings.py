"""Settings of an observer that learns the unmodelled torque of the testbed, and what it needs of the rest of a scenario."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from models.dynamics.learned_torque import Input, TorqueBasis
from models.plants.register.entries import KINDS, kind_of
from models.plants.register.parameters import BodyParameters
from models.sections import NonNegative, Positive
from sim.estimators.fading import FadingSettings, NoFadingSettings
from sim.estimators.learning_observer import learning_observer
from sim.estimators.observer import ObserverBase, Place

Array = NDArray[np.floating]

UNKNOWABLE = ("inertia", "lock")  # faults that change what is there to be learned


class Learning(ObserverBase):
    """Joint adaptive unscented filter of attitude, rate and the weights of an unmodelled torque; wheel speeds are read."""

    learns: ClassVar[bool] = True

    type: Literal["learning"]
    terms: Literal["network", "constant", "none"] = Field("network", description="of the torque in B; none: the plain filter")
    inputs: tuple[Input, ...] = Field(("tilt", "rate", "wheels"), description="of the network")
    order: Annotated[int, Field(ge=1, le=10)] = Field(3, description="of its polynomials")
    greatest_tilt_deg: Annotated[float, Field(gt=0, le=90)] = Field(12.0, description="that is 1 to the polynomials, cut off beyond")
    greatest_rate_deg_s: Positive = Field(4.0, description="likewise")
    greatest_wheel_rad_s: Positive = Field(500.0, description="likewise, of a wheel's speed")
    first_weight_nm: NonNegative = Field(3e-4, description="deviation of each weight before anything is read")
    weight_walk_nm: NonNegative = Field(1e-6, description="deviation of each weight's step in a tick")
    constant_walk_nm: NonNegative | None = Field(None, description="likewise of the constant terms, for what no input explains")
    initial_rate_rad_s: Positive = Field(1.0, description="deviation of each rate that the first reading does not hold")
    alpha: Positive = Field(0.1, description="spread of the sigma points")
    beta: NonNegative = 2.0
    kappa: NonNegative = 0.0
    fading: FadingSettings = NoFadingSettings()

    @model_validator(mode="after")
    def _has_inputs(self) -> Learning:
        if self.terms == "network" and (not self.inputs or len(set(self.inputs)) < len(self.inputs)):
            raise ValueError(f"inputs = {list(self.inputs)}: a network needs one or more of 'tilt', 'rate', 'wheels', each once")
        return self

    def basis(self, wheels: int) -> TorqueBasis | None:
        """What the learned torque can depend on."""
        if self.terms == "none":
            return None
        scales = [float(np.radians(self.greatest_tilt_deg)), float(np.radians(self.greatest_rate_deg_s)), self.greatest_wheel_rad_s]
        return TorqueBasis(self.inputs if self.terms == "network" else (), self.order, wheels, *scales)

    def walk(self, parameters: int) -> Array:
        """Deviation of each weight's step in a tick, (parameters,) N m: rows of W, in each the constant term first."""
        steps = np.full((3, parameters // 3), self.weight_walk_nm)
        steps[:, :1] = self.weight_walk_nm if self.constant_walk_nm is None else self.constant_walk_nm
        return steps.ravel()

    def build(self, place: Place) -> Any:
        """The joint filter; of a plant with something to be learned."""
        return learning_observer(self, place.models.parameters, place.sensors, place.tick_s)


def compensates(law: Any) -> bool:
    """Whether a law subtracts a learned torque."""
    return bool(getattr(law, "compensate_learned", False))


def check_learning(observers: Mapping[str, Any], laws: Mapping[str, Any], plant: BodyParameters, kinds: Iterable[str]) -> None:
    """Raise ValueError if there is nothing to be learned here, or a law subtracts what nobody learns.

    Args:
      observers: settings by name.
      laws: settings of the laws, by their place in the file.
      plant: its settings.
      kinds: of the faults, in their order.
    """
    learning = {f"observers.{name}": o for name, o in observers.items() if o.learns}
    users = [*learning, *(f"{where}.compensate_learned" for where, law in laws.items() if compensates(law))]
    if not users:
        return
    if kind_of(plant).learnable is None:
        known = ", ".join(repr(name) for name, kind in KINDS.items() if kind.learnable)
        raise ValueError(f"{users[0]}: what is learned is a plant's unmodelled torque; needs plant.type = {known}")
    for number, kind in enumerate(kinds):
        if kind in UNKNOWABLE:
            raise ValueError(f"faults.{number} ({kind}): changes the torque that {users[0]} is held against")
    for where, law in laws.items():
        if compensates(law) and law.feedback != "truth" and f"observers.{law.feedback}" not in learning:
            raise ValueError(f"{where}.compensate_learned: {law.feedback!r} learns no torque; needs feedback of type learning, or 'truth'")
