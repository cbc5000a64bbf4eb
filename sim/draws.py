"""A number in a scenario file that may be drawn anew in every trial."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, model_validator
from scipy.special import ndtri

from models.sections import Section

_KINDS = ("constant", "uniform", "normal", "log_uniform", "choice")


class Draw(Section):
    """A number, or one of {uniform = [low, high]}, {normal = [mean, std]}, {log_uniform = [low, high]}, {choice = [...]}."""

    constant: float | None = None
    uniform: tuple[float, float] | None = None
    normal: tuple[float, float] | None = None
    log_uniform: tuple[float, float] | None = None
    choice: tuple[float, ...] | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> Draw:
        given = [kind for kind in _KINDS if getattr(self, kind) is not None]
        if len(given) != 1:
            raise ValueError("give a number or one of uniform, normal, log_uniform, choice")
        for kind in ("uniform", "log_uniform"):
            interval = getattr(self, kind)
            if interval is not None and not interval[0] < interval[1]:
                raise ValueError(f"{kind} = {list(interval)}: needs low < high")
        if self.log_uniform is not None and self.log_uniform[0] <= 0:
            raise ValueError(f"log_uniform = {list(self.log_uniform)}: needs 0 < low")
        if self.normal is not None and self.normal[1] < 0:
            raise ValueError(f"normal = {list(self.normal)}: needs [mean, standard deviation >= 0]")
        if self.choice is not None and not self.choice:
            raise ValueError("choice is empty")
        return self

    def sample(self, generator: np.random.Generator) -> float:
        """One draw; takes the same share of the stream whatever the kind."""
        return self.quantile(generator.random())

    def quantile(self, share: float) -> float:
        """The value below which a `share` in [0, 1) of all draws lies."""
        if self.constant is not None:
            return self.constant
        if self.uniform is not None:
            return self.uniform[0] + share * (self.uniform[1] - self.uniform[0])
        if self.log_uniform is not None:
            return float(self.log_uniform[0] * (self.log_uniform[1] / self.log_uniform[0]) ** share)
        if self.choice is not None:
            return self.choice[int(share * len(self.choice))]
        assert self.normal is not None
        return float(self.normal[0] + self.normal[1] * ndtri(max(share, 1e-16)))

    def bounds(self) -> tuple[float, float]:
        """Least and greatest value that can be drawn (5 sigma of a normal)."""
        if self.constant is not None:
            return self.constant, self.constant
        if self.normal is not None:
            return self.normal[0] - 5 * self.normal[1], self.normal[0] + 5 * self.normal[1]
        values = self.uniform or self.log_uniform or self.choice
        assert values is not None
        return min(values), max(values)


def _from_number(value: Any) -> Any:
    return {"constant": value} if isinstance(value, int | float) and not isinstance(value, bool) else value


Number = Annotated[Draw, BeforeValidator(_from_number)]
