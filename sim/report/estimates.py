"""Panels of `report.png` of several closed loops: how far off the estimates are that close them."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from models.dynamics.state_layout import RATE
from sim.report.axes import QUIET, Several, line, over, plain_log
from sim.series.loops import Flight, moving_mean, moving_rms, window


def draw_rate_error(axes: Axes, several: Several) -> None:
    """Length of the rate's error, of every loop that an observer closes."""
    ticks = window(several)
    for flight in several:
        if flight.closing:
            error = flight.channel(f"{flight.closing}/mean")[:, RATE] - flight.channel("truth/state")[:, RATE]
            axes.semilogy(flight.recording.time, moving_rms(1e3 * np.linalg.norm(error, axis=-1), ticks), **line(flight))
    axes.set(title=f"Rate error of the estimate, {over(several)}", ylabel="error [mrad/s]")
    if any(flight.closing for flight in several):
        plain_log(axes)


def counting(several: Several) -> list[Flight]:
    """Loops that are closed by a particle filter."""
    return [flight for flight in several if f"{flight.closing}/ess" in flight.recording.channels]


def draw_particles(axes: Axes, several: Several) -> None:
    """How many particles count, of every loop that a particle filter closes."""
    for flight in counting(several):
        axes.semilogy(flight.recording.time, moving_mean(flight.channel(f"{flight.closing}/ess"), window(several)), **line(flight))
    axes.set(title=f"Effective number of particles, mean over {window(several) * several[0].recording.dt:g} s", ylabel="particles")
    plain_log(axes)


def draw_estimate(axes: Axes, several: Several) -> None:
    """Angle of the attitude's error, of every loop that an observer closes."""
    ticks, high = window(several), 0.0
    for flight in several:
        if flight.closing:
            error = moving_rms(1e3 * flight.error_of_estimate()[:, 0], ticks)
            axes.semilogy(flight.recording.time, error, **line(flight))
            high = float(np.max(error[2 * ticks :], initial=high))
    if high > 0.0:
        axes.set_ylim(top=1.3 * high)  # a filter that starts far off may leave the picture
    axes.set(title=f"Attitude error of the estimate, {over(several)}", ylabel="error [mdeg]")
    if any(flight.closing for flight in several):
        plain_log(axes)
    else:
        axes.text(0.5, 0.5, "no observer closes a loop", transform=axes.transAxes, ha="center", color=QUIET)
