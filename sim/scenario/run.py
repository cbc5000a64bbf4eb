"""What scenario files of every kind say of their run, and of the numbers that they are held against."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from models.sections import Headline, Positive, Section, Seed

MOST_STEPS = 1e5  # of a tick: where six digits no longer tell one number of steps from the next
TOO_MANY_STEPS = 1e9  # of a tick: MuJoCo counts them in 32 bits


class RunSettings(Section):
    """How long, how often, from which seed."""

    ticks: Annotated[int, Field(ge=1)] = Field(1000, description="control ticks")
    tick_s: Positive = Field(0.1, description="control period")
    trials: Annotated[int, Field(ge=1)] = 10
    seed: Seed


def check_steps(run: RunSettings, step_s: float, key: str, what: str = "physics steps") -> None:
    """Raise ValueError if a control period is not a whole number of steps, with the longest that would do; `key` is where it is set."""
    steps = run.tick_s / step_s
    if steps > TOO_MANY_STEPS:
        raise ValueError(
            f"run.tick_s: {run.tick_s:g} s is {steps:.3g} {what} ({key} = {step_s:g} s); a control tick has at most {TOO_MANY_STEPS:.0e}"
        )
    if abs(steps - round(steps)) > 1e-9 * max(1.0, steps) or round(steps) < 1:
        fits = f"{key} = {run.tick_s / math.ceil(steps):.6g}" if steps < MOST_STEPS else f"a longer {key}"
        raise ValueError(f"run.tick_s: {run.tick_s:g} s is not a whole number of {what} ({key} = {step_s:g} s); {fits} would do")


class Published(Section):
    """What the paper prints, to be shown beside the twin's numbers."""

    source: Headline
    values: dict[str, dict[str, float]] = Field(description="subject -> metric -> value; metric@phase for one phase")
