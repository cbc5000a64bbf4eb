"""What a scenario says of the identification of its controllers in flight."""

from __future__ import annotations

from math import tau
from typing import Annotated

from pydantic import Field, model_validator

from models.sections import Positive, Section


class IdentificationSettings(Section):
    """A flight under each of three fixed controllers: the first one, the nominal one and the last one of the adaptive loop."""

    adaptive: str = Field("adaptive", description="the loop whose first and last controllers are identified")
    nominal: str = Field("nominal", description="the loop of the nominal controller")
    rms_deg: Positive = Field(0.3, description="of the sines of a channel together")
    period: Positive = Field(600.0, description="of all sines, in 1 / lambda")
    periods: Annotated[int, Field(ge=1)] = Field(2, description="heard")
    settling_periods: Annotated[int, Field(ge=1)] = Field(1, description="flown before that")
    highest: Positive = Field(3.0, description="frequency / lambda")
    claim: Positive = Field(2.5, description="M1 of the specification that is claimed; the law itself is tighter")

    @model_validator(mode="after")
    def _a_sine_each(self) -> IdentificationSettings:
        if self.highest * self.period < 2.0 * tau:
            least = 2.0 * tau / self.highest
            raise ValueError(f"period = {self.period:g}: has no sine for each channel up to highest = {self.highest:g}; needs {least:.4g}")
        return self
