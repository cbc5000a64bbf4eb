"""`report.png`: the run of one trial as a figure for a paper."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from models.attitude import quaternion
from models.dynamics.state_layout import ATTITUDE, RATE, WHEELS
from sim.loop.recording import Recording
from sim.series.palette import WHEEL_COLORS, on_light
from sim.series.picture_style import SMOOTHING_S, STYLE
from sim.units import RPM

Array = NDArray[np.floating]


def draw_report(name: str, title: str, recording: Recording, feedback: str) -> Figure:
    """Draw the first recorded trial: errors of the filters, detection statistics with their thresholds, rates and wheels.

    Args:
      name: of the scenario.
      title: of the scenario.
      recording: of one trial or more.
      feedback: who closes the loop.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(11.0, 8.4), dpi=160, layout="constrained")
        grid = figure.subplots(3, 2, sharex=True)
        time = recording.time
        _attitude_error(grid[0, 0], recording)
        _rate_error(grid[0, 1], recording)
        _statistics(grid[1, 0], recording)
        _tracking(grid[1, 1], recording)
        _wheel_speeds(grid[2, 0], recording)
        _wheel_torques(grid[2, 1], recording)
        for letter, axes in zip("abcdef", grid.flat, strict=True):
            _shade_faults(axes, recording)
            axes.set_title(f"({letter}) {axes.get_title(loc='left')}", loc="left")
            axes.set_xlim(0.0, time[-1] if len(time) > 1 else 1.0)
        for axes in grid[-1]:
            axes.set_xlabel("time [s]")
        figure.suptitle(f"{title}\n", x=0.01, ha="left", fontsize=12, fontweight="bold")
        faults = "; ".join(f"{o.text} at {recording.dt * o.start_tick:.1f} s" for o in recording.occurrences if o.trial == 0)
        figure.text(
            0.01, 0.957, f"{name}, trial {recording.trials[0]}, loop closed on {feedback}" + (f" | {faults}" if faults else ""),
            fontsize=8, color="#5a6270",
        )  # fmt: skip
        return figure


def _shade_faults(axes: Axes, recording: Recording) -> None:
    for occurrence in recording.occurrences:
        if occurrence.trial == 0:
            start, end = recording.dt * occurrence.start_tick, recording.dt * occurrence.end_tick
            axes.axvspan(start, end, color="#d62839", alpha=0.10, lw=0)
            axes.axvline(start, color="#d62839", lw=0.6, alpha=0.5)


def _smooth(values: Array, recording: Recording) -> Array:
    """Root mean square over a moving window, (ticks,)."""
    width = max(1, round(SMOOTHING_S / recording.dt))
    return np.sqrt(uniform_filter1d(values**2, width, mode="nearest"))


def _attitude_error(axes: Axes, recording: Recording) -> None:
    truth = recording.channels["truth/state"][:, 0, ATTITUDE]
    for observer in recording.observers:
        angle = np.degrees(quaternion.angle(recording.channels[f"{observer}/mean"][:, 0, ATTITUDE], truth))
        axes.semilogy(recording.time, 1e3 * _smooth(angle, recording), label=observer, **_line(observer, recording))
    axes.set(title=f"Attitude error of the estimate (RMS over {SMOOTHING_S:g} s)", ylabel="error [mdeg]")
    _finish_log(axes)
    axes.legend(ncols=5 if len(recording.observers) <= 5 else 4, loc="upper left", columnspacing=1.2, handlelength=1.6)


def _rate_error(axes: Axes, recording: Recording) -> None:
    truth = recording.channels["truth/state"][:, 0, RATE]
    for observer in recording.observers:
        error = np.linalg.norm(recording.channels[f"{observer}/mean"][:, 0, RATE] - truth, axis=-1)
        axes.semilogy(recording.time, 1e3 * _smooth(error, recording), label=observer, **_line(observer, recording))
    axes.set(title=f"Rate error of the estimate (RMS over {SMOOTHING_S:g} s)", ylabel="error [mrad/s]")
    _finish_log(axes)
    axes.legend(ncols=5 if len(recording.observers) <= 5 else 4, loc="upper left", columnspacing=1.2, handlelength=1.6)


def _statistics(axes: Axes, recording: Recording) -> None:
    """Smoothed NIS over its upper threshold, so that detectors with different weights share an axis."""
    hybrids = {name: limits for name, limits in recording.thresholds.items() if limits is not None}
    axes.set(title="Smoothed NIS / upper threshold, and declared faults", ylabel="ratio")
    for row, (observer, (on, off)) in enumerate(hybrids.items()):
        color = on_light(recording.observers)[observer]
        axes.semilogy(recording.time, recording.channels[f"{observer}/statistic"][:, 0] / on, color=color, label=observer)
        axes.axhline(off / on, color=color, lw=0.8, ls=(0, (1, 2)))
        declared = recording.channels[f"{observer}/declared"][:, 0].astype(bool)
        low, high = 0.02 + 0.05 * row, 0.06 + 0.05 * row
        axes.fill_between(recording.time, low, high, where=declared, color=color, lw=0, step="mid", transform=axes.get_xaxis_transform())
    if hybrids:
        axes.axhline(1.0, color="#222222", lw=0.8, ls="--", label="on (dotted: off)")
        axes.set_ylim(bottom=axes.get_ylim()[0] / 1.6)
        _finish_log(axes)
        axes.legend(loc="upper left", ncols=3)


def _tracking(axes: Axes, recording: Recording) -> None:
    truth = recording.channels["truth/state"][:, 0, ATTITUDE]
    error = np.degrees(quaternion.error(truth, recording.channels["reference/q"]))
    for axis, color in enumerate(("#d1495b", "#2e8b57", "#3066be")):
        axes.plot(recording.time, error[:, axis], color=color, label="xyz"[axis])
    axes.set(title="Tracking error of the body (truth)", ylabel="error [deg]")
    axes.margins(y=0.22)
    axes.legend(ncols=3, loc="upper left")


def _wheel_speeds(axes: Axes, recording: Recording) -> None:
    for wheel, speed in enumerate(recording.channels["truth/state"][:, 0, WHEELS].T):
        axes.plot(recording.time, speed / RPM, color=WHEEL_COLORS[wheel % len(WHEEL_COLORS)], label=f"wheel {wheel + 1}")
    axes.set(title="Wheel speeds", ylabel="speed [rpm]")
    axes.margins(y=0.22)
    axes.legend(ncols=4, loc="upper left")


def _wheel_torques(axes: Axes, recording: Recording) -> None:
    for wheel, torque in enumerate(recording.channels["applied"][:, 0].T):
        axes.plot(recording.time, 1e3 * torque, color=WHEEL_COLORS[wheel % len(WHEEL_COLORS)], lw=0.7, label=f"wheel {wheel + 1}")
    axes.set(title="Torque of the drives on the wheels", ylabel="torque [mN m]")


def _finish_log(axes: Axes) -> None:
    """Plain numbers on a logarithmic axis, and room for a legend above the curves."""
    low, high = axes.get_ylim()
    axes.set_ylim(low, high * (high / low) ** 0.22)
    axes.yaxis.set_major_locator(LogLocator(10, subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_locator(NullLocator())


def _line(observer: str, recording: Recording) -> dict[str, str | float]:
    """Colour of an observer; the baselines are thinner than what the scenario is about, the MEKF dashed over the EKF it equals."""
    return {
        "color": on_light(recording.observers)[observer],
        "lw": 1.1 if observer in ("ekf", "mekf", "sif") else 1.5,
        "ls": "--" if observer == "mekf" else "-",
    }
