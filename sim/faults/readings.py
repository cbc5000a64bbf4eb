"""Faults of sensors."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from sim.draws import Draw, Number
from sim.faults.effects import AGE, BIAS, MISSING, NOISE
from sim.faults.events import Alias, NotNegative, OfAgents, OfSensor
from sim.faults.parts import Parts
from sim.faults.placement import Placement

ZERO = Draw(constant=0.0)


class NoiseChange(OfSensor):
    """A sensor's noise grows by a factor, or has another deviation; a bias may come with it."""

    aliases = (Alias("readings", "formation"),)
    kind: Literal["noise"]
    factor: NotNegative | None = None
    deviation: NotNegative | None = Field(None, description="of agents, in the reading's unit")
    bias: Number = Field(ZERO, description="the same as kind bias")

    @model_validator(mode="after")
    def _said_once(self) -> NoiseChange:
        if (self.factor is None) == (self.deviation is None):
            raise ValueError("give factor or deviation, one of the two")
        return self

    def check(self, parts: Parts) -> None:
        """Raise ValueError if one deviation cannot be that of the sensor."""
        super().check(parts)
        if self.deviation is not None and not parts.agents:
            raise ValueError("deviation: a body's sensors have several; give a factor")

    def lay(self, on: Placement) -> str:
        """Deviation and bias."""
        said, sensors = [], on.parts.numbers(self.sensor)
        if self.factor is not None:
            factor = self.factor.sample(on.random)
            on.scale(NOISE, factor, self.agents, sensors)
            said.append(f"{self.who} noise x {factor:.3g}")
        if self.deviation is not None:
            deviation = self.deviation.sample(on.random)
            on.put(NOISE, deviation, self.agents, sensors)
            said.append(f"{'readings' if self.sensor == 'all' else self.sensor}{self.whose()}: deviation {deviation:g}")
        if self.bias != ZERO:
            bias = self.bias.sample(on.random)
            on.add(BIAS, bias, self.agents, on.parts.components(self.sensor))
            said.append(f"bias {bias:g}")
        return ", ".join(said)


class Bias(OfSensor):
    """A sensor reads too much, by the same on each axis (rad, rad/s; of agents in the reading's unit)."""

    kind: Literal["bias"]
    size: Number

    def lay(self, on: Placement) -> str:
        """The bias besides all others."""
        size = self.size.sample(on.random)
        on.add(BIAS, size, self.agents, on.parts.components(self.sensor))
        return f"{self.who} bias {size:.3g}"


class DropOut(OfSensor):
    """A sensor says nothing."""

    shapes = ("step", "intermittent")
    kind: Literal["drop-out"]

    def lay(self, on: Placement) -> str:
        """It is missing."""
        on.put(MISSING, 1.0, self.agents, on.parts.numbers(self.sensor))
        return f"{self.who} silent"


class Delay(OfAgents):
    """All readings come later."""

    of_readings = True
    kind: Literal["delay"]
    delay_s: NotNegative

    def lay(self, on: Placement) -> str:
        """The age besides what readings have anyway."""
        delay = self.delay_s.sample(on.random)
        on.add(AGE, delay, self.agents)
        return f"readings{self.whose()} {delay:.3g} s late"
