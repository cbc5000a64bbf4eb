"""`learners.png` and `weights.png` of agents that learn: what Rososhansky (2017) draws in figures 5.2 to 5.10 and in appendix C."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from models.dynamics.state_layout import POSITION
from sim.estimators.learner_settings import Nothing
from sim.loop.recording import Recording
from sim.scenario.consensus import ConsensusScenario
from sim.series.consensus import line_styles, occurrences
from sim.series.picture_style import STYLE
from sim.series.raster import write_png

Array = NDArray[np.floating]
Loops = dict[str, Recording]

MOST = 6  # agents that are drawn: the first
FAULT, QUIET = "#d62839", "#5a6270"
MARGIN = 0.15  # of the span of what is drawn of loops that hold the agents
LOST = 3.0  # times that span: what is further out has diverged, and sets no axis


def write_learners(path: Path, name: str, scenario: ConsensusScenario, flown: Loops) -> None:
    """Draw f + d and W phi, commands, positions and their errors to the leader of all agents in all loops, by axis, of the first trial.

    Args:
      path: PNG to write.
      name: of the scenario.
      scenario: with all its loops.
      flown: of one trial or more, by loop; those that learn nothing are left out.
    """
    shown = {loop: one for loop, one in flown.items() if not isinstance(scenario.loops[loop], Nothing)} or flown
    looks = _looks(scenario)
    agents = min(scenario.plant.agents, MOST)
    leader = next(iter(shown.values())).channels["reference/leader"]
    rows: tuple[tuple[str, str, Callable[[Recording, int, int], Array]], ...] = (
        ("learned, f + d broad", "N", lambda one, agent, axis: one.channels["learned"][:, 0, agent, axis]),
        ("command", "N", lambda one, agent, axis: one.channels["force"][:, 0, agent, axis]),
        ("position, leader broad", "m", lambda one, agent, axis: one.channels["truth/state"][:, 0, agent, POSITION][:, axis]),
        ("estimate - position", "mm", lambda one, agent, axis: 1e3 * _apart(one, agent)[:, axis]),
        ("position - leader", "m", lambda one, agent, axis: one.channels["truth/state"][:, 0, agent, POSITION][:, axis] - leader[:, axis]),
    )
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(3.6 * agents + 1.0, 2.0 * 2 * len(rows) + 1.2), dpi=110)
        grid = figure.subplots(2 * len(rows), agents, sharex=True, squeeze=False)
        for row, (what, unit, of) in enumerate(rows):
            for axis in range(2):
                for agent, axes in enumerate(grid[2 * row + axis]):
                    drawn = {loop: of(one, agent, axis) for loop, one in shown.items() if row or loop not in _exact(shown)}
                    for loop, values in drawn.items():
                        axes.plot(shown[loop].time, values, lw=0.8, **looks[loop])
                    if row in {0, 2}:
                        broad = _unknown(shown, agent, axis) if row == 0 else leader[:, axis]
                        axes.plot(next(iter(shown.values())).time, broad, color="black", lw=2.4, alpha=0.25, zorder=0)
                        drawn["broad"] = broad
                    _span(axes, list(drawn.values()))
                    axes.set_title(f"{what}, {'xy'[axis]}, agent {agent + 1} [{unit}]", fontsize=8)
        _finish(
            figure,
            grid[-1],
            grid,
            shown,
            looks,
            f"{name}, trial {next(iter(shown.values())).trials[0]} | what every loop knows and does | {scenario.title}",
        )
        write_png(figure, path)


def write_weights(path: Path, name: str, scenario: ConsensusScenario, flown: Loops) -> None:
    """Draw all weights of every agent in every loop that learns, of the first trial: a row for a loop, the rows of W in two shades.

    Args:
      path: PNG to write.
      name: of the scenario.
      scenario: with all its loops.
      flown: of one trial or more, by loop.
    """
    learning = {loop: one for loop, one in flown.items() if "weights" in one.channels}
    agents = min(scenario.plant.agents, MOST)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(3.6 * agents + 1.0, 2.3 * max(len(learning), 1) + 1.2), dpi=110)
        grid = figure.subplots(max(len(learning), 1), agents, sharex=True, squeeze=False)
        shades = [mpl.colormaps[shade](np.linspace(0.35, 0.95, 13)) for shade in ("Blues", "Oranges")]
        for row, (loop, one) in zip(grid, learning.items(), strict=False):
            for agent, axes in enumerate(row):
                weights = one.channels["weights"][:, 0, agent]
                half = weights.shape[-1] // 2
                for number in range(weights.shape[-1]):
                    shade = shades[number // half]
                    axes.plot(one.time, weights[:, number], lw=0.7, color=shade[number % half % len(shade)])
                axes.set_title(f"W of {loop}, agent {agent + 1}", fontsize=8)
        if not learning:
            grid[0, 0].set_title("no loop learns")
        handles = [Line2D([], [], lw=1.8, color=shade[8], label=f"row of W for {axis}") for shade, axis in zip(shades, "xy", strict=True)]
        _finish(
            figure, grid[-1], grid, flown, {}, f"{name}, trial {next(iter(flown.values())).trials[0]} | weights | {scenario.title}", handles
        )
        write_png(figure, path)


def _looks(scenario: ConsensusScenario) -> dict[str, dict[str, Any]]:
    return {
        loop: {"color": look.on_light, "ls": (0.0, look.dashes) if look.dashes else "-"} for loop, look in line_styles(scenario).items()
    }


def _exact(shown: Loops) -> set[str]:
    """Loops that learn nothing because they know everything."""
    return {loop for loop, one in shown.items() if "weights" not in one.channels}


def _unknown(shown: Loops, agent: int, axis: int) -> Array:
    """What is not known, f + d, along the motion of the loop that follows the leader best."""
    return _best(shown).channels["unknown"][:, 0, agent, axis]


def _best(shown: Loops) -> Recording:
    """The loop with the least error to the leader in the middle of its run."""

    def error(one: Recording) -> float:
        apart = one.channels["truth/state"][:, 0, :, POSITION] - one.channels["reference/leader"][:, None]
        return float(np.nan_to_num(np.median(np.abs(apart)), nan=np.inf))

    return min(shown.values(), key=error)


def _apart(one: Recording, agent: int) -> Array:
    """Estimated minus true position of an agent, (ticks, 2)."""
    return (one.channels["estimate"][:, 0, agent] - one.channels["truth/state"][:, 0, agent])[:, POSITION]


def _span(axes: Axes, values: list[Array]) -> None:
    """An axis for what holds: nothing that has diverged hides the rest."""
    spans = [np.nanquantile(np.abs(one[np.isfinite(one)]), 0.98) for one in values if np.isfinite(one).any()]
    if not spans or not (middle := float(np.median(spans))):
        return
    inside = np.concatenate([one[np.isfinite(one) & (np.abs(one) < LOST * middle)] for one in values])
    low, high = float(np.min(inside)), float(np.max(inside))
    pad = MARGIN * max(high - low, 1e-9)
    axes.set_ylim(low - pad, high + pad)


def _finish(
    figure: Figure, last: Any, grid: Any, flown: Loops, looks: dict[str, dict[str, Any]], title: str, handles: list[Line2D] | None = None
) -> None:
    """Time axes, faults, what is which, and the headline."""
    first = next(iter(flown.values()))
    for axes in _all(grid):
        axes.set_xlim(0.0, max(first.time[-1], first.dt))
        for one in occurrences(flown):
            axes.axvline(first.dt * one.start_tick, color=FAULT, lw=0.7, alpha=0.7, zorder=0)
    for axes in last:
        axes.set_xlabel("time [s]")
    handles = handles or [Line2D([], [], lw=1.8, label=loop, **looks[loop]) for loop in flown]
    width, height = figure.get_size_inches()  # fixed places: to work them out for so many panels takes ten times as long as to draw them
    figure.subplots_adjust(0.55 / width, 0.85 / height, 1.0 - 0.1 / width, 1.0 - 0.65 / height, wspace=0.22, hspace=0.34)
    figure.legend(handles=handles, loc="lower center", ncols=len(handles), fontsize=10, handlelength=3.0)
    figure.suptitle(title, x=0.01, y=1.0 - 0.12 / height, va="top", ha="left", fontsize=12, fontweight="bold")


def _all(grid: Any) -> Iterator[Axes]:
    yield from grid.flat
