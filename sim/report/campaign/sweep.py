"""A campaign over a grid: every metric against the settings that are tried, as a table and as curves with their spread."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray
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

Array = NDArray[np.floating]
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
    several, operating = list(_by_metric(rows)), operating_points(campaign, key, rows)
    count = len(several) + bool(operating)
    with panels(path, campaign, count, COLUMNS, 3.2, "lines: median of a point's trials, shaded: 5 to 95 %") as every:
        for axes, ((metric, phase, unit), some) in zip(every, several, strict=False):
            _curves(axes, campaign, key, some)
            axes.set(title=metric + ("" if phase == "all" else f", {phase}"), xlabel=key, ylabel=f"[{unit}]")
        if operating:
            _characteristic(every[-1], key, operating)


class OperatingPoints(NamedTuple):
    """Of a detector, along the key that curves run along.

    Attributes:
      subject: the detector.
      settings: the other keys of the grid.
      values: of the key.
      silent: mean share of the ticks of a fault at which none is declared, (values,).
      false: mean share of the ticks before it at which one is, (values,).
    """

    subject: str
    settings: Row
    values: tuple[float, ...]
    silent: Array
    false: Array


def operating_points(campaign: Campaign, key: str, rows: list[Row]) -> list[OperatingPoints]:
    """Silence in faults against false alarm before them, of every detector of which both are kept: an operating characteristic."""
    kept = {(r["subject"], r["metric"], r["phase"], r["point"]): r["mean"] for r in rows}
    found = []
    values = tuple(sorted(campaign.grid[key]))
    for subject in dict.fromkeys(r["subject"] for r in rows if r["metric"] == "silent_fraction"):
        for settings in {str(other): other for other in (_without(point, key) for point in campaign.points)}.values():
            here = [campaign.points.index(settings | {key: value}) for value in values]
            silent, false = (
                np.array([kept.get((subject, metric, phase, point), np.nan) for point in here])
                for metric, phase in (("silent_fraction", "all"), ("false_alarm_fraction", "nominal"))
            )
            if not np.isnan(silent + false).all():
                found.append(OperatingPoints(subject, settings, values, silent, false))
    return found


def _without(point: Row, key: str) -> Row:
    """The settings of a point but one."""
    return {k: v for k, v in point.items() if k != key}


def _characteristic(axes: Axes, key: str, operating: list[OperatingPoints]) -> None:
    """A line for each detector and combination of the other keys, which begins at the least value of `key`."""
    subjects = list(dict.fromkeys(line.subject for line in operating))
    combinations = list(dict.fromkeys(str(line.settings) for line in operating))
    for line in operating:
        colour = LOOP_VARIANTS[subjects.index(line.subject) % len(LOOP_VARIANTS)][0]
        dash = DASHES[combinations.index(str(line.settings)) % len(DASHES)]
        axes.plot(100.0 * line.false, 100.0 * (1.0 - line.silent), color=colour, ls=dash, marker="o", ms=2.5)
        axes.plot(100.0 * line.false[:1], 100.0 * (1.0 - line.silent[:1]), color=colour, marker="s", ms=4.5)
    axes.set(
        title=f"declared in the fault against before it; square: {key.rpartition('.')[2]} {operating[0].values[0]:g}",
        xlabel="declared before the fault, mean [% of ticks]",
        ylabel="declared in the fault, mean [% of ticks]",
    )


def _by_metric(rows: list[Row]) -> Iterator[tuple[tuple[str, str, str], list[Row]]]:
    """Measured rows, metric by metric and phase by phase."""

    def key(row: Row) -> tuple[str, str, str]:
        return row["metric"], row["phase"], row["unit"]

    measured = [row for row in rows if row["metric"] not in ("failed", *BESIDE)]
    for what, some in groupby(sorted(measured, key=key), key=key):
        yield what, list(some)


def _curves(axes: Axes, campaign: Campaign, key: str, some: list[Row]) -> None:
    others = [_without(point, key) for point in campaign.points]
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
