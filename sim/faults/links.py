"""Faults of the network that agents hear each other by."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from models.sections import Ordinal
from sim.faults.effects import CUT, LOSS, MESSAGE_AGE
from sim.faults.events import Alias, Event, Fraction, NotNegative, OfLinks
from sim.faults.placement import Placement


class Loss(OfLinks):
    """Each message is lost with a probability, by itself."""

    kind: Literal["message-loss"]
    probability: Fraction

    def lay(self, on: Placement) -> str:
        """The probability of each message."""
        probability = self.probability.sample(on.random)
        on.put(LOSS, probability, inner=self.messages(on.parts))
        return f"{100 * probability:g} % of messages lost{' on ' if self.who else ''}{self.who}"


class Late(Event):
    """Messages come late."""

    families = ("formation", "consensus")
    aliases = tuple(Alias("delay", family, unless=("agents",)) for family in families)
    kind: Literal["message-delay"]
    delay_s: NotNegative

    def lay(self, on: Placement) -> str:
        """The age of what is heard."""
        delay = self.delay_s.sample(on.random)
        on.put(MESSAGE_AGE, delay)
        return f"messages {delay:g} s late"


class Cut(OfLinks):
    """Links are cut in both directions, 0 being the leader; who is left alone knows it and gives them no weight."""

    shapes = ("step", "intermittent")
    kind: Literal["cut"]
    links: tuple[tuple[Annotated[int, Field(ge=0)], Ordinal], ...] = Field(min_length=1)

    def lay(self, on: Placement) -> str:
        """Nothing comes along them."""
        on.put(CUT, 1.0, inner=self.messages(on.parts))
        return f"cut: {self.who}"
