"""What scenario files of every kind say of their run, and of the numbers that they are held against."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from models.sections import Headline, Positive, Section, Seed


class RunSettings(Section):
    """How long, how often, from which seed."""

    ticks: Annotated[int, Field(ge=1)] = Field(1000, description="control ticks")
    tick_s: Positive = Field(0.1, description="control period")
    trials: Annotated[int, Field(ge=1)] = 10
    seed: Seed


class Published(Section):
    """What the paper prints, to be shown beside the twin's numbers."""

    source: Headline
    values: dict[str, dict[str, float]] = Field(description="subject -> metric -> value; metric@phase for one phase")
