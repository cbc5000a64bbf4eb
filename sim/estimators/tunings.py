"""Noise that a filter expects: tuning sets by name, or as a scenario gives them."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from estimation.proposals import MatchedNoise
from models.sections import NonNegative, Positive, Section, Share
from sim.sensors.sensors import SensorSettings
from sim.units import RPM

Array = NDArray[np.floating]

Triple = tuple[Positive, Positive, Positive]

LEAST_VARIANCE = 1e-16  # of a reading, so that an innovation covariance can be inverted in double precision


class MatchedSettings(Section):
    """Process noise of rates that are not read, as large as what a wrong inertia does at the estimated rate; a deviation each tick.

    hypot(floor, slope max(|omega|^2, e^(-t / fade))) of each rate; the other states have deviations of their own.
    """

    attitude: NonNegative = Field(1e-4, description="of each quaternion component; a particle filter needs no less than the reading's")
    floor_rad_s: Positive = 2e-3
    slope_s: NonNegative = Field(1e-2, description="per square of the rate")
    fade_s: Positive = Field(1.0, description="how long the first estimate of the rate is not believed")
    wheel_rad_s: NonNegative = Field(0.0, description="of a wheel speed that is a state")

    @property
    def law(self) -> MatchedNoise:
        """As filters know it."""
        return MatchedNoise(self.attitude, self.floor_rad_s, self.slope_s, self.fade_s, self.wheel_rad_s)


class Tuning(Section):
    """Noise that a filter expects, each as [quaternion component, body rate (rad/s), wheel speed]."""

    process_noise: Triple = Field(description="variances added in a tick, Q")
    tick_s: Positive | None = Field(None, description="tick that `process_noise` is meant for; none: any")
    by_torques: bool = Field(
        False, description="Q is what torques do in a tick, half added before and half after, and at another tick what they do then"
    )
    torque_correlation_s: NonNegative = Field(0.004, description="time below which these torques no longer count as white")
    held_share: Share = Field(0.17, description="of the rates' variance, what torques do that hold over a tick")
    measurement_noise: Literal["sensors"] | Triple = Field(description="variances of a reading, R, or those of the simulated sensors")
    boundary_layer: Triple = Field((4e-4, 8e-3, 2.0), description="delta of the sliding innovation gain")
    matched: MatchedSettings | None = Field(None, description="of the filters aukf and pf in place of `process_noise`")
    wheel_unit_rad_s: Positive = Field(1.0, description="wheel speed in which the wheels' entries are counted")
    wheel_drag: bool = Field(False, description="the model knows the wheels' friction, as a spin-down test would identify it")

    def over(self, dt: float) -> Array:
        """How much more Q is at a tick of `dt` seconds than at its own, [attitude, rate, wheel speed].

        A white torque adds variance to the rate in proportion to the time, one that is correlated over tau with the square of short times,
        dt^2 / (dt + tau), one that holds over a tick always so, as a drive's error does to the wheel's speed.
        """
        if self.tick_s is None or not self.by_torques:
            return np.ones(3)
        longer, tau, held = dt / self.tick_s, self.torque_correlation_s, self.held_share
        white = longer**2 * (self.tick_s + tau) / (dt + tau)
        return np.array([longer, white * (1.0 - held + held * longer), longer**2])

    def warnings(self, where: str, dt: float) -> list[str]:
        """A line if Q is added as it is at a tick that it is not meant for."""
        if self.tick_s is None or self.by_torques or abs(dt / self.tick_s - 1.0) < 1e-3:
            return []
        return [f"{where}: its noises are those of a tick of {self.tick_s:g} s and are added at every tick of {dt:g} s as they are"]

    def scaled(self, sensors: SensorSettings, dt: float) -> tuple[Array, Array, Array]:
        """Q of a tick of `dt` seconds, R (variances) and delta in rad/s: (3,) each."""
        scale = self.wheel_unit_rad_s
        variance, deviation = np.array([1.0, 1.0, scale**2]), np.array([1.0, 1.0, scale])
        if self.measurement_noise == "sensors":
            rotation, rate, wheel = sensors.variances
            measurement = np.maximum([rotation / 4.0, rate, wheel], LEAST_VARIANCE)  # half a small rotation is a quaternion component
        else:
            measurement = np.array(self.measurement_noise) * variance
        return np.array(self.process_noise) * variance * self.over(dt), measurement, np.array(self.boundary_layer) * deviation


# 1 V of the drives' monitor output if 4 V are 2000 rpm (the scale can be configured and is not printed): the reading with which the
# paper's Q and R give the detection that it reports. It is a unit for those numbers; the twin's sensors read farther.
MONITOR_VOLT_RAD_S = 2000 * RPM / 4.0

# `paper`: McCafferty-Leroux et al. (2024, sec. 5), wheels in volts (docs/errata.md).
# `wmap`: Hill et al. (2021, table I); wheel speeds are no states there.
# `as-printed`: Rososhansky (2017, sec. 3.3), deviations of 1e-3 in all seven states a step and of 1e-4 in the reading.
# `matched`: for a body whose rates are not read, of what its wrong inertia does; its `process_noise` is that of a body nearly at rest.
# `consistent`: R of the simulated sensors, Q of the mismatch between plant and analytic model (docs/consistency.md).
TUNINGS: dict[str, Tuning] = {
    "paper": Tuning(
        process_noise=(4e-5, 4e-5, 4e-5),
        measurement_noise=(3e-6, 3e-6, 2.42e-3),
        boundary_layer=(4e-4, 8e-3, 0.02),
        wheel_unit_rad_s=MONITOR_VOLT_RAD_S,
        tick_s=0.1,
    ),
    "consistent": Tuning(
        process_noise=(1e-10, 4.4e-7, 1.35e-2),
        measurement_noise="sensors",
        boundary_layer=(4e-4, 8e-3, 2.0),
        wheel_drag=True,
        tick_s=0.1,
        by_torques=True,
    ),
    "as-printed": Tuning(process_noise=(1e-6, 1e-6, 1e-6), measurement_noise=(1e-8, 1e-8, 1e-8), tick_s=0.01),
    "matched": Tuning(process_noise=(1e-8, 4e-6, 1.3e-2), measurement_noise="sensors", matched=MatchedSettings()),
    "wmap": Tuning(process_noise=(1e-7, 1e-7, 1e-7), measurement_noise=(5e-7, 5e-7, 5e-7), boundary_layer=(4e-4, 8e-3, 2.0), tick_s=0.1),
}
