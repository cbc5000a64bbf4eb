"""`report.png` of a formation: one trial of every loop, as a figure for a paper."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from models.plants.formation import colour
from sim.loop.recording import Recording
from sim.metrics.formation import SETTLED
from sim.scenario.formation import FormationScenario
from sim.series.formation import FormationFlight, flights
from sim.series.palette import LOOP_VARIANTS
from sim.series.picture_style import STYLE
from sim.units import RPM

Array = NDArray[np.floating]

QUIET = "#5a6270"
FAULT = "#d62839"
SMOOTH_S = 1.0
MOST_ROWS = 4000  # of a line; the picture has no more points


def draw_report(name: str, scenario: FormationScenario, recordings: dict[str, Recording]) -> Figure:
    """Draw the first recorded trial of every loop: errors of the formation, of the estimates and of what is known of the leader.

    Args:
      name: of the scenario.
      scenario: with all its loops.
      recordings: by loop, of one recorded trial or more.
    """
    loops = flights(recordings, scenario)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(13.0, 8.6), dpi=160, layout="constrained")
        grid = figure.subplots(2, 3, sharex=True)
        _over_time(grid[0, 0], loops, "fkae", "Formation-keeping error FKAE, between all pairs", "FKAE [-]")
        grid[0, 0].axhline(SETTLED, color=QUIET, lw=0.8, ls=":")
        _over_time(grid[0, 1], loops, "skae", "Station-keeping error SKAE, from the leader", "SKAE [-]")
        members = "testbeds" if scenario.wheels else "spacecraft"
        _over_time(grid[0, 2], loops, "formation_angle", f"Angle between two {members}, RMS of all pairs", "angle [deg]", np.degrees(1.0))
        _velocity(grid[1, 0], loops)
        if scenario.wheels:
            _wheels(grid[1, 1], _shown(loops))
        else:
            _turns(grid[1, 1], loops[0])
        _torque(grid[1, 2], _shown(loops))
        for letter, axes in zip("abcdef", grid.flat, strict=True):
            for occurrence in loops[0].occurrences:
                axes.axvline(loops[0].dt * occurrence.start_tick, color=FAULT, lw=0.7, alpha=0.6, zorder=0)
            axes.set_title(f"({letter}) {axes.get_title(loc='left')}", loc="left")
            axes.set_xlim(0.0, loops[0].time[-1])
        for axes in grid[-1]:
            axes.set_xlabel("time [s]")
        entries = [Line2D([], [], label=label, color=shade, lw=1.8) for label, shade in _subjects(loops).items()]
        figure.legend(handles=entries, loc="outside lower center", ncols=min(6, len(entries)), fontsize=9)
        figure.suptitle(f"{scenario.title}\n", x=0.01, ha="left", fontsize=12, fontweight="bold")
        happened = dict.fromkeys((o.start_tick, o.text) for o in loops[0].occurrences)
        said = [f"{name}, trial {loops[0].recorded[0]}"] + [f"{loops[0].dt * start:g} s: {text}" for start, text in happened]
        figure.text(0.01, 0.958, " | ".join(said), fontsize=7.5, color=QUIET)
        return figure


def _subjects(loops: list[FormationFlight]) -> dict[str, str]:
    """Colour of every loop, and of the observers that only watch."""
    watching = [f"{flown.loop}/{name}" for flown in loops for name in _observers(flown) if name != flown.loop]
    names = [*(flown.loop for flown in loops), *(w for w in watching if len(loops) == 1)]
    return {name: LOOP_VARIANTS[i % len(LOOP_VARIANTS)][0] for i, name in enumerate(names)}


def _observers(flown: FormationFlight) -> list[str]:
    return [name.removesuffix("/velocity_squared") for name in flown.figures if name.endswith("/velocity_squared")]


def _place(flown: FormationFlight) -> int:
    """Of the first recorded trial among all."""
    return int(np.flatnonzero(flown.trials == flown.recorded[0])[0])


def _line(axes: Axes, flown: FormationFlight, values: Array, **look: Any) -> None:
    every = max(1, len(values) // MOST_ROWS)
    axes.plot(flown.time[::every], values[::every], **look)


def _over_time(axes: Axes, loops: list[FormationFlight], figure: str, title: str, label: str, scale: float = 1.0) -> None:
    shades = _subjects(loops)
    for flown in loops:
        _line(axes, flown, scale * flown.figures[figure][:, _place(flown)], color=shades[flown.loop])
    axes.set_yscale("log")
    axes.set(title=title, ylabel=label)


def _velocity(axes: Axes, loops: list[FormationFlight]) -> None:
    shades, drawn = _subjects(loops), False
    for flown in loops:
        for name in _observers(flown):
            shade = shades.get(f"{flown.loop}/{name}", shades[flown.loop])
            square = flown.figures[f"{name}/velocity_squared"][:, _place(flown)]
            smooth = np.sqrt(np.maximum(uniform_filter1d(square, max(1, round(SMOOTH_S / flown.dt))), 1e-30))
            _line(axes, flown, smooth, color=shade)
            drawn = True
    axes.set(title=f"Error of estimated rates, RMS of all, {SMOOTH_S:g} s", ylabel="error [1/s]")
    if drawn:
        axes.set_yscale("log")
    else:
        axes.text(0.5, 0.5, "no observer", transform=axes.transAxes, ha="center", color=QUIET)


def _shown(loops: list[FormationFlight]) -> FormationFlight:
    """A loop that an observer closes, if there is one."""
    return next((flown for flown in loops if _observers(flown)), loops[0])


def _turns(axes: Axes, flown: FormationFlight) -> None:
    """|sigma| of each agent: above one it has turned more than half around."""
    length = np.sqrt(np.sum(flown.channels["truth/state"][:, 0, :, :3] ** 2, axis=-1))
    agents = length.shape[1]
    for number, values in enumerate(length.T):
        _line(axes, flown, values, color=colour(number, agents), label=f"{number + 1}" if agents <= 12 else None)
    _line(axes, flown, np.sqrt(np.sum(flown.leader[:, :3] ** 2, axis=-1)), color="black", ls="--", label="leader")
    axes.axhline(1.0, color=QUIET, lw=0.8, ls=":")
    axes.set(title=f"Turns in {flown.loop}, |sigma|; 1: half a turn", ylabel="|sigma| [-]")
    axes.legend(ncols=4, loc="upper right", columnspacing=1.0, handlelength=1.4)


def _wheels(axes: Axes, flown: FormationFlight) -> None:
    """Speed of each testbed's fastest wheel."""
    fastest = np.max(np.abs(flown.channels["truth/wheel_speed"][:, 0]), axis=-1) / RPM
    for number, values in enumerate(fastest.T):
        _line(axes, flown, values, color=colour(number, fastest.shape[1]), label=f"{number + 1}")
    axes.set(title=f"Fastest wheel of each testbed in {flown.loop}", ylabel="speed [rpm]", ylim=(0.0, None))
    axes.legend(ncols=4, loc="upper right", columnspacing=1.0, handlelength=1.4)


def _torque(axes: Axes, flown: FormationFlight) -> None:
    applied = flown.channels["applied"][:, 0]
    size = np.sqrt(uniform_filter1d(np.sum(applied**2, axis=-1), max(1, round(SMOOTH_S / flown.dt)), axis=0).clip(1e-30))
    for number, values in enumerate(size.T):
        _line(axes, flown, 1e3 * values, color=colour(number, size.shape[1]))
    axes.set_yscale("log")
    axes.set(title=f"Torque of each in {flown.loop}, RMS over {SMOOTH_S:g} s", ylabel="torque [mN m]")
