"""`report.png` of a campaign: how the filters' errors are spread, what decides who wins, how fast and how surely faults are found."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from sim.campaign.settings import Campaign
from sim.campaign.summary import Distribution, beats_both_by_trial, mean_interval, watched
from sim.metrics.detection import detected_by
from sim.report.campaign.panels import legend
from sim.series.palette import on_light
from sim.series.picture_style import STYLE
from sim.series.raster import write_png
from sim.text.table_style import counted

Array = NDArray[np.floating]

BASELINES = ("ekf", "sif")
SHOWN = 6  # dispersed parameters with a curve of their own


def write_report(path: Path, campaign: Campaign, found: list[Distribution], point: dict[str, Any]) -> None:
    """Draw the first point of a campaign's grid; `point` is its entry in the summary."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(11.0, 8.4), dpi=160, layout="constrained")
        grid = figure.subplots(2, 2)
        _errors(grid[0, 0], found)
        _who_wins(grid[0, 1], campaign, found)
        _delays(grid[1, 0], found)
        _characteristic(grid[1, 1], point)
        for letter, axes in zip("abcd", grid.flat, strict=True):
            axes.set_title(f"({letter}) {axes.get_title(loc='left')}", loc="left")
        figure.suptitle(f"{campaign.title}\n", x=0.01, ha="left", fontsize=12, fontweight="bold")
        spread = ", ".join(key.partition(".")[2] for key in campaign.dispersion)
        figure.text(
            0.01,
            0.957,
            f"{campaign.scenario}, {counted(campaign.trials, 'trial')} | dispersed: {spread}",
            fontsize=8,
            color="#5a6270",
        )
        write_png(figure, path)


def _color(observer: str) -> str:
    return on_light((observer,))[observer]


def _errors(axes: Axes, found: list[Distribution]) -> None:
    """Distribution functions of the rate error of every filter."""
    for d in found:
        if (d.metric, d.phase) == ("rmse_truth_rate", "all") and d.subject != "mekf":
            values = np.sort(1e3 * d.values)
            axes.plot(values, 100.0 * (np.arange(len(values)) + 0.5) / len(values), color=_color(d.subject), label=d.subject, lw=1.5)
    axes.set(title="Rate error against the truth", xlabel="sum of RMSE over the components [mrad/s]", ylabel="trials with less [%]")
    legend(axes, loc="lower right")


def _who_wins(axes: Axes, campaign: Campaign, found: list[Distribution]) -> None:
    """Share of trials in which a hybrid beats both baselines, over the range of each dispersed parameter."""
    hybrid = "nis-fading"
    of = {d.subject: d for d in found if (d.metric, d.phase) == ("rmse_truth_rate", "all")}
    draws = {d.metric: d for d in found if d.subject == "draw" and d.metric in campaign.dispersion}
    axes.set(
        title=f"{hybrid} beats both EKF and SIF in rate", xlabel="quantile of the dispersed parameter [%]", ylabel="share of trials [%]"
    )
    if not {hybrid, *BASELINES} <= of.keys() or not draws:
        return
    trials, wins = beats_both_by_trial(of, hybrid, BASELINES)
    strength: dict[str, tuple[float, Array]] = {}
    for key, d in draws.items():
        rank = np.argsort(np.argsort(d.values[np.isin(d.trials, trials)], kind="stable"), kind="stable") / len(trials)
        share = (
            np.array([wins[(rank >= low) & (rank < low + 0.1)].mean() for low in np.arange(10) / 10]) if len(trials) >= 50 else np.zeros(0)
        )
        if len(share):
            strength[key] = float(np.ptp(share)), share
    for key, (_, share) in sorted(strength.items(), key=lambda item: -item[1][0])[:SHOWN]:
        axes.plot(np.arange(5, 100, 10), 100.0 * share, marker="o", ms=3, lw=1.2, label=key.partition(".")[2])
    low, high, _ = mean_interval(wins.astype(float), 0, of_share=True)
    if low is not None and high is not None:
        axes.axhspan(100 * low, 100 * high, color="#1b4f9c", alpha=0.15, lw=0)
    axes.axhline(100 * wins.mean(), color="#1b4f9c", lw=1.0, ls="--", label=f"all: {100 * wins.mean():.1f} %")
    axes.set_ylim(min(90.0, axes.get_ylim()[0]), 101.0)
    legend(axes, loc="lower left", ncols=2)


def _delays(axes: Axes, found: list[Distribution]) -> None:
    """Share of the faults that were detected by a time; a fault with an alarm that already stood is none that could be, and is named."""
    for subject in dict.fromkeys(d.subject for d in found if (d.metric, d.phase) == ("detection_delay_s", "all")):
        seen = watched(found, subject)
        time, share = detected_by(seen.delay, seen.detected)
        before, total = seen.counts["faults_already_alarmed"], seen.counts["faults"]
        said = f" ({100.0 * before / total:.0f} % already alarmed)" if total else ""
        axes.step(time, 100.0 * share, where="post", color=_color(subject), label=f"{subject}{said}", lw=1.5)
    axes.set(title="Detection delay", xlabel="delay [s]", ylabel="faults detected, of those without an alarm before [%]", ylim=(0, 101))
    if axes.lines:
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter(mpl.ticker.FuncFormatter(lambda value, _: f"{value:g}"))
        legend(axes, loc="lower right")


def _characteristic(axes: Axes, point: dict[str, Any]) -> None:
    """Detection against false alarm as the threshold moves; the dot is the threshold in use."""
    for observer, curve in point["roc"].items():
        alarm, detection, threshold = (
            100.0 * np.array(curve["false_alarm"]),
            100.0 * np.array(curve["detection"]),
            np.array(curve["threshold"]),
        )
        axes.plot(alarm, detection, color=_color(observer), label=observer, lw=1.5)
        used = int(np.argmin(np.abs(threshold - 1.0)))
        axes.plot(alarm[used], detection[used], "o", color=_color(observer), ms=5)
    axes.plot([0, 100], [0, 100], color="#b0b5bd", lw=0.8, ls="--")
    axes.set(
        title="Detection against false alarm (dots: the thresholds in use)",
        xlabel="trials with an alarm before the fault [%]",
        ylabel="trials that declare during the fault [%]",
        xlim=(-2, 102),
        ylim=(-2, 102),
    )
    legend(axes, loc="lower right")
