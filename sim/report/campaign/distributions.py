"""A campaign of any scenario: how every metric is spread over its trials, and which trials are at the ends."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from rich.table import Table

from sim.campaign.settings import Campaign
from sim.campaign.summary import BESIDE, Distribution
from sim.report.campaign.panels import legend, panels
from sim.series.palette import on_light
from sim.text.table_style import counted, number, plain_table

COLUMNS = 4
FENCE = 1.5  # interquartile ranges beyond the quartiles: an outlier (Tukey 1977)


def outliers(found: Distribution) -> list[tuple[int, float]]:
    """Trials (number, value) far outside the others, the farthest first."""
    low, high = np.quantile(found.values, (0.25, 0.75))
    away = np.maximum(low - found.values, found.values - high)
    far = np.flatnonzero(away > FENCE * max(high - low, 1e-12))
    return [(int(found.trials[i]), float(found.values[i])) for i in far[np.argsort(-away[far], kind="stable")]]


def kept(found: list[Distribution]) -> list[Distribution]:
    """What was measured, not what was drawn, metric by metric."""
    measured = [d for d in found if d.subject not in ("draw", "loop") or d.metric == "failed"]
    return sorted((d for d in measured if d.metric not in ("failed", *BESIDE)), key=lambda d: (d.metric, d.subject, d.phase))


def write_report(path: Path, campaign: Campaign, found: list[Distribution]) -> None:
    """Draw the distribution function of every metric at the first point of a campaign's grid."""
    several = [(metric, list(some)) for metric, some in groupby(kept(found), key=lambda d: d.metric)]
    spread = ", ".join(key.rpartition(".")[2] for key in campaign.dispersion)
    with panels(path, campaign, len(several), COLUMNS, 2.7, f"dispersed: {spread}") as every:
        for axes, (metric, some) in zip(every, several, strict=True):
            _spread(axes, metric, some)


def _spread(axes: Axes, metric: str, some: list[Distribution]) -> None:
    colours = on_light(tuple(dict.fromkeys(d.subject for d in some)))
    phases = list(dict.fromkeys(d.phase for d in some))
    for d in some:
        values = np.sort(d.values)
        share = 100.0 * (np.arange(len(values)) + 0.5) / len(values)
        dash = ("-", "--", ":", "-.")[phases.index(d.phase) % 4]
        axes.plot(values, share, color=colours[d.subject], ls=dash, label=d.subject if d.phase == "all" else f"{d.subject}, {d.phase}")
        far = [value for _, value in outliers(d)]
        axes.plot(far, np.interp(far, values, share), "o", ms=3.0, color=colours[d.subject])
    low, high = min(d.values.min() for d in some), max(d.values.max() for d in some)
    if low > 0 and high > 20 * low:
        axes.set_xscale("log")
    axes.set(title=metric, xlabel=f"[{some[0].unit}]", ylabel="trials with less [%]")
    legend(axes, fontsize=6)


def table(found: list[Distribution], failed: list[int], trials: int) -> Table:
    """Spread of every metric, and the trials that are far outside it."""
    caption = f"outliers: beyond {FENCE:g} interquartile ranges" + (
        f"; failed: trials {', '.join(map(str, failed))}" if failed else "; none failed"
    )
    out = plain_table(f"Over {counted(trials, 'trial')}", caption)
    out.add_column("metric", overflow="fold")
    out.add_column("of", overflow="fold")
    for heading in ("5 %", "median", "95 %"):
        out.add_column(heading, justify="right", no_wrap=True)
    out.add_column("outliers (trial)", overflow="fold")
    for d in kept(found):
        low, middle, high = np.quantile(d.values, (0.05, 0.5, 0.95))
        far = outliers(d)
        named = ", ".join(f"{number(value)} ({trial})" for trial, value in far[:3]) + (f" and {len(far) - 3} more" if len(far) > 3 else "")
        out.add_row(
            d.metric, d.subject if d.phase == "all" else f"{d.subject}, {d.phase}", number(low), number(middle), number(high), named
        )
    return out
