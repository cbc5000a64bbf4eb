"""Scenario files of every kind: found, read, changed by the command line and checked; every complaint is one line with file and key."""

from __future__ import annotations

from typing import Any, Protocol

from pydantic import BaseModel, ValidationError

from models.plants.register.entries import KINDS
from models.plants.register.parameters import Parameters
from sim.bad_input import BadInput
from sim.scenario.consensus import ConsensusScenario
from sim.scenario.extension import extended, find, read
from sim.scenario.formation import FormationScenario
from sim.scenario.one_body import Scenario
from sim.scenario.run import RunSettings
from sim.scenario.validation import first_error
from sim.text import toml_text

# what a file must be, by the family of its plant
FAMILIES: dict[str, type[BaseModel]] = {"body": Scenario, "formation": FormationScenario, "consensus": ConsensusScenario}


class AnyScenario(Protocol):
    """What every kind of scenario has."""

    @property
    def family(self) -> str:
        """Which closed loop, metrics, tables and pictures are its own: `body`, `formation` or `consensus`."""
        ...

    @property
    def title(self) -> str:
        """What it shows."""
        ...

    @property
    def source(self) -> str:
        """Equation, table or figure that it comes from."""
        ...

    @property
    def plant(self) -> Parameters:
        """What is simulated."""
        ...

    @property
    def run(self) -> RunSettings:
        """How long, how often, from which seed."""
        ...

    @property
    def loops(self) -> dict[str, Any]:
        """Closed loops that are flown on the same trials, by name; empty if there is a single one without a name."""
        ...

    @property
    def loop_names(self) -> tuple[str, ...]:
        """Names of all closed loops; a single one of one body is called `loop`."""
        ...

    def warnings(self) -> list[str]:
        """What may be meant but deserves a word, a line each."""
        ...


def load(name: str, overrides: dict[str, Any] | None = None, guests: tuple[str, ...] = ()) -> Any:
    """Read and check a scenario of any kind.

    Args:
      name: family/name, or a path to a TOML file.
      overrides: dotted key to value, taken instead of what the file says.
      guests: names of the user's own filters, which may close the loop too.

    Raises:
      BadInput: one line with file and key.
    """
    path = find(name)
    label = f"{name}.toml" if not name.endswith(".toml") else name
    return check(read(path, label), label, overrides, guests)


def check(data: dict[str, Any], label: str, overrides: dict[str, Any] | None = None, guests: tuple[str, ...] = ()) -> Any:
    """The scenario that `data`, as read from a file, stands for; complaints begin with `label`. The rest as for `load`."""
    data = extended(data, label)
    for key, value in (overrides or {}).items():
        override(data, key, value)
    plant = data.get("plant")
    kind = plant.get("type") if isinstance(plant, dict) else None
    model = FAMILIES[KINDS[kind].family] if isinstance(kind, str) and kind in KINDS else Scenario
    try:
        return model.model_validate(data, context={"guests": guests})
    except ValidationError as invalid:
        raise BadInput(f"{label}: {first_error(invalid, data, model)}") from None
    except (OverflowError, RecursionError) as beyond:
        raise BadInput(f"{label}: a value is beyond what can be computed with ({beyond})") from None


def dumped(scenario: Any) -> dict[str, Any]:
    """All settings of a checked scenario as its file would say them."""
    said: dict[str, Any] = scenario.model_dump(mode="json", exclude_none=True, by_alias=True)
    return said


def parse_override(text: str) -> tuple[str, Any]:
    """`key.sub=value` as a dotted key and a TOML value; what is no TOML value is a string."""
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise BadInput(f"--set {text}: needs the form key.sub=value")
    try:
        return key.strip(), toml_text.value(value)
    except BadInput as wrong:
        raise BadInput(f"--set {key.strip()}={wrong}") from None


def override(data: dict[str, Any], key: str, value: Any) -> None:
    """Set a dotted key of a file's tables; raises BadInput."""
    node: Any = data
    *parents, last = key.split(".")
    if not all(part.strip() for part in (*parents, last)):
        raise BadInput(f"--set {key}: a name is empty")
    if set(key) & set("\"'"):
        raise BadInput(f"--set {key}: names are not quoted here")
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
