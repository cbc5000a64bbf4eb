"""`report.png` of several closed loops: one trial of each, side by side, as a figure for a paper."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator
from numpy.typing import NDArray

from sim.learned_series import learners
from sim.loop_series import GAIN_NAMES, GAIN_UNITS, Flight, edges, flights, moving_mean, moving_rms, running_rms, torque_unit, window
from sim.palette import WHEEL_COLORS
from sim.recording import Recording
from sim.report import STYLE
from sim.report_learned import draw_error, draw_torque
from sim.scenario import Scenario
from sim.series import RPM

Array = NDArray[np.floating]
Several = tuple[Flight, ...]

FAULT = "#d62839"
QUIET = "#5a6270"
PLATE: dict[str, Any] = {"facecolor": "white", "edgecolor": "none", "pad": 0.6, "alpha": 0.85}
MOST_IN_A_ROW = 6  # entries of the legend
SYMBOLS = {"phi": "$\\phi$", "theta": "$\\theta$", "psi": "$\\psi$", "lambda": "$\\lambda$", "K_p": "$K_p$", "K_d": "$K_d$", "K": "$K$"}


def write_report(path: Path, name: str, scenario: Scenario, recordings: dict[str, Recording]) -> None:
    """Draw the first recorded trial of every loop: tracking, what is believed of the wheels, gains, torque, wheels, estimates.

    The running RMS of the tracking errors starts anew where a fault begins or ends: so it ends, in each phase, at the number that
    papers print and docs/metrics.md defines, and the first transient does not hide the fault. Diamonds are those printed numbers.

    Args:
      path: PNG to write.
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
            _running_error(grid[0, axis], several, axis, restarts)
        _angle(grid[1, 0], several)
        modal = any(flight.probabilities is not None for flight in several)
        wheels = several[0].channel("truth/state").shape[-1] > 7
        if learners(several):
            draw_error(grid[1, 1], several, _line)
            _plain_log(grid[1, 1])
            draw_torque(grid[1, 2], several)
        else:
            (_modes if modal else _body_rate)(grid[1, 1], several)
            (_gains if modal or not _counting(several) else _particles)(grid[1, 2], several)
        _effort(grid[2, 0], several)
        (_wheel_speeds if wheels else _rate_error)(grid[2, 1], several)
        _estimate(grid[2, 2], several)
        for letter, axes in zip("abcdefghi", grid.flat, strict=True):
            _shade_faults(axes, several)
            axes.set_title(f"({letter}) {axes.get_title(loc='left')}", loc="left")
            axes.set_xlim(0.0, max(recording.dt, *(flight.recording.time[-1] for flight in several)))
        for axes in grid[-1]:
            axes.set_xlabel("time [s]")
        _legend(figure, several)
        figure.suptitle(f"{scenario.title}\n", x=0.01, ha="left", fontsize=12, fontweight="bold")
        happened = dict.fromkeys((o.start_tick, o.text) for flight in several for o in flight.recording.occurrences)
        said = [f"{name}, trial {recording.trials[0]}, {len(several)} closed loop{'s' if len(several) > 1 else ''}"]
        said += ["; ".join(f"{text} at {recording.dt * start:.1f} s" for start, text in happened)] if happened else []
        said += [f"diamonds: as printed, {scenario.published.source}"] if scenario.published and restarts else []
        figure.text(0.01, 0.964, " | ".join(said), fontsize=8, color=QUIET)
        figure.savefig(path)


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
    return Line2D([], [], label=flight.name, **_line(flight, 1.8))


def _line(flight: Flight, width: float = 1.15) -> dict[str, Any]:
    return {"color": flight.look.on_light, "lw": width, "ls": (0.0, flight.look.dashes) if flight.look.dashes else "-"}


def _shade_faults(axes: Axes, several: Several) -> None:
    for start, end in {(o.start_tick, o.end_tick) for flight in several for o in flight.recording.occurrences}:
        dt = several[0].recording.dt
        axes.axvspan(dt * start, dt * end, color=FAULT, alpha=0.06, lw=0, zorder=0)
        axes.axvline(dt * start, color=FAULT, lw=0.7, alpha=0.6, zorder=0)


