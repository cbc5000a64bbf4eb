"""Observers of a scenario: their settings in a file."""

from __future__ import annotations

from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from estimation.adaptive_unscented import AdaptiveUnscentedFilter
from estimation.extended_kalman import ExtendedFilter, GainLaw, KalmanGain
from estimation.interacting_multiple_model import InteractingMultipleModel
from estimation.nis_switching import Fading, SwitchedGain, Windowed
from estimation.particle import ParticleFilter
from estimation.proposals import PROPOSALS, ConstantNoise, ProcessNoise
from estimation.resampling import SCHEMES
from estimation.sliding_innovation import SlidingGain
from estimation.state_space import Additive, Multiplicative, Signed, StateSpace
from estimation.unscented import UnscentedFilter, euler
from models.attitude.quaternion import IDENTITY
from models.dynamics.direction_measurement import DirectionsOfAttitude
from models.dynamics.measurement import MeasurementModel, WholeState
from models.dynamics.process import predict, predict_euler, runge_kutta
from models.dynamics.stacked_measurement import PartOfReading
from models.dynamics.state_layout import MOTION
from models.dynamics.vector_part_measurement import VectorPart
from models.dynamics.wheel_faults import WheelFault, lost_axis
from models.sections import NonNegative, Positive, Section, Share
from sim.estimators import learning_settings as _  # noqa: F401  # whose kind joins the register
from sim.estimators.fading import FadingSettings, NoFadingSettings
from sim.estimators.observer import ObserverBase, Place
from sim.estimators.particle_settings import MIXED, ProposalName, ResampleEvery
from sim.sensors.distribution import NoiseDistribution, NormalNoise

Array = NDArray[np.floating]

Measured = Literal["quaternion", "vector", "directions"]  # what a filter takes of a reading's attitude
Directions = Annotated[tuple[tuple[float, float, float], ...], Field(min_length=1)]

MEASURED = "all of the reading's attitude, its vector part as printed, or how known directions appear by it"
TWO = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))


class Parts(NamedTuple):
    """What a filter with one model is made of."""

    common: dict[str, Any]  # arguments of every filter
    noise: ProcessNoise  # at the end of a step, for filters that can be told more than a matrix
    whole: ProcessNoise  # of the step, for filters that add all of it at its end
    layer: Array  # of a sliding gain
    explicit: bool  # Euler steps


class ExtendedSettings(ObserverBase):
    """What all filters with one model can be told."""

    initial_rate_rad_s: Positive = Field(1.0, description="deviation of each rate that the first reading does not hold")
    initial_attitude: Positive = Field(1.0, description="deviation of each error of an attitude that it does not hold")
    discretization: Literal["runge-kutta", "euler"] = "runge-kutta"

    @property
    def by_rotation(self) -> bool:
        """Whether attitude errors are a rotation vector."""
        return False

    @property
    def by_vector(self) -> bool:
        """Whether the vector part alone is taken of a reading's attitude."""
        return False

    @property
    def by_directions(self) -> Array | None:
        """Directions of N that alone are taken of a reading's attitude, (k, 3); None: all of it."""
        return None

    def law(self, boundary_layer: Array) -> GainLaw:
        """Gain of this filter."""
        return KalmanGain()

    def parts(self, place: Place, fault: WheelFault | None) -> Parts:
        """What the filter is made of, believing in a fault of the wheels or none."""
        models, tuning = place.models, self.numbers
        q, r, layer = tuning.scaled(place.sensors, place.tick_s)
        counts = [3 if self.by_rotation else 4, 3, place.wheels if models.speeds_are_states else 0]
        unit = np.array([4.0, 1.0, 1.0]) if self.by_rotation else np.ones(3)  # a rotation vector is twice the quaternion's vector part
        space: StateSpace = Multiplicative() if self.by_rotation else Signed() if self.by_vector else Additive()
        noise_of_reading = np.diag(np.repeat(unit * r, counts))
        read: MeasurementModel = VectorPart(noise_of_reading) if self.by_vector else WholeState(noise_of_reading, space.attitude)
        if self.by_directions is not None:
            read = DirectionsOfAttitude(self.by_directions, 4.0 * r[0] * np.eye(3))
        elif not models.speeds_are_states:
            read = PartOfReading(read, MOTION)  # wheel speeds are inputs
        process = np.diag(np.repeat(unit * q, counts))
        before = 0.5 * process if tuning.by_torques else 0.0
        common: dict[str, Any] = {
            "process": models.believing(tuning.wheel_drag, fault),
            "process_noise": process - before,
            "process_noise_before": before,
            "measurement_noise": None,
            "measurement": read,
            "prior": np.concatenate([IDENTITY, np.zeros(sum(counts[1:]))]),
            "prior_variance": np.repeat([self.initial_attitude**2, self.initial_rate_rad_s**2, 1e4], counts),
            "space": space,
        }
        end, whole = ((tuning.matched.law if tuning.matched else ConstantNoise.of(q)) for q in (process - before, process))
        return Parts(common, end, whole, np.repeat(layer, counts), self.discretization == "euler")

    def build(self, place: Place, fault: WheelFault | None = None) -> Any:
        """An extended filter with this gain."""
        parts = self.parts(place, fault)
        return ExtendedFilter(**parts.common, gain=self.law(parts.layer), prediction=predict_euler if parts.explicit else predict)


