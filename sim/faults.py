"""Faults as timed events: what goes wrong, with which part, when and how much, in a file and in every trial."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, field_validator

from models.inertia import tensor
from sim.draws import Draw, Number
from sim.randomness import Stream, Trials, generator

Array = NDArray[np.floating]
Flags = NDArray[np.bool_]

SENSORS = ("attitude", "gyro", "wheels")


def _not_negative(draw: Draw) -> Draw:
    if draw.bounds()[0] < 0:
        raise ValueError(f"can be {draw.bounds()[0]:g}; must not be negative")
    return draw


NotNegative = Annotated[Number, AfterValidator(_not_negative)]
Wheel = Literal["all"] | Annotated[int, Field(ge=1)]
Sensor = Literal["attitude", "gyro", "wheels", "all"]
Axis = Literal["x", "y", "z"]


class Event(BaseModel):
    """When a fault begins and how long it lasts; both may be drawn anew in every trial.

    Faults may overlap; where two say different things of one wheel or of the inertia, the one later in the file is heard.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    start_s: NotNegative
    duration_s: NotNegative


class Float(Event):
    """A wheel without power: its drive gives no torque, it coasts."""

    kind: Literal["float"]
    wheel: Wheel


class Effectiveness(Event):
    """A drive gives only a share of the torque that it is told."""

    kind: Literal["effectiveness"]
    wheel: Wheel
    remaining: NotNegative


class ConstantOutput(Event):
    """A drive gives a constant torque whatever it is told."""

    kind: Literal["constant-output"]
    wheel: Wheel
    torque_nm: Number


class Lock(Event):
    """A wheel seizes: its bearing takes any torque."""

    kind: Literal["lock"]
    wheel: Wheel


class NoCommand(Event):
    """No command reaches any drive."""

    kind: Literal["no-command"]


class ExternalTorque(Event):
    """A push: a torque on the body, constant in B, about a given axis or any axis in the plate's plane ('planar')."""

    kind: Literal["external-torque"]
    torque_nm: Number
    direction: Literal["planar"] | tuple[float, float, float] = "planar"

    @field_validator("direction")
    @classmethod
    def _points_somewhere(cls, direction: str | tuple[float, float, float]) -> str | tuple[float, float, float]:
        if not isinstance(direction, str) and not np.any(direction):
            raise ValueError("is zero; give an axis in B or 'planar'")
        return direction


class BodyTorque(Event):
    """The torque on a body without wheels is constant about an axis, whatever the command."""

    kind: Literal["body-torque"]
    axis: Axis
    torque_nm: Number


class PeriodicTorque(Event):
    """A disturbance a [sin pt, cos pt, sin 2pt] in B, t since the start of the run (Rososhansky 2017, sec. 3.3)."""

    kind: Literal["periodic-torque"]
    amplitude_nm: Number
    pulsation_rad_s: Annotated[float, Field(gt=0)] = Field(1.0, description="p")


class UniformTorque(Event):
    """A disturbance about each body axis that is drawn anew at every tick, uniform between -a and a."""

    kind: Literal["uniform-torque"]
    amplitude_nm: NotNegative


class InertiaChange(Event):
    """The whole gets another inertia (about the centre of rotation) and centre of mass; the rate is kept."""

    kind: Literal["inertia"]
    inertia_kg_m2: tuple[float, float, float, float, float, float]
    centre_of_mass_um: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def properties(self) -> WholeProperties:
        """In SI units."""
        return WholeProperties(tensor(self.inertia_kg_m2), 1e-6 * np.array(self.centre_of_mass_um))


class NoiseChange(Event):
    """A sensor's noise grows by a factor."""

    kind: Literal["noise"]
    sensor: Sensor
    factor: NotNegative


class Bias(Event):
    """A sensor reads too much, by the same on each axis (rad, rad/s)."""

    kind: Literal["bias"]
    sensor: Sensor
    size: Number


class DropOut(Event):
    """A sensor says nothing."""

    kind: Literal["drop-out"]
    sensor: Sensor


class Delay(Event):
    """All readings come later."""

    kind: Literal["delay"]
    delay_s: NotNegative


