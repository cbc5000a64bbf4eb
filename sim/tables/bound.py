"""Table of the errors of filters over the least that there can be."""

from __future__ import annotations

from rich.table import Table

from sim.metrics.bound import Efficiency
from sim.text.table_style import counted, number, plain_table


def table(found: list[Efficiency], loop: str, start_s: float, end_s: float, trials: int) -> Table:
    """A row for each filter and part of its error."""
    shown = plain_table(
        f"RMS error and posterior Cramer-Rao bound, loop {loop}, {start_s:g} to {end_s:g} s",
        f"{counted(trials, 'trial')}; the bound takes what the model leaves out for white noise of that size",
    )
    shown.add_column("filter", overflow="fold")
    shown.add_column("error of")
    shown.add_column("unit")
    for heading in ("RMS", "bound", "RMS / bound"):
        shown.add_column(heading, justify="right", no_wrap=True)
    for row in found:
        shown.add_row(row.observer, row.part, row.unit, number(row.error), number(row.bound), number(row.error / row.bound))
    return shown
