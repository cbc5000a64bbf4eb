"""Colour and dashes of closed loops that are set side by side: their law by hue, what else they differ in by shade and dashes."""

from __future__ import annotations

from itertools import takewhile
from typing import NamedTuple

from sim.scenario.one_body import Scenario
from sim.series.palette import LOOP_DASHES, LOOP_FAMILIES, LOOP_VARIANTS, Colour


class LineStyle(NamedTuple):
    """How a loop is drawn everywhere."""

    family: int  # of the control law
    variant: int  # of the rest of its name, such as -imm or -ukf
    on_light: str
    on_dark: Colour
    dashes: tuple[float, ...]


def line_styles(scenario: Scenario) -> dict[str, LineStyle]:
    """Looks of a scenario's loops: pd-imm and smc-imm differ in hue, pd-imm and pd-ukf in shade and dashes."""
    families: dict[str, list[str]] = {}
    for name, single in scenario.singles().items():
        families.setdefault(single.law.type, []).append(name)
    variants: dict[str, int] = {}
    for names in families.values():
        shared = _shared_beginning(names)
        for name in names:
            variants.setdefault(name[shared:], len(variants))
    found: dict[str, LineStyle] = {}
    for family, names in enumerate(families.values()):
        shared = _shared_beginning(names)
        shades = LOOP_FAMILIES[family % len(LOOP_FAMILIES)] if len(families) > 1 else LOOP_VARIANTS
        for name in names:
            variant = variants[name[shared:]]
            light, dark = shades[variant % len(shades)]
            found[name] = LineStyle(family, variant, light, dark, LOOP_DASHES[variant % len(LOOP_DASHES)] if len(variants) > 1 else ())
    return {name: found[name] for name in scenario.singles()}


def _shared_beginning(names: list[str]) -> int:
    """How many letters the names of a family have in common, whole words only; none if there is only one name."""
    if len(names) == 1:
        return 0
    words = zip(*(name.split("-")[:-1] for name in names), strict=False)
    return sum(len(word[0]) + 1 for word in takewhile(lambda word: len(set(word)) == 1, words))