def _running_error(axes: Axes, several: Several, axis: int, restarts: list[int]) -> None:
    label, settled, lowest = several[0].axes[axis], 2 * window(several), np.inf
    for flight in several:
        running = running_rms(flight.errors[:, axis], restarts)
        for first, last in zip([0, *restarts], [*restarts, len(running)], strict=True):  # no line from one phase to the next
            axes.semilogy(flight.recording.time[first:last], running[first:last], **_line(flight))
            lowest = float(np.min(running[first + settled : last], initial=lowest))
        for tick, value in _published(flight, f"rmse_{label}_deg", restarts).items():
            axes.plot(
                flight.recording.time[tick], value, "D", ms=4.5, mfc=flight.look.on_light, mec="white", mew=0.6, clip_on=False, zorder=5
            )
            lowest = min(lowest, value)
    name = f"of {SYMBOLS[label]}" if label in SYMBOLS else f"about {label}"
    anew = ", restarted at fault edges" if len(restarts) > 1 else ", restarted at the fault" if restarts else ""
    axes.set(title=f"RMSE {name}{anew}", ylabel="running RMSE [deg]")
    if 0.0 < lowest < np.inf:
        axes.set_ylim(bottom=0.7 * lowest)  # the first few errors after a restart are no mean yet
    _plain_log(axes)


def _published(flight: Flight, metric: str, restarts: list[int]) -> dict[int, float]:
    """What the paper prints of a phase, by the phase's last tick."""
    printed = flight.scenario.published.values.get(flight.name, {}) if flight.scenario.published else {}
    stops = [*restarts, flight.recording.ticks][:2] if restarts else []
    ends = dict(zip((stop - 1 for stop in stops), ("nominal", "fault"), strict=False))
    named = {tick: f"{metric}@{phase}" for tick, phase in ends.items() if tick < flight.recording.ticks}
    return {tick: printed[key] for tick, key in named.items() if key in printed}


def _angle(axes: Axes, several: Several) -> None:
    ticks = window(several)
    for flight in several:
        axes.semilogy(flight.recording.time, moving_rms(flight.angle, ticks), **_line(flight))
    axes.set(title=f"Tracking error of the body (truth), {_over(several)}", ylabel="angle [deg]")
    _plain_log(axes)


def _modes(axes: Axes, several: Several) -> None:
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


def _gains(axes: Axes, several: Several) -> None:
    """Gains over those of the first, healthy, mode: the same axis for all laws."""
    named: dict[tuple[int, str], tuple[float, str, str]] = {}
    for flight in several:
        for number, (key, gain) in enumerate(flight.gains.items()):
            of_modes = np.atleast_1d(flight.scenario.law.gains[key])
            if len(of_modes) > 1:
                axes.semilogy(flight.recording.time, gain / of_modes[0], **_line(flight, 1.3 if number == 0 else 0.9))
                text = f"{SYMBOLS[GAIN_NAMES[key]]}: {of_modes[0]:g} to {of_modes[-1]:g} {GAIN_UNITS[key]}"
                named.setdefault((flight.look.family, key), (of_modes[-1] / of_modes[0], text, flight.look.on_light))
    axes.set(title="Blended gains, over those of the healthy mode", ylabel="ratio")
    if not named:
        axes.text(0.5, 0.5, "no law has gains of modes", transform=axes.transAxes, ha="center", color=QUIET)
        return
    low, high = axes.get_ylim()
    axes.set_ylim(low, high * (high / low) ** 0.08)
    _plain_log(axes)
    low, high = np.log(axes.get_ylim())
    lowest = 0.02
    early = any(edge < 0.35 * several[0].recording.ticks for edge in edges(several))
    place: dict[str, Any] = {"x": 0.98, "ha": "right"} if early else {"x": 0.02, "ha": "left"}  # where there is no fault
    for above, (ratio, text, color) in enumerate(sorted(named.values())):  # each near its line, none on another
        highest = 1.0 - 0.065 * (len(named) - above)
        lowest = max(lowest, min((np.log(ratio) - low) / (high - low) - 0.02, highest))
        axes.text(**place, y=lowest, s=text, transform=axes.transAxes, va="bottom", fontsize=7.5, color=color, bbox=PLATE)
        lowest += 0.065


