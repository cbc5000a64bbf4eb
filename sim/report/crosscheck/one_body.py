"""`crosscheck.png`: a cross-check as a figure for a paper."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from sim.crosscheck.attribution import size_deg
from sim.crosscheck.divergence import QUANTITIES, passes, rms
from sim.crosscheck.study import CrossCheck
from sim.series.picture_style import STYLE
from sim.series.raster import write_png
from sim.text.table_style import counted

Array = NDArray[np.floating]

MODEL_COLOR, LIMIT_COLOR = "#1b4f9c", "#d62839"
OTHERS = {
    "eq9-10": ("#8a8f98", "-"),
    "exact": ("#8a8f98", (0, (4, 2))),
    "printed-inertia": ("#e07a1f", "-"),
    "printed-gyroscopic-sign": ("#7b4fb5", "-"),
    "printed-control-sign": ("#1f9e89", "-"),
    "believed": ("#8a8f98", "-"),
    "uncoupled": ("#e07a1f", "-"),
    "rigid": ("#e07a1f", "-"),
    "panels": ("#1f9e89", "-"),
}
EFFECTS = ("#1b4f9c", "#e07a1f", "#1f9e89", "#d1495b", "#7b4fb5", "#c9a227", "#3b9ad9", "#7a5c3e", "#5a6270", "#e58fb1", "#9bbf5a")
SHOWN = 8  # effects that are drawn; the rest are too small to see
PATCH = {"facecolor": "white", "edgecolor": "none", "pad": 0.8}
LEAST_DEG = 1e-7  # below this, curves are rounding
LEAST = 1e-12  # the same of any quantity


def write_picture(path: Path, name: str, found: CrossCheck) -> None:
    """Draw the divergence over time with its thresholds, and the effects that cause it.

    Args:
      path: PNG to write.
      name: of the scenario.
      found: the cross-check.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(11.0, 8.8), dpi=160, layout="constrained")
        grid = figure.subplots(3, 2, height_ratios=[1.0, 1.0, 1.25])
        time = found.tick_s * np.arange(len(found.states))
        _attitude(grid[0, 0], time, found)
        _quantity(grid[0, 1], time, found, ("rate",), "Body rate", "greatest component [rad/s]")
        if "wheel" in found.apart:
            _quantity(grid[1, 0], time, found, ("wheel",), "Wheel speed", "greatest wheel [rad/s]")
            _quantity(grid[1, 1], time, found, ("momentum", "energy"), "Momentum and energy", "relative to the flight's greatest")
        else:
            _quantity(grid[1, 0], time, found, ("momentum",), "Momentum", f"relative to {_scale(found)}")
            _quantity(grid[1, 1], time, found, ("energy",), "Kinetic energy", "relative to the flight's greatest")
        drawn = _order(found)[:SHOWN]
        _growth(grid[2, 0], time, found, drawn)
        _shares(grid[2, 1], found, drawn)
        for letter, axes in zip("abcdef", grid.flat, strict=True):
            axes.set_title(f"({letter}) {axes.get_title(loc='left')}", loc="left")
        for axes in grid.flat[:-1]:
            axes.set_xlim(time[_first(found)], time[-1])
            axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        for axes in grid.flat[2:5]:
            axes.set_xlabel("time [s]")
        figure.suptitle(f"Cross-check: {found.model.name} against the plant\n", x=0.01, ha="left", fontsize=12, fontweight="bold")
        trials = found.states.shape[1]
        passed = sum(check.passed for check in found.checks)
        figure.text(
            0.01, 0.958,
            f"{name}, {counted(trials, 'trial')}, open loop under the commands of a closed-loop flight"
            f" | lines: RMS, bands: all trials | physics checks: {passed} of {len(found.checks)} pass"
            + f" | as printed: {sum(f.fails for f in found.failures)} of {len(found.failures)} fail as they must" * bool(found.failures),
            fontsize=8, color="#5a6270",
        )  # fmt: skip
        write_png(figure, path)


def _first(found: CrossCheck) -> int:
    """Tick at which something can be seen: the first, or where a plant that rests begins to move."""
    return min(max(1, int(np.argmax(found.apart["attitude"].max(axis=1) > LEAST_DEG))), max(1, len(found.states) - 2))


def _scale(found: CrossCheck) -> str:
    """What momentum is relative to."""
    return "the greatest in the wheels" if found.states.shape[-1] > 7 else "that at the start"


def _order(found: CrossCheck) -> list[int]:
    """Effects, the largest at the last stated instant first."""
    return [int(i) for i in np.argsort(-size_deg(found.causes.contribution[:, found.ticks[-1]]))]


def _attitude(axes: Axes, time: Array, found: CrossCheck) -> None:
    for name, values in found.others.items():
        color, dash = OTHERS.get(name, ("#8a8f98", ":"))
        axes.loglog(time[1:], rms(np.maximum(values, LEAST_DEG))[1:], color=color, ls=dash, lw=0.9, label=name)
    _line(axes, time, found.apart["attitude"], MODEL_COLOR, found.model.name, _first(found))
    axes.set(title="Attitude", ylabel="angle [deg]")
    _threshold(axes, found, "attitude")
    axes.legend(loc="lower right", ncols=2)


