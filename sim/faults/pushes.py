"""Torques and forces from outside."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from models.sections import Positive
from sim.draws import Number
from sim.faults.effects import PUSH, wave
from sim.faults.events import Alias, NotNegative, OfAgents
from sim.faults.parts import Parts
from sim.faults.placement import Placement

Array = NDArray[np.floating]

BODIES = ("body", "formation")


class ExternalTorque(OfAgents):
    """A push: a torque on the body, constant in B, about a given axis or any axis in the plate's plane ('planar')."""

    families = BODIES
    kind: Literal["external-torque"]
    torque_nm: Number
    direction: Literal["planar"] | tuple[float, float, float] = "planar"

    @field_validator("direction")
    @classmethod
    def _points_somewhere(cls, direction: str | tuple[float, float, float]) -> str | tuple[float, float, float]:
        if not isinstance(direction, str) and not np.any(direction):
            raise ValueError("is zero; give an axis in B or 'planar'")
        return direction

    @property
    def drawn(self) -> bool:
        """Whether trials differ: also by an azimuth of their own."""
        return isinstance(self.direction, str) or super().drawn

    def lay(self, on: Placement) -> str:
        """The torque besides all others."""
        torque = self.torque_nm.sample(on.random)
        axis = _axis(self.direction, on.random)
        on.add(PUSH, torque * axis, self.agents)
        return f"push of {1e3 * torque:.1f} mN m about [{axis[0]:.2f}, {axis[1]:.2f}, {axis[2]:.2f}]{self.whose(' on ')}"


class PeriodicTorque(OfAgents):
    """A disturbance a [sin pt, cos pt, sin 2pt] in B, t since the start of the run (Rososhansky 2017, sec. 3.3, 4.2 and table 4.5)."""

    families = BODIES
    aliases = (Alias("disturbance", "formation", {"size_nm": "amplitude_nm"}),)
    kind: Literal["periodic-torque"]
    amplitude_nm: Number
    pulsation_rad_s: Positive = Field(1.0, description="p")
    by_agent: bool = Field(False, description="p times the agent's number, as in sec. 4.2; else the same for all")

    def check(self, parts: Parts) -> None:
        """Raise ValueError if there are no such agents, or none that have a number."""
        super().check(parts)
        if self.by_agent and not parts.agents:
            raise ValueError("the plant is one body; leave by_agent out")

    def lay(self, on: Placement) -> str:
        """Its amplitude besides that of others of the same pulsation."""
        size = self.amplitude_nm.sample(on.random)
        on.add(wave(self.pulsation_rad_s, self.by_agent), size, self.agents)
        each = f" at {self.pulsation_rad_s:g} i rad/s" if self.by_agent else ""
        return f"periodic torque of {1e3 * size:.0f} mN m{each}{self.whose(' on ')}"


class UniformTorque(OfAgents):
    """A disturbance about each body axis that is drawn anew at every tick, uniform between -a and a."""

    families = BODIES
    random = True
    kind: Literal["uniform-torque"]
    amplitude_nm: NotNegative

    def lay(self, on: Placement) -> str:
        """A torque of its own at every tick, for every agent."""
        size = self.amplitude_nm.sample(on.random)
        each = () if not on.parts.agents else (on.parts.agents if self.agents == "all" else len(self.agents),)
        on.add(PUSH, on.random.uniform(-size, size, (on.end - on.start, *each, 3)), self.agents, by_tick=True)
        return f"random torque of {1e3 * size:.0f} mN m{self.whose(' on ')}"


class ExternalForce(OfAgents):
    """A constant force on agents in the plane."""

    families = ("consensus",)
    kind: Literal["external-force"]
    force_n: tuple[Number, Number]

    def lay(self, on: Placement) -> str:
        """The force besides all others."""
        force = [part.sample(on.random) for part in self.force_n]
        on.add(PUSH, force, self.agents)
        return f"push of [{force[0]:.3g}, {force[1]:.3g}] N{self.whose(' on ')}"


def _axis(direction: str | tuple[float, float, float], random: np.random.Generator) -> Array:
    if isinstance(direction, str):
        azimuth = 2.0 * np.pi * random.random()
        return np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    return np.array(direction) / np.linalg.norm(direction)
