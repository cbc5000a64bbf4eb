"""`replay.png`: what filters made of a flight log, for a paper."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from estimation.consistency import average_bounds
from models.dynamics.state_layout import StateLayout
from sim.loop.recording import Recording
from sim.series.estimation_errors import error_of_block, unit_of_error
from sim.series.palette import on_light
from sim.series.picture_style import SMOOTHING_S, STYLE
from sim.series.raster import write_png

Array = NDArray[np.floating]


def write_picture(path: Path, title: str, recording: Recording, layout: StateLayout) -> None:
    """Draw the first trial: residuals, errors where the truth is known, NIS and detection.

    Args:
      path: PNG to write.
      title: headline.
      recording: of a replay.
      layout: of the state; of several agents the RMS over all of them is drawn.
    """
    get = {name: channel[:, 0] for name, channel in recording.channels.items() if not name.startswith("reference/")}
    known = np.isfinite(get["truth/state"]).any()
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(11.0, 8.4 if known else 5.8), dpi=160, layout="constrained")
        grid = figure.subplots(3 if known else 2, 2, sharex=True)
        pairs = [("Residual of the reading", get["reading"])] + ([("Error against the truth", get["truth/state"])] if known else [])
        for row, (what, target) in zip(grid, pairs, strict=False):
            for axes, block in zip(row, layout.blocks[:2], strict=True):
                place, unit = layout.places[block.kind], unit_of_error(block)
                for name in recording.observers:
                    apart = error_of_block(get[f"{name}/mean"], target, block, place)
                    if np.isfinite(apart).any():
                        axes.semilogy(recording.time, _smooth(apart, recording), **_line(recording, name))
                axes.set(title=f"{what}: {block.kind} (RMS over {SMOOTHING_S:g} s)", ylabel=f"[{unit}]")
        _nis(grid[-1, 0], recording, get)
        _detection(grid[-1, 1], recording, get)
        for letter, axes in zip("abcdef", grid.flat, strict=False):
            axes.set_title(f"({letter}) {axes.get_title(loc='left')}", loc="left")
            axes.set_xlim(0.0, recording.time[-1])
            if get["fault"].any():
                axes.fill_between(
                    recording.time,
                    0,
                    1,
                    where=get["fault"].astype(bool),
                    color="#d62839",
                    alpha=0.1,
                    lw=0,
                    transform=axes.get_xaxis_transform(),
                )
        for axes in grid[-1]:
            axes.set_xlabel("time [s]")
        figure.legend(handles=grid[0, 0].get_lines(), ncols=5, loc="outside upper right")
        figure.suptitle(f"{title}, trial {recording.trials[0]}", x=0.01, ha="left", fontsize=12, fontweight="bold")
        write_png(figure, path)


def _smooth(values: Array, recording: Recording) -> Array:
    """Root mean square of the numbers in a moving window, (ticks,)."""
    width, there = max(1, round(SMOOTHING_S / recording.dt)), np.isfinite(values)
    square = uniform_filter1d(np.where(there, values, 0.0) ** 2, width, mode="nearest")
    share = uniform_filter1d(there.astype(float), width, mode="nearest")
    return np.sqrt(square / np.where(share > 1e-9, share, np.nan))


def _nis(axes: Axes, recording: Recording, get: dict[str, Array]) -> None:
    """NIS over the band of its own degrees of freedom, those of what was read, of the filter that compares the most."""
    bands: dict[float, tuple[Array, Array]] = {}
    for name in recording.observers:
        nis, dof = (get[f"{name}/{part}"].reshape(recording.ticks, -1) for part in ("nis", "dof"))
        there = np.isfinite(nis)
        if there.any():
            count = np.sum(there, axis=-1)
            mean, freedom = (
                np.where(count, np.sum(np.where(there, part, 0.0), axis=-1) / np.maximum(count, 1), np.nan) for part in (nis, dof)
            )
            axes.semilogy(recording.time, _smooth(np.sqrt(mean), recording) ** 2, **_line(recording, name))
            width = nis.shape[-1] * max(1, round(SMOOTHING_S / recording.dt))
            bands[float(np.nanmean(freedom))] = average_bounds(_smooth(np.sqrt(freedom), recording) ** 2, width)
    if bands:
        axes.fill_between(recording.time, *bands[max(bands)], color="#8a8f98", alpha=0.25, lw=0)
    axes.set(title=f"NIS (mean over {SMOOTHING_S:g} s); grey: 95 % of a consistent filter's", ylabel="[-]")


def _detection(axes: Axes, recording: Recording, get: dict[str, Array]) -> None:
    detectors = [name for name, limits in recording.thresholds.items() if limits is not None]
    for row, name in enumerate(reversed(detectors)):
        flags = get[f"{name}/declared"].astype(bool)
        axes.fill_between(recording.time, row + 0.1, row + 0.9, where=flags, step="mid", lw=0, color=_line(recording, name)["color"])
    axes.set_yticks(np.arange(len(detectors)) + 0.5, detectors[::-1])
    axes.set(title="Faults declared", ylim=(0.0, max(3, len(detectors))))
    axes.grid(visible=False)


def _line(recording: Recording, name: str) -> dict[str, str | float]:
    return {"color": on_light(recording.observers)[name], "label": name, "lw": 1.1, "ls": "--" if name == "mekf" else "-"}
