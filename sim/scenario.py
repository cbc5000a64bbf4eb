"""Scenario files: what is simulated, checked before anything runs; every complaint is one line that names file and key."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, ValidationInfo, field_validator, model_validator
from pydantic_core import ErrorDetails

from models.inertia import why_impossible
from models.nacs import ImpossibleInertia, NacsParameters, prepare_nacs
from sim.faults import Fault, InertiaChange, earliest_start, latest_end
from sim.observers import TUNINGS, ObserverSettings, Tuning
from sim.references import ReferenceSettings
from sim.sensors import SENSOR_SETS, SensorSettings

SCENARIOS = Path(__file__).with_name("scenarios")

Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]


class BadInput(ValueError):
    """Something that the user wrote cannot be run; the message is one line: what, where, what would be right."""


class _Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class RunSettings(_Section):
    """How long, how often, from which seed."""

    ticks: Annotated[int, Field(ge=1)] = Field(1000, description="control ticks")
    tick_s: Positive = Field(0.1, description="control period")
    trials: Annotated[int, Field(ge=1)] = 10
    seed: Annotated[int, Field(ge=0)]


class NacsPlant(NacsParameters):
    """The air-bearing testbed; every parameter of models/nacs.py is a key."""

    type: Literal["nacs"]


class StartSettings(_Section):
    """State at t = 0: the reference's attitude but for a small random turn, at rest."""

    attitude_error_deg: NonNegative = Field(1.0, description="standard deviation of the turn about each body axis")
    wheel_speed_rad_s: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)


class PdSettings(_Section):
    """Quaternion feedback on the tracking error."""

    type: Literal["pd"]
    proportional_nm: Positive = Field(0.4, description="K_p")
    derivative_nms: Positive = Field(0.075, description="K_d")
    feedback: str = Field(description="who tells the controller the state: an observer, `truth` or `measurement`")


class Published(_Section):
    """What the paper prints, to be shown beside the twin's numbers."""

    source: str
    values: dict[str, dict[str, float]] = Field(description="subject -> metric -> value")


class Scenario(_Section):
    """One scenario file."""

    title: str
    source: str = Field(description="seed equation, table or figure that it comes from")
    run: RunSettings
    plant: NacsPlant
    start: StartSettings = StartSettings()
    sensors: SensorSettings = SensorSettings()
    reference: ReferenceSettings
    control: PdSettings
    tuning: str | Tuning = Field("consistent", description="of all observers that do not have their own")
    observers: dict[str, ObserverSettings]
    faults: tuple[Fault, ...] = ()
    published: Published | None = None

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

    @field_validator("observers")
    @classmethod
    def _named_tunings(cls, observers: dict[str, ObserverSettings]) -> dict[str, ObserverSettings]:
        for name, settings in observers.items():
            if isinstance(settings.tuning, str) and settings.tuning not in TUNINGS:
                raise ValueError(f"{name}.tuning: no set {settings.tuning!r}; there are {', '.join(TUNINGS)}")
            if "/" in name or name in ("loop", "truth", "measurement", "reference"):
                raise ValueError(f"{name!r} cannot be an observer's name")
        return observers

    @model_validator(mode="after")
    def _fits_together(self, info: ValidationInfo) -> Scenario:
        sources = [*self.observers, *(info.context or {}).get("guests", ()), "truth", "measurement"]
        if self.control.feedback not in sources:
            raise ValueError(f"control.feedback: no observer {self.control.feedback!r}; there are {', '.join(sources)}")
        steps = self.run.tick_s / self.plant.step_s
        if abs(steps - round(steps)) > 1e-9 or round(steps) < 1:
            raise ValueError(
                f"run.tick_s: {self.run.tick_s:g} s is not a whole number of physics steps (plant.step_s = {self.plant.step_s:g} s)"
            )
        duration = self.run.ticks * self.run.tick_s
        for number, fault in enumerate(self.faults):
            where = f"faults.{number} ({fault.kind})"
            if earliest_start(fault) < 0 or latest_end(fault) > duration + 1e-9:
                raise ValueError(
                    f"{where}: lasts from {earliest_start(fault):g} to {latest_end(fault):g} s, the run from 0 to {duration:g} s"
                )
            wheel = getattr(fault, "wheel", "all")
            if isinstance(wheel, int) and wheel > 4:
                raise ValueError(f"{where}: there is no wheel {wheel}; wheels are 1 to 4 or 'all'")
        try:
            reassemble = prepare_nacs(self.plant).reassemble
        except ImpossibleInertia as impossible:
            raise ValueError(f"plant.{impossible}") from None
        for number, fault in enumerate(self.faults):
            if isinstance(fault, InertiaChange):
                whole, bus = fault.properties.inertia, np.diag(reassemble(*fault.properties).moments)
                if reason := why_impossible(whole) or why_impossible(bus):
                    raise ValueError(f"faults.{number} (inertia): no rigid body has inertia_kg_m2 = {list(fault.inertia_kg_m2)}, {reason}")
        return self


