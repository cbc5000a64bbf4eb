"""What the sensors say of the truth: noise, bias, resolution, range, late and missing readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field

from models.attitude import quaternion
from models.dynamics.state_layout import ATTITUDE, RATE, WHEELS
from models.sections import NonNegative, Positive, Section
from sim import randomness
from sim.faults.effects import AGE, BIAS, MISSING, NOISE
from sim.faults.timeline import Timeline
from sim.parts import Truth
from sim.randomness import Stream
from sim.sensors.distribution import NoiseDistribution, NormalNoise
from sim.units import RPM

Array = NDArray[np.floating]


class SensorSettings(Section):
    """Attitude and rate from the IMU, wheel speeds from the drives' monitor outputs, all read once a control tick."""

    model_config = ConfigDict(json_schema_extra=lambda schema: schema["properties"].update({"set": {"type": "string"}}))  # in files

    attitude_noise_rad: NonNegative = Field(4e-4, description="standard deviation of a small rotation about each body axis")
    quaternion_noise: NonNegative = Field(0.0, description="standard deviation added to each component of q, which is then scaled to one")
    attitude_resolution_rad: NonNegative = Field(0.0, description="least step of a reading's rotation vector from N; 0: none")
    gyro: bool = Field(True, description="whether there is a rate gyro; without one rates are never read")
    gyro_noise_rad_s: NonNegative = Field(1.7320508e-3, description="standard deviation of a reading, each axis")
    gyro_bias_rad_s: NonNegative = Field(4.8e-5, description="standard deviation of the bias at the start, each axis")
    gyro_bias_walk_rad_s_sqrt_s: NonNegative = Field(2e-6, description="random walk of the bias")
    gyro_resolution_rad_s: NonNegative = Field(3.5e-4, description="least step of a reading; 0: none")
    gyro_range_rad_s: Positive = Field(34.9, description="greatest reading")
    wheel_noise_rad_s: NonNegative = Field(0.5, description="standard deviation of a wheel speed reading")
    wheel_full_scale_rad_s: Positive = Field(8000 * RPM, description="greatest wheel speed that can be read")
    wheel_bits: Annotated[int, Field(ge=0, le=24)] = Field(12, description="resolution over the whole range; 0: none")
    latency_s: NonNegative = Field(0.0, description="age of what a reading describes when it is read")
    jitter_s: NonNegative = Field(0.0, description="a reading is older than that by up to this much, evenly distributed")
    attitude_period_s: NonNegative = Field(0.0, description="from one reading to the next, a whole number of ticks; 0: every tick")
    gyro_period_s: NonNegative = Field(0.0, description="the same of the rate gyro")
    wheel_period_s: NonNegative = Field(0.0, description="the same of the wheel speeds")
    dropout_probability: Annotated[float, Field(ge=0, lt=1)] = Field(0.0, description="share of readings, of each sensor, that are missing")
    distribution: NoiseDistribution = Field(
        NormalNoise(), description="of all noise of a reading, whose deviations above are then its scale"
    )

    @property
    def wheel_step_rad_s(self) -> float:
        """Least step of a wheel speed reading; 0: none."""
        return 2.0 * self.wheel_full_scale_rad_s / 2**self.wheel_bits if self.wheel_bits else 0.0

    @property
    def periods_s(self) -> dict[str, float]:
        """Of attitude, gyro and wheels, by key; 0: every tick."""
        return {key: getattr(self, key) for key in ("attitude_period_s", "gyro_period_s", "wheel_period_s")}

    @property
    def variances(self) -> tuple[float, float, float]:
        """Variance of a reading: small rotation about an axis (rad2), rate, wheel speed (rad2/s2), with resolution and tails."""
        wider = self.distribution.variance
        return (
            wider * (self.attitude_noise_rad**2 + 4.0 * self.quaternion_noise**2) + self.attitude_resolution_rad**2 / 12.0,
            wider * self.gyro_noise_rad_s**2 + self.gyro_resolution_rad_s**2 / 12.0,
            wider * self.wheel_noise_rad_s**2 + self.wheel_step_rad_s**2 / 12.0,
        )


