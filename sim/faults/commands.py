"""Faults of what laws command."""

from __future__ import annotations

from typing import Literal

from pydantic import model_validator

from sim.draws import Draw, Number
from sim.faults.effects import COMMAND_GAIN, COMMAND_OFFSET, DRIVE_GAIN, GAINS, SLIDING
from sim.faults.events import Alias, NotNegative, OfAgents
from sim.faults.parts import Parts
from sim.faults.placement import Placement


class NoCommand(OfAgents):
    """No command reaches any drive; without wheels, no body."""

    kind: Literal["no-command"]

    def lay(self, on: Placement) -> str:
        """Nothing of the command is left."""
        on.put(DRIVE_GAIN if on.parts.wheels else COMMAND_GAIN, 0.0, self.agents)
        return f"no command{self.whose(' to ')}"


class ConstantCommand(OfAgents):
    """A body gets a constant torque, or an agent in the plane a force, whatever its law says; filters believe the law.

    About one axis, the others being the law's, or about all (Rososhansky 2017, tables 4.6 and 4.7).
    """

    aliases = (Alias("body-torque", "body"), Alias("command", "formation"))
    kind: Literal["constant-command"]
    axis: Literal["x", "y", "z"] | None = None
    torque_nm: Number | tuple[Number, Number, Number] | None = None
    force_n: tuple[Number, Number] | None = None

    @model_validator(mode="after")
    def _said_once(self) -> ConstantCommand:
        if (self.torque_nm is None) == (self.force_n is None):
            raise ValueError("give torque_nm, or force_n of agents in the plane")
        if (self.axis is None) == (self.torque_nm is not None and not isinstance(self.torque_nm, tuple)):
            raise ValueError("torque_nm: give one number and its axis, or three numbers and no axis")
        return self

    def check(self, parts: Parts) -> None:
        """Raise ValueError if the plant is not moved like that."""
        super().check(parts)
        if parts.wheels and not parts.agents:
            raise ValueError("the plant is turned by its wheels; constant-output is the fault of a wheel")
        wanted = "torque_nm" if parts.axes == 3 else "force_n"
        if getattr(self, wanted) is None:
            raise ValueError(f"give {wanted}")

    def lay(self, on: Placement) -> str:
        """The constant in place of the command."""
        if self.axis is not None:
            assert self.torque_nm is not None
            assert not isinstance(self.torque_nm, tuple)
            torque, about = self.torque_nm.sample(on.random), ["xyz".index(self.axis)]
            on.put(COMMAND_GAIN, 0.0, self.agents, about)
            on.put(COMMAND_OFFSET, torque, self.agents, about)
            return f"{1e3 * torque:.1f} mN m about {self.axis} whatever the command{self.whose()}"
        parts = self.force_n or self.torque_nm
        assert isinstance(parts, tuple)
        effort = [part.sample(on.random) for part in parts]
        on.put(COMMAND_GAIN, 0.0, self.agents)
        on.put(COMMAND_OFFSET, effort, self.agents)
        who = "all" if self.agents == "all" else self.whose("")
        return f"{who} give {effort} {'N' if self.force_n else 'N m'}"


class OtherGains(OfAgents):
    """Laws of a formation have other gains (Rososhansky 2017, tables 4.6 and 4.7)."""

    families = ("formation",)
    kind: Literal["gains"]
    k1: NotNegative | None = None
    k2: NotNegative | None = None
    k3: NotNegative | None = None
    gamma: NotNegative | None = None

    def lay(self, on: Placement) -> str:
        """The gains that are given; the others stay."""
        said = []
        for number, key in enumerate(("k1", "k2", "k3", "gamma")):
            if (drawn := getattr(self, key)) is not None:
                value = drawn.sample(on.random)
                on.put(GAINS, value, self.agents, [number])
                said.append(f"{key} = {value:g}")
        return f"{'all' if self.agents == 'all' else self.whose('')}: {', '.join(said)}"


class ConstantSliding(OfAgents):
    """A constant stands for the sliding terms of the law, -W phi - h + constant (Rososhansky 2017, table 5.5)."""

    families = ("consensus",)
    shapes = ("step", "intermittent")
    aliases = (Alias("command", "consensus"),)
    kind: Literal["constant-sliding"]
    constant_n: Number = Draw(constant=-0.0125)

    def lay(self, on: Placement) -> str:
        """The constant on both axes."""
        on.put(SLIDING, [1.0, self.constant_n.sample(on.random)], self.agents)
        return f"no sliding terms in the command{self.whose()}"
