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

from sim import scenario as scenarios
from sim.complaints import first_complaint
from sim.metrics import Metric
from sim.results import Row
from sim.scenario import BadInput, RunSettings, override

# plant.type in a file: module with an object FAMILY; loaded when such a file is
MODULES = {"formation": "sim.formation_family", "formation-nacs": "sim.formation_family", "agents": "sim.consensus_family"}


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
        kind = _read(scenarios.find(name)).get("plant", {}).get("type")
    except (AttributeError, tomllib.TOMLDecodeError, UnicodeDecodeError, OSError):
        return None  # the complaint is made by whoever reads it next
    if not isinstance(kind, str) or kind not in MODULES:
        return None
    family: Family = import_module(MODULES[kind]).FAMILY
    return family


def load(name: str, overrides: dict[str, Any]) -> Settings:
    """Read and check a scenario of any kind; raises BadInput."""
    family = family_of(name)
    if family is None:
        return scenarios.load(name, overrides)
    label, data = name if name.endswith(".toml") else f"{name}.toml", _read(scenarios.find(name))
    for key, value in overrides.items():
        override(data, key, value)
    try:
        checked: Any = family.settings.model_validate(data)
    except ValidationError as invalid:
        raise BadInput(f"{label}: {first_complaint(invalid, data, family.settings)}") from None
    settings: Settings = checked
    return settings


def _read(path: Path) -> dict[str, Any]:
    return tomllib.loads(path.read_text(encoding="utf-8"))
