"""Colours that mean the same thing in every picture: of wheels, observers, axes and states."""

from __future__ import annotations

import colorsys
from collections.abc import Iterable

Colour = tuple[int, int, int]

WHEEL_COLORS = ("#eb4236", "#33b859", "#3b82f5", "#fabf2e")  # those of nacs.xml

OBSERVER_COLORS = {
    "ekf": "#e07a1f",
    "mekf": "#8a8f98",
    "sif": "#7b4fb5",
    "nis-windowed": "#1f9e89",
    "nis-fading": "#1b4f9c",
}

AXES: tuple[Colour, ...] = ((238, 84, 72), (92, 200, 110), (92, 148, 255))  # x, y, z
PALE_AXES: tuple[Colour, ...] = ((255, 178, 170), (178, 240, 190), (184, 208, 255))
TOTAL: Colour = (255, 92, 205)  # total momentum
REFERENCE: Colour = (255, 236, 150)
TRUTH: Colour = (236, 240, 247)
HEALTHY: Colour = (46, 125, 70)
CALM: Colour = (52, 60, 72)
ALERT: Colour = (214, 72, 62)

_SPARE: tuple[Colour, ...] = ((240, 215, 90), (255, 120, 160), (130, 225, 110), (120, 170, 255))  # for observers that are not named above


_SPARE_ON_LIGHT = ("#a3195b", "#5b7f00", "#00718f", "#7a4b00")


def on_light(observers: Iterable[str]) -> dict[str, str]:
    """Colour code of each observer on a white page."""
    return {name: OBSERVER_COLORS.get(name, _SPARE_ON_LIGHT[i % len(_SPARE_ON_LIGHT)]) for i, name in enumerate(observers)}


def rgb(code: str) -> Colour:
    """Bytes of a colour code like #eb4236."""
    return int(code[1:3], 16), int(code[3:5], 16), int(code[5:7], 16)


def wheel(number: int) -> Colour:
    """Colour of a wheel, counted from zero."""
    return rgb(WHEEL_COLORS[number % len(WHEEL_COLORS)])


def on_dark(observers: Iterable[str]) -> dict[str, Colour]:
    """The hue that each observer has in every picture, light enough for a dark background."""
    colours: dict[str, Colour] = {}
    for i, name in enumerate(observers):
        colours[name] = _SPARE[i % len(_SPARE)]
        if code := OBSERVER_COLORS.get(name):
            hue, _, saturation = colorsys.rgb_to_hls(*(byte / 255.0 for byte in rgb(code)))
            red, green, blue = colorsys.hls_to_rgb(hue, 0.72, min(1.0, 1.3 * saturation))
            colours[name] = (round(255 * red), round(255 * green), round(255 * blue))
    return colours


# control laws by hue, each loop's variant by shade: on a white page, on a dark one
LOOP_FAMILIES: tuple[tuple[tuple[str, Colour], ...], ...] = (
    (
        ("#ee9a4d", (255, 196, 130)),
        ("#d1420b", (255, 118, 56)),
        ("#7a1a12", (255, 66, 96)),
        ("#c9a100", (255, 228, 92)),
        ("#b07a63", (206, 160, 128)),
    ),
    (
        ("#74b3e8", (158, 206, 255)),
        ("#1c66c9", (72, 148, 255)),
        ("#1d1d7a", (150, 120, 255)),
        ("#12a594", (64, 228, 204)),
        ("#8088ad", (164, 174, 216)),
    ),
    (
        ("#9fbf5a", (206, 232, 140)),
        ("#4d8a1a", (140, 216, 72)),
        ("#1f4d1f", (60, 170, 90)),
        ("#7d7d7d", (205, 205, 205)),
        ("#a9a97c", (190, 190, 150)),
    ),
)
# hues that persons with any colour vision tell apart (Okabe & Ito 2008), where all loops have one law
LOOP_VARIANTS = (
    ("#0072b2", (80, 170, 240)),
    ("#d55e00", (255, 128, 40)),
    ("#009e73", (40, 214, 164)),
    ("#cc79a7", (240, 150, 204)),
    ("#e69f00", (255, 206, 84)),
    ("#56b4e9", (166, 220, 255)),
    ("#6b6b6b", (196, 196, 196)),
    ("#000000", (236, 240, 247)),
)
LOOP_DASHES: tuple[tuple[float, ...], ...] = ((4.0, 1.6), (), (7.0, 1.4, 1.2, 1.4), (1.2, 1.2), (9.0, 2.5))  # of the variants
