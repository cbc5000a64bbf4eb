"""How tables look at a terminal."""

from __future__ import annotations

from rich.box import SIMPLE_HEAD
from rich.table import Table


def number(value: float | None) -> str:
    """Three digits; a dash where there is none."""
    if value is None:
        return "[dim]-[/]"
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}" if abs(value) < 1e6 else f"{value:.2e}"


def plain_table(title: str, caption: str | None = None) -> Table:
    """A table without frame, narrow enough for 80 columns."""
    return Table(
        title=title,
        caption=caption,
        box=SIMPLE_HEAD,
        padding=(0, 0, 0, 1),
        pad_edge=False,
        title_justify="left",
        title_style="bold",
        caption_justify="left",
        caption_style="dim",
    )
