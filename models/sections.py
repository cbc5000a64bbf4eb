"""What every section of a file has in common: it is frozen, knows its keys, and takes finite numbers only."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]
Ordinal = Annotated[int, Field(ge=1)]  # of agents and wheels, which a person counts from one
Sextuple = tuple[float, float, float, float, float, float]  # [xx, yy, zz, xy, xz, yz] of a symmetric tensor


class Section(BaseModel):
    """A section of a scenario, campaign or parameter file."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