def names() -> list[str]:
    """Names family/name of the scenarios that come with the twin."""
    return sorted(str(path.relative_to(SCENARIOS).with_suffix("")) for path in SCENARIOS.glob("*/*.toml"))


def find(name: str) -> Path:
    """File of a scenario by name or path; raises BadInput if there is none."""
    path = Path(name) if name.endswith(".toml") else SCENARIOS / f"{name}.toml"
    if path.is_file():
        return path
    if name.endswith(".toml"):
        raise BadInput(f"no scenario file {name}")
    near = difflib.get_close_matches(name, names(), n=1)
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
        _override(data, key, value)
    try:
        return Scenario.model_validate(data, context={"guests": guests})
    except ValidationError as invalid:
        raise BadInput(f"{label}: {first_complaint(invalid, data)}") from None


def parse_override(text: str) -> tuple[str, Any]:
    """`key.sub=value` as a dotted key and a TOML value; what is no TOML value is a string."""
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise BadInput(f"--set {text}: needs the form key.sub=value")
    try:
        return key.strip(), tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return key.strip(), value.strip()


def _override(data: dict[str, Any], key: str, value: Any) -> None:
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


def first_complaint(invalid: ValidationError, data: dict[str, Any]) -> str:
    """One line on the first key that is wrong; where a value may be of several kinds, what each would need."""
    errors = invalid.errors()
    key = ".".join(_path_in_file(errors[0]["loc"], data))
    messages = [_message(error) for error in errors if ".".join(_path_in_file(error["loc"], data)) == key]
    given = errors[0]["input"]
    shown = f" (got {given!r})" if isinstance(given, str | int | float | list | tuple) and "got" not in messages[0] else ""
    return (f"{key}: " if key else "") + ", or ".join(dict.fromkeys(messages)) + shown


def _message(error: ErrorDetails) -> str:
    last = error["loc"][-1] if error["loc"] else ""
    if error["type"] == "extra_forbidden":
        near = difflib.get_close_matches(str(last), _all_keys(), n=1)
        return "unknown key" + (f"; did you mean {near[0]}?" if near else "")
    if error["type"] == "missing":
        return f"needs {last + 1} values or more" if isinstance(last, int) else "is missing"
    text = error["msg"].removeprefix("Value error, ")
    return text[:1].lower() + text[1:]


def _path_in_file(location: tuple[int | str, ...], data: Any) -> Iterator[str]:
    """The parts of pydantic's location that are keys of the file: tags of unions and validators are left out."""
    node = data
    for number, part in enumerate(location):
        inside = part in node if isinstance(node, dict) else isinstance(node, list) and isinstance(part, int) and part < len(node)
        if inside:
            yield str(part)
            node = node[part]
        elif number == len(location) - 1 and isinstance(node, dict):
            yield str(part)


def _all_keys() -> list[str]:
    found: set[str] = set()
    schema = Scenario.model_json_schema()
    for block in [schema, *schema.get("$defs", {}).values()]:
        found |= set(block.get("properties", {}))
    return sorted(found)
