"""Observers of a scenario: their settings in a file, and the filters that they stand for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from estimation.extended_kalman import ExtendedFilter, GainLaw, KalmanGain
from estimation.gaussian import Belief
from estimation.nis_switching import Fading, SwitchedGain, Windowed
from estimation.sliding_innovation import SlidingGain
from estimation.stacking import stack, stackable
from estimation.state_space import Additive, Multiplicative, StateSpace
from models.process import ProcessModel, predict, predict_euler
from models.quaternion import IDENTITY
from sim.sensors import RPM, SensorSettings

Array = NDArray[np.floating]

Positive = Annotated[float, Field(gt=0)]
Triple = tuple[Positive, Positive, Positive]


class Tuning(BaseModel):
    """Noise that a filter expects, each as [quaternion component, body rate (rad/s), wheel speed]."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    process_noise: Triple = Field(description="variances added in a tick, Q")
    measurement_noise: Literal["sensors"] | Triple = Field(description="variances of a reading, R, or those of the simulated sensors")
    boundary_layer: Triple = Field(description="delta of the sliding innovation gain")
    wheel_unit_rad_s: Positive = Field(1.0, description="wheel speed in which the wheels' entries are counted")
    wheel_drag: bool = Field(False, description="the model knows the wheels' friction, as a spin-down test would identify it")

    def scaled(self, sensors: SensorSettings) -> tuple[Array, Array, Array]:
        """Q, R (variances) and delta in rad/s: (3,) each."""
        scale = self.wheel_unit_rad_s
        variance, deviation = np.array([1.0, 1.0, scale**2]), np.array([1.0, 1.0, scale])
        if self.measurement_noise == "sensors":
            rotation, rate, wheel = sensors.variances
            measurement = np.maximum([rotation / 4.0, rate, wheel], 1e-16)  # half a small rotation is a quaternion component
        else:
            measurement = np.array(self.measurement_noise) * variance
        return np.array(self.process_noise) * variance, measurement, np.array(self.boundary_layer) * deviation


# 1 V of the drives' monitor output if 4 V are 2000 rpm (the scale can be configured and is not printed): the reading with which the
# paper's Q and R give the detection that it reports. It is a unit for those numbers; the twin's sensors read farther.
MONITOR_VOLT_RAD_S = 2000 * RPM / 4.0

# `paper`: McCafferty-Leroux et al. (2024, sec. 5), wheels in volts (docs/errata.md).
# `consistent`: R of the simulated sensors, Q of the mismatch between plant and analytic model (docs/consistency.md).
TUNINGS: dict[str, Tuning] = {
    "paper": Tuning(
        process_noise=(4e-5, 4e-5, 4e-5),
        measurement_noise=(3e-6, 3e-6, 2.42e-3),
        boundary_layer=(4e-4, 8e-3, 0.02),
        wheel_unit_rad_s=MONITOR_VOLT_RAD_S,
    ),
    "consistent": Tuning(
        process_noise=(1e-10, 4e-7, 1.3e-2), measurement_noise="sensors", boundary_layer=(4e-4, 8e-3, 2.0), wheel_drag=True
    ),
}


class ExtendedSettings(BaseModel):
    """What all filters of the extended family can be told."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    tuning: str | Tuning
    discretization: Literal["runge-kutta", "euler"] = "runge-kutta"

    @property
    def numbers(self) -> Tuning:
        """The tuning, by name or as given."""
        return TUNINGS[self.tuning] if isinstance(self.tuning, str) else self.tuning

    def law(self, boundary_layer: Array) -> GainLaw:
        """Gain of this filter."""
        return KalmanGain()


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


ObserverSettings = Annotated[Ekf | Mekf | Sif | NisSwitched, Field(discriminator="type")]


@dataclass(frozen=True, eq=False)
class Models:
    """Analytic models of the plant that a filter can be built on."""

    plain: ProcessModel  # as the paper writes it
    with_drag: ProcessModel  # knows the wheels' friction


class Observer(Protocol):
    """A filter as the loop sees it."""

    @property
    def space(self) -> StateSpace:
        """Error coordinates of its covariance."""
        ...

    def initial(self, measurement: Array) -> Belief:
        """Belief after the first reading, (trials, n)."""
        ...

    def step(self, belief: Belief, command: Array, measurement: Array, dt: float) -> Belief:
        """Belief after `dt` seconds of `command`, (trials, wheels), and a reading, (trials, n)."""
        ...


@dataclass(frozen=True, eq=False)
class Bank:
    """Observers of one kind, stepped as one; beliefs are (members, trials, ...)."""

    names: tuple[str, ...]
    filter: Observer
    thresholds: tuple[tuple[float, float] | None, ...]


def build_filter(settings: ObserverSettings, models: Models, sensors: SensorSettings, wheels: int) -> ExtendedFilter:
    """The filter that the settings stand for."""
    tuning = settings.numbers
    q, r, layer = tuning.scaled(sensors)
    multiplicative = isinstance(settings, Mekf)
    counts = [3 if multiplicative else 4, 3, wheels]
    # a rotation vector is twice the quaternion's vector part
    unit = np.array([4.0, 1.0, 1.0]) if multiplicative else np.ones(3)
    return ExtendedFilter(
        process=models.with_drag if tuning.wheel_drag else models.plain,
        process_noise=np.diag(np.repeat(unit * q, counts)),
        measurement_noise=np.diag(np.repeat(unit * r, counts)),
        prior=np.concatenate([IDENTITY, np.zeros(3 + wheels)]),
        prior_variance=np.repeat([1.0, 1.0, 1e4], counts),
        gain=settings.law(np.repeat(layer, counts)),
        space=Multiplicative() if multiplicative else Additive(),
        prediction=predict_euler if settings.discretization == "euler" else predict,
    )


def build_banks(observers: dict[str, ObserverSettings], models: Models, sensors: SensorSettings, wheels: int) -> tuple[Bank, ...]:
    """All observers of a scenario, those of one kind together."""
    groups: list[list[tuple[str, ExtendedFilter]]] = []
    for name, settings in observers.items():
        single = build_filter(settings, models, sensors, wheels)
        for group in groups:
            if stackable(group[0][1], single):
                group.append((name, single))
                break
        else:
            groups.append([(name, single)])
    return tuple(
        Bank(
            names=tuple(name for name, _ in group),
            filter=stack([single for _, single in group]),
            thresholds=tuple(single.gain.thresholds if isinstance(single.gain, SwitchedGain) else None for _, single in group),
        )
        for group in groups
    )
