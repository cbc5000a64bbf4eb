"""Faults of reaction wheels and their drives."""

from __future__ import annotations

from typing import Literal

from sim.draws import Number
from sim.faults.effects import DRIVE_GAIN, DRIVE_OFFSET, FRICTION, LOCKED
from sim.faults.events import Alias, Fraction, NotNegative, OfWheel
from sim.faults.placement import Placement


class Float(OfWheel):
    """A wheel without power: its drive gives no torque, it coasts."""

    kind: Literal["float"]

    def lay(self, on: Placement) -> str:
        """Nothing of what the drive would give is left."""
        wheels = self.numbers(on.parts)
        on.put(DRIVE_GAIN, 0.0, self.agents, wheels)
        on.put(DRIVE_OFFSET, 0.0, self.agents, wheels)
        return f"{self.who} floats"


class Effectiveness(OfWheel):
    """A drive gives only a share of the torque that it is told; nobody on board knows."""

    aliases = (Alias("wheel-failure", "formation", defaults={"remaining": 0.0}),)
    kind: Literal["effectiveness"]
    remaining: Fraction

    def lay(self, on: Placement) -> str:
        """A share is left."""
        share = self.remaining.sample(on.random)
        on.scale(DRIVE_GAIN, share, self.agents, self.numbers(on.parts))
        return f"{self.who} at {100 * share:.0f} %"


class ConstantOutput(OfWheel):
    """A drive gives a constant torque whatever it is told."""

    kind: Literal["constant-output"]
    torque_nm: Number

    def lay(self, on: Placement) -> str:
        """The constant in place of what it would give."""
        torque, wheels = self.torque_nm.sample(on.random), self.numbers(on.parts)
        on.put(DRIVE_GAIN, 0.0, self.agents, wheels)
        on.put(DRIVE_OFFSET, torque, self.agents, wheels)
        return f"{self.who} gives {1e3 * torque:.2f} mN m"


class Lock(OfWheel):
    """A wheel seizes: its bearing takes any torque. As a ramp its dry friction grows to that."""

    kind: Literal["lock"]

    def lay(self, on: Placement) -> str:
        """The bearing is seized."""
        on.put(LOCKED, 1.0, self.agents, self.numbers(on.parts))
        return f"{self.who} locks"


class Friction(OfWheel):
    """A bearing, or the windings of a drive without power, brake a wheel by dry friction besides its own."""

    kind: Literal["friction"]
    torque_nm: NotNegative

    def lay(self, on: Placement) -> str:
        """What brakes besides."""
        torque = self.torque_nm.sample(on.random)
        on.add(FRICTION, torque, self.agents, self.numbers(on.parts))
        return f"{self.who} is braked by {1e3 * torque:.3g} mN m"
