"""How an observer's memory fades: settings in a file."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from estimation.fading import ConstantFading, FadingLaw, GatedTracking, StrongTracking
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
    """A fading factor that makes innovations as large as expected; also above one by chance, in some 40 % of the ticks."""

    type: Literal["adaptive"]
    forgetting: Annotated[float, Field(gt=0, le=1)] = Field(0.95, description="rho, of the innovations' variance")
    cap: Annotated[float, Field(ge=1)] = Field(1e3, description="greatest factor")

    @property
    def law(self) -> FadingLaw:
        """As the filter knows it."""
        return StrongTracking(self.forgetting, self.cap)


class GatedTrackingSettings(Section):
    """The same where innovations are larger than chance makes them, and one where they are not."""

    type: Literal["gated"]
    forgetting: Annotated[float, Field(gt=0, lt=1)] = Field(0.8, description="rho, of NIS; (1 + rho) / (1 - rho) readings count")
    tail: Annotated[float, Field(gt=0, lt=1)] = Field(1e-5, description="probability with which chance is taken for a failing model")
    cap: Annotated[float, Field(ge=1)] = Field(1e3, description="greatest factor")

    @property
    def law(self) -> FadingLaw:
        """As the filter knows it."""
        return GatedTracking(self.forgetting, self.tail, self.cap)


FadingSettings = Annotated[
    NoFadingSettings | ConstantFadingSettings | StrongTrackingSettings | GatedTrackingSettings, Field(discriminator="type")
]
