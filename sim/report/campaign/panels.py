"""The picture of a campaign: as many panels as there are metrics, under its title."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sim.campaign.settings import Campaign
from sim.series.picture_style import STYLE
from sim.series.raster import write_png
from sim.text.table_style import counted


@contextmanager
def panels(path: Path, campaign: Campaign, count: int, columns: int, height: float, about: str) -> Iterator[list[Axes]]:
    """Axes to be drawn on, `height` inches each, so many in a row; the picture is written when they are left."""
    columns = min(columns, max(1, count))
    rows = max(1, -(-count // columns))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(13.0, 0.9 + height * rows), dpi=160, layout="constrained")
        axes = list(figure.subplots(rows, columns, squeeze=False).flat)
        for spare in axes[count:]:
            spare.set_axis_off()
        yield axes[:count]
        figure.suptitle(f"{campaign.title}\n", x=0.01, ha="left", fontsize=12, fontweight="bold")
        place = 1.0 - 0.43 / figure.get_figheight()
        figure.text(0.01, place, f"{campaign.scenario}, {counted(campaign.trials, 'trial')} | {about}", fontsize=8, color="#5a6270")
        write_png(figure, path)


def legend(axes: Axes, **look: Any) -> None:
    """A legend, if anything was drawn that it could name."""
    if axes.get_legend_handles_labels()[0]:
        axes.legend(**look)
