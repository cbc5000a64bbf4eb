"""Filters of attitudes by modified Rodrigues parameters: their settings in a file."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from models.sections import NonNegative, Positive, Section, Share
from sim.estimators.fading import FadingSettings, StrongTrackingSettings, older_fading
from sim.estimators.particle_settings import MIXED, ProposalName, ResampleEvery
from sim.sensors.distribution import NoiseDistribution, NormalNoise


class _Filter(Section):
    process_deviation: Positive = Field(1e-3, description="of each state, a step")
    reading_deviation: Positive = 1e-4
    start_rate_deviation: Positive = Field(1e-2, description="of the rate, which is taken for zero")
    rate_process_deviation: Positive | None = Field(None, description="of each rate alone, a step, in place of process_deviation")


class AukfSettings(_Filter):
    """Adaptive unscented filter."""

    type: Literal["aukf"]
    alpha: Positive = 0.1
    beta: NonNegative = 2.0
    kappa: NonNegative = 0.0
    fading: FadingSettings = StrongTrackingSettings(type="adaptive")
    outlier_tail: Annotated[float, Field(ge=0, lt=1)] = Field(
        0.0, description="a reading less likely than that is not believed; 0: all are"
    )

    @model_validator(mode="before")
    @classmethod
    def _older_names(cls, data: Any) -> Any:
        return older_fading(data)


class PfSettings(_Filter):
    """Particle filter."""

    type: Literal["pf"]
    particles: Annotated[int, Field(ge=2, le=100_000)] = 100
    threshold: Share = 0.8
    proposal: ProposalName = "optimal"
    resampling: Literal["multinomial", "residual", "stratified", "systematic"] = "systematic"
    resample_every: ResampleEvery = 0
    likelihood: NoiseDistribution = Field(
        NormalNoise(), description="how it takes readings to be distributed, with reading_deviation as theirs"
    )

    @model_validator(mode="after")
    def _of_one_size(self) -> PfSettings:
        if self.likelihood.mixture is not None and self.proposal == "likelihood":
            raise ValueError(f"proposal: {MIXED}")
        return self


ObserverSettings = Annotated[AukfSettings | PfSettings, Field(discriminator="type")]
