"""Scenario files: what is simulated, checked before anything runs; every complaint is one line that names file and key."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationInfo, field_validator, model_validator

from control.tracking import Target
from models.attitude import quaternion
from models.attitude.euler_angles import from_euler_313
from models.plants.assembly import ImpossibleInertia
from models.plants.register.entries import kind_of
from models.sections import Headline, NonNegative, Section
from sim.controllers.settings import ControlSettings
from sim.estimators.learning_settings import check_learning
from sim.estimators.tunings import Tuning
from sim.faults.kinds import Fault, check_faults, renamed
from sim.faults.parts import Parts
from sim.plant.kinds import PlantSettings, beyond_wheels, check_masses, check_speeds, check_tilt, filled
from sim.scenario.identification import IdentificationSettings
from sim.scenario.loops import Loops, check_laws, check_loops, laws_by_place
from sim.scenario.named_sections import Observers, Windows, beyond, check_windows
from sim.scenario.references import ReferenceSettings
from sim.scenario.run import Published, RunSettings, check_steps
from sim.sensors.sensors import SENSOR_SETS, SensorSettings

Array = NDArray[np.floating]

INSTANTS = 2000  # of a reference that are held against what the plant can follow


class StartSettings(Section):
    """State at t = 0: near a given attitude, the reference's if none is given."""

    attitude_error_deg: NonNegative = Field(1.0, description="standard deviation of a random turn about each body axis")
    euler_313_deg: tuple[float, float, float] | None = Field(None, description="attitude phi, theta, psi in place of the reference's")
    quaternion: tuple[float, float, float, float] | None = Field(None, description="the same as a quaternion, scalar last")
    rate_deg_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rate_rad_s: tuple[float, float, float] | None = Field(None, description="the same in rad/s")
    wheel_speed_rad_s: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _said_once(self) -> StartSettings:
        if self.quaternion is not None:
            if self.euler_313_deg is not None:
                raise ValueError("quaternion: give the attitude either so or as euler_313_deg")
            if abs(sum(part**2 for part in self.quaternion) - 1.0) > 1e-3:
                raise ValueError(f"quaternion = {list(self.quaternion)}: the squares must add up to one")
        if self.rate_rad_s is not None and any(self.rate_deg_s):
            raise ValueError("rate_rad_s: give the rate either so or as rate_deg_s")
        return self

    @property
    def attitude(self) -> Array | None:
        """Attitude q_BN (4,) that is given; None: the reference's."""
        if self.quaternion is not None:
            return quaternion.normalize(np.array(self.quaternion))
        return None if self.euler_313_deg is None else from_euler_313(np.radians(self.euler_313_deg))

    @property
    def rate(self) -> Array:
        """Body rate omega_BN_B (3,) rad/s."""
        return np.radians(self.rate_deg_s) if self.rate_rad_s is None else np.array(self.rate_rad_s)


