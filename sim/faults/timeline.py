"""Faults laid out over the ticks of every trial: what each does to wheels, body and sensors, and when it happened."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.faults.kinds import (
    Bias,
    BodyTorque,
    ConstantOutput,
    Delay,
    DropOut,
    Effectiveness,
    ExternalTorque,
    Fault,
    Float,
    InertiaChange,
    Lock,
    NoCommand,
    NoiseChange,
    PeriodicTorque,
    UniformTorque,
    WholeProperties,
)
from sim.randomness import Stream, Trials, generator

Array = NDArray[np.floating]
Flags = NDArray[np.bool_]

SENSORS = ("attitude", "gyro", "wheels")


class Occurrence(NamedTuple):
    """One fault as it happens in one trial."""

    trial: int
    start_tick: int
    end_tick: int
    kind: str
    text: str


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