class Ekf(ExtendedSettings):
    """Extended Kalman filter, the quaternion's errors by components."""

    type: Literal["ekf"]


class Mekf(ExtendedSettings):
    """Multiplicative extended Kalman filter, attitude errors as a rotation."""

    type: Literal["mekf"]

    @property
    def by_rotation(self) -> bool:
        """They are."""
        return True


class Sif(ExtendedSettings):
    """Extended sliding innovation filter."""

    type: Literal["sif"]

    def law(self, boundary_layer: Array) -> GainLaw:
        """Saturated gain."""
        return SlidingGain(boundary_layer)


class NisSwitched(ExtendedSettings):
    """EKF that becomes a sliding innovation filter while the smoothed NIS says that there is a fault."""

    declares: ClassVar[bool] = True

    type: Literal["nis-switched"]
    smoothing: Literal["windowed", "fading"]
    window: Annotated[int, Field(ge=1, le=1_000_000)] = 45
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
    outlier_tail: Annotated[float, Field(ge=0, lt=1)] = Field(
        0.0, description="a reading less likely than that is not believed; 0: all are"
    )

    @property
    def by_rotation(self) -> bool:
        """Whether attitude errors are a rotation vector."""
        return self.coordinates == "multiplicative"

    def build(self, place: Place, fault: WheelFault | None = None) -> Any:
        """An unscented filter."""
        return self.unscented(self.parts(place, fault))

    def unscented(self, parts: Parts) -> UnscentedFilter:
        """The filter without a fading memory."""
        integrate = euler if parts.explicit else runge_kutta
        return UnscentedFilter(
            **parts.common, alpha=self.alpha, beta=self.beta, kappa=self.kappa, integrate=integrate, outlier_tail=self.outlier_tail
        )


class Aukf(Ukf):
    """Adaptive unscented Kalman filter: with a fading memory."""

    type: Literal["aukf"]  # type: ignore[assignment]
    coordinates: Literal["additive", "multiplicative"] = "additive"
    fading: FadingSettings = NoFadingSettings()
    measured: Measured = Field("quaternion", description=MEASURED)
    directions: Directions = Field(TWO, description='of N, for measured = "directions"; from it the filter begins at N, not at a reading')

    def check(self, where: str, wheels: int) -> None:
        """Raise ValueError if the coordinates are those of a rotation, which has neither a vector part nor that process noise."""
        super().check(where, wheels)
        if self.coordinates == "multiplicative" and (self.measured == "vector" or self.numbers.matched):
            raise ValueError(f"{where}.coordinates: measured = 'vector' and matched process noise need 'additive'")

    @property
    def by_vector(self) -> bool:
        """Whether the vector part alone is taken of a reading's attitude."""
        return self.measured == "vector"

    @property
    def by_directions(self) -> Array | None:
        """Directions of N that alone are taken of a reading's attitude, (k, 3); None: all of it."""
        return _unit(self.directions) if self.measured == "directions" else None

    def build(self, place: Place, fault: WheelFault | None = None) -> Any:
        """An unscented filter with a fading memory."""
        parts = self.parts(place, fault)
        return AdaptiveUnscentedFilter(self.unscented(parts), parts.noise, self.fading.law)


