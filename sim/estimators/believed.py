"""Analytic models of a plant that its filters believe in."""

from __future__ import annotations

from dataclasses import dataclass

from models.dynamics.process import ProcessModel
from models.dynamics.wheel_faults import WheelFault
from models.plants.register.entries import kind_of
from models.plants.register.parameters import BodyParameters


@dataclass(frozen=True, eq=False)
class Models:
    """Analytic models of the plant that a filter can be built on."""

    plain: ProcessModel  # as the paper writes it
    with_drag: ProcessModel  # knows the wheels' friction
    parameters: BodyParameters

    @classmethod
    def of(cls, parameters: BodyParameters) -> Models:
        """Models of a plant."""
        believed = kind_of(parameters).believed
        return cls(believed(parameters, False, None), believed(parameters, True, None), parameters)

    def believing(self, wheel_drag: bool, fault: WheelFault | None) -> ProcessModel:
        """The model that believes in a fault of the wheels, or none."""
        if fault is None:
            return self.with_drag if wheel_drag else self.plain
        return kind_of(self.parameters).believed(self.parameters, wheel_drag, fault)

    @property
    def speeds_are_states(self) -> bool:
        """Whether the wheel speeds are estimated; otherwise they are read and taken as known."""
        return "wheels" in kind_of(self.parameters).layout(self.parameters).places
