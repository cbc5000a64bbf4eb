"""How agents learn what moves them: settings in a file."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from estimation.resampling import SCHEMES
from models.sections import NonNegative, Positive, Section, Share
from sim.estimators.fading import FadingSettings, NoFadingSettings, older_fading
from sim.estimators.particle_settings import ResampleEvery


class TuningSettings(Section):
    """What filters are told; the thesis prints none of it."""

    state_std: Positive = Field(1e-3, description="sigma_q: of positions (m) and speeds (m/s), a tick")
    reading_std: Positive = Field(1e-4, description="sigma_r: of positions (m) and speeds (m/s)")
    weight_std: NonNegative = Field(1e-2, description="random walk of each weight, a tick")
    first_weight_std: Positive = Field(1.0, description="of each weight around zero at first")


class Learner(Section):
    """What the loops have in common."""

    feedback: str | None = Field(None, description="whose motion the law acts on: a filter of your own, or truth; none: what learns")


class Exact(Learner):
    """Knows f + d: what the law makes of perfect learning."""

    type: Literal["exact"]


class Nothing(Learner):
    """Learns nothing, W = 0."""

    type: Literal["none"]


class Adaptive(Learner):
    """Weights by the adaptive law, at its own rate; readings are taken as they are."""

    type: Literal["adaptive-law"]
    rate: Positive = Field(5.0, description="Gamma")
    tick_s: Positive = Field(0.001, description="its own control period: the law is stiff")


class Unscented(Learner):
    """State and weights by one adaptive unscented Kalman filter."""

    type: Literal["unscented"]
    fading: FadingSettings = NoFadingSettings()
    outlier_tail: Annotated[float, Field(ge=0, lt=1)] = Field(
        0.0, description="a reading less likely than that is not believed; 0: all are"
    )
    alpha: Positive = 0.1
    beta: NonNegative = 2.0
    kappa: NonNegative = 0.0

    @model_validator(mode="before")
    @classmethod
    def _older_names(cls, data: Any) -> Any:
        return older_fading(data)


class Marginalised(Learner):
    """The marginalised unscented particle filter."""

    type: Literal["marginalised"]
    sampled: Literal["state", "weights"] = Field("state", description="block of the particles: state is variant B, weights A")
    proposal: Literal["optimal", "prior", "likelihood"] = "optimal"
    particles: Annotated[int, Field(ge=2, le=100_000)] = 100
    first_weight_std: Positive | None = Field(None, description="instead of the scenario's")
    resampling: str = "multinomial"
    threshold: Share = 0.8
    resample_every: ResampleEvery = 0

    @model_validator(mode="after")
    def _of_what_is_read(self) -> Marginalised:
        if self.proposal == "likelihood" and self.sampled == "weights":
            raise ValueError("proposal: no reading is of the weights themselves; 'likelihood' needs sampled = 'state'")
        return self

    @field_validator("resampling")
    @classmethod
    def _known(cls, value: str) -> str:
        if value not in SCHEMES:
            raise ValueError(f"no resampling {value!r}; there are {', '.join(SCHEMES)}")
        return value


LoopSettings = Annotated[Exact | Nothing | Adaptive | Unscented | Marginalised, Field(discriminator="type")]
