"""A campaign over a grid: every metric against the settings that are tried, as a table and as curves with their spread."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from numpy.typing import NDArray
from rich.table import Table

from sim.campaign.settings import Campaign
from sim.campaign.summary import BESIDE
from sim.report.campaign.panels import panels
from sim.series.palette import LOOP_VARIANTS
from sim.text.table_style import counted, number, plain_table

COLUMNS = 3
DASHES = ("-", "--", ":", "-.")
UNEVEN = 20.0  # the widest gap between neighbouring values over the narrowest
WIDTH = 78  # of a table
LEAST_FALSE = 1.0  # % of the ticks that an axis of false alarms shows at least
HEAD = 8  # letters of a key that stay in one line over its values

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
        cells = {place: _spread(row, campaign.trials) for place, row in found.items()}
        room = WIDTH - sum(_width_of(key, values) + 2 for key, values in campaign.grid.items())
        side_by_side = max(1, room // (2 + max(map(len, [*cells.values(), *subjects]))))
        for first in range(0, len(subjects), side_by_side):
            table = plain_table(
                f"{metric}{'' if phase == 'all' else f', {phase}'} [{unit}]",
                f"median (5 .. 95 %) of {counted(campaign.trials, 'trial')}, or of n",
            )
            for key, values in campaign.grid.items():
                table.add_column(key.rpartition(".")[2], justify="right", overflow="fold", min_width=_width_of(key, values))
            for subject in subjects[first : first + side_by_side]:
                table.add_column(subject, justify="right", no_wrap=True)
            for point, settings in enumerate(campaign.points):
                here = [cells.get((point, subject), number(None)) for subject in subjects[first : first + side_by_side]]
                table.add_row(*(str(value) for value in settings.values()), *here)
            yield table


def write_report(path: Path, campaign: Campaign, rows: list[Row]) -> None:
    """Draw every metric against the grid's longest numeric key: a colour a subject, a dash for each combination of the other keys.

    More combinations than dashes have panels of their own for each value of the keys that are words.
    """
    key = abscissa(campaign)
    assert key is not None
    several, operating, facets = list(_by_metric(rows)), operating_points(campaign, key, rows), _facets(campaign, key)
    drawn = [(facet, what, some) for facet in facets for what, some in several]
    count = len(drawn) + len(facets) * bool(operating)
    subjects = list(dict.fromkeys(row["subject"] for _, some in several for row in some))
    colours = {subject: LOOP_VARIANTS[i % len(LOOP_VARIANTS)][0] for i, subject in enumerate(subjects)}
    others = {str(rest): rest for point in campaign.points if (rest := _without(point, key, *facets[0]))}
    dashes = {combination: DASHES[i % len(DASHES)] for i, combination in enumerate(others)}
    with panels(path, campaign, count, COLUMNS, 3.2, "lines: median of a point's trials, shaded: 5 to 95 %") as every:
        for axes, (facet, (metric, phase, unit), some) in zip(every, drawn, strict=False):
            _curves(axes, campaign, key, some, facet, colours, dashes)
            axes.set(title=_titled(metric + ("" if phase == "all" else f", {phase}"), facet), xlabel=key, ylabel=f"[{unit}]")
        for axes, facet in zip(every[len(drawn) :], facets, strict=False):
            _characteristic(axes, key, operating, facet, colours, dashes)
        handles = [Line2D([], [], color=colour, lw=1.8, label=subject) for subject, colour in colours.items()]
        handles += [Line2D([], [], color="#5a6270", ls=ls, label=_said(others[combination])) for combination, ls in dashes.items()]
        if len(every):
            every[0].figure.legend(handles=handles, loc="outside lower center", ncols=min(6, len(handles)), handlelength=3.0)


def _facets(campaign: Campaign, key: str) -> list[Row]:
    """Settings that a panel is of: none, or each combination of the keys that are words, if there are more lines than dashes."""
    if len({str(_without(point, key)) for point in campaign.points}) <= len(DASHES):
        return [{}]
    words = [k for k, values in campaign.grid.items() if k != key and all(isinstance(value, str) for value in values)]
    return list({str(facet): facet for point in campaign.points for facet in [{k: point[k] for k in words}]}.values())


def _said(settings: Row) -> str:
    return ", ".join(f"{k.rpartition('.')[2]} {v}" for k, v in settings.items())


def _titled(title: str, facet: Row) -> str:
    return f"{title} | {_said(facet)}" if facet else title


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


def _without(point: Row, *keys: str) -> Row:
    """The settings of a point but some."""
    return {k: v for k, v in point.items() if k not in keys}


def _characteristic(
    axes: Axes, key: str, operating: list[OperatingPoints], facet: Row, colours: dict[str, str], dashes: dict[str, str]
) -> None:
    """A line for each detector and combination of the other keys, which begins at the least value of `key`."""
    for line in operating:
        if not facet.items() <= line.settings.items():
            continue
        ls = dashes.get(str(_without(line.settings, *facet)), "-")
        false, declared = 100.0 * line.false, 100.0 * (1.0 - line.silent)
        axes.plot(false, declared, color=colours[line.subject], ls=ls, marker="o", ms=2.5)
        axes.plot(false[:1], declared[:1], color=colours[line.subject], marker="s", ms=4.5)
    axes.set(
        title=_titled("operating points", facet),
        xlabel=f"declared before the fault [% of ticks]; square: {key.rpartition('.')[2]} {operating[0].values[0]:g}",
        ylabel="declared in it [% of ticks]",
    )
    axes.margins(0.08)
    if axes.get_xlim()[1] < LEAST_FALSE:
        axes.set_xlim(-0.08 * LEAST_FALSE, LEAST_FALSE)


def _curves(axes: Axes, campaign: Campaign, key: str, some: list[Row], facet: Row, colours: dict[str, str], dashes: dict[str, str]) -> None:
    here = [row for row in some if facet.items() <= campaign.points[row["point"]].items()]
    x, labels = _places(sorted(campaign.grid[key]))
    for subject in dict.fromkeys(row["subject"] for row in here):
        for combination in dashes or {"{}": "-"}:
            found = {
                campaign.points[r["point"]][key]: r
                for r in here
                if r["subject"] == subject and str(_without(campaign.points[r["point"]], key, *facet)) == combination
            }
            low, middle, high = (np.array([found.get(value, {}).get(q, np.nan) for value in x]) for q in ("q05", "q50", "q95"))
            axes.plot(list(x.values()), middle, color=colours[subject], ls=dashes.get(combination, "-"), marker="o", ms=2.5)
            axes.fill_between(list(x.values()), low, high, color=colours[subject], alpha=0.10, lw=0)
    if labels:
        axes.set_xticks(list(x.values()), labels, rotation=45, fontsize=7)
    least, greatest = min(row["q05"] for row in here), max(row["q95"] for row in here)
    if 0 < 20 * least < greatest:
        axes.set_yscale("log")


def _by_metric(rows: list[Row]) -> Iterator[tuple[tuple[str, str, str], list[Row]]]:
    """Measured rows, metric by metric and phase by phase."""

    def key(row: Row) -> tuple[str, str, str]:
        return row["metric"], row["phase"], row["unit"]

    measured = [row for row in rows if row["metric"] not in ("failed", *BESIDE)]
    for what, some in groupby(sorted(measured, key=key), key=key):
        yield what, list(some)


def _places(values: list[float]) -> tuple[dict[float, float], list[str]]:
    """Where each value is drawn; if they crowd together at one end side by side, and labelled."""
    gaps = np.diff(values)
    if gaps.max() <= UNEVEN * gaps.min():
        return {value: float(value) for value in values}, []
    return {value: float(place) for place, value in enumerate(values)}, [f"{value:g}" for value in values]


def _width_of(key: str, values: tuple[Any, ...]) -> int:
    """Letters that a column of the grid needs: its values in one line each, its name in several if it is long."""
    return max(min(HEAD, len(key.rpartition(".")[2])), *(len(str(value)) for value in values))


def _spread(row: Row, trials: int) -> str:
    few = "" if row["n"] == trials else f" n={row['n']}"
    return f"{number(row['q50'])} ({number(row['q05'])} .. {number(row['q95'])}){few}"