class Scenario(Section):
    """One scenario file."""

    family: ClassVar[str] = "body"

    title: Headline
    source: Headline = Field(description="seed equation, table or figure that it comes from")
    run: RunSettings
    plant: PlantSettings
    start: StartSettings = StartSettings()
    sensors: SensorSettings = SensorSettings()
    reference: ReferenceSettings
    control: ControlSettings | None = Field(None, description="the law of the only loop")
    loops: Loops = Field({}, description="or several closed loops on the same trials, by name")
    tuning: str | Tuning = Field("consistent", description="of all observers that do not have their own")
    observers: Observers
    faults: tuple[Fault, ...] = ()
    phases: Windows = Field({}, description="windows of time with metrics of their own: [start, end] in s")
    phase_metrics: Literal["estimates", "all"] = Field("estimates", description="of those windows: of body and estimate, or every metric")
    identification: IdentificationSettings | None = Field(None, description="of what the controllers of two loops truly make of the plant")
    published: Published | None = None
    claims: Literal["gyroless"] | None = Field(None, description="whose claims the run is held against, see sim/metrics/claims.py")

    @field_validator("sensors", mode="before")
    @classmethod
    def _named_set(cls, value: Any) -> Any:
        if not isinstance(value, dict) or "set" not in value:
            return value
        name = value["set"]
        if not isinstance(name, str) or name not in SENSOR_SETS:
            raise ValueError(f"no sensor set {name!r}; there are {', '.join(SENSOR_SETS)}")
        return SENSOR_SETS[name].model_dump() | {k: v for k, v in value.items() if k != "set"}

    @field_validator("faults", mode="before")
    @classmethod
    def _older_names(cls, value: Any) -> Any:
        return renamed(value, cls.family)

    @model_validator(mode="before")
    @classmethod
    def _common_tuning(cls, data: Any) -> Any:
        """Give every observer without a tuning of its own the scenario's."""
        if not isinstance(data, dict) or not isinstance(data.get("observers"), dict):
            return data
        tuning = data.get("tuning", cls.model_fields["tuning"].default)
        observers = {name: {"tuning": tuning} | o if isinstance(o, dict) else o for name, o in data["observers"].items()}
        return data | {"observers": observers}

    @model_validator(mode="after")
    def _fits_together(self, info: ValidationInfo) -> Scenario:
        duration, wheels = self.run.ticks * self.run.tick_s, self.plant.wheel_axes.shape[1]
        for name, settings in self.observers.items():
            settings.check(f"observers.{name}", wheels)
        laws = laws_by_place(self.control, self.loops)
        check_laws(laws, self.observers, (info.context or {}).get("guests", ()), self.run.tick_s)
        check_loops(self.loops, self.observers, self.identification)
        check_steps(self.run, self.plant.step_s, "plant.step_s")
        for key, period in self.sensors.periods_s.items():
            if abs(period / self.run.tick_s - round(period / self.run.tick_s)) > 1e-9:
                raise ValueError(f"sensors.{key}: {period:g} s is not a whole number of ticks (run.tick_s = {self.run.tick_s:g} s)")
        check_windows(self.phases, self.run)
        self._can_begin_and_follow(duration)
        check_faults(self.faults, duration, self.parts)
        check_learning(self.observers, laws, self.plant, [fault.kind for fault in self.faults])
        try:
            check_masses(self.plant, self.faults)
        except ImpossibleInertia as impossible:
            raise ValueError(f"plant.{impossible}") from None
        return self

    def _can_begin_and_follow(self, duration: float) -> None:
        """Raise ValueError if the plant cannot be where it starts, or where the reference leads."""
        check_speeds(self.plant, self.start.wheel_speed_rad_s, "start.wheel_speed_rad_s")
        if (attitude := self.start.attitude) is not None:
            check_tilt(self.plant, attitude, "start")
        check_tilt(self.plant, self._followed(duration).q_DN, "reference")

    def _followed(self, duration: float) -> Target:
        """The reference all along a run."""
        return self.reference.at(np.linspace(0.0, duration, INSTANTS))

    @property
    def parts(self) -> Parts:
        """What can fail."""
        wheels = self.plant.wheel_axes.shape[1]
        return Parts(self.family, {"attitude": 3, "gyro": 3, "wheels": wheels}, wheels=wheels)

    @property
    def law(self) -> ControlSettings:
        """The law of the only loop."""
        assert self.control is not None, "of several loops, `singles` gives each on its own"
        return self.control

    def warnings(self) -> list[str]:
        """What may be meant but deserves a word, a line each."""
        return [
            *kind_of(self.plant).warnings(self.plant),
            *(
                line
                for name, o in self.observers.items()
                for line in o.warnings(f"observers.{name}", self.plant.wheel_axes, self.run.tick_s)
            ),
            *beyond_wheels(self.plant, self.start.rate, "start"),
            *beyond_wheels(self.plant, self._followed(self.run.ticks * self.run.tick_s).omega_DN_D, "reference"),
            *filled(self.plant, self.run.ticks * self.run.tick_s),
            *(f"{line}; it counts as far as the run goes" for line in beyond(self.phases, self.run)[:1]),
        ]

    @property
    def loop_names(self) -> tuple[str, ...]:
        """Names of all closed loops; the only one is called `loop`."""
        return tuple(self.loops) or ("loop",)

    def singles(self) -> dict[str, Scenario]:
        """Every closed loop as a scenario with that one loop, by name; the only one is called `loop`."""
        if self.control is not None:
            return {"loop": self}
        return {
            name: self.model_copy(
                update={
                    "control": loop.control,
                    "loops": {},
                    "observers": {n: o for n, o in self.observers.items() if n == loop.control.feedback or n in loop.watching},
                    "faults": self.faults if loop.faults else (),
                }
            )
            for name, loop in self.loops.items()
        }
