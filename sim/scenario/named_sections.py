"""Sections of a scenario file whose names are the user's own: observers and windows of time; and which names are taken."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import AfterValidator

from models.sections import NonNegative, Positive
from sim.estimators.settings import ObserverSettings
from sim.estimators.tunings import TUNINGS

PHASES = ("all", "nominal", "fault", "recovery")  # in which every run is judged
RESERVED = ("loop", "truth", "measurement", "reference")  # of recordings and tables


def is_taken(name: str) -> bool:
    """Whether neither an observer nor a loop can have this name."""
    return "/" in name or name in RESERVED


def names_taken(scenario: Any) -> tuple[str, ...]:
    """Names that a further observer of a scenario cannot have."""
    return (*getattr(scenario, "observers", ()), *scenario.loop_names, *RESERVED)


def _named_tunings(observers: dict[str, ObserverSettings]) -> dict[str, ObserverSettings]:
    for name, settings in observers.items():
        if isinstance(settings.tuning, str) and settings.tuning not in TUNINGS:
            raise ValueError(f"{name}.tuning: no set {settings.tuning!r}; there are {', '.join(TUNINGS)}")
        if is_taken(name):
            raise ValueError(f"{name!r} cannot be an observer's name")
    return observers


def _in_order(windows: dict[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
    for name, (start, end) in windows.items():
        if name in PHASES:
            raise ValueError(f"{name!r} cannot be a phase of the scenario's own")
        if not start < end:
            raise ValueError(f"{name} = [{start:g}, {end:g}]: needs start < end")
    return windows


Observers = Annotated[dict[str, ObserverSettings], AfterValidator(_named_tunings)]
Windows = Annotated[dict[str, tuple[NonNegative, Positive]], AfterValidator(_in_order)]
