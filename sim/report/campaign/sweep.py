"""A campaign over a grid: every metric against the settings that are tried, as a table and as curves with their spread."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from rich.table import Table

from sim.campaign.settings import Campaign
from sim.campaign.summary import BESIDE
from sim.report.campaign.panels import legend, panels
from sim.series.palette import LOOP_VARIANTS
from sim.text.table_style import counted, number, plain_table

COLUMNS = 3
DASHES = ("-", "--", ":", "-.")
UNEVEN = 20.0  # the widest gap between neighbouring values over the narrowest
SUBJECTS = 3  # side by side in a table of 80 columns

Row = dict[str, Any]


def abscissa(campaign: Campaign) -> str | None:
    """The key of the grid whose values curves run along: of those with numbers the one with most; None if there is none."""
    numeric = [k for k, values in campaign.grid.items() if len(values) > 1 and all(isinstance(v, int | float) for v in values)]
    return max(numeric, key=lambda key: len(campaign.grid[key]), default=None)


def tables(campaign: Campaign, rows: list[Row]) -> Iterator[Table]:
    """Median and 5 to 95 % over the trials of every metric, point by point."""
    for (metric, phase, unit), some in _by_metric(rows):
        subjects = list(dict.fromkeys(row["subject"] for row in some))
        found = {(row["point"], row["subject"]): row for row in some}
        for first in range(0, len(subjects), SUBJECTS):
            table = plain_table(
                f"{metric}{'' if phase == 'all' else f', {phase}'} [{unit}]",
                f"median (5 .. 95 %) of {counted(campaign.trials, 'trial')}, or of n",
            )
            for key in campaign.grid:
                table.add_column(key.rpartition(".")[2], justify="right", overflow="fold")
            for subject in subjects[first : first + SUBJECTS]:
                table.add_column(subject, justify="right", no_wrap=True)
            for point, settings in enumerate(campaign.points):
                cells = [_spread(found.get((point, subject)), campaign.trials) for subject in subjects[first : first + SUBJECTS]]
                table.add_row(*(str(value) for value in settings.values()), *cells)
            yield table


def write_report(path: Path, campaign: Campaign, rows: list[Row]) -> None:
    """Draw every metric against the grid's longest numeric key: a colour a subject, a dash for each combination of the other keys."""
    key = abscissa(campaign)
    assert key is not None
    several = list(_by_metric(rows))
    with panels(path, campaign, len(several), COLUMNS, 3.2, "lines: median of a point's trials, shaded: 5 to 95 %") as every:
        for axes, ((metric, phase, unit), some) in zip(every, several, strict=True):
            _curves(axes, campaign, key, some)
            axes.set(title=metric + ("" if phase == "all" else f", {phase}"), xlabel=key, ylabel=f"[{unit}]")


def _by_metric(rows: list[Row]) -> Iterator[tuple[tuple[str, str, str], list[Row]]]:
    """Measured rows, metric by metric and phase by phase."""

    def key(row: Row) -> tuple[str, str, str]:
        return row["metric"], row["phase"], row["unit"]

    measured = [row for row in rows if row["metric"] not in ("failed", *BESIDE)]
    for what, some in groupby(sorted(measured, key=key), key=key):
        yield what, list(some)


def _curves(axes: Axes, campaign: Campaign, key: str, some: list[Row]) -> None:
    others = [{k: v for k, v in point.items() if k != key} for point in campaign.points]
    combinations = list({str(other): other for other in others}.values())
    x, labels = _places(sorted(campaign.grid[key]))
    for i, subject in enumerate(dict.fromkeys(row["subject"] for row in some)):
        colour = LOOP_VARIANTS[i % len(LOOP_VARIANTS)][0]
        for j, combination in enumerate(combinations):
            here = {campaign.points[r["point"]][key]: r for r in some if r["subject"] == subject and others[r["point"]] == combination}
            low, middle, high = (np.array([here.get(value, {}).get(q, np.nan) for value in x]) for q in ("q05", "q50", "q95"))
            said = ", ".join([subject, *(f"{k.rpartition('.')[2]} {v}" for k, v in combination.items())])
            axes.plot(list(x.values()), middle, color=colour, ls=DASHES[j % len(DASHES)], marker="o", ms=2.5, label=said)
            axes.fill_between(list(x.values()), low, high, color=colour, alpha=0.15, lw=0)
    if labels:
        axes.set_xticks(list(x.values()), labels, rotation=45, fontsize=7)
    least, greatest = min(row["q05"] for row in some), max(row["q95"] for row in some)
    if 0 < 20 * least < greatest:
        axes.set_yscale("log")
    legend(axes, fontsize=6)


def _places(values: list[float]) -> tuple[dict[float, float], list[str]]:
    """Where each value is drawn; if they crowd together at one end side by side, and labelled."""
    gaps = np.diff(values)
    if gaps.max() <= UNEVEN * gaps.min():
        return {value: float(value) for value in values}, []
    return {value: float(place) for place, value in enumerate(values)}, [f"{value:g}" for value in values]


def _spread(row: Row | None, trials: int) -> str:
    if row is None:
        return number(None)
    few = "" if row["n"] == trials else f" n={row['n']}"
    return f"{number(row['q50'])} ({number(row['q05'])} .. {number(row['q95'])}){few}"
