"""Scenario files: what is simulated, checked before anything runs; every complaint is one line that names file and key."""

from __future__ import annotations

import difflib
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, ValidationInfo, field_validator, model_validator

from models.plants.assembly import ImpossibleInertia
from models.sections import NonNegative, Positive, Section
from sim.bad_input import BadInput
from sim.controllers.settings import ControlSettings
from sim.estimators.learning_settings import complain_of_learning
from sim.estimators.settings import Imm
from sim.estimators.tunings import Tuning
from sim.faults.kinds import Fault, complain_of_faults
from sim.metrics.closed_loop_identification import IdentificationSettings
from sim.plant.kinds import NacsPlant, PlantSettings, complain_of_masses
from sim.scenario.catalogue import SCENARIOS, scenario_names
from sim.scenario.loops import Loops, complain_of_laws, complain_of_loops, laws_by_place
from sim.scenario.named_sections import Observers, Windows
from sim.scenario.references import ReferenceSettings
from sim.scenario.validation import first_complaint
from sim.sensors.sensors import SENSOR_SETS, SensorSettings


class RunSettings(Section):
    """How long, how often, from which seed."""

    ticks: Annotated[int, Field(ge=1)] = Field(1000, description="control ticks")
    tick_s: Positive = Field(0.1, description="control period")
    trials: Annotated[int, Field(ge=1)] = 10
    seed: Annotated[int, Field(ge=0)]


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


class Published(Section):
    """What the paper prints, to be shown beside the twin's numbers."""

    source: str
    values: dict[str, dict[str, float]] = Field(description="subject -> metric -> value; metric@phase for one phase")


class Scenario(Section):
    """One scenario file."""

    title: str
    source: str = Field(description="seed equation, table or figure that it comes from")
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
        if name not in SENSOR_SETS:
            raise ValueError(f"no sensor set {name!r}; there are {', '.join(SENSOR_SETS)}")
        return SENSOR_SETS[name].model_dump() | {k: v for k, v in value.items() if k != "set"}

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
            settings.complain(f"observers.{name}", wheels)
        laws = laws_by_place(self.control, self.loops)
        complain_of_laws(laws, self.observers, (info.context or {}).get("guests", ()))
        complain_of_loops(self.loops, self.observers, self.identification)
        steps = self.run.tick_s / self.plant.step_s
        if abs(steps - round(steps)) > 1e-9 or round(steps) < 1:
            raise ValueError(
                f"run.tick_s: {self.run.tick_s:g} s is not a whole number of physics steps (plant.step_s = {self.plant.step_s:g} s)"
            )
        complain_of_faults(self.faults, duration, wheels)
        complain_of_learning(self.observers, laws, self.plant, [fault.kind for fault in self.faults])
        try:
            complain_of_masses(self.plant, self.faults)
        except ImpossibleInertia as impossible:
            raise ValueError(f"plant.{impossible}") from None
        return self

    @property
    def law(self) -> ControlSettings:
        """The law of the only loop."""
        assert self.control is not None, "of several loops, `singles` gives each on its own"
        return self.control

    @property
    def testbed(self) -> NacsPlant:
        """The plant, for what only knows the testbed; raises BadInput if it is another, or flies several loops."""
        if not isinstance(self.plant, NacsPlant) or self.control is None:
            raise BadInput("plant.type: this needs the testbed (type = 'nacs') with one [control]")
        return self.plant

    def warnings(self) -> list[str]:
        """What may be meant but deserves a word, a line each."""
        return [
            line
            for name, o in self.observers.items()
            if isinstance(o, Imm)
            for line in o.warnings(f"observers.{name}", self.plant.wheel_axes)
        ]

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


def find(name: str) -> Path:
    """File of a scenario by name or path; raises BadInput if there is none."""
    path = Path(name) if name.endswith(".toml") else SCENARIOS / f"{name}.toml"
    if path.is_file():
        return path
    if name.endswith(".toml"):
        raise BadInput(f"no scenario file {name}")
    near = difflib.get_close_matches(name, scenario_names(), n=1)
    hint = f"did you mean {near[0]}?" if near else "`nacs list` shows what there is"
    raise BadInput(f"no scenario {name!r}; {hint}")


def load(name: str, overrides: dict[str, Any] | None = None, guests: tuple[str, ...] = ()) -> Scenario:
    """Read and check a scenario.

    Args:
      name: family/name, or a path to a TOML file.
      overrides: dotted key to value, taken instead of what the file says.
      guests: names of the user's own filters, which may close the loop too.

    Raises:
      BadInput: one line with file and key.
    """
    path = find(name)
    label = f"{name}.toml" if not name.endswith(".toml") else name
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, OSError) as broken:
        raise BadInput(f"{label}: cannot be read as TOML: {broken}") from None
    return check(data, label, overrides, guests)


def check(data: dict[str, Any], label: str, overrides: dict[str, Any] | None = None, guests: tuple[str, ...] = ()) -> Scenario:
    """The scenario that `data`, as read from a file, stands for; complaints begin with `label`. The rest as for `load`."""
    for key, value in (overrides or {}).items():
        override(data, key, value)
    try:
        return Scenario.model_validate(data, context={"guests": guests})
    except ValidationError as invalid:
        raise BadInput(f"{label}: {first_complaint(invalid, data, Scenario)}") from None


def parse_override(text: str) -> tuple[str, Any]:
    """`key.sub=value` as a dotted key and a TOML value; what is no TOML value is a string."""
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise BadInput(f"--set {text}: needs the form key.sub=value")
    try:
        return key.strip(), tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return key.strip(), value.strip()


def override(data: dict[str, Any], key: str, value: Any) -> None:
    """Set a dotted key of a file's tables; raises BadInput."""
    node: Any = data
    *parents, last = key.split(".")
    for part in parents:
        node = _element(node, part, key) if isinstance(node, list) else node.setdefault(part, {})
        if not isinstance(node, dict | list):
            raise BadInput(f"--set {key}: {part!r} is a value and has no keys")
    if isinstance(node, list):
        _element(node, last, key)
        node[int(last)] = value
    else:
        node[last] = value


def _element(items: list[Any], part: str, key: str) -> Any:
    if not part.isdigit() or int(part) >= len(items):
        raise BadInput(f"--set {key}: {part!r} must be a number from 0 to {len(items) - 1}")
    return items[int(part)]