Fault = Annotated[
    Float
    | Effectiveness
    | ConstantOutput
    | Lock
    | NoCommand
    | BodyTorque
    | ExternalTorque
    | PeriodicTorque
    | UniformTorque
    | InertiaChange
    | NoiseChange
    | Bias
    | DropOut
    | Delay,
    Field(discriminator="kind"),
]


class Occurrence(NamedTuple):
    """One fault as it happens in one trial."""

    trial: int
    start_tick: int
    end_tick: int
    kind: str
    text: str


class WholeProperties(NamedTuple):
    """What a trial's whole becomes."""

    inertia: Array  # (3, 3) kg m2 about the centre of rotation
    centre_of_mass: Array  # (3,) m


@dataclass(frozen=True, eq=False)
class FaultSchedule:
    """All faults of a run, tick by tick; first axes (ticks, trials). None where no fault of the kind occurs."""

    active: Flags
    wheel_gain: Array | None  # (..., wheels) share of the commanded torque that is given; of a body without wheels: (..., 3)
    wheel_offset: Array | None  # the same shape, N m added after that
    torque_B: Array | None  # (..., 3) N m
    noise_factor: Array | None  # (..., 3) of attitude, gyro, wheels
    sensor_bias: Array | None  # (..., 6 + wheels) rad, rad/s, rad/s
    missing: Flags | None  # (..., 3) of attitude, gyro, wheels
    delay_s: Array | None  # (...)
    locked: Flags | None  # (..., wheels) the bearing is seized
    mass: NDArray[np.int64] | None  # (...) which of `masses` the whole has; -1: its own
    masses: tuple[WholeProperties, ...]
    occurrences: tuple[Occurrence, ...]

    def act(self, tick: int, command: Array) -> Array:
        """Torque that is given instead of `command`, (trials, wheels) N m, or (trials, 3) on a body without wheels."""
        if self.wheel_gain is not None:
            command = command * self.wheel_gain[tick]
        return command if self.wheel_offset is None else command + self.wheel_offset[tick]


