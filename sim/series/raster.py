"""Figures as pixels: laid out once and drawn once, where saving by the library's own way does both twice."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imsave
from matplotlib.text import Text
from numpy.typing import NDArray

MARGIN = 0.995  # share of a picture's width that words may take


def pixels(figure: Figure) -> NDArray[np.uint8]:
    """A figure with its layout, (rows, columns, 4)."""
    canvas = FigureCanvasAgg(figure)
    for headline in figure.texts:  # which hold the user's words: a dollar is a dollar there
        headline.set_parse_math(False)
        _keep_within(headline, canvas)
    if (layout := figure.get_layout_engine()) is not None:
        layout.execute(figure)
        figure.set_layout_engine("none")
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())


def _keep_within(headline: Text, canvas: FigureCanvasAgg) -> None:
    """Cut what would leave the picture at its right edge, and say so by three dots."""
    room, text = MARGIN * canvas.figure.bbox.width, headline.get_text()
    lines = text.split("\n")
    longest = max(map(len, lines))
    while longest > 1 and (extent := headline.get_window_extent(canvas.get_renderer())).x1 > room:
        longest = max(1, min(longest - 1, int(longest * (room - extent.x0) / extent.width)))
        headline.set_text("\n".join(line if len(line) <= longest else f"{line[:longest].rstrip(' ;,|')} ..." for line in lines))


def write_png(figure: Figure, path: Path) -> None:
    """A figure as a picture in a file."""
    imsave(path, pixels(figure), format="png", dpi=figure.dpi)
