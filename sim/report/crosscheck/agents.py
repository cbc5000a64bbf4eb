"""`crosscheck.png` of several agents: how far each model is from the plant, for a paper."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from sim.crosscheck.agents import AgentsCrossCheck
from sim.series.palette import LOOP_VARIANTS
from sim.series.picture_style import STYLE
from sim.series.raster import write_png

LEAST = 1e-12


def write_agents_picture(path: Path, name: str, found: AgentsCrossCheck) -> None:
    """Draw every quantity over time: the worst agent of each trial as a band, their mean as a line.

    Args:
      path: PNG to write.
      name: of the scenario.
      found: of the cross-check.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(11.0, 4.6), dpi=160, layout="constrained")
        grid = figure.subplots(1, len(found.quantities), squeeze=False)[0]
        for letter, axes, (quantity, of) in zip("ab", grid, found.quantities.items(), strict=False):
            for (model, apart), (color, _) in zip(found.apart.items(), LOOP_VARIANTS, strict=False):
                worst = np.maximum(np.max(apart[quantity], axis=-1), LEAST)
                axes.loglog(found.time[1:], np.mean(worst, axis=-1)[1:], color=color, lw=1.4, label=model)
                axes.fill_between(found.time[1:], worst.min(axis=-1)[1:], worst.max(axis=-1)[1:], color=color, alpha=0.15, lw=0)
            axes.axhline(of.threshold, color="#8a8f98", lw=0.8, ls="--")
            axes.set_title(f"({letter}) {quantity.capitalize()}, worst agent", loc="left")
            axes.set(xlabel="time [s]", ylabel=f"[{of.unit}]", xlim=(found.time[1], found.time[-1]))
        grid[0].legend(loc="upper left")
        figure.suptitle(
            f"Cross-check of {name}, loop {found.loop}: models against the plant", x=0.01, ha="left", fontsize=12, fontweight="bold"
        )
        write_png(figure, path)
