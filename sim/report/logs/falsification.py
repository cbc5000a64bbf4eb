"""`falsification.png`: how far each candidate controller is from being falsified by a log, axis by axis."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from sim.replay.falsification import TESTS, AxisVerdict
from sim.series.picture_style import STYLE
from sim.series.raster import write_png

COLOURS = {True: "#d62839", False: "#2a7f62"}  # falsified or not
MOST = 40  # candidates with their name


def write_picture(path: Path, title: str, found: Sequence[AxisVerdict]) -> None:
    """Draw the record of each axis, first trial, and the greatest ratios of its candidates over all trials.

    Args:
      path: PNG to write.
      title: headline.
      found: what was judged, one row of panels each.
    """
    longest = min(MOST, max(len(one.names) for one in found))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(11.0, len(found) * (2.4 + 0.16 * longest)), dpi=160, layout="constrained")
        for row, one in zip(figure.subplots(len(found), 2, squeeze=False, width_ratios=(1, 1.2)), found, strict=True):
            where = f"axis {'xyz'[one.axis]}, data of {one.loop}"
            record, (left, right) = one.record, row
            angle = np.degrees(record.angle[:, 0] - record.angle[0, 0])
            left.plot(record.time, angle, color="#1d3557", lw=1.1)
            left.set(title=f"{where}: angle, trial {one.trials[0]}", xlabel="time [s]", ylabel="[deg]")
            first = one.when(one.verdict.first[:, 0])
            gone = np.any(one.verdict.falsified, axis=1)
            for at in first[np.isfinite(first)]:
                left.axvline(at, color=COLOURS[True], lw=0.6, alpha=0.5)
            there = np.isfinite(one.verdict.ratio)
            ratio = np.max(np.where(there, one.verdict.ratio, 0.0), axis=1)
            place = np.arange(len(one.names))
            for k, (test, marker) in enumerate(zip(TESTS, ("o", "s"), strict=True)):
                colour = np.array([COLOURS[bool(flag)] for flag in ratio[:, k] >= 1.0])
                right.scatter(ratio[:, k], place, c=colour, marker=marker, s=14, label=test, zorder=3)
            right.axvline(1.0, color="#8a8f98", lw=1.0)
            right.set_xscale("symlog", linthresh=2.0)
            right.set(
                title=f"{where}: {int(np.sum(gone))} of {len(one.names)} falsified (red)",
                xlabel="greatest weighted response / reference [-]",
            )
            if len(one.names) <= MOST:
                right.set_yticks(place, one.names)
            right.set_ylim(len(one.names) - 0.5, -0.5)
            right.legend(loc="lower right")
        figure.suptitle(title, x=0.01, ha="left", fontsize=12, fontweight="bold")
        write_png(figure, path)
