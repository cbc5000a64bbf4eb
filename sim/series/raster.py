"""Figures as pixels: laid out once and drawn once, where saving by the library's own way does both twice."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imsave
from numpy.typing import NDArray


def pixels(figure: Figure) -> NDArray[np.uint8]:
    """A figure with its layout, (rows, columns, 4)."""
    canvas = FigureCanvasAgg(figure)
    for headline in figure.texts:  # which hold the user's words: a dollar is a dollar there
        headline.set_parse_math(False)
    if (layout := figure.get_layout_engine()) is not None:
        layout.execute(figure)
        figure.set_layout_engine("none")
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())


def write_png(figure: Figure, path: Path) -> None:
    """A figure as a picture in a file."""
    imsave(path, pixels(figure), format="png", dpi=figure.dpi)
