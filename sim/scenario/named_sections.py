"""Sections of a scenario file whose names are the user's own: observers and windows of time; and which names are taken."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import Annotated, Any

from pydantic import AfterValidator

from models.sections import NonNegative, Positive
from sim.estimators.settings import ObserverSettings
from sim.estimators.tunings import TUNINGS
from sim.scenario.run import RunSettings
from sim.text.names import LONGEST_NAME, WHAT_A_NAME_IS, is_a_name

PHASES = ("all", "nominal", "fault", "recovery")  # in which every run is judged
RESERVED = ("loop", "truth", "measurement", "reference")  # of recordings and tables


def check_name(name: str, what: str, reserved: Iterable[str] = RESERVED) -> None:
    """Raise ValueError if an observer, a loop or a window of time cannot be called so: files, tables, pictures and paths say its name."""
    if not name.strip():
        raise ValueError(f"{what} has an empty name")
    shown = name if len(name) <= LONGEST_NAME else f"{name[:20]}..."
    if name in reserved:
        raise ValueError(f"{shown!r} cannot be {what}'s name: it means something else")
    if not is_a_name(name):
        raise ValueError(f"{shown!r} cannot be {what}'s name: {WHAT_A_NAME_IS}")


def names_taken(scenario: Any) -> tuple[str, ...]:
    """Names that a further observer of a scenario cannot have."""
    return (*getattr(scenario, "observers", ()), *scenario.loop_names, *RESERVED)


def _named_tunings(observers: dict[str, ObserverSettings]) -> dict[str, ObserverSettings]:
    for name, settings in observers.items():
        if isinstance(settings.tuning, str) and settings.tuning not in TUNINGS:
            raise ValueError(f"{name}.tuning: no set {settings.tuning!r}; there are {', '.join(TUNINGS)}")
        check_name(name, "an observer")
    return observers


def _in_order(windows: dict[str, tuple[float, float]], reserved: tuple[str, ...] = PHASES) -> dict[str, tuple[float, float]]:
    for name, (start, end) in windows.items():
        check_name(name, "a phase", reserved)
        if not start < end:
            raise ValueError(f"{name} = [{start:g}, {end:g}]: needs start < end")
    return windows


def check_windows(windows: dict[str, tuple[float, float]], run: RunSettings) -> None:
    """Raise ValueError if a window of time is so short that no tick lies in it."""
    for name, (start, end) in windows.items():
        if round(start / run.tick_s) >= round(end / run.tick_s):
            raise ValueError(f"phases.{name}: no tick of {run.tick_s:g} s lies from {start:g} to {end:g} s")


def beyond(windows: dict[str, tuple[float, float]], run: RunSettings) -> list[str]:
    """A line on each window that the run does not reach the end of."""
    duration = run.ticks * run.tick_s
    return [
        f"phases.{name}: [{start:g}, {end:g}] s is not inside the run of {duration:g} s"
        for name, (start, end) in windows.items()
        if end > duration * (1 + 1e-9)
    ]


Observers = Annotated[dict[str, ObserverSettings], AfterValidator(_named_tunings)]
Windows = Annotated[dict[str, tuple[NonNegative, Positive]], AfterValidator(_in_order)]
WindowsOfAgents = Annotated[dict[str, tuple[NonNegative, Positive]], AfterValidator(partial(_in_order, reserved=PHASES[:1]))]
