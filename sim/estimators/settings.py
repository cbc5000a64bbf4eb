"""Observers of a scenario: their settings in a file."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from estimation.extended_kalman import GainLaw, KalmanGain
from estimation.nis_switching import Fading, SwitchedGain, Windowed
from estimation.sliding_innovation import SlidingGain
from models.dynamics.wheel_faults import WheelFault, lost_axis
from models.sections import NonNegative, Positive, Section, Share
from sim.estimators.fading import FadingSettings, NoFadingSettings
from sim.estimators.learning_settings import Learning
from sim.estimators.tunings import LEAST_VARIANCE, TUNINGS, Tuning

Array = NDArray[np.floating]

Measured = Literal["quaternion", "vector"]  # what a filter takes of a reading's attitude


class ExtendedSettings(Section):
    """What all filters of the extended family can be told."""

    tuning: str | Tuning
    initial_rate_rad_s: Positive = Field(1.0, description="deviation of each rate that the first reading does not hold")
    discretization: Literal["runge-kutta", "euler"] = "runge-kutta"

    @property
    def numbers(self) -> Tuning:
        """The tuning, by name or as given."""
        return TUNINGS[self.tuning] if isinstance(self.tuning, str) else self.tuning

    def law(self, boundary_layer: Array) -> GainLaw:
        """Gain of this filter."""
        return KalmanGain()

    def check(self, where: str, wheels: int) -> None:
        """Raise ValueError, beginning with `where`, if no innovation covariance could be inverted."""
        noise = self.numbers.measurement_noise
        if not isinstance(noise, str) and min(noise) < LEAST_VARIANCE:
            raise ValueError(
                f"{where}.tuning.measurement_noise: {min(noise):g} makes the innovation covariance singular; needs {LEAST_VARIANCE:g}"
            )


class Ekf(ExtendedSettings):
    """Extended Kalman filter, the quaternion's errors by components."""

    type: Literal["ekf"]


class Mekf(ExtendedSettings):
    """Multiplicative extended Kalman filter, attitude errors as a rotation."""

    type: Literal["mekf"]


class Sif(ExtendedSettings):
    """Extended sliding innovation filter."""

    type: Literal["sif"]

    def law(self, boundary_layer: Array) -> GainLaw:
        """Saturated gain."""
        return SlidingGain(boundary_layer)


class NisSwitched(ExtendedSettings):
    """EKF that becomes a sliding innovation filter while the smoothed NIS says that there is a fault."""

    type: Literal["nis-switched"]
    smoothing: Literal["windowed", "fading"]
    window: Annotated[int, Field(ge=1)] = 45
    alpha: Annotated[float, Field(gt=0, lt=1)] = 0.965
    tail_on: Annotated[float, Field(gt=0, lt=1)] = 0.001
    tail_off: Annotated[float, Field(gt=0, lt=1)] = 0.05
    dof: Positive | None = Field(None, description="measurements in a reading; default: all components, as in the paper")

    @model_validator(mode="after")
    def _hysteresis(self) -> NisSwitched:
        if not self.tail_on < self.tail_off:
            raise ValueError(f"tail_on = {self.tail_on:g}, tail_off = {self.tail_off:g}: needs on < off, or there is no hysteresis")
        return self

    def law(self, boundary_layer: Array) -> GainLaw:
        """Gain that switches."""
        smoothing = Windowed(self.window) if self.smoothing == "windowed" else Fading(self.alpha)
        return SwitchedGain(boundary_layer, smoothing, self.dof or float(len(boundary_layer)), self.tail_on, self.tail_off)


class Ukf(ExtendedSettings):
    """Unscented Kalman filter."""

    type: Literal["ukf"]
    coordinates: Literal["additive", "multiplicative"] = Field(
        "multiplicative", description="attitude errors by components or as a rotation"
    )
    alpha: Positive = Field(0.1, description="spread of the sigma points")
    beta: NonNegative = 2.0
    kappa: NonNegative = 0.0


class Aukf(Ukf):
    """Adaptive unscented Kalman filter: with a fading memory."""

    type: Literal["aukf"]  # type: ignore[assignment]
    coordinates: Literal["additive", "multiplicative"] = "additive"
    fading: FadingSettings = NoFadingSettings()
    measured: Measured = Field("quaternion", description="all of the reading's attitude, or its vector part as printed")

    def check(self, where: str, wheels: int) -> None:
        """Raise ValueError if the coordinates are those of a rotation, which has neither a vector part nor that process noise."""
        super().check(where, wheels)
        if self.coordinates == "multiplicative" and (self.measured == "vector" or self.numbers.matched):
            raise ValueError(f"{where}.coordinates: measured = 'vector' and matched process noise need 'additive'")


class Pf(ExtendedSettings):
    """Particle filter."""

    type: Literal["pf"]
    particles: Annotated[int, Field(ge=2, le=100_000)] = 100
    proposal: Literal["bootstrap", "optimal"] = Field("optimal", description="importance density")
    resampling: Literal["multinomial", "residual", "stratified", "systematic"] = "systematic"
    threshold: Share = Field(0.5, description="effective share of the particles below which they are resampled")
    roughening: NonNegative = Field(0.0, description="K of Gordon, Salmond & Smith (1993); 0: none")
    measured: Measured = Field("quaternion", description="all of the reading's attitude, or its vector part as printed")


