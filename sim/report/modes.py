"""Panels of `report.png` of several closed loops: what each believes of its wheels, and the gains that it blends by that."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from sim.report.axes import PLATE, QUIET, SYMBOLS, Several, line, plain_log
from sim.series.loops import GAIN_NAMES, GAIN_UNITS, edges
from sim.series.palette import WHEEL_COLORS


def draw_modes(axes: Axes, several: Several) -> None:
    """A lane for each loop whose observer has modes, filled by the probability of the faulty ones."""
    modal = sorted((flight for flight in several if flight.probabilities is not None), key=lambda flight: flight.look[:2])
    axes.set(title="Probability of a failure, 0 to 1 in each lane")
    if not modal:
        axes.text(0.5, 0.5, "no observer has modes", transform=axes.transAxes, ha="center", color=QUIET)
    for row, flight in enumerate(reversed(modal)):
        probabilities = flight.probabilities
        assert probabilities is not None
        heights = row + 0.82 * np.concatenate([np.zeros((len(probabilities), 1)), np.cumsum(probabilities[:, 1:], axis=-1)], axis=-1)
        many = probabilities.shape[1] > 2
        for mode, wheel in enumerate(flight.wheels_of_modes[1:]):
            color = WHEEL_COLORS[(wheel or 0) % len(WHEEL_COLORS)] if many else flight.look.on_light
            axes.fill_between(flight.recording.time, heights[:, mode], heights[:, mode + 1], color=color, alpha=0.45, lw=0)
        axes.plot(flight.recording.time, heights[:, -1], color=flight.look.on_light, lw=0.9)
        axes.axhline(row, color="#c5c9d1", lw=0.6)
    axes.set_yticks(np.arange(len(modal)) + 0.41, [flight.name for flight in reversed(modal)], fontsize=7.5)
    for tick, flight in zip(axes.get_yticklabels(), reversed(modal), strict=True):
        tick.set_color(flight.look.on_light)
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=False, axis="y")
    axes.set_ylim(-0.08, max(len(modal), 1) + (0.5 if any(len(f.modes) > 2 for f in modal) else 0.05))
    wheels = sorted({w for f in modal if len(f.modes) > 2 for w in f.wheels_of_modes if w is not None})
    if wheels:
        patches = [Line2D([], [], color=WHEEL_COLORS[w % len(WHEEL_COLORS)], lw=5, alpha=0.45, label=f"wheel {w + 1}") for w in wheels]
        axes.legend(handles=patches, loc="upper left", ncols=len(wheels), handlelength=1.0, columnspacing=1.2)


def draw_gains(axes: Axes, several: Several) -> None:
    """Gains over those of the first, healthy, mode: the same axis for all laws."""
    named: dict[tuple[int, str], tuple[float, str, str]] = {}
    for flight in several:
        for number, (key, gain) in enumerate(flight.gains.items()):
            of_modes = np.atleast_1d(flight.scenario.law.gains[key])
            if len(of_modes) > 1:
                axes.semilogy(flight.recording.time, gain / of_modes[0], **line(flight, 1.3 if number == 0 else 0.9))
                text = f"{SYMBOLS[GAIN_NAMES[key]]}: {of_modes[0]:g} to {of_modes[-1]:g} {GAIN_UNITS[key]}"
                named.setdefault((flight.look.family, key), (of_modes[-1] / of_modes[0], text, flight.look.on_light))
    axes.set(title="Blended gains, over those of the healthy mode", ylabel="ratio")
    if not named:
        axes.text(0.5, 0.5, "no law has gains of modes", transform=axes.transAxes, ha="center", color=QUIET)
        return
    low, high = axes.get_ylim()
    axes.set_ylim(low, high * (high / low) ** 0.08)
    plain_log(axes)
    low, high = np.log(axes.get_ylim())
    lowest = 0.02
    early = any(edge < 0.35 * several[0].recording.ticks for edge in edges(several))
    place: dict[str, Any] = {"x": 0.98, "ha": "right"} if early else {"x": 0.02, "ha": "left"}  # where there is no fault
    for above, (ratio, text, color) in enumerate(sorted(named.values())):  # each near its line, none on another
        highest = 1.0 - 0.065 * (len(named) - above)
        lowest = max(lowest, min((np.log(ratio) - low) / (high - low) - 0.02, highest))
        axes.text(**place, y=lowest, s=text, transform=axes.transAxes, va="bottom", fontsize=7.5, color=color, bbox=PLATE)
        lowest += 0.065