def _quantity(axes: Axes, time: Array, found: CrossCheck, names: tuple[str, ...], title: str, label: str) -> None:
    for name, color in zip(names, (MODEL_COLOR, "#e07a1f"), strict=False):
        _line(axes, time, found.apart[name], color, name if len(names) > 1 else found.model.name, _first(found))
    axes.set(title=title, ylabel=label)
    for name in names:
        _threshold(axes, found, name, text=name == names[0] or found.thresholds[name] != found.thresholds[names[0]])
    if len(names) > 1:
        axes.legend(loc="lower right")


def _line(axes: Axes, time: Array, values: Array, color: str, label: str, first: int) -> None:
    shown = np.maximum(values[first:], LEAST)
    axes.loglog(time[first:], rms(shown), color=color, lw=1.6, label=label)
    axes.fill_between(time[first:], shown.min(axis=1), shown.max(axis=1), color=color, alpha=0.16, lw=0)


def _threshold(axes: Axes, found: CrossCheck, name: str, text: bool = True) -> None:
    """The threshold, and a mark where the median trial passes it."""
    limit = found.thresholds[name]
    unit = next(q.unit for q in QUANTITIES if q.name == name)
    axes.axhline(limit, color=LIMIT_COLOR, lw=0.8, ls="--")
    instants = passes(found.apart[name], limit, found.tick_s)
    reached = instants[np.isfinite(instants)]
    when = f", passed after {np.median(reached):.3g} s" if len(reached) else ", never passed"
    if len(reached):
        axes.plot(np.median(reached), limit, "o", color=LIMIT_COLOR, ms=4, zorder=5)
    if text:
        shown = f"{100 * limit:g} %" if unit == "1" else f"{limit:.3g} {unit}"
        names = "threshold " + shown + (when if name not in ("momentum", "energy") else "")
        place = axes.get_yaxis_transform()
        axes.text(0.99, limit, names, color=LIMIT_COLOR, fontsize=7, ha="right", va="bottom", transform=place, bbox=PATCH | {"alpha": 0.7})


def _growth(axes: Axes, time: Array, found: CrossCheck, drawn: list[int]) -> None:
    causes = found.causes
    end = causes.total.shape[0]
    total = size_deg(causes.total)
    axes.loglog(time[1:end], total[1:], color="#111111", lw=2.0, label="total")
    for place, effect in enumerate(drawn):
        size = np.maximum(size_deg(causes.contribution[effect]), LEAST_DEG)
        axes.loglog(time[1:end], size[1:], color=EFFECTS[place], label=causes.names[effect])
    for tick in found.ticks:
        axes.axvline(tick * found.tick_s, color="#9aa1ac", lw=0.6, ls=":")
    axes.set(title="What each effect contributes to the attitude", ylabel="angle [deg]")
    axes.set_ylim(bottom=max(1e-5, total[1:].min() * 1e-3))
    axes.yaxis.set_major_locator(LogLocator(10, numticks=12))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.legend(loc="lower right", fontsize=6.6, labelspacing=0.25, frameon=True, edgecolor="none", framealpha=0.75)


def _shares(axes: Axes, found: CrossCheck, drawn: list[int]) -> None:
    causes, ticks = found.causes, found.ticks[-4:]
    shares = 100 * np.stack([causes.shares(tick) for tick in ticks])
    rows = [*drawn, -1]
    height = 0.8 / len(ticks)
    for number, values in enumerate(shares):
        strength = 0.35 + 0.65 * (number + 1) / len(ticks)
        for place, effect in enumerate(rows):
            value = values[effect] if effect >= 0 else values.sum()
            color = EFFECTS[place] if effect >= 0 else "#111111"
            at = place - 0.4 + height * (number + 0.5)
            axes.barh(at, value, height * 0.88, color=color, alpha=strength, lw=0)
    for place, effect in enumerate(rows):
        figures = shares[:, effect] if effect >= 0 else shares.sum(axis=1)
        beside = max(0.0, float(figures.max())) + 2.0
        axes.text(
            beside,
            place,
            ", ".join(f"{round(v, 1) + 0.0:.1f}" for v in figures) + " %",
            fontsize=6.6,
            va="center",
            color="#3a404a",
            bbox=PATCH,
        )
    axes.axvline(100.0, color="#111111", lw=0.7, ls="--")
    axes.axvline(0.0, color="#111111", lw=0.7)
    axes.set_yticks(range(len(rows)), [_two_lines(causes.names[i]) for i in drawn] + ["sum of all"], fontsize=6.8)
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    axes.set_xlim(min(0.0, 1.1 * float(shares[:, drawn].min())), max(138.0, 1.38 * float(shares.sum(axis=1).max())))
    good = all(causes.superposes(tick) for tick in found.ticks)
    rest = 100 * max(causes.rest(tick) for tick in ticks)
    title = (
        f"Share of the total; at most {rest:.2g} % left over"
        if good
        else "Share of the total; the effects do not superpose at every instant"
    )
    axes.set(title=title, xlabel=f"share of the attitude divergence [%]; light to dark: {', '.join(found.instant(tick) for tick in ticks)}")


def _two_lines(name: str) -> str:
    """A name broken at the space nearest to its middle."""
    spaces = [i for i, letter in enumerate(name) if letter == " "]
    if len(name) < 16 or not spaces:
        return name
    middle = min(spaces, key=lambda i: abs(i - len(name) / 2))
    return f"{name[:middle]}\n{name[middle + 1 :]}"
