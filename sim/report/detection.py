"""`detection.png`: what was to be followed, and of each detector its statistic, its thresholds and what it declared.

The pictures are those of McCafferty-Leroux et al. (2024): the desired quaternion (fig. 4), and a page for each detector (figs 6 to 9).
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from models.dynamics.state_layout import ATTITUDE
from sim.loop.recording import Recording
from sim.report.axes import FAULT, QUIET
from sim.series.channels import hybrids, modal
from sim.series.picture_style import STYLE
from sim.series.raster import write_png

ROW_IN = 2.9, 0.95  # heights of a detector's statistic and of what it declares, inches
REFERENCE_IN = 2.5
HEAD_IN = 0.75
RAW, SMOOTHED = "#e07a1f", "#1b4f9c"
COMPONENTS = ("#d1495b", "#2e8b57", "#3066be", "#5a6270")  # of a quaternion, the scalar last


class Detector(NamedTuple):
    """One detector of a flight."""

    loop: str
    name: str
    recording: Recording

    def channel(self, what: str) -> np.ndarray:
        """Of the first recorded trial, (ticks,)."""
        return np.asarray(self.recording.channels[f"{self.name}/{what}"][:, 0])


def detectors(recordings: dict[str, Recording]) -> list[Detector]:
    """All that declare faults, loop by loop."""
    return [Detector(loop, name, r) for loop, r in recordings.items() for name in hybrids(r.thresholds)]


def write_report(path: Path, name: str, title: str, recordings: dict[str, Recording]) -> None:
    """Draw the first recorded trial.

    Args:
      path: PNG to write.
      name: of the scenario.
      title: of the scenario.
      recordings: by loop; all follow the same reference.
    """
    every, first = detectors(recordings), next(iter(recordings.values()))
    columns = min(2, max(1, len(every)))
    rows = -(-len(every) // columns)
    heights = [REFERENCE_IN, *(ROW_IN * rows)]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(11.0, HEAD_IN + sum(heights)), dpi=160, layout="constrained")
        grid = figure.add_gridspec(1 + 2 * rows, columns, height_ratios=heights)
        top = figure.add_subplot(grid[0, :])
        _reference(top, first)
        for place, detector in enumerate(every):
            row, column = divmod(place, columns)
            above = figure.add_subplot(grid[1 + 2 * row, column], sharex=top)
            below = figure.add_subplot(grid[2 + 2 * row, column], sharex=top)
            _statistic(above, detector, several=len(recordings) > 1)
            _declared(below, detector)
            for axes in (above, below):
                _shade_faults(axes, detector.recording)
        top.set_xlim(0.0, first.time[-1] if first.ticks > 1 else 1.0)
        figure.suptitle(f"{title}\n", x=0.01, ha="left", fontsize=12, fontweight="bold")
        faults = "; ".join(f"{o.text} at {first.dt * o.start_tick:.1f} s" for o in first.occurrences if o.trial == 0)
        said = f"{name}, trial {first.trials[0]}" + (f" | {faults}" if faults else "")
        figure.text(0.01, 1.0 - 0.43 / figure.get_figheight(), said, fontsize=8, color=QUIET)
        write_png(figure, path)


def _reference(axes: Axes, recording: Recording) -> None:
    """The desired quaternion; dots are the body's initial attitude, on which it is based."""
    desired, start = recording.channels["reference/q"], recording.channels["truth/state"][0, 0, ATTITUDE]
    start = start * np.copysign(1.0, start @ desired[0])
    for part, colour in enumerate(COMPONENTS):
        axes.plot(recording.time, desired[:, part], color=colour, label=f"$q_{part + 1}$")
        axes.plot(0.0, start[part], "o", color=colour, ms=4.0, clip_on=False)
    axes.set(title="Desired quaternion; dots: the body's attitude at the start", ylabel="component", xlabel="time [s]")
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.22 * (high - low))
    axes.legend(ncols=4, loc="upper left")


def _statistic(axes: Axes, detector: Detector, several: bool) -> None:
    """Raw values dotted, the smoothed one solid, thresholds dashed; of a probability there are no raw values."""
    time, (on, off) = detector.recording.time, detector.recording.thresholds[detector.name] or (np.nan, np.nan)
    probability = detector.name in modal(detector.recording.thresholds)
    if not probability:
        axes.semilogy(time, detector.channel("nis"), color=RAW, ls=(0, (1, 1.2)), lw=0.9, label="NIS")
    axes.plot(
        time, detector.channel("statistic"), color=SMOOTHED, lw=1.5, label="probability of a fault" if probability else "smoothed NIS"
    )
    axes.axhline(on, color="#222222", ls="--", lw=0.9, label=f"on, {on:.4g}")
    axes.axhline(off, color="#222222", ls=":", lw=0.9, label=f"off, {off:.4g}")
    axes.set_title(f"{detector.loop}: {detector.name}" if several else detector.name)
    axes.set_ylabel("probability" if probability else "NIS")
    axes.tick_params(labelbottom=False)
    low, high = axes.get_ylim()
    if probability:
        axes.set_ylim(-0.03, 1.25)
    else:
        axes.set_ylim(max(low, 1e-3 * on), high * (high / max(low, 1e-3 * on)) ** 0.12)
        axes.yaxis.set_major_locator(LogLocator(10))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.yaxis.set_minor_locator(NullLocator())
    axes.legend(ncols=4, loc="upper left", handlelength=1.8, columnspacing=1.2)


def _declared(axes: Axes, detector: Detector) -> None:
    """The state of fault: zero or one."""
    axes.step(detector.recording.time, detector.channel("declared").astype(float), where="post", color=FAULT, lw=1.2)
    axes.set(ylim=(-0.12, 1.12), yticks=(0.0, 1.0), ylabel="fault", xlabel="time [s]")


def _shade_faults(axes: Axes, recording: Recording) -> None:
    """Where a fault is active."""
    for occurrence in recording.occurrences:
        if occurrence.trial == 0:
            start, end = recording.dt * occurrence.start_tick, recording.dt * occurrence.end_tick
            axes.axvspan(start, end, color=FAULT, alpha=0.10, lw=0)