class Pf(ExtendedSettings):
    """Particle filter."""

    type: Literal["pf"]
    particles: Annotated[int, Field(ge=2, le=100_000)] = 100
    proposal: ProposalName = Field("optimal", description="importance density")
    resampling: Literal["multinomial", "residual", "stratified", "systematic"] = "systematic"
    threshold: Share = Field(0.5, description="effective share of the particles below which they are resampled")
    resample_every: ResampleEvery = 0
    roughening: NonNegative = Field(0.0, description="K of Gordon, Salmond & Smith (1993); 0: none")
    measured: Measured = Field("quaternion", description=MEASURED)
    directions: Directions = Field(TWO, description='of N, for measured = "directions"')
    likelihood: NoiseDistribution = Field(NormalNoise(), description="how it takes readings to be distributed, with the covariance R")
    start: Literal["reading", "mirrored", "anywhere"] = Field(
        "reading", description="particles around the first reading, half of them with the other q4, or attitudes evenly everywhere"
    )
    annealing: Annotated[float, Field(ge=1, le=1e9)] = Field(1.0, description="how much larger a reading's deviation is taken at first")
    annealing_s: Positive = Field(10.0, description="after how long it is taken as it is, falling geometrically")

    def check(self, where: str, wheels: int) -> None:
        """Raise ValueError if a mixture meets a reading whose density it has not in closed form."""
        super().check(where, wheels)
        if self.measured == "directions" and self.likelihood.mixture is not None and self.proposal != "bootstrap":
            raise ValueError(f"{where}.proposal: directions and a likelihood that is not normal need 'bootstrap'")
        if self.measured == "directions" and self.proposal == "likelihood":
            raise ValueError(f"{where}.proposal: directions say more than an attitude has components, which 'likelihood' cannot draw")
        if self.likelihood.mixture is not None and self.proposal == "likelihood":
            raise ValueError(f"{where}.proposal: {MIXED}")

    @property
    def by_vector(self) -> bool:
        """Whether the vector part alone is taken of a reading's attitude."""
        return self.measured == "vector"

    @property
    def by_directions(self) -> Array | None:
        """Directions of N that alone are taken of a reading's attitude, (k, 3); None: all of it."""
        return _unit(self.directions) if self.measured == "directions" else None

    def build(self, place: Place, fault: WheelFault | None = None) -> Any:
        """A particle filter; its random numbers are handed in."""
        parts = self.parts(place, fault)
        common = {name: part for name, part in parts.common.items() if name != "process_noise_before"}
        return ParticleFilter(
            **common | {"process_noise": parts.whole},
            particles=self.particles,
            proposal=PROPOSALS[self.proposal],
            resampling=SCHEMES[self.resampling],
            threshold=self.threshold,
            every=self.resample_every,
            roughening=self.roughening,
            integrate=euler if parts.explicit else runge_kutta,
            mixture=self.likelihood.mixture,
            start=self.start,
            annealing=self.annealing,
            annealing_s=self.annealing_s,
        )


def _unit(directions: Directions) -> Array:
    """Of length one, (k, 3)."""
    given = np.array(directions)
    return given / np.linalg.norm(given, axis=-1, keepdims=True)


class WheelMode(Section):
    """What is wrong with a wheel in a mode of operation: T_a = T_c + sigma (T_i - T_c)."""

    kind: Literal["float", "lock", "hard-over", "effectiveness"]
    wheel: Annotated[int, Field(ge=1)]
    torque_nm: float = Field(0.0, description="of a hard-over")
    remaining: Share = Field(0.5, description="share of the torque, of an effectiveness loss")


FilterSettings = Annotated[Ekf | Mekf | Sif | Ukf, Field(discriminator="type")]


class Imm(ObserverBase):
    """Interacting multiple model: one filter for each mode of operation of the wheels, the first mode being the healthy one."""

    declares: ClassVar[bool] = True

    type: Literal["imm"]
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

    @property
    def mode_settings(self) -> tuple[tuple[WheelMode, ...], ...]:
        """The modes."""
        return self.modes

    def build(self, place: Place) -> Any:
        """One filter for each mode, mixed."""
        members = tuple(self.filter.build(place, fault) for fault in self.faults(place.wheels))
        limits = (self.declare_above, self.withdraw_below)
        return InteractingMultipleModel(members, self.matrix, self.start, self.floor, *limits)

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

    def warnings(self, where: str, wheel_axes: Array, tick_s: float) -> list[str]:
        """A line for each mode in which the wheels cannot turn the body about some axis, and what every observer says."""
        lines = super().warnings(where, wheel_axes, tick_s)
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


if TYPE_CHECKING:
    ObserverSettings = ObserverBase
else:
    ObserverSettings = Annotated[reduce(or_, ObserverBase.kinds), Field(discriminator="type")]
