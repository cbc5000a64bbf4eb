"""Faults as files name them: all kinds, older names that are still read, and what a plant must have for them."""

from __future__ import annotations

from collections.abc import Iterable
from functools import reduce
from operator import or_
from typing import Annotated, Any

from pydantic import Field, GetCoreSchemaHandler
from pydantic_core import CoreSchema

from sim.faults import bodies, commands, links, pushes, readings, wheels
from sim.faults.events import KINDS, Alias, Event
from sim.faults.parts import FAMILIES, Parts

GROUPS = (wheels, commands, pushes, bodies, readings, links)  # which fill the register as they are imported


class _AnyKind:
    """Any kind of the register, told by its key `kind`."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        union: Any = Annotated[reduce(or_, dict.fromkeys(KINDS.values())), Field(discriminator="kind")]
        return handler.generate_schema(union)


Fault = Annotated[Event, _AnyKind()]


def aliases(family: str) -> dict[str, tuple[str, Alias]]:
    """Older names that files of a family may have: the kind that each is now, and how its keys are called there."""
    return {alias.kind: (kind, alias) for kind, event in KINDS.items() for alias in event.aliases if alias.family == family}


def renamed(faults: Any, family: str) -> Any:
    """The faults of a file with older names replaced by today's; what is no list of tables is left for the complaint.

    An old key beside a new one was set on top of it, and is heard.
    """
    if not isinstance(faults, list | tuple):
        return faults
    return [_renamed(fault, family) if isinstance(fault, dict) else fault for fault in faults]


def _renamed(fault: dict[str, Any], family: str) -> dict[str, Any]:
    known = aliases(family)
    said = fault.get("kind")
    if isinstance(said, str) and said in known and not any(key in fault for key in known[said][1].unless):
        kind, alias = known[said]
        fault = alias.defaults | fault | {"kind": kind}
    for kind, alias in known.values():
        if fault.get("kind") == kind:
            fault = {key: value for key, value in fault.items() if key not in alias.keys} | {
                new: fault[old] for old, new in alias.keys.items() if old in fault
            }
    return fault


def check_faults(faults: Iterable[Event], duration_s: float, parts: Parts) -> None:
    """Raise ValueError if a fault lies outside the run, or is of something that the plant does not have."""
    for number, fault in enumerate(faults):
        where = f"faults.{number} ({fault.kind})"
        if parts.family not in fault.families:
            there = " and ".join(FAMILIES[family] for family in fault.families)
            raise ValueError(f"{where}: {FAMILIES[parts.family]} cannot have it; it is a fault of {there}")
        if fault.duration_s is not None and fault.latest_end > duration_s + 1e-9:
            raise ValueError(f"{where}: lasts from {fault.earliest_start:g} to {fault.latest_end:g} s, the run from 0 to {duration_s:g} s")
        if fault.latest_start >= duration_s:
            raise ValueError(f"{where}: begins at {fault.latest_start:g} s, the run ends at {duration_s:g} s")
        try:
            fault.check(parts)
        except ValueError as wrong:
            raise ValueError(f"{where}: {wrong}") from None
