"""`report.png` of antenna mapping under unfalsified control: figures 5 to 11 of Tsao, Brozenec & Safonov on one page."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator
from numpy.typing import NDArray

from sim.loop.recording import Recording
from sim.metrics.antenna_study import CHANNELS
from sim.report.axes import FAULT, QUIET
from sim.scenario.one_body import Scenario
from sim.series.antenna import AntennaFlight, antenna_flights
from sim.series.antenna_panels import LIGHT, plain_log, plane, response
from sim.series.loops import torque_unit
from sim.series.palette import WHEEL_COLORS
from sim.series.picture_style import STYLE

Array = NDArray[np.floating]
Several = tuple[AntennaFlight, ...]

DASHES: tuple[Any, ...] = ("-", (0.0, (3.0, 1.5)))  # azimuth, elevation


def draw_report(name: str, scenario: Scenario, recordings: dict[str, Recording]) -> Figure:
    """Draw the first recorded trial: a column each for azimuth and elevation, and one for what they share.

    Args:
      name: of the scenario.
      scenario: all of whose loops are under unfalsified control.
      recordings: of one trial or more, by loop; of a failed run, those loops that there are.
    """
    several = antenna_flights(scenario, recordings)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(14.0, 13.4), dpi=150, layout="constrained")
        grid = figure.add_gridspec(4, 3)
        shared = [_references, _parameters, _wheel_torques, _panels]
        in_time: list[Axes] = []
        for channel in range(2):
            error = figure.add_subplot(grid[0, channel])
            _error(error, several, channel)
            in_time.append(error)
            plane(figure.add_subplot(grid[1, channel]), several, channel, LIGHT)
            for row, effort in ((2, False), (3, True)):
                response(figure.add_subplot(grid[row, channel]), several, channel, effort, LIGHT)
        for row, draw in enumerate(shared):
            in_time += draw(figure, grid[row, 2], several)
        for axes in in_time:
            axes.set_xlim(0.0, max(several[0].recording.dt, *(flight.recording.time[-1] for flight in several)))
            _mark_faults(axes, several)
        titled = sorted((axes for axes in figure.axes if axes.get_title(loc="left")), key=_place)
        for letter, axes in zip("abcdefghijklmnop", titled, strict=False):
            axes.set_title(f"({letter}) {axes.get_title(loc='left')}", loc="left")
        _legend(figure, several)
        figure.suptitle(f"{scenario.title}\n", x=0.01, ha="left", fontsize=12, fontweight="bold")
        figure.text(0.01, 0.9725, _said(name, several), fontsize=8, color=QUIET)
        return figure


def _place(axes: Axes) -> tuple[int, int, int]:
    spec = axes.get_subplotspec()
    assert spec is not None
    top = spec.get_topmost_subplotspec()
    return top.rowspan.start, top.colspan.start, spec.rowspan.start if spec is not top else 0


def _said(name: str, several: Several) -> str:
    first = several[0]
    said = [f"{name}, trial {first.recording.trials[0]}", f"lambda = {first.law.pace:g} rad/s"]
    identified = first.scenario.identification or any(first.recording.findings)
    linear = first.linear(0, first.theta[0, 0]) is not None
    if (
        drawn := ["circles: identified in closed loop"] * bool(identified)
        + [f"{'lines' if identified else 'responses'}: linear model"] * linear
    ):
        said.append("; ".join(drawn))
    happened = dict.fromkeys((o.start_tick, o.text) for flight in several for o in flight.recording.occurrences)
    said += [f"{text} at {first.recording.dt * start:.1f} s" for start, text in happened]
    return " | ".join(said)


def _legend(figure: Figure, several: Several) -> None:
    handles = [Line2D([], [], color=f.look.on_light, lw=1.8, label=f"loop {f.name}") for f in several]
    handles += [Line2D([], [], color=QUIET, lw=1.4, ls=ls, label=c) for c, ls in zip(CHANNELS, DASHES, strict=True)]
    marks = (("o", LIGHT.first, "first controller"), ("*", several[0].look.on_light, f"last controller of {several[0].name}"))
    handles += [
        Line2D([], [], color=color, ls="none", marker=marker, ms=8, mfc=color if marker == "*" else "none", label=label)
        for marker, color, label in marks
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), fontsize=9, handlelength=3.0, columnspacing=2.4)


def _mark_faults(axes: Axes, several: Several) -> None:
    for start, end in {(o.start_tick, o.end_tick) for flight in several for o in flight.recording.occurrences}:
        axes.axvspan(several[0].recording.dt * start, several[0].recording.dt * end, color=FAULT, alpha=0.06, lw=0, zorder=0)


def _error(axes: Axes, several: Several, channel: int) -> None:
    half = several[0].recording.ticks // 2
    for flight in reversed(several):
        error = flight.pointed[:, channel] - flight.wanted[:, channel]
        rms = np.sqrt(np.mean(error[half:] ** 2)) if len(error) > half else np.nan
        axes.plot(flight.recording.time, error, color=flight.look.on_light, lw=1.0, label=f"{flight.name}: RMS {rms:.3g} in 2nd half")
    for tick in several[0].switches[channel]:
        axes.axvline(several[0].recording.dt * tick, color=several[0].look.on_light, lw=0.7, ls=":", zorder=0)
    axes.set(title=f"Pointing error of {CHANNELS[channel]}, dotted: switches", ylabel="angle - reference [deg]", xlabel="time [s]")
    axes.margins(y=0.22)
    axes.legend(*(part[::-1] for part in axes.get_legend_handles_labels()), loc="upper right", ncols=2, handlelength=1.6, columnspacing=1.2)


def _two(figure: Figure, cell: SubplotSpec, alike: bool = False) -> tuple[Axes, Axes]:
    """Two low panels in the place of one."""
    halves = cell.subgridspec(2, 1, hspace=0.05)
    top = figure.add_subplot(halves[0])
    bottom = figure.add_subplot(halves[1], sharex=top, sharey=top if alike else None)
    top.tick_params(labelbottom=False)
    bottom.set_xlabel("time [s]")
    return top, bottom


def _references(figure: Figure, cell: SubplotSpec, several: Several) -> list[Axes]:
    axes = figure.add_subplot(cell)
    for channel, dashes in enumerate(DASHES):
        axes.plot(several[0].recording.time, several[0].wanted[:, channel], color=QUIET, ls=dashes, label=CHANNELS[channel])
    axes.set(title="Reference", ylabel="angle [deg]", xlabel="time [s]")
    axes.margins(y=0.18)
    axes.legend(loc="upper right", ncols=2)
    return [axes]


def _parameters(figure: Figure, cell: SubplotSpec, several: Several) -> list[Axes]:
    both = _two(figure, cell)
    labels = (r"$\theta_1$ [rad/(N m)]", r"$\theta_2$ [s]")
    for part, (axes, label) in enumerate(zip(both, labels, strict=True)):
        for flight in reversed(several):
            for channel, dashes in enumerate(DASHES):
                values, time = flight.theta[:, channel, part], flight.recording.time
                axes.step(time, values, where="post", color=flight.look.on_light, ls=dashes, lw=1.3 if flight is several[0] else 0.9)
                after = np.minimum(flight.switches[channel] + 1, len(time) - 1)
                axes.plot(time[after], values[after], "o", ms=3.0, color=flight.look.on_light)
        axes.set(yscale="log", ylabel=label)
        low, high = axes.get_ylim()
        axes.set_ylim(low / 1.5, high * 1.5)
        plain_log(axes, axes.yaxis)
    last = max((int(s[-1]) for f in several for s in f.switches if len(s)), default=None)
    said = f", the last switch at {several[0].recording.dt * last:.1f} s" if last is not None else ", no switch"
    both[0].set_title(f"Controllers{said}", loc="left")
    return list(both)


def _wheel_torques(figure: Figure, cell: SubplotSpec, several: Several) -> list[Axes]:
    scale, unit = torque_unit(several)
    both = _two(figure, cell, alike=True)
    for axes, flight in zip(both, several, strict=False):
        for wheel, torque in enumerate(scale * flight.channel("applied").T):
            look: dict[str, Any] = {
                "color": WHEEL_COLORS[wheel % len(WHEEL_COLORS)],
                "ls": "-" if wheel < 2 else (0.0, (2.0, 2.0)),
            }  # opposite ones are alike
            axes.plot(flight.recording.time, torque, lw=0.9, label=f"wheel {wheel + 1}", **look)
        axes.set_ylabel(f"{flight.name} [{unit}]")
    both[0].set_title("Torque of the wheels' motors", loc="left")
    both[0].margins(y=0.28)
    both[0].legend(loc="upper left", ncols=4, handlelength=1.8, columnspacing=1.0)
    return list(both)


def _panels(figure: Figure, cell: SubplotSpec, several: Several) -> list[Axes]:
    both: tuple[Axes, ...] = _two(figure, cell) if several[0].panels else (figure.add_subplot(cell),)
    if len(both) > 1:
        for flight in reversed(several):
            for angle in list(flight.panels.values())[:1]:
                both[0].plot(flight.recording.time, angle, color=flight.look.on_light, lw=0.8)
        both[0].set_title("Panel against hub; worse test, falsified above 0", loc="left")
        both[0].set_ylabel("panel [deg]")
    else:
        both[0].set(title="Worse test, falsified above 0", xlabel="time [s]")
    tests = both[-1]
    for flight in reversed(several):
        score = np.max(flight.channel("control/score"), axis=-1)
        for channel, dashes in enumerate(DASHES):
            heard = np.where(score[:, channel] == 0.0, np.nan, score[:, channel])
            tests.plot(flight.recording.time, heard, color=flight.look.on_light, ls=dashes, lw=0.9)
    tests.axhline(0.0, color=LIGHT.bound, lw=0.9)
    tests.set_yscale("symlog", linthresh=1.0, linscale=1.5)
    tests.set_ylim(-1.3, max(1.3, tests.get_ylim()[1]))
    tests.yaxis.set_major_locator(FixedLocator([-1.0, 0.0, 1.0, 10.0, 100.0, 1000.0]))
    tests.yaxis.set_minor_locator(NullLocator())
    tests.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    tests.set_ylabel(r"test / $\int y^2$ [-]")
    return list(both)