def _effort(axes: Axes, several: Several) -> None:
    ticks = window(several)
    scale, unit = torque_unit(several)
    for flight in several:
        demanded = scale * np.linalg.norm(flight.channel("torque_B"), axis=-1)
        axes.semilogy(flight.recording.time, moving_rms(demanded, ticks), **_line(flight))
    axes.set(title=f"Torque demanded, {_over(several)}", ylabel=f"torque on the body [{unit}]")
    _plain_log(axes)


def _wheel_speeds(axes: Axes, several: Several) -> None:
    """Of the loop that shares the torque out anew, if there is one."""
    weighted = (flight for flight in several if flight.scenario.law.allocation.type == "mode-weighted")
    flight = next(weighted, several[0])
    for wheel, speed in enumerate(flight.channel("truth/state")[:, 7:].T):
        axes.plot(flight.recording.time, RPM * speed, color=WHEEL_COLORS[wheel % len(WHEEL_COLORS)], label=f"wheel {wheel + 1}")
    axes.set(title=f"Wheel speeds of {flight.name}", ylabel="speed [rpm]")
    axes.margins(y=0.2)
    axes.legend(ncols=4, loc="upper left", columnspacing=1.2, handlelength=1.6)


def _body_rate(axes: Axes, several: Several) -> None:
    for flight in several:
        rate = np.degrees(np.linalg.norm(flight.channel("truth/state")[:, 4:7], axis=-1))
        axes.semilogy(flight.recording.time, np.maximum(rate, 1e-6), **_line(flight))
    axes.set(title="Body rate (truth)", ylabel="length [deg/s]")
    _plain_log(axes)


def _rate_error(axes: Axes, several: Several) -> None:
    ticks = window(several)
    for flight in several:
        if flight.closing:
            error = flight.channel(f"{flight.closing}/mean")[:, 4:7] - flight.channel("truth/state")[:, 4:7]
            axes.semilogy(flight.recording.time, moving_rms(1e3 * np.linalg.norm(error, axis=-1), ticks), **_line(flight))
    axes.set(title=f"Rate error of the estimate, {_over(several)}", ylabel="error [mrad/s]")
    if any(flight.closing for flight in several):
        _plain_log(axes)


def _counting(several: Several) -> list[Flight]:
    """Loops that are closed by a particle filter."""
    return [flight for flight in several if f"{flight.closing}/ess" in flight.recording.channels]


def _particles(axes: Axes, several: Several) -> None:
    for flight in _counting(several):
        axes.semilogy(flight.recording.time, moving_mean(flight.channel(f"{flight.closing}/ess"), window(several)), **_line(flight))
    axes.set(title=f"Effective number of particles, mean over {window(several) * several[0].recording.dt:g} s", ylabel="particles")
    _plain_log(axes)


def _estimate(axes: Axes, several: Several) -> None:
    ticks, high = window(several), 0.0
    for flight in several:
        if flight.closing:
            error = moving_rms(1e3 * flight.error_of_estimate()[:, 0], ticks)
            axes.semilogy(flight.recording.time, error, **_line(flight))
            high = float(np.max(error[2 * ticks :], initial=high))
    if high > 0.0:
        axes.set_ylim(top=1.3 * high)  # a filter that starts far off may leave the picture
    axes.set(title=f"Attitude error of the estimate, {_over(several)}", ylabel="error [mdeg]")
    if any(flight.closing for flight in several):
        _plain_log(axes)
    else:
        axes.text(0.5, 0.5, "no observer closes a loop", transform=axes.transAxes, ha="center", color=QUIET)


def _over(several: Several) -> str:
    return f"RMS over {window(several) * several[0].recording.dt:g} s"


def _plain_log(axes: Axes) -> None:
    """Plain numbers on a logarithmic axis, with more of them where it spans little."""
    low, high = axes.get_ylim()
    subs = (1.0,) if high > 300.0 * low else (1.0, 2.0, 5.0) if high > 8.0 * low else (1.0, 1.2, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)
    axes.yaxis.set_major_locator(LogLocator(10, subs=subs))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_locator(NullLocator())
