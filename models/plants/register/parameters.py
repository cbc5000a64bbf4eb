"""What the parameters of every plant have in common."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from models.plants import provenance
from models.sections import Section

Array = NDArray[np.floating]


class PlantParameters(Section):
    """Every number of a plant; `json_schema_extra` of a field holds its unit and provenance, `type` names the kind."""

    @property
    def centre_of_mass(self) -> Array:
        """Of the whole from the origin of B, (3,) m: there, whatever moves."""
        return np.zeros(3)

    @property
    def wheel_axes(self) -> Array:
        """Spin axes in B of a body's wheels, (3, wheels); without wheels (3, 0)."""
        return np.zeros((3, 0))

    def table(self) -> Iterator[tuple[str, str, str, str, str]]:
        """Rows (name, value, unit, meaning, provenance) of every parameter."""
        return provenance.table(self)


class Parameters(Protocol):
    """What is known of the parameters of any plant."""

    @property
    def type(self) -> str:
        """Its kind, as in a file."""
        ...

    @property
    def step_s(self) -> float:
        """Physics step."""
        ...

    @property
    def wheel_axes(self) -> Array:
        """Of each body, (3, wheels)."""
        ...

    def model_dump_json(self) -> str:
        """The same as a string."""
        ...

    def table(self) -> Iterator[tuple[str, str, str, str, str]]:
        """Rows (name, value, unit, meaning, provenance) of every parameter."""
        ...

    def model_dump(self) -> dict[str, Any]:
        """Every number by name."""
        ...


class BodyParameters(Parameters, Protocol):
    """What is known of the parameters of a single body."""

    @property
    def inertia(self) -> Array:
        """Of the whole, wheels locked, about the centre of rotation, (3, 3) kg m2; physical or not."""
        ...

    @property
    def centre_of_mass(self) -> Array:
        """From the centre of rotation, (3,) m in B."""
        ...


class SeveralParameters(Parameters, Protocol):
    """What is known of the parameters of several bodies."""

    @property
    def agents(self) -> int:
        """How many."""
        ...

    @property
    def inertia(self) -> Array:
        """Of each, wheels locked, (agents, 3, 3) kg m2; physical or not."""
        ...

    @property
    def believed_inertia(self) -> Array:
        """What filters and laws take them for, (agents, 3, 3) kg m2."""
        ...

    @property
    def centres_of_mass(self) -> Array:
        """Of each from its centre of rotation, (agents, 3) m in B."""
        ...

    @property
    def places(self) -> Array:
        """Where each is in the lab, (agents, 3) m."""
        ...

    @property
    def torque_limit_nm(self) -> float:
        """About each body axis."""
        ...
