"""How an observer's memory fades: settings in a file."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from estimation.fading import ConstantFading, FadingLaw, StrongTracking
from models.sections import Section


class NoFadingSettings(Section):
    """Nothing fades."""

    type: Literal["off"] = "off"

    @property
    def law(self) -> FadingLaw:
        """As the filter knows it."""
        return ConstantFading()


class ConstantFadingSettings(Section):
    """The same fading factor at every tick."""

    type: Literal["constant"]
    factor: Annotated[float, Field(ge=1)] = Field(1.02, description="lambda, of the covariance; 1: nothing fades")

    @property
    def law(self) -> FadingLaw:
        """As the filter knows it."""
        return ConstantFading(self.factor)


class StrongTrackingSettings(Section):
    """A fading factor that makes innovations as large as expected."""

    type: Literal["adaptive"]
    forgetting: Annotated[float, Field(gt=0, le=1)] = Field(0.95, description="rho, of the innovations' variance")
    cap: Annotated[float, Field(ge=1)] = Field(1e3, description="greatest factor")

    @property
    def law(self) -> FadingLaw:
        """As the filter knows it."""
        return StrongTracking(self.forgetting, self.cap)


FadingSettings = Annotated[NoFadingSettings | ConstantFadingSettings | StrongTrackingSettings, Field(discriminator="type")]
