"""Closed loops of a scenario file: what each is, and whether its law has what it needs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Annotated

from pydantic import AfterValidator, Field

from models.sections import Section
from sim.controllers.settings import ControlSettings, ModeWeightedSettings, UnfalsifiedSettings
from sim.estimators.settings import ObserverSettings
from sim.scenario.identification import IdentificationSettings
from sim.scenario.named_sections import check_name


class LoopSettings(Section):
    """One of several closed loops that are flown on the same trials."""

    control: ControlSettings
    watching: tuple[str, ...] = Field((), description="further observers, which do not close the loop")
    faults: bool = Field(True, description="whether the scenario's faults happen in it")


def _named(loops: dict[str, LoopSettings]) -> dict[str, LoopSettings]:
    for name in loops:
        check_name(name, "a loop")
    return loops


Loops = Annotated[dict[str, LoopSettings], AfterValidator(_named)]


def laws_by_place(control: ControlSettings | None, loops: Mapping[str, LoopSettings]) -> dict[str, ControlSettings]:
    """Settings of all laws by their place in the file, of one closed loop or of several; raises ValueError if it has both or neither."""
    if (control is None) == (not loops):
        raise ValueError("control: give either [control] for one closed loop or [loops.NAME.control] for several")
    return {f"loops.{name}.control": loop.control for name, loop in loops.items()} if control is None else {"control": control}


def check_laws(
    laws: Mapping[str, ControlSettings], observers: Mapping[str, ObserverSettings], guests: Iterable[str], tick_s: float
) -> None:
    """Raise ValueError if a law is fed by nothing or too rarely, or has gains for other modes than its observer's.

    Args:
      laws: by their place in the file.
      observers: of the scenario.
      guests: names of the user's own filters.
      tick_s: control period, s.
    """
    sources = [*observers, *guests, "truth", "measurement"]
    for where, law in laws.items():
        law.check(where, tick_s)
        if law.feedback not in sources:
            raise ValueError(f"{where}.feedback: no observer {law.feedback!r}; there are {', '.join(sources)}")
        observer = observers.get(law.feedback)
        modes = max(1, len(observer.mode_settings)) if observer is not None else 1
        for key, gains in law.gains.items():
            if isinstance(gains, tuple) and len(gains) != modes:
                raise ValueError(f"{where}.{key}: {len(gains)} gains for the {modes} modes of {law.feedback}; give one a mode, or one")
        if isinstance(law.allocation, ModeWeightedSettings) and not (observer is not None and observer.mode_settings):
            raise ValueError(f"{where}.allocation: mode-weighted needs the mode probabilities of an observer of type imm as feedback")


def check_loops(
    loops: Mapping[str, LoopSettings], observers: Mapping[str, ObserverSettings], identification: IdentificationSettings | None
) -> None:
    """Raise ValueError if there is no such loop to be identified, or no such observer to watch one."""
    if identification is not None:
        for key, name in (("adaptive", identification.adaptive), ("nominal", identification.nominal)):
            if name not in loops or not isinstance(loops[name].control, UnfalsifiedSettings):
                raise ValueError(f"identification.{key}: no loop {name!r} with a control of type unfalsified")
    for name, settings in loops.items():
        if absent := [watching for watching in settings.watching if watching not in observers]:
            raise ValueError(f"loops.{name}.watching: no observer {absent[0]!r}; there are {', '.join(observers)}")
