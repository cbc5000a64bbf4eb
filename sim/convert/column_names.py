"""What a laboratory's columns are, as far as their names tell."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import NamedTuple

from sim.convert.units import Quantity, said_by

SEPARATORS = r"[\s_.\-/()\[\]]+"
TRUTH = re.compile(r"truth|true|ground")


class Role(NamedTuple):
    """A quantity of a log, and how names give it away.

    Attributes:
      key: of the map.
      pattern: found in the words of a name without unit and label.
      quantity: whose units a name may end with.
      labels: sets of labels that tell its components apart, in the order that they are listed in; none: any numbers.
    """

    key: str
    pattern: str
    quantity: Quantity
    labels: tuple[str, ...] = ()


class Found(NamedTuple):
    """Columns of one quantity.

    Attributes:
      columns: their names.
      labels: what tells them apart.
      unit: that the names say; None: they say none.
    """

    columns: tuple[str, ...]
    labels: tuple[str, ...]
    unit: str | None


ROLES = (
    Role("command", r"command|cmd|torque|tau\b|\bu\b|motor", "torque"),
    Role("wheels", r"wheel|\brw|flywheel|tacho|spin|\bomega ?w\b", "rate"),
    Role("attitude", r"quat|\bq\b|attitude|orientation", "number", ("xyzw", "xyzs", "0123", "1234")),
    Role("rate", r"gyr|omega|rate|angular ?vel|\bw\b|\bg\b|\bangvel", "rate", ("xyz", "123", "012")),
)
CLOCK = re.compile(r"time|stamp|clock|\bt\b|seconds|epoch")
TRIAL = re.compile(r"^(trial|flight|run|experiment|test)( (number|nr|no|id))?$")


class Named(NamedTuple):
    """Columns by what their names say that they are.

    Attributes:
      clock: the time stamps and their unit; None: no name says so.
      trial: the number of a flight.
      groups: by key of the map, the most likely first; those of the truth with `truth_` before the key.
    """

    clock: tuple[str, str | None] | None
    trial: str | None
    groups: dict[str, list[Found]]


def named(columns: Iterable[str]) -> Named:
    """What names say of columns."""
    clock: tuple[str, str | None] | None = None
    trial = None
    members: dict[tuple[str, str], dict[str, tuple[str, str | None]]] = {}
    for name in columns:
        for role in ROLES:
            words, unit = _without_unit(name, role.quantity)
            stem, label = _labelled(words)
            if label and unit is None:
                stem, unit = _without_last_unit(stem.split(), role.quantity)
            if label and re.search(role.pattern, stem):
                key = f"truth_{role.key}" if TRUTH.search(stem) else role.key
                members.setdefault((key, stem), {}).setdefault(label, (name, unit))
                break
        else:
            words, unit = _without_unit(name, "time")
            if clock is None and CLOCK.search(words):
                clock = (name, unit)
            elif trial is None and TRIAL.search(words):
                trial = name
    groups: dict[str, list[Found]] = {}
    for (key, _), found in members.items():
        if (group := _group(next(role for role in ROLES if key.removeprefix("truth_") == role.key), found)) is not None:
            groups.setdefault(key, []).append(group)
    return Named(clock, trial, groups)


def _group(role: Role, found: dict[str, tuple[str, str | None]]) -> Found | None:
    """Columns of a role, if their labels are those of all its components."""
    if role.labels:
        labels = next((tuple(labels) for labels in role.labels if set(labels) == set(found)), None)
    else:
        labels = tuple(sorted(found, key=int)) if all(label.isdigit() for label in found) else None
        labels = labels or next((tuple(some) for some in ("xyz",) if set(some) == set(found)), None)
    if labels is None:
        return None
    units = {found[label][1] for label in labels}
    return Found(tuple(found[label][0] for label in labels), labels, units.pop() if len(units) == 1 else None)


def _without_unit(name: str, quantity: Quantity) -> tuple[str, str | None]:
    """The words of a name in small letters, and the unit that it ends with."""
    text = name.strip().lower()
    if (bracket := re.search(r"\s*[\[(]([^\d\])][^\])]*)[\])]\s*$", text)) is not None:
        said = said_by(bracket[1], (quantity,))
        return " ".join(_words(text[: bracket.start()])), None if said is None else said.unit
    return _without_last_unit(_words(text), quantity)


def _without_last_unit(words: list[str], quantity: Quantity) -> tuple[str, str | None]:
    """Words without those of the unit at their end, and that."""
    for count in (3, 2, 1):
        if len(words) > count and quantity != "number" and (said := said_by("".join(words[-count:]), (quantity,))) is not None:
            return " ".join(words[:-count]), said.unit
    return " ".join(words), None


def _words(text: str) -> list[str]:
    """Words of a name; a number at the end of one is a word of its own, and so is x, y, z or w after a letter or two."""
    return [word for part in re.split(SEPARATORS, text) if part for word in _split(part)]


def _split(part: str) -> list[str]:
    """`wheel3` as wheel, 3; `qx` as q, x."""
    if (cut := re.fullmatch(r"(.*?[a-z])(\d+)", part) or re.fullmatch(r"([a-z]{1,2})([wxyz])", part)) is None:
        return [part]
    return [cut[1], cut[2]]


def _labelled(words: str) -> tuple[str, str]:
    """The words without the last one that can be a label, and that; the first word is none."""
    parts = words.split()
    for place in range(len(parts) - 1, 0, -1):
        if re.fullmatch(r"[wxyzs]|\d+", parts[place]):
            return " ".join(parts[:place] + parts[place + 1 :]), parts[place]
    return words, ""