def schedule(faults: Sequence[tuple[Fault, ...]], seed: int, trials: Trials, ticks: int, dt: float, wheels: int) -> FaultSchedule:
    """Lay out the faults of each trial over its ticks; trial i is the same in any company."""
    shape, drives = (ticks, len(trials)), wheels or 3
    active = np.zeros(shape, dtype=bool)
    fields: dict[str, Array] = {}
    masses: list[WholeProperties] = []
    occurrences: list[Occurrence] = []

    def field(name: str, size: tuple[int, ...], neutral: float) -> Array:
        return fields.setdefault(name, np.full((*shape, *size), neutral))

    for i, trial in enumerate(trials):
        for number, fault in enumerate(faults[i]):
            random = generator(seed, int(trial), Stream.FAULT + number)
            start = round(fault.start_s.sample(random) / dt)
            end = min(ticks, start + max(1, round(fault.duration_s.sample(random) / dt)))
            when = (slice(start, end), i)
            active[when] = True
            which = _wheels(fault, wheels)
            text = ""
            match fault:
                case Float():
                    field("wheel_gain", (wheels,), 1.0)[when][:, which] = 0.0
                    field("wheel_offset", (wheels,), 0.0)[when][:, which] = 0.0
                    text = f"wheel {fault.wheel} floats"
                case Effectiveness():
                    share = fault.remaining.sample(random)
                    field("wheel_gain", (wheels,), 1.0)[when][:, which] *= share
                    text = f"wheel {fault.wheel} at {100 * share:.0f} %"
                case ConstantOutput():
                    torque = fault.torque_nm.sample(random)
                    field("wheel_gain", (wheels,), 1.0)[when][:, which] = 0.0
                    field("wheel_offset", (wheels,), 0.0)[when][:, which] = torque
                    text = f"wheel {fault.wheel} gives {1e3 * torque:.2f} mN m"
                case Lock():
                    field("locked", (wheels,), 0.0)[when][:, which] = 1.0
                    text = f"wheel {fault.wheel} locks"
                case NoCommand():
                    field("wheel_gain", (drives,), 1.0)[when] = 0.0
                    text = "no command"
                case BodyTorque():
                    torque, about = fault.torque_nm.sample(random), "xyz".index(fault.axis)
                    field("wheel_gain", (drives,), 1.0)[when][:, about] = 0.0
                    field("wheel_offset", (drives,), 0.0)[when][:, about] = torque
                    text = f"{1e3 * torque:.1f} mN m about {fault.axis} whatever the command"
                case PeriodicTorque():
                    size, angle = fault.amplitude_nm.sample(random), fault.pulsation_rad_s * dt * np.arange(start, end)
                    field("torque_B", (3,), 0.0)[when] += size * np.stack([np.sin(angle), np.cos(angle), np.sin(2.0 * angle)], axis=-1)
                    text = f"periodic torque of {1e3 * size:.0f} mN m"
                case UniformTorque():
                    size = fault.amplitude_nm.sample(random)
                    field("torque_B", (3,), 0.0)[when] += random.uniform(-size, size, (end - start, 3))
                    text = f"random torque of {1e3 * size:.0f} mN m"
                case ExternalTorque():
                    torque = fault.torque_nm.sample(random)
                    axis = _axis(fault.direction, random)
                    field("torque_B", (3,), 0.0)[when] += torque * axis
                    text = f"push of {1e3 * torque:.1f} mN m about [{axis[0]:.2f}, {axis[1]:.2f}, {axis[2]:.2f}]"
                case InertiaChange():
                    field("mass", (), -1.0)[when] = len(masses)
                    masses.append(fault.properties)
                    text = f"inertia {list(fault.inertia_kg_m2)} kg m2"
                case NoiseChange():
                    factor = fault.factor.sample(random)
                    field("noise_factor", (3,), 1.0)[when][:, _sensors(fault.sensor)] *= factor
                    text = f"{fault.sensor} noise x {factor:.3g}"
                case Bias():
                    size = fault.size.sample(random)
                    axes = np.repeat(_sensors(fault.sensor), [3, 3, wheels])
                    field("sensor_bias", (6 + wheels,), 0.0)[when][:, axes] += size
                    text = f"{fault.sensor} bias {size:.3g}"
                case DropOut():
                    field("missing", (3,), 0.0)[when][:, _sensors(fault.sensor)] = 1.0
                    text = f"{fault.sensor} silent"
                case Delay():
                    delay = fault.delay_s.sample(random)
                    field("delay_s", (), 0.0)[when] += delay
                    text = f"readings {delay:.3g} s late"
            occurrences.append(Occurrence(i, start, end, fault.kind, text))
    missing, locked, mass = fields.get("missing"), fields.get("locked"), fields.get("mass")
    return FaultSchedule(
        active=active,
        wheel_gain=fields.get("wheel_gain"),
        wheel_offset=fields.get("wheel_offset"),
        torque_B=fields.get("torque_B"),
        noise_factor=fields.get("noise_factor"),
        sensor_bias=fields.get("sensor_bias"),
        missing=None if missing is None else missing > 0,
        delay_s=fields.get("delay_s"),
        locked=None if locked is None else locked > 0,
        mass=None if mass is None else mass.astype(np.int64),
        masses=tuple(masses),
        occurrences=tuple(occurrences),
    )


def latest_end(fault: Fault) -> float:
    """Latest second at which the fault can still be active."""
    return fault.start_s.bounds()[1] + fault.duration_s.bounds()[1]


def earliest_start(fault: Fault) -> float:
    """Earliest second at which the fault can begin."""
    return fault.start_s.bounds()[0]


def _wheels(fault: Fault, wheels: int) -> NDArray[np.int64]:
    wheel = getattr(fault, "wheel", None)
    return np.arange(wheels) if wheel is None or wheel == "all" else np.array([wheel - 1])


def _sensors(sensor: str) -> Flags:
    return np.array([sensor in ("all", name) for name in SENSORS])


def _axis(direction: str | tuple[float, float, float], random: np.random.Generator) -> Array:
    if isinstance(direction, str):
        azimuth = 2.0 * np.pi * random.random()
        return np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    return np.array(direction) / np.linalg.norm(direction)
