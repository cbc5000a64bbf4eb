"""Timed events that a file names by kind: when each begins and ends, how it grows, and the register of all kinds."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, model_validator

from models.sections import Ordinal, Section
from sim.draws import Draw, Number
from sim.faults.parts import FAMILIES, Parts
from sim.faults.placement import Placement

Array = NDArray[np.floating]
Shape = Literal["step", "ramp", "intermittent"]


def _not_negative(draw: Draw) -> Draw:
    if draw.bounds()[0] < 0:
        raise ValueError(f"can be {draw.bounds()[0]:g}; must not be negative")
    return draw


def _positive(draw: Draw) -> Draw:
    if draw.bounds()[0] <= 0:
        raise ValueError(f"can be {draw.bounds()[0]:g}; must be positive")
    return draw


def _fraction(draw: Draw) -> Draw:
    low, high = draw.bounds()
    if low < 0 or high > 1:
        raise ValueError(f"can be {low if low < 0 else high:g}; must be from 0 to 1")
    return draw


NotNegative = Annotated[Number, AfterValidator(_not_negative)]
PositiveNumber = Annotated[Number, AfterValidator(_positive)]
Fraction = Annotated[Number, AfterValidator(_fraction)]


class Alias(NamedTuple):
    """Another name of a kind, from older files of some family."""

    kind: str
    family: str
    keys: dict[str, str] = {}  # noqa: RUF012
    defaults: dict[str, Any] = {}  # noqa: RUF012
    unless: tuple[str, ...] = ()  # keys that only the kind of that very name has


KINDS: dict[str, type[Event]] = {}


class Event(Section, ABC):
    """When a fault begins, when it ends, and how it grows; all may be drawn anew in every trial.

    Faults may overlap; where two say different things of one part, the one later in the file is heard.
    """

    families: ClassVar[tuple[str, ...]] = tuple(FAMILIES)
    shapes: ClassVar[tuple[str, ...]] = get_args(Shape)
    aliases: ClassVar[tuple[Alias, ...]] = ()
    lasting: ClassVar[bool] = False  # may go on to the end of the run, or until the next of its kind
    random: ClassVar[bool] = False  # draws numbers that no key names
    of_readings: ClassVar[bool] = False  # shows in the reading of its first tick, where what befalls the plant shows a tick later

    kind: str
    start_s: NotNegative
    duration_s: NotNegative | None = None
    end_s: NotNegative | None = None
    shape: Shape = "step"
    ramp_s: PositiveNumber | None = Field(None, description="in which a ramp reaches its full size; else in its whole duration")
    period_s: PositiveNumber | None = Field(None, description="from one beginning of an intermittent fault to the next")
    duty: Fraction | None = Field(None, description="share of the period in which an intermittent fault is there; else a half")

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        """Every class that says its kind joins the register."""
        super().__pydantic_init_subclass__(**kwargs)
        for kind in get_args(cls.model_fields["kind"].annotation):
            KINDS[kind] = cls

    @model_validator(mode="after")
    def _timed(self) -> Event:
        if (self.duration_s is None) == (self.end_s is None) and not (self.lasting and self.end_s is None):
            raise ValueError("give duration_s or end_s, one of the two")
        if self.end_s is not None and (end := self.end_s.bounds()[0]) <= (start := self.start_s.bounds()[1]):
            raise ValueError(f"end_s = {end:g} is not after start_s = {start:g}")
        if self.shape not in self.shapes:
            raise ValueError(f"shape: {self.kind} cannot be a {self.shape}; it can be {' or '.join(self.shapes)}")
        for key, shape in (("ramp_s", "ramp"), ("period_s", "intermittent"), ("duty", "intermittent")):
            if getattr(self, key) is not None and self.shape != shape:
                raise ValueError(f"{key}: is of shape = {shape!r} alone")
        if self.shape == "intermittent" and self.period_s is None:
            raise ValueError("shape: an intermittent fault needs period_s")
        return self

    @property
    def drawn(self) -> bool:
        """Whether trials differ."""
        numbers = [part for value in self.__dict__.values() for part in (value if isinstance(value, tuple) else (value,))]
        return self.random or any(isinstance(part, Draw) and part.constant is None for part in numbers)

    @property
    def earliest_start(self) -> float:
        """Earliest second at which it can begin."""
        return self.start_s.bounds()[0]

    @property
    def latest_start(self) -> float:
        """Latest second at which it can begin."""
        return self.start_s.bounds()[1]

    @property
    def latest_end(self) -> float:
        """Latest second at which it can still last."""
        if self.end_s is not None:
            return self.end_s.bounds()[1]
        return np.inf if self.duration_s is None else self.latest_start + self.duration_s.bounds()[1]

    def check(self, parts: Parts) -> None:
        """Raise ValueError if it is of something that there is not."""

    @abstractmethod
    def lay(self, on: Placement) -> str:
        """Lay down what it does, and say it."""


class OfAgents(Event):
    """A fault of bodies: of the only one, or of some agents."""

    agents: tuple[Ordinal, ...] | Literal["all"] = Field("all", min_length=1)

    def check(self, parts: Parts) -> None:
        """Raise ValueError if there are no such agents."""
        if self.agents == "all":
            return
        if not parts.agents:
            raise ValueError("the plant is one body; leave agents out")
        if max(self.agents) > parts.agents:
            raise ValueError(f"there is no agent {max(self.agents)}; there are {parts.agents}")

    def whose(self, link: str = " of ") -> str:
        """The agents that it is of; nothing if it is of all."""
        return "" if self.agents == "all" else link + ", ".join(map(str, self.agents))


class OfWheel(OfAgents):
    """A fault of a wheel."""

    families = ("body", "formation")
    wheel: Literal["all"] | Ordinal

    def check(self, parts: Parts) -> None:
        """Raise ValueError if there is no such wheel."""
        super().check(parts)
        if not parts.wheels and not parts.agents:
            raise ValueError("the plant has no wheels")
        if not parts.wheels and self.wheel == "all":
            raise ValueError("the agents have no wheels")
        if self.wheel != "all" and self.wheel > parts.wheels:
            there = f"each agent has {parts.wheels}" if parts.agents else f"wheels are 1 to {parts.wheels} or 'all'"
            raise ValueError(f"there is no wheel {self.wheel}; {there}")

    def numbers(self, parts: Parts) -> list[int]:
        """Places of the wheels, from zero."""
        return list(range(parts.wheels)) if self.wheel == "all" else [self.wheel - 1]

    @property
    def who(self) -> str:
        """The wheel, and the agents that it is of."""
        return f"wheel {self.wheel}{self.whose()}"


class OfSensor(OfAgents):
    """A fault of a sensor."""

    of_readings = True
    sensor: str = "all"

    def check(self, parts: Parts) -> None:
        """Raise ValueError if there is no such sensor."""
        super().check(parts)
        there = [name for name, size in parts.sensors.items() if size]
        if self.sensor not in (*there, "all"):
            raise ValueError(f"there is no sensor {self.sensor!r}; there are {', '.join(there)}, or 'all'")

    @property
    def who(self) -> str:
        """The sensor, and the agents that it is of."""
        return f"{self.sensor}{self.whose()}"


class OfLinks(Event):
    """A fault of links between agents, 0 being the leader."""

    families = ("formation", "consensus")
    links: tuple[tuple[Annotated[int, Field(ge=0)], Ordinal], ...] | Literal["all"] = Field("all", min_length=1)

    def check(self, parts: Parts) -> None:
        """Raise ValueError if there is no such link."""
        for i, j in () if self.links == "all" else self.links:
            if not len(parts.along(i, j)):
                raise ValueError(f"there is no link {i}-{j}")

    def messages(self, parts: Parts) -> NDArray[np.int64]:
        """Which messages go along the links."""
        if self.links == "all":
            return np.arange(len(parts.messages))
        return np.unique(np.concatenate([parts.along(i, j) for i, j in self.links]))

    @property
    def who(self) -> str:
        """The links; nothing if they are all."""
        return "" if self.links == "all" else ", ".join(f"{i}-{j}" if i else f"leader-{j}" for i, j in self.links)
