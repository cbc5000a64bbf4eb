"""Panels of `report.png` for loops that learn the unmodelled torque: how far off each is, and the torque of one beside the truth."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from sim.series.learned import UNIT, applied, learned, learners, torque_error
from sim.series.loops import Flight, moving_mean, window

AXIS_COLOURS = ("#d62839", "#2a9d4e", "#2a6fdb")


def draw_error(axes: Axes, several: tuple[Flight, ...], line: Callable[[Flight], dict[str, Any]]) -> None:
    """Length of learned minus applied torque, of every loop that learns."""
    ticks = window(several)
    for flight in learners(several):
        axes.semilogy(flight.recording.time, torque_error(flight, ticks), **line(flight))
    seconds = ticks * several[0].recording.dt
    axes.set(title=f"Learned minus applied torque, RMS over {seconds:g} s", ylabel=f"length [{UNIT}]")


def draw_torque(axes: Axes, several: tuple[Flight, ...]) -> None:
    """Learned (line) and applied (dashes) torque about the body axes, of the last loop that learns."""
    flight = learners(several)[-1]
    time, ticks = flight.recording.time, window(several)
    for axis, colour in enumerate(AXIS_COLOURS):
        axes.plot(time, moving_mean(learned(flight)[:, axis], ticks), color=colour, lw=1.0)
        axes.plot(time, applied(flight)[:, axis], color=colour, lw=1.2, ls="--", alpha=0.7)
    handles = [Line2D([], [], color=colour, label=name) for colour, name in zip(AXIS_COLOURS, "xyz", strict=True)]
    handles += [Line2D([], [], color="#5a6270", ls=style, label=label) for style, label in (("-", "learned"), ("--", "applied"))]
    axes.legend(handles=handles, ncols=5, loc="upper left", columnspacing=1.2, handlelength=1.6)
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.2 * (high - low))
    axes.set(title=f"Unmodelled torque in loop {flight.name}", ylabel=f"torque on the body [{UNIT}]")
    axes.axhline(0.0, color="#c5c9d1", lw=0.6, zorder=0)
