"""`report.png` of several closed loops: one trial of each, side by side, as a figure for a paper."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from models.dynamics.state_layout import WHEELS
from sim.loop.recording import Recording
from sim.report.axes import QUIET, Several, line, over, plain_log, shade_faults
from sim.report.estimates import counting, draw_estimate, draw_particles, draw_rate_error
from sim.report.learned import draw_error, draw_torque
from sim.report.modes import draw_gains, draw_modes
from sim.report.tracking import draw_angle, draw_body_rate, draw_running_error
from sim.scenario.one_body import Scenario
from sim.series.learned import learners
from sim.series.loops import Flight, edges, flights, moving_rms, torque_unit, window
from sim.series.palette import WHEEL_COLORS
from sim.series.picture_style import STYLE
from sim.text.table_style import counted
from sim.units import RPM

MOST_IN_A_ROW = 6  # entries of the legend


def draw_report(name: str, scenario: Scenario, recordings: dict[str, Recording]) -> Figure:
    """Draw the first recorded trial of every loop: tracking, what is believed of the wheels, gains, torque, wheels, estimates.

    The running RMS of the tracking errors starts anew where a fault begins or ends: so it ends, in each phase, at the number that
    papers print and docs/metrics.md defines, and the first transient does not hide the fault. Diamonds are those printed numbers.

    Args:
      name: of the scenario.
      scenario: with all its loops.
      recordings: of one trial or more, by loop; of a failed run, those loops that there are.
    """
    several = flights(scenario, recordings)
    recording = several[0].recording
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(13.0, 10.2), dpi=160, layout="constrained")
        grid = figure.subplots(3, 3, sharex=True)
        restarts = edges(several)
        for axis in range(3):
            draw_running_error(grid[0, axis], several, axis, restarts)
        draw_angle(grid[1, 0], several)
        modal = any(flight.probabilities is not None for flight in several)
        wheels = several[0].channel("truth/state").shape[-1] > 7
        if learners(several):
            draw_error(grid[1, 1], several, line)
            plain_log(grid[1, 1])
            draw_torque(grid[1, 2], several)
        else:
            (draw_modes if modal else draw_body_rate)(grid[1, 1], several)
            (draw_gains if modal or not counting(several) else draw_particles)(grid[1, 2], several)
        _effort(grid[2, 0], several)
        (_wheel_speeds if wheels else draw_rate_error)(grid[2, 1], several)
        draw_estimate(grid[2, 2], several)
        for letter, axes in zip("abcdefghi", grid.flat, strict=True):
            shade_faults(axes, several)
            axes.set_title(f"({letter}) {axes.get_title(loc='left')}", loc="left")
            axes.set_xlim(0.0, max(recording.dt, *(flight.recording.time[-1] for flight in several)))
        for axes in grid[-1]:
            axes.set_xlabel("time [s]")
        _legend(figure, several)
        figure.suptitle(f"{scenario.title}\n", x=0.01, ha="left", fontsize=12, fontweight="bold")
        happened = dict.fromkeys((o.start_tick, o.text) for flight in several for o in flight.recording.occurrences)
        said = [f"{name}, trial {recording.trials[0]}, {counted(len(several), 'closed loop')}"]
        said += ["; ".join(f"{text} at {recording.dt * start:.1f} s" for start, text in happened)] if happened else []
        said += [f"diamonds: as printed, {scenario.published.source}"] if scenario.published and restarts else []
        figure.text(0.01, 0.964, " | ".join(said), fontsize=8, color=QUIET)
        return figure


def _legend(figure: Figure, several: Several) -> None:
    """One legend for all panels: a row for each control law, a column for each variant where the laws share them."""
    families = sorted({flight.look.family for flight in several})
    rows = [sorted((f for f in several if f.look.family == family), key=lambda f: f.look.variant) for family in families]
    width = max(map(len, rows))
    if width > MOST_IN_A_ROW:
        rows, width = [[f for row in rows for f in row]], MOST_IN_A_ROW
    empty = Line2D([], [], ls="none", label=" ")
    by_column = [_handle(row[i]) if i < len(row) else empty for i in range(max(map(len, rows))) for row in rows]
    figure.legend(handles=by_column, loc="outside lower center", ncols=width, fontsize=9, handlelength=3.6, columnspacing=2.4)


def _handle(flight: Flight) -> Line2D:
    return Line2D([], [], label=flight.name, **line(flight, 1.8))


def _effort(axes: Axes, several: Several) -> None:
    ticks = window(several)
    scale, unit = torque_unit(several)
    for flight in several:
        demanded = scale * np.linalg.norm(flight.channel("torque_B"), axis=-1)
        axes.semilogy(flight.recording.time, moving_rms(demanded, ticks), **line(flight))
    axes.set(title=f"Torque demanded, {over(several)}", ylabel=f"torque on the body [{unit}]")
    plain_log(axes)


def _wheel_speeds(axes: Axes, several: Several) -> None:
    """Of the loop that shares the torque out anew, if there is one."""
    weighted = (flight for flight in several if flight.scenario.law.allocation.type == "mode-weighted")
    flight = next(weighted, several[0])
    for wheel, speed in enumerate(flight.channel("truth/state")[:, WHEELS].T):
        axes.plot(flight.recording.time, speed / RPM, color=WHEEL_COLORS[wheel % len(WHEEL_COLORS)], label=f"wheel {wheel + 1}")
    axes.set(title=f"Wheel speeds of {flight.name}", ylabel="speed [rpm]")
    axes.margins(y=0.2)
    axes.legend(ncols=4, loc="upper left", columnspacing=1.2, handlelength=1.6)
