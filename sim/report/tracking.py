"""Panels of `report.png` of several closed loops: how each body follows its reference, by the truth."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from models.dynamics.state_layout import RATE
from sim.report.axes import SYMBOLS, Several, line, over, plain_log
from sim.series.loops import Flight, moving_rms, running_rms, window


def draw_running_error(axes: Axes, several: Several, axis: int, restarts: list[int]) -> None:
    """RMS since the last edge of a fault of the error in one angle, beside what the paper prints of a phase."""
    label, settled, lowest = several[0].axes[axis], 2 * window(several), np.inf
    for flight in several:
        running = running_rms(flight.errors[:, axis], restarts)
        for first, last in zip([0, *restarts], [*restarts, len(running)], strict=True):  # no line from one phase to the next
            axes.semilogy(flight.recording.time[first:last], running[first:last], **line(flight))
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
    plain_log(axes)


def _published(flight: Flight, metric: str, restarts: list[int]) -> dict[int, float]:
    """What the paper prints of a phase, by the phase's last tick."""
    printed = flight.scenario.published.values.get(flight.name, {}) if flight.scenario.published else {}
    stops = [*restarts, flight.recording.ticks][:2] if restarts else []
    ends = dict(zip((stop - 1 for stop in stops), ("nominal", "fault"), strict=False))
    named = {tick: f"{metric}@{phase}" for tick, phase in ends.items() if tick < flight.recording.ticks}
    return {tick: printed[key] for tick, key in named.items() if key in printed}


def draw_angle(axes: Axes, several: Several) -> None:
    """Angle between the body and its reference."""
    ticks = window(several)
    for flight in several:
        axes.semilogy(flight.recording.time, moving_rms(flight.angle, ticks), **line(flight))
    axes.set(title=f"Tracking error of the body (truth), {over(several)}", ylabel="angle [deg]")
    plain_log(axes)


def draw_body_rate(axes: Axes, several: Several) -> None:
    """Length of the body's rate."""
    for flight in several:
        rate = np.degrees(np.linalg.norm(flight.channel("truth/state")[:, RATE], axis=-1))
        axes.semilogy(flight.recording.time, np.maximum(rate, 1e-6), **line(flight))
    axes.set(title="Body rate (truth)", ylabel="length [deg/s]")
    plain_log(axes)