# `bench`: what a well set-up NACS would read. `paper`: the variances that the paper takes for its R, as if they were the sensors' own.
# `wmap`: R of Hill et al. (2021, table I) as white noise, wheel speeds exact.
# `tracker`: the attitude alone, with the noise of Rososhansky (2017, sec. 3.3) on every component of the quaternion.
# `vn100`: datasheet densities over a 5 Hz bandwidth. Sources in docs/parameters.md.
SENSOR_SETS: dict[str, SensorSettings] = {
    "bench": SensorSettings(),
    "paper": SensorSettings(attitude_noise_rad=2 * 3e-6**0.5, gyro_noise_rad_s=3e-6**0.5, wheel_noise_rad_s=2.42e-3**0.5 * 2000 * RPM / 4),
    "vn100": SensorSettings(attitude_noise_rad=4e-4, gyro_noise_rad_s=6.1e-5 * 5**0.5, wheel_noise_rad_s=0.5),
    "wmap": SensorSettings(
        attitude_noise_rad=2 * 5e-7**0.5, gyro_noise_rad_s=5e-7**0.5, gyro_bias_rad_s=0, gyro_bias_walk_rad_s_sqrt_s=0,
        gyro_resolution_rad_s=0, wheel_noise_rad_s=0, wheel_bits=0, wheel_full_scale_rad_s=1e4,
    ),
    "ideal": SensorSettings(
        attitude_noise_rad=0, gyro_noise_rad_s=0, gyro_bias_rad_s=0, gyro_bias_walk_rad_s_sqrt_s=0,
        gyro_resolution_rad_s=0, wheel_noise_rad_s=0, wheel_bits=0,
    ),
    "tracker": SensorSettings(attitude_noise_rad=0, quaternion_noise=1e-4, gyro=False),
}  # fmt: skip


class SensorArrays(NamedTuple):
    """Settings of each trial, (trials, 1)."""

    attitude_noise_rad: Array
    quaternion_noise: Array
    attitude_resolution_rad: Array
    gyro: Array  # one or zero
    gyro_noise_rad_s: Array
    gyro_bias_rad_s: Array
    gyro_bias_walk_rad_s_sqrt_s: Array
    gyro_resolution_rad_s: Array
    gyro_range_rad_s: Array
    wheel_noise_rad_s: Array
    wheel_full_scale_rad_s: Array
    wheel_step_rad_s: Array
    latency_s: Array
    jitter_s: Array
    dropout_probability: Array
    attitude_period_s: Array
    gyro_period_s: Array
    wheel_period_s: Array

    @classmethod
    def of(cls, settings: Sequence[SensorSettings]) -> SensorArrays:
        """One row a trial."""
        return cls(*(np.array([[getattr(one, name)] for one in settings], dtype=float) for name in cls._fields))


class Noise(NamedTuple):
    """Everything random of a run's readings, drawn before it starts; (ticks, trials, ...)."""

    attitude: Array  # (..., 3) standard normal
    gyro: Array  # (..., 3) standard normal
    gyro_bias: Array  # (..., 3) rad/s
    wheel: Array  # (..., wheels) standard normal
    age: Array | None  # (ticks, trials) s
    missing: NDArray[np.bool_] | None  # (..., 3): attitude, gyro, wheels
    quaternion: Array | None = None  # (..., 4) standard normal
    scale: Array | None = None  # (ticks, trials, 3) by which attitude, gyro and wheels are noisier than normal


