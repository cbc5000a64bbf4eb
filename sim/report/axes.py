"""Lines, colours and axes that all panels of `report.png` of several closed loops share."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from sim.series.loops import Flight, window

Several = tuple[Flight, ...]

FAULT = "#d62839"
QUIET = "#5a6270"
PLATE: dict[str, Any] = {"facecolor": "white", "edgecolor": "none", "pad": 0.6, "alpha": 0.85}
SYMBOLS = {"phi": "$\\phi$", "theta": "$\\theta$", "psi": "$\\psi$", "lambda": "$\\lambda$", "K_p": "$K_p$", "K_d": "$K_d$", "K": "$K$"}


def line(flight: Flight, width: float = 1.15) -> dict[str, Any]:
    """How a loop is drawn in every panel, for `plot`."""
    return {"color": flight.look.on_light, "lw": width, "ls": (0.0, flight.look.dashes) if flight.look.dashes else "-"}


def shade_faults(axes: Axes, several: Several) -> None:
    """Where a fault is active, and where it begins."""
    for start, end in {(o.start_tick, o.end_tick) for flight in several for o in flight.recording.occurrences}:
        dt = several[0].recording.dt
        axes.axvspan(dt * start, dt * end, color=FAULT, alpha=0.06, lw=0, zorder=0)
        axes.axvline(dt * start, color=FAULT, lw=0.7, alpha=0.6, zorder=0)


def over(several: Several) -> str:
    """Words for the window of the moving figures."""
    return f"RMS over {window(several) * several[0].recording.dt:g} s"


def plain_log(axes: Axes) -> None:
    """Plain numbers on a logarithmic axis, with more of them where it spans little."""
    low, high = axes.get_ylim()
    subs = (1.0,) if high > 300.0 * low else (1.0, 2.0, 5.0) if high > 8.0 * low else (1.0, 1.2, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)
    axes.yaxis.set_major_locator(LogLocator(10, subs=subs))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_locator(NullLocator())
