"""Tables for a person at a terminal."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

from estimation.consistency import average_bounds
from sim.metrics import STATES
from sim.results import Row
from sim.scenario import Published

# metric, heading, factor
_ESTIMATORS = (
    ("rmse_truth_quaternion", "truth\nq\n1e-3", 1e3),
    ("rmse_truth_rate", "truth\nrate\n1e-3", 1e3),
    ("rmse_residual_total", "resid.\nsum\n1e-3", 1e3),
    ("nees_mean", "NEES\n10\ndof", 1.0),
    ("nis_mean", "NIS\n10\ndof", 1.0),
    ("detection_delay_s", "delay\n\ns", 1.0),
    ("false_alarm_fraction", "false\nalarm\n%", 100.0),
    ("missed_fraction", "missed\n\n%", 100.0),
)
_CAMPAIGN = {
    "rmse_truth_quaternion": ("truth q, 1e-3", 1e3),
    "rmse_truth_rate": ("truth rate, 1e-3", 1e3),
    "nees_mean": ("NEES", 1.0),
    "nis_mean": ("NIS", 1.0),
    "detection_delay_s": ("delay, s", 1.0),
    "false_alarm_fraction": ("false alarm, %", 100.0),
    "missed_fraction": ("missed, %", 100.0),
    "tracking_error_deg": ("tracking, deg", 1.0),
    "saturated_time_s": ("saturated, s", 1.0),
}
_LOOP = (
    ("tracking_error_deg", "tracking error", "deg", 1.0),
    ("control_effort_rms", "control effort", "mN m", 1e3),
    ("peak_wheel_speed", "peak wheel speed", "rpm", 60 / (2 * np.pi)),
    ("saturated_time_s", "saturated", "s", 1.0),
    ("missing_readings", "missing readings", "", 1.0),
)


def _number(value: float | None) -> str:
    if value is None:
        return "[dim]-[/]"
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}" if abs(value) < 1e6 else f"{value:.2e}"


def _table(title: str, caption: str | None = None) -> Table:
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


def _lookup(rows: Iterable[Row], phase: str) -> dict[tuple[str, str], float]:
    return {(row.subject, row.metric): row.mean for row in rows if row.phase == phase}


def estimators(rows: list[Row], observers: Iterable[str], published: Published | None, trials: int) -> Table:
    """The filters against the truth and against their readings, beside what the paper prints."""
    found = _lookup(rows, "all")
    low, high = average_bounds(10, trials)
    caption = f"means over {trials} trials; consistent NEES and NIS at a tick: {low:.2f} .. {high:.2f} (95 %)"
    table = _table("Estimators: sums of RMSE against the truth, and consistency", caption)
    table.add_column("filter", overflow="fold")
    for metric, heading, _ in _ESTIMATORS:
        table.add_column(heading, justify="right", no_wrap=True)
        if published and metric == "rmse_residual_total":
            table.add_column(f"paper\n{published.source}\n1e-3", justify="right", style="cyan", no_wrap=True)
    for name in observers:
        cells = []
        for metric, _, factor in _ESTIMATORS:
            value = found.get((name, metric))
            cells.append(_number(None if value is None else factor * value))
            if published and metric == "rmse_residual_total":
                printed = published.values.get(name, {}).get(metric)
                cells.append(_number(None if printed is None else factor * printed))
        table.add_row(name, *cells)
    return table


def residuals(rows: list[Row], published: Published) -> Table:
    """The paper's own table, state by state: the twin's residual RMSE and, in colour, the printed one (both 1e-3)."""
    found = _lookup(rows, "all")
    names = [name for name in published.values if (name, "rmse_residual_q1") in found]
    table = _table(f"Residual RMSE as in {published.source}, 1e-3: twin and [cyan]paper[/]")
    table.add_column("state")
    for name in names:
        table.add_column(name, justify="right")
    for state in (*STATES, "total"):
        cells = []
        for name in names:
            printed = published.values[name].get(f"rmse_residual_{state}")
            beside = "-" if printed is None else f"{1e3 * printed:.4f}"
            cells.append(f"{1e3 * found[name, f'rmse_residual_{state}']:.4f} [cyan]{beside:>6}[/]")
        table.add_row("sum" if state == "total" else state, *cells)
    return table


def campaign(rows: list[dict[str, Any]], point: dict[str, Any]) -> Table:
    """The metrics of a campaign's point: mean with its interval, and quantiles over trials."""
    settings = ", ".join(f"{key} = {value}" for key, value in point["settings"].items())
    table = _table("Over the trials" + (f" at {settings}" if settings else ""), _campaign_caption(point))
    table.add_column("filter", no_wrap=True)
    table.add_column("metric", no_wrap=True)
    for heading in ("mean", "95 % of the mean", "5 %", "median", "95 %"):
        table.add_column(heading, justify="right")
    for row in rows:
        if row["phase"] == "all" and row["metric"] in _CAMPAIGN:
            name, factor = _CAMPAIGN[row["metric"]]
            interval = f"{_number(factor * row['mean_low'])} .. {_number(factor * row['mean_high'])}"
            table.add_row(
                row["subject"], name, *(_number(factor * row["mean"]), interval), *(_number(factor * row[q]) for q in ("q05", "q50", "q95"))
            )
    return table


def _campaign_caption(point: dict[str, Any]) -> str:
    lines = [
        f"{d['who']} in {d['metric']}: {100 * d['share']:.1f} % of {d['n']} trials ({100 * d['low']:.1f} .. {100 * d['high']:.1f})"
        for d in point["beats_both"]
    ]
    lines += [f"worst of {name}: trials {', '.join(str(trial) for trial, _ in found)}" for name, found in point["worst"].items() if found]
    if point["failed_trials"]:
        lines.append(f"failed: trials {', '.join(map(str, point['failed_trials'][:10]))}")
    return "\n".join(lines)


def loop(rows: list[Row]) -> str:
    """One line on the closed loop."""
    found = _lookup(rows, "all")
    parts = [f"{label} {_number(factor * found['loop', metric])} {unit}".rstrip() for metric, label, unit, factor in _LOOP]
    return "Loop: " + ", ".join(parts)