def draw_noise(
    settings: SensorArrays,
    seed: int,
    trials: randomness.Trials,
    ticks: int,
    wheels: int,
    dt: float,
    distributions: Sequence[NoiseDistribution] = (),
) -> Noise:
    """Draw a run's noise: trial i gets the same numbers whatever the batch; `distributions` are those of the trials, normal if empty."""
    bias = randomness.normals(seed, trials, Stream.GYRO_BIAS, ticks, 3)
    bias[0] *= settings.gyro_bias_rad_s
    bias[1:] *= settings.gyro_bias_walk_rad_s_sqrt_s * np.sqrt(dt)
    age = None
    if settings.latency_s.any() or settings.jitter_s.any():
        age = settings.latency_s[:, 0] + settings.jitter_s[:, 0] * randomness.uniforms(seed, trials, Stream.TIMING, ticks, 1)[..., 0]
    missing, quaternion = None, None
    if settings.quaternion_noise.any():
        quaternion = randomness.normals(seed, trials, Stream.QUATERNION, ticks, 4)
    if settings.dropout_probability.any():
        missing = randomness.uniforms(seed, trials, Stream.DROPOUT, ticks, 3) < settings.dropout_probability
    return Noise(
        attitude=randomness.normals(seed, trials, Stream.ATTITUDE, ticks, 3),
        gyro=randomness.normals(seed, trials, Stream.GYRO, ticks, 3),
        gyro_bias=np.cumsum(bias, axis=0),
        wheel=randomness.normals(seed, trials, Stream.WHEEL, ticks, wheels),
        age=age,
        missing=missing,
        quaternion=quaternion,
        scale=_scales(distributions, seed, trials, ticks),
    )


def _scales(distributions: Sequence[NoiseDistribution], seed: int, trials: randomness.Trials, ticks: int) -> Array | None:
    """By which attitude, gyro and wheels are noisier than normal, (ticks, trials, 3); None where all are normal."""
    if all(isinstance(one, NormalNoise) for one in distributions):
        return None
    uniforms = randomness.uniforms(seed, trials, Stream.TAILS, ticks, 3)
    return np.stack([one.scales(uniforms[:, i]) for i, one in enumerate(distributions)], axis=1)


