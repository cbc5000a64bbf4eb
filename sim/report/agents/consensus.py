"""`report.png` of agents that follow a leader: one trial of every loop, as a figure for a paper."""

from __future__ import annotations

from itertools import cycle
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator
from numpy.typing import NDArray

from sim.loop.recording import Recording
from sim.metrics.consensus import absolute_error, dynamics_error, relative_error
from sim.scenario.consensus import ConsensusScenario
from sim.series.consensus import SMOOTHING_S, chosen, line_styles, moving_mean, occurrences
from sim.series.picture_style import STYLE

Array = NDArray[np.floating]

Lines = dict[str, dict[str, Any]]  # how every loop's are drawn

AGENT_COLORS = ("#d1382d", "#e58a1f", "#b59a12", "#2c9c4b", "#3066be", "#8a4fc0")
FAULT, QUIET = "#d62839", "#5a6270"
OUT_OF_SIGHT = 30.0  # m: what has diverged leaves the picture
ONE = 0  # agent whose dynamics are drawn


def draw_report(name: str, scenario: ConsensusScenario, flown: dict[str, Recording]) -> Figure:
    """Draw the first recorded trial: errors, the paths, what is learned, and what it costs.

    Args:
      name: of the scenario.
      scenario: with all its loops.
      flown: of one trial or more, by loop.
    """
    lines: Lines = {
        loop: {"color": look.on_light, "ls": (0.0, look.dashes) if look.dashes else "-"} for loop, look in line_styles(scenario).items()
    }
    first = next(iter(flown.values()))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(13.0, 7.4), dpi=160, layout="constrained")
        grid = figure.subplots(2, 3)
        _errors(grid[0, 0], flown, lines, "Absolute error AEM", {k: absolute_error(f)[:, 0] for k, f in flown.items()}, "m")
        _errors(grid[0, 1], flown, lines, "Relative error REM", {k: relative_error(f)[:, 0] for k, f in flown.items()}, "m")
        _paths(grid[0, 2], chosen(flown), flown[chosen(flown)])
        wrong = {k: np.sqrt(moving_mean(dynamics_error(f)[:, 0], f.dt)) for k, f in flown.items() if k != "exact"}
        _errors(grid[1, 0], flown, lines, f"Error of the learned dynamics, RMS over {SMOOTHING_S:g} s", wrong, "N")
        _learned(grid[1, 1], flown, lines)
        force = {k: np.linalg.norm(f.channels["force"][:, 0], axis=(-2, -1)) for k, f in flown.items()}
        smooth = {k: moving_mean(value, flown[k].dt) for k, value in force.items()}
        _errors(grid[1, 2], flown, lines, f"Command of all agents, mean over {SMOOTHING_S:g} s", smooth, "N")
        for letter, axes in zip("abcdef", grid.flat, strict=True):
            axes.set_title(f"({letter}) {axes.get_title(loc='left')}", loc="left")
            if axes is not grid[0, 2]:
                axes.set(xlabel="time [s]", xlim=(0.0, max(first.time[-1], first.dt)))
                for one in occurrences(flown):
                    axes.axvline(first.dt * one.start_tick, color=FAULT, lw=0.7, alpha=0.7, zorder=0)
        handles = [Line2D([], [], lw=1.8, label=loop, **lines[loop]) for loop in flown]
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), fontsize=9, handlelength=3.0)
        figure.suptitle(f"{scenario.title}\n", x=0.01, ha="left", fontsize=12, fontweight="bold")
        said = [f"{name}, trial {first.trials[0]}", *(f"{one.text} from {first.dt * one.start_tick:g} s" for one in occurrences(flown))]
        figure.text(0.01, 0.952, " | ".join(said), fontsize=8, color=QUIET)
        return figure


def _errors(axes: Axes, flown: dict[str, Recording], lines: Lines, title: str, values: dict[str, Array], unit: str) -> None:
    """Logarithmic curves; those that diverge leave the picture."""
    low, high = np.inf, 0.0
    for loop, curve in values.items():
        axes.semilogy(flown[loop].time, curve, lw=1.2, **lines[loop])
        low = float(np.nanmin(curve[curve > 0.0], initial=low))
        inside = curve[np.isfinite(curve)]
        if len(inside) and inside[-1] < OUT_OF_SIGHT:
            high = max(high, float(np.max(inside)))
    axes.set(title=title, ylabel=unit)
    if 0.0 < low < high:
        axes.set_ylim(0.8 * low, 2.0 * high)
    low, high = axes.get_ylim()
    axes.yaxis.set_major_locator(LogLocator(10, subs=(1.0,) if high > 300.0 * low else (1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_locator(NullLocator())


def _paths(axes: Axes, loop: str, flown: Recording) -> None:
    """Where the agents of one loop went."""
    truth = flown.channels["truth/state"][:, 0]
    for number, (path, colour) in enumerate(zip(np.moveaxis(truth[..., :2], 1, 0), cycle(AGENT_COLORS), strict=False), 1):
        axes.plot(*path.T, color=colour, lw=0.9)
        axes.plot(*path[0], "o", color=colour, ms=4)
        axes.annotate(f"{number}", tuple(path[0]), xytext=(4, 3), textcoords="offset points", fontsize=7.5, color=colour)
    axes.plot(*flown.channels["reference/leader"].T, color="black", lw=1.2, ls=(0.0, (3.0, 2.0)))
    axes.set(title=f"Paths of {loop}; dashed: leader", xlabel="x [m]", ylabel="y [m]", aspect="equal")


def _learned(axes: Axes, flown: dict[str, Recording], lines: Lines) -> None:
    """What moves one agent, and what each loop makes of it; loops have motions of their own, but those that track share the leader's."""
    truth = flown[chosen(flown)]
    unknown = truth.channels["unknown"][:, 0, ONE, 0]
    axes.plot(truth.time, unknown, color="black", lw=2.2, alpha=0.35)
    for loop, one in flown.items():
        if loop not in {"exact", "none"}:
            axes.plot(one.time, one.channels["learned"][:, 0, ONE, 0], lw=1.0, **lines[loop])
    span = max(float(np.nanmax(np.abs(unknown))), 1e-3)
    axes.set(title=f"f + d along x, agent {ONE + 1} of {chosen(flown)} (broad), and W phi", ylabel="N", ylim=(-1.6 * span, 1.6 * span))
