"""How an observer's memory fades: settings in a file, the same for every family of scenarios."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from estimation.fading import ConstantFading, FadingLaw, GatedTracking, StrongTracking, TraceFading
from models.sections import NonNegative, Section


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


class TraceFadingSettings(Section):
    """One plus a multiple of the innovation's squared length, as a thesis prints it."""

    type: Literal["trace"]
    coefficient: NonNegative = Field(1e3, description="c of lambda = 1 + c tr(nu nu'), in the units of the reading")

    @property
    def law(self) -> FadingLaw:
        """As the filter knows it."""
        return TraceFading(self.coefficient)


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
    NoFadingSettings | ConstantFadingSettings | TraceFadingSettings | StrongTrackingSettings | GatedTrackingSettings,
    Field(discriminator="type"),
]


def older_fading(settings: Any) -> Any:
    """A section of an observer with `fading` as a table, where it is a word with its numbers beside it, or the bare factor."""
    if not isinstance(settings, dict) or isinstance(settings.get("fading"), dict | Section):
        return settings
    kept = {key: part for key, part in settings.items() if key != "fading"}
    match settings.get("fading", "strong-tracking"):
        case "constant":
            return kept | {"fading": {"type": "constant", "factor": kept.pop("value", 1.0)}}
        case "strong-tracking" if "fading" in settings or {"forgetting", "cap"} & set(settings):
            numbers = {key: kept.pop(key) for key in ("forgetting", "cap") if key in kept}
            return kept | {"fading": {"type": "adaptive"} | numbers}
        case int() | float() as factor if not isinstance(factor, bool):
            return kept | {"fading": {"type": "constant", "factor": factor}}
    return settings