class WheelMode(Section):
    """What is wrong with a wheel in a mode of operation: T_a = T_c + sigma (T_i - T_c)."""

    kind: Literal["float", "lock", "hard-over", "effectiveness"]
    wheel: Annotated[int, Field(ge=1)]
    torque_nm: float = Field(0.0, description="of a hard-over")
    remaining: Share = Field(0.5, description="share of the torque, of an effectiveness loss")


FilterSettings = Annotated[Ekf | Mekf | Ukf, Field(discriminator="type")]


class Imm(Section):
    """Interacting multiple model: one filter for each mode of operation of the wheels, the first mode being the healthy one."""

    type: Literal["imm"]
    tuning: str | Tuning
    filter: FilterSettings = Field(description="the kind of the members")
    modes: tuple[tuple[WheelMode, ...], ...] = Field(description="for each mode what is wrong with which wheels; [] is healthy")
    stay_probability: Annotated[float, Field(gt=0, lt=1)] = Field(0.9999, description="of a mode in a tick; the others share the rest")
    transition: tuple[tuple[float, ...], ...] | None = Field(None, description="p_ij from mode i to j in a tick, in place of that")
    initial: tuple[float, ...] | None = Field(None, description="probability of each mode at the start; default: all alike")
    floor: Annotated[float, Field(ge=0, lt=0.1)] = Field(1e-9, description="least probability of a mode")
    declare_above: Annotated[float, Field(gt=0, lt=1)] = Field(0.9, description="probability of all faulty modes that declares a fault")
    withdraw_below: Annotated[float, Field(gt=0, lt=1)] = Field(0.5, description="and the one that withdraws it")

    @model_validator(mode="before")
    @classmethod
    def _members_share_the_tuning(cls, data: Any) -> Any:
        if isinstance(data, dict) and isinstance(data.get("filter"), dict):
            return data | {"filter": {"tuning": data.get("tuning")} | data["filter"]}
        return data

    @property
    def matrix(self) -> Array:
        """Transition probabilities, (modes, modes)."""
        if self.transition is not None:
            return np.array(self.transition)
        count = len(self.modes)
        others = (1.0 - self.stay_probability) / max(count - 1, 1)
        return np.where(np.eye(count) > 0, self.stay_probability if count > 1 else 1.0, others)

    @property
    def start(self) -> Array:
        """Probabilities at the start, (modes,)."""
        return np.full(len(self.modes), 1.0 / len(self.modes)) if self.initial is None else np.array(self.initial)

    def faults(self, wheels: int) -> tuple[WheelFault, ...]:
        """The modes."""
        return tuple(_wheel_fault(mode, wheels) for mode in self.modes)

    def check(self, where: str, wheels: int) -> None:
        """Raise ValueError, beginning with `where`, if the modes do not fit together."""
        count = len(self.modes)
        if count < 2 or self.modes[0]:
            raise ValueError(f"{where}.modes: needs two modes or more, of which the first is [] (healthy)")
        for number, mode in enumerate(self.modes):
            for fault in mode:
                if fault.wheel > wheels:
                    raise ValueError(f"{where}.modes.{number}: there is no wheel {fault.wheel}; wheels are 1 to {wheels}")
        if self.transition is not None:
            if len(self.transition) != count or any(len(row) != count for row in self.transition):
                raise ValueError(f"{where}.transition: needs {count} rows of {count} probabilities, one for each mode")
            for number, row in enumerate(self.transition):
                if min(row) < 0 or abs(sum(row) - 1.0) > 1e-9:
                    raise ValueError(f"{where}.transition.{number}: a row must be probabilities that sum to one; this sums to {sum(row):g}")
        if self.initial is not None:
            if len(self.initial) != count:
                raise ValueError(f"{where}.initial: {len(self.initial)} probabilities for {count} modes")
            if min(self.initial) < 0 or abs(sum(self.initial) - 1.0) > 1e-9:
                raise ValueError(f"{where}.initial: must be probabilities that sum to one; these sum to {sum(self.initial):g}")
        if self.withdraw_below > self.declare_above:
            raise ValueError(f"{where}.withdraw_below = {self.withdraw_below:g} must not exceed declare_above = {self.declare_above:g}")
        self.filter.check(f"{where}.filter", wheels)

    def warnings(self, where: str, wheel_axes: Array) -> list[str]:
        """A line for each mode in which the wheels cannot turn the body about some axis."""
        lines = []
        for number, fault in enumerate(self.faults(wheel_axes.shape[1])):
            axis = lost_axis(wheel_axes, fault)
            if axis is not None:
                shown = ", ".join(f"{part:.2f}" for part in axis)
                lines.append(f"{where}.modes.{number}: its wheels give no torque about [{shown}] in B")
        return lines


def _wheel_fault(mode: tuple[WheelMode, ...], wheels: int) -> WheelFault:
    indicator, torque = np.zeros(wheels), np.zeros(wheels)
    for fault in mode:
        indicator[fault.wheel - 1] = 1.0 - fault.remaining if fault.kind == "effectiveness" else 1.0
        torque[fault.wheel - 1] = fault.torque_nm if fault.kind == "hard-over" else 0.0
    return WheelFault(indicator, torque)


ObserverSettings = Annotated[Ekf | Mekf | Sif | NisSwitched | Ukf | Aukf | Pf | Imm | Learning, Field(discriminator="type")]
