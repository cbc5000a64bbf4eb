"""What two trees' short flights have in common, name by name, and how far apart the rest is."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

AnyArray = NDArray[Any]
Loop = dict[str, Any]  # channels, metrics and occurrences as the probe puts them down

SIDES = ("parent", "head")
KINDS = ("channels", "metrics", "occurrences")


class BadArguments(ValueError):
    """What was asked for makes no sense; one line."""


class Rename(NamedTuple):
    """A change of names that is meant: what the parent's are turned into before they are compared."""

    old: re.Pattern[str]
    new: str


class Side(NamedTuple):
    """What a tree left: scenarios by name, and the folder with the arrays of each."""

    flown: dict[str, Any]
    folders: dict[str, Path]


@dataclass
class Tally:
    """How much was compared, and how much of it differs; of what could not be flown, a line each."""

    files: int = 0
    loops: int = 0
    compared: dict[str, int] = field(default_factory=lambda: dict.fromkeys(KINDS, 0))
    differences: int = 0
    errors: list[str] = field(default_factory=list)


def renamed(names: dict[str, Any], renames: list[Rename]) -> dict[str, Any]:
    """The same by the new names; raises BadArguments if two become one."""
    out: dict[str, Any] = {}
    for name, value in names.items():
        new = name
        for rename in renames:
            new = rename.old.sub(rename.new, new)
        if new in out:
            raise BadArguments(f"--rename makes {new!r} of two names of the parent")
        out[new] = value
    return out


def compare(sides: tuple[Side, Side], renames: list[Rename], tally: Tally) -> Iterator[str]:
    """The report, line by line; names of scenarios, loops, channels and metrics of the parent are renamed before."""
    flown = renamed(sides[0].flown, renames), sides[1].flown
    folders = renamed(sides[0].folders, renames), sides[1].folders
    for name in sorted({*flown[0], *flown[1]}):
        failed = [
            f"{side} {name}: {there[name]['error']}" for side, there in zip(SIDES, flown, strict=True) if "error" in there.get(name, {})
        ]
        tally.errors += failed
        alone = [side for side, there, other in zip(SIDES, flown, flown[::-1], strict=True) if name in there and name not in other]
        if alone:
            tally.differences += 1
            yield f"{name}: the scenario is only in {alone[0]}"
        elif not failed:
            tally.files += 1
            loops = renamed(flown[0][name]["loops"], renames), flown[1][name]["loops"]
            with (
                np.load(folders[0][name] / flown[0][name]["arrays"]) as first,
                np.load(folders[1][name] / flown[1][name]["arrays"]) as second,
            ):
                for loop in dict.fromkeys((*loops[0], *loops[1])):
                    yield from _compare_loop(f"{name} {loop}", (loops[0].get(loop), loops[1].get(loop)), (first, second), renames, tally)


def _compare_loop(
    where: str, loops: tuple[Loop | None, Loop | None], arrays: tuple[Any, Any], renames: list[Rename], tally: Tally
) -> Iterator[str]:
    """How many channels, metrics and occurrences of a loop are equal; then a line on each name that differs or is only in one tree."""
    parent, head = loops
    if parent is None or head is None:
        tally.differences += 1
        yield f"{where}: the loop is only in {SIDES[0] if head is None else SIDES[1]}"
        return
    tally.loops += bool(head["channels"])
    equal, lines = dict.fromkeys(KINDS, 0), []
    for kind in ("channels", "metrics"):
        old, new = renamed(parent[kind], renames), head[kind]
        for name in dict.fromkeys((*old, *new)):
            what = f"  {kind[:-1]} {name}"
            if name not in old or name not in new:
                lines.append(f"{what}: only in {SIDES[0] if name in old else SIDES[1]}")
                continue
            tally.compared[kind] += 1
            one, other = old[name], new[name]
            if kind == "channels" and one["hash"] != other["hash"]:
                lines.append(f"{what}: {apart(arrays[0][one['key']], arrays[1][other['key']])}")
            elif kind == "metrics" and one != other:
                lines.append(f"{what}: {apart(*(np.array([float.fromhex(value) for value in values]) for values in (one, other)))}")
            else:
                equal[kind] += 1
    happened = Counter(parent["occurrences"]), Counter(head["occurrences"])
    tally.compared["occurrences"] += (happened[0] | happened[1]).total()
    equal["occurrences"] = (happened[0] & happened[1]).total()
    for side, more in zip(SIDES, (happened[0] - happened[1], happened[1] - happened[0]), strict=True):
        lines += [f"  occurrence {line!r}: only in {side}" for line in more.elements()]
    tally.differences += len(lines)
    yield f"{where}: equal are {', '.join(f'{count} {kind}' for kind, count in equal.items())}" + (
        f"; {len(lines)} differ" if lines else ""
    )
    yield from lines


def apart(parent: AnyArray, head: AnyArray) -> str:
    """How far two arrays of unequal bits are apart, largest absolute and relative difference first."""
    if parent.shape != head.shape or parent.dtype != head.dtype:
        return f"{parent.dtype} {parent.shape} in parent, {head.dtype} {head.shape} in head"
    bits = [np.frombuffer(array.tobytes(), dtype=np.uint8).reshape(array.size, array.itemsize) for array in (parent, head)]
    moved = np.any(bits[0] != bits[1], axis=-1)
    one, other = (array.ravel()[moved].astype(float) for array in (parent, head))
    lonely = int(np.sum(np.isnan(one) != np.isnan(other)))
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        gap = np.abs(one - other)
        share = gap / np.maximum(np.abs(one), np.abs(other))
    largest, relative = (float(np.max(part[~np.isnan(part)], initial=0.0)) for part in (gap, share))
    text = f"{int(moved.sum())} of {parent.size} numbers differ, by {largest:.3g} at most, relatively by {relative:.3g}"
    return f"{text}; {lonely} NaN in one tree only" if lonely else text
