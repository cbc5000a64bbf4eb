"""Faults that change the bodies themselves, or what moves them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from models.plants.inertia import tensor
from models.sections import Sextuple
from sim.draws import Number
from sim.faults.effects import CENTRE_OF_MASS, DISTURBANCE, DYNAMICS, INERTIA, OWN_MASS
from sim.faults.events import Alias, OfAgents
from sim.faults.placement import Placement

Array = NDArray[np.floating]


class WholeProperties(NamedTuple):
    """What a whole becomes."""

    inertia: Array  # (..., 3, 3) kg m2 about the centre of rotation
    centre_of_mass: Array  # (..., 3) m


class InertiaChange(OfAgents):
    """The whole gets another inertia (about the centre of rotation) and centre of mass, or more inertia; the rate is kept.

    Filters and laws do not know (Rososhansky 2017, table 4.4).
    """

    families = ("body", "formation")
    kind: Literal["inertia"]
    inertia_kg_m2: Sextuple | None = None
    centre_of_mass_um: tuple[float, float, float] = (0.0, 0.0, 0.0)
    add_kg_m2: tuple[Number, Number, Number] | None = Field(None, description="to the diagonal, the centre of mass being kept")

    @model_validator(mode="after")
    def _said_once(self) -> InertiaChange:
        if (self.inertia_kg_m2 is None) == (self.add_kg_m2 is None):
            raise ValueError("give inertia_kg_m2 or add_kg_m2, one of the two")
        if self.add_kg_m2 is not None and any(self.centre_of_mass_um):
            raise ValueError("centre_of_mass_um: goes with inertia_kg_m2; add_kg_m2 keeps the centre of mass")
        return self

    def wholes(self, inertia: Array, centre_of_mass: Array) -> Iterator[WholeProperties]:
        """What wholes of that inertia (..., 3, 3) kg m2 and centre of mass (..., 3) m can become, at the bounds of what is drawn."""
        if self.inertia_kg_m2 is not None:
            replaced = np.broadcast_to(tensor(self.inertia_kg_m2), inertia.shape)
            yield WholeProperties(replaced, np.broadcast_to(1e-6 * np.array(self.centre_of_mass_um), centre_of_mass.shape))
        for bound in () if self.add_kg_m2 is None else (0, 1):
            assert self.add_kg_m2 is not None
            yield WholeProperties(inertia + np.diag([part.bounds()[bound] for part in self.add_kg_m2]), centre_of_mass)

    def lay(self, on: Placement) -> str:
        """The other inertia in place of the own one, or more of it."""
        if self.add_kg_m2 is not None:
            added = [part.sample(on.random) for part in self.add_kg_m2]
            on.add(INERTIA, np.diag(added), self.agents)
            return f"inertia + {added} kg m2{self.whose()}"
        assert self.inertia_kg_m2 is not None
        on.put(OWN_MASS, 0.0, self.agents)
        on.put(INERTIA, tensor(self.inertia_kg_m2), self.agents)
        on.put(CENTRE_OF_MASS, 1e-6 * np.array(self.centre_of_mass_um), self.agents)
        return f"inertia {list(self.inertia_kg_m2)} kg m2{self.whose()}"


class OtherDynamics(OfAgents):
    """The unknown dynamics f have other factors on their two axes (Rososhansky 2017, table 5.3); to the run's end if none is given."""

    families = ("consensus",)
    lasting = True
    kind: Literal["dynamics"]
    gain: tuple[Number, Number]

    def lay(self, on: Placement) -> str:
        """The factors."""
        factors = [part.sample(on.random) for part in self.gain]
        on.put(DYNAMICS, factors, self.agents)
        return f"f times {factors[0]:g}, {factors[1]:g}{self.whose()}"


class OtherDisturbance(OfAgents):
    """The disturbance d has another amplitude and rate (Rososhansky 2017, table 5.4); to the run's end if none is given."""

    families = ("consensus",)
    shapes = ("step", "intermittent")
    aliases = (Alias("disturbance", "consensus"),)
    lasting = True
    kind: Literal["disturbance-change"]
    amplitude_n: Number
    rate_rad_s: Number
    by_agent: bool = Field(True, description="times the agent's number, as in eq. 5.31; else the same rate for all")

    def lay(self, on: Placement) -> str:
        """Amplitude and rate, and by what the rate is multiplied."""
        amplitude, rate = self.amplitude_n.sample(on.random), self.rate_rad_s.sample(on.random)
        on.put(DISTURBANCE, amplitude, self.agents, [0])
        on.put(DISTURBANCE, rate, self.agents, [1])
        number = on.parts.disturbance[:, 2:]
        chosen = number if self.agents == "all" else number[np.array(self.agents) - 1]
        on.put(DISTURBANCE, chosen if self.by_agent else 1.0, self.agents, [2])
        return f"disturbance {amplitude:g} N, {rate:g}{' i' if self.by_agent else ''} rad/s{self.whose(' on ')}"
