"""Faults as timed events: what goes wrong, with which part, when and how much, as a file says it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, field_validator

from models.plants.inertia import tensor
from models.sections import Positive, Section, Sextuple
from sim.draws import Draw, Number

Array = NDArray[np.floating]


def _not_negative(draw: Draw) -> Draw:
    if draw.bounds()[0] < 0:
        raise ValueError(f"can be {draw.bounds()[0]:g}; must not be negative")
    return draw


NotNegative = Annotated[Number, AfterValidator(_not_negative)]
Wheel = Literal["all"] | Annotated[int, Field(ge=1)]
Sensor = Literal["attitude", "gyro", "wheels", "all"]
Axis = Literal["x", "y", "z"]


class Event(Section):
    """When a fault begins and how long it lasts; both may be drawn anew in every trial.

    Faults may overlap; where two say different things of one wheel or of the inertia, the one later in the file is heard.
    """

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
    pulsation_rad_s: Positive = Field(1.0, description="p")


class UniformTorque(Event):
    """A disturbance about each body axis that is drawn anew at every tick, uniform between -a and a."""

    kind: Literal["uniform-torque"]
    amplitude_nm: NotNegative


class WholeProperties(NamedTuple):
    """What a trial's whole becomes."""

    inertia: Array  # (3, 3) kg m2 about the centre of rotation
    centre_of_mass: Array  # (3,) m


class InertiaChange(Event):
    """The whole gets another inertia (about the centre of rotation) and centre of mass; the rate is kept."""

    kind: Literal["inertia"]
    inertia_kg_m2: Sextuple
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


def latest_end(fault: Fault) -> float:
    """Latest second at which the fault can still be active."""
    return fault.start_s.bounds()[1] + fault.duration_s.bounds()[1]


def earliest_start(fault: Fault) -> float:
    """Earliest second at which the fault can begin."""
    return fault.start_s.bounds()[0]


def complain_of_faults(faults: Iterable[Fault], duration_s: float, wheels: int) -> None:
    """Raise ValueError if a fault lies outside the run, or is of a part that the plant does not have."""
    for number, fault in enumerate(faults):
        where = f"faults.{number} ({fault.kind})"
        if earliest_start(fault) < 0 or latest_end(fault) > duration_s + 1e-9:
            raise ValueError(
                f"{where}: lasts from {earliest_start(fault):g} to {latest_end(fault):g} s, the run from 0 to {duration_s:g} s"
            )
        if not wheels and hasattr(fault, "wheel"):
            raise ValueError(f"{where}: the plant has no wheels")
        if wheels and fault.kind == "body-torque":
            raise ValueError(f"{where}: the plant is turned by its wheels; constant-output is the fault of a wheel")
        wheel = getattr(fault, "wheel", "all")
        if isinstance(wheel, int) and wheel > wheels:
            raise ValueError(f"{where}: there is no wheel {wheel}; wheels are 1 to {wheels} or 'all'")
