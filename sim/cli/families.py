"""Scenarios of several agents: kinds of file that are not of one body, each with a loop, metrics and pictures of its own."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ValidationError
from rich.table import Table

from sim.bad_input import BadInput
from sim.metrics.one_body import Metric
from sim.metrics.results import Row
from sim.scenario import one_body as scenarios
from sim.scenario.one_body import RunSettings, Scenario, override
from sim.scenario.validation import first_complaint

# plant.type in a file: module with an object FAMILY; loaded when such a file is
MODULES = {"formation": "sim.cli.formation", "formation-nacs": "sim.cli.formation", "agents": "sim.cli.consensus"}


class Settings(Protocol):
    """What every kind of scenario has."""

    @property
    def title(self) -> str:
        """What it shows."""
        ...

    @property
    def source(self) -> str:
        """Equation, table or figure that it comes from."""
        ...

    @property
    def run(self) -> RunSettings:
        """How long, how often, from which seed."""
        ...

    @property
    def loops(self) -> dict[str, Any]:
        """Closed loops that are flown on the same trials, by name."""
        ...


class Family(Protocol):
    """One kind of scenario."""

    @property
    def settings(self) -> type[BaseModel]:
        """Model of its files."""
        ...

    def simulate(
        self, scenario: Any, trials: NDArray[np.int64], recorded: NDArray[np.int64], on_tick: Callable[[int], None] | None
    ) -> tuple[list[Metric], dict[str, Any]]:
        """Metrics of the given trials, and recordings of some of them by loop; raises SimulationFailed."""
        ...

    def tables(self, rows: list[Row], scenario: Any, trials: int) -> list[Table]:
        """What is shown at the terminal."""
        ...

    def write_report(self, path: Path, name: str, scenario: Any, flown: dict[str, Any]) -> None:
        """Draw `report.png`."""
        ...

    def write_recording(self, path: Path, name: str, scenario: Any, flown: dict[str, Any], configuration: dict[str, Any]) -> None:
        """Write `recording.rrd`."""
        ...

    def warnings(self, scenario: Any) -> list[str]:
        """What may be meant but deserves a word."""
        ...


def family_of(name: str) -> Family | None:
    """The family of a scenario by name or path; None if it is of one body, or cannot be read."""
    try:
        return _of(_read(scenarios.find(name)))
    except (AttributeError, tomllib.TOMLDecodeError, UnicodeDecodeError, OSError):
        return None  # the complaint is made by whoever reads it next


def of(scenario: Settings) -> Family | None:
    """The family of a checked scenario; None if it is of one body."""
    return None if isinstance(scenario, Scenario) else _of(dumped(scenario))


def load(name: str, overrides: dict[str, Any]) -> Settings:
    """Read and check a scenario of any kind; raises BadInput."""
    if family_of(name) is None:
        return scenarios.load(name, overrides)
    label = name if name.endswith(".toml") else f"{name}.toml"
    return check(_read(scenarios.find(name)), label, overrides)


def check(data: dict[str, Any], label: str, overrides: dict[str, Any]) -> Settings:
    """Check what a file or `dumped` says, with some keys changed; raises BadInput, which begins with the label."""
    family = _of(data)
    if family is None:
        return scenarios.check(data, label, overrides)
    for key, value in overrides.items():
        override(data, key, value)
    try:
        checked: Any = family.settings.model_validate(data)
    except ValidationError as invalid:
        raise BadInput(f"{label}: {first_complaint(invalid, data, family.settings)}") from None
    settings: Settings = checked
    return settings


def dumped(scenario: Settings) -> dict[str, Any]:
    """All settings of a checked scenario as its file would say them."""
    model: Any = scenario
    said: dict[str, Any] = model.model_dump(mode="json", exclude_none=True, by_alias=True)
    return said


def _of(data: dict[str, Any]) -> Family | None:
    kind = data.get("plant", {}).get("type")
    if not isinstance(kind, str) or kind not in MODULES:
        return None
    family: Family = import_module(MODULES[kind]).FAMILY
    return family


def _read(path: Path) -> dict[str, Any]:
    return tomllib.loads(path.read_text(encoding="utf-8"))
