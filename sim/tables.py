"""Tables for a person at a terminal."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table
from scipy.stats import chi2

from sim.metrics import STATES
from sim.results import Row
from sim.scenario import Published

# metric, heading, factor
_ESTIMATORS = (
    ("rmse_truth_quaternion", "truth q\n\\[1e-3]", 1e3),
    ("rmse_truth_rate", "truth rate\n\\[mrad/s]", 1e3),
    ("attitude_error_deg", "attitude\n\\[mdeg]", 1e3),
    ("rmse_residual_total", "residual q + rate\n\\[1e-3]", 1e3),
    ("nees_mean", "NEES\n(10 dof)", 1.0),
    ("nis_mean", "NIS\n(10 dof)", 1.0),
    ("detection_delay_s", "delay\n\\[s]", 1.0),
    ("false_alarm_fraction", "false alarm\n\\[%]", 100.0),
    ("missed_fraction", "missed\n\\[%]", 100.0),
)
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


def _lookup(rows: Iterable[Row], phase: str) -> dict[tuple[str, str], float]:
    return {(row.subject, row.metric): row.mean for row in rows if row.phase == phase}


def estimators(rows: list[Row], observers: Iterable[str], published: Published | None, trials: int) -> Table:
    """The filters against the truth and against their readings, beside what the paper prints."""
    found = _lookup(rows, "all")
    low, high = chi2.ppf([0.025, 0.975], 10 * trials) / trials
    caption = f"means over {trials} trials; 95 % of consistent NEES and NIS at a tick lie in {low:.2f} .. {high:.2f}"
    table = Table(title="Estimators", caption=caption, box=SIMPLE_HEAD, title_justify="left", caption_justify="left", caption_style="dim")
    table.add_column("filter")
    for _, heading, _ in _ESTIMATORS:
        table.add_column(heading, justify="right")
        if published and heading.startswith("residual"):
            table.add_column(f"paper,\n{published.source}", justify="right", style="cyan")
    for name in observers:
        cells = []
        for metric, heading, factor in _ESTIMATORS:
            value = found.get((name, metric))
            cells.append(_number(None if value is None else factor * value))
            if published and heading.startswith("residual"):
                printed = published.values.get(name, {}).get(metric)
                cells.append(_number(None if printed is None else factor * printed))
        table.add_row(name, *cells)
    return table


def residuals(rows: list[Row], published: Published) -> Table:
    """The paper's own table, state by state: the twin's residual RMSE and, in colour, the printed one (both 1e-3)."""
    found = _lookup(rows, "all")
    names = [name for name in published.values if (name, "rmse_residual_q1") in found]
    table = Table(title=f"Residual RMSE as in {published.source} \\[1e-3]: twin and [cyan]paper[/]", box=SIMPLE_HEAD, title_justify="left")
    table.add_column("state")
    for name in names:
        table.add_column(name, justify="right")
        table.add_column("", style="cyan", justify="right")
    for state in (*STATES, "total"):
        cells = []
        for name in names:
            printed = published.values[name].get(f"rmse_residual_{state}")
            cells += [f"{1e3 * found[name, f'rmse_residual_{state}']:.4f}", "-" if printed is None else f"{1e3 * printed:.4f}"]
        table.add_row("sum" if state == "total" else state, *cells)
    return table


def loop(rows: list[Row]) -> str:
    """One line on the closed loop."""
    found = _lookup(rows, "all")
    parts = [f"{label} {_number(factor * found['loop', metric])} {unit}".rstrip() for metric, label, unit, factor in _LOOP]
    return "Loop: " + ", ".join(parts)