@dataclass(frozen=True, eq=False)
class Sensors:
    """The sensors of a run: settings, noise and the faults that touch them."""

    settings: SensorArrays
    noise: Noise
    faults: Timeline
    dt: float

    @cached_property
    def _between(self) -> NDArray[np.bool_] | None:
        """Whether each sensor is between two readings, (ticks, trials, 3); None if all read at every tick."""
        periods = np.concatenate([self.settings.attitude_period_s, self.settings.gyro_period_s, self.settings.wheel_period_s], axis=-1)
        if not periods.any():
            return None
        every = np.maximum(1, np.round(periods / self.dt).astype(int))
        return np.arange(len(self.noise.attitude))[:, None, None] % every != 0

    @cached_property
    def _due(self) -> NDArray[np.bool_] | None:
        """Whether each component is read at all at a tick, (ticks, trials, n), if nothing fails; None: always."""
        between, without_gyro = self._between, self.settings.gyro == 0.0
        if between is None and not without_gyro.any():
            return None
        silent = (without_gyro & np.array([False, True, False])) | (False if between is None else between)
        silent = np.broadcast_to(silent, (*self.noise.attitude.shape[:2], 3))
        return ~np.repeat(silent, [4, 3, self.noise.wheel.shape[-1]], axis=-1)

    def due(self, tick: int) -> dict[str, NDArray[np.bool_]]:
        """Which components of a reading are due at a tick, (trials, n), to be recorded if they are not all at every one."""
        return {} if self._due is None else {"due": self._due[tick]}

    def rest(self) -> Array:
        """At rest in N, until something has been read; (trials, n)."""
        wheels = self.noise.wheel.shape[-1]
        return np.tile(np.concatenate([quaternion.IDENTITY, np.zeros(3 + wheels)]), (self.noise.attitude.shape[1], 1))

    def read(self, tick: int, truth: Truth, past: Array) -> Array:
        """Reading [q, omega, wheel speeds] at a tick, (trials, n); a missing component is NaN.

        Args:
          tick: number of the control tick.
          truth: the present.
          past: true states of ticks 0 to `tick`, (ticks, trials, n); late readings look back into it.
        """
        s, noise, faults = self.settings, self.noise, self.faults
        state = truth.state
        late = faults.at(AGE, tick)
        age = _sum(None if noise.age is None else noise.age[tick], None if late is None else late[:, 0])
        if age is not None:
            state = _look_back(past, tick, age / self.dt)
        sigma = [s.attitude_noise_rad, s.gyro_noise_rad_s, s.wheel_noise_rad_s, s.quaternion_noise]  # (trials, 1) each
        if (factor := faults.at(NOISE, tick)) is not None:
            sigma = [sigma[i] * factor[:, which, None] for i, which in enumerate((0, 1, 2, 0))]
        if noise.scale is not None:
            sigma = [sigma[i] * noise.scale[tick][:, which, None] for i, which in enumerate((0, 1, 2, 0))]
        turn = sigma[0] * noise.attitude[tick]
        rate = state[:, RATE] + noise.gyro_bias[tick] + sigma[1] * noise.gyro[tick]
        wheel = state[:, WHEELS] + sigma[2] * noise.wheel[tick]
        if (bias := faults.at(BIAS, tick)) is not None:
            turn, rate, wheel = turn + bias[:, :3], rate + bias[:, 3:6], wheel + bias[:, 6:]
        attitude = quaternion.multiply(quaternion.from_rotation_vector(turn), state[:, ATTITUDE])
        if noise.quaternion is not None:
            noisy = quaternion.normalize(attitude + sigma[3] * noise.quaternion[tick])
            attitude = np.where(s.quaternion_noise > 0.0, noisy, attitude)
        if s.attitude_resolution_rad.any():
            stepped = quaternion.from_rotation_vector(_quantize(quaternion.to_rotation_vector(attitude), s.attitude_resolution_rad))
            attitude = np.where(s.attitude_resolution_rad > 0.0, stepped, attitude)
        rate = np.clip(_quantize(rate, s.gyro_resolution_rad_s), -s.gyro_range_rad_s, s.gyro_range_rad_s)
        wheel = np.clip(_quantize(wheel, s.wheel_step_rad_s), -s.wheel_full_scale_rad_s, s.wheel_full_scale_rad_s)
        if not s.gyro.all():
            rate = np.where(s.gyro > 0.0, rate, np.nan)
        reading = np.concatenate([attitude, rate, wheel], axis=-1)
        drawn, between = noise.missing, self._between
        for missing in (None if drawn is None else drawn[tick], faults.at(MISSING, tick), None if between is None else between[tick]):
            if missing is not None and missing.any():
                lost = np.repeat(missing, [4, 3, wheel.shape[-1]], axis=-1)
                reading = np.where(lost, np.nan, reading)
        return reading


def _quantize(value: Array, step: Array) -> Array:
    """Nearest multiple of `step`, (trials, 1); zero: as it is."""
    return np.where(step > 0.0, step * np.round(value / np.where(step > 0.0, step, 1.0)), value)


def _sum(one: Array | None, other: Array | None) -> Array | None:
    if one is None or other is None:
        return one if other is None else other
    return one + other


def _look_back(past: Array, tick: int, age_ticks: Array) -> Array:
    """State (trials, n) that was so `age_ticks` (trials,) before `tick`, between ticks by interpolation; the start before the start."""
    when = np.broadcast_to(np.maximum(tick - age_ticks, 0.0), past.shape[1])
    before = np.floor(when).astype(int)
    share = (when - before)[:, None]
    trial = np.arange(past.shape[1])
    old, new = past[before, trial], past[np.minimum(before + 1, tick), trial]
    turn = share * quaternion.error(new[:, ATTITUDE], old[:, ATTITUDE])
    attitude = quaternion.multiply(quaternion.from_rotation_vector(turn), old[:, ATTITUDE])
    return np.concatenate([attitude, old[:, 4:] + share * (new[:, 4:] - old[:, 4:])], axis=-1)
