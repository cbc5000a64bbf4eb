"""Tables for a person at a terminal."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from rich.table import Table
from rich.text import Text

from estimation.consistency import average_bounds
from sim.estimators.tunings import Tuning
from sim.metrics.claims import Claim
from sim.metrics.one_body import STATES
from sim.metrics.results import Row
from sim.scenario.one_body import Scenario
from sim.scenario.references import EulerRates
from sim.scenario.run import Published
from sim.sensors.sensors import SENSOR_SETS, SensorSettings
from sim.tables.learned import learned
from sim.text.table_style import counted, number, paper, plain_table

# metric, heading, factor
_ESTIMATORS = (
    ("rmse_truth_quaternion", "truth\nq\n1e-3", 1e3),
    ("rmse_truth_rate", "truth\nrate\n1e-3", 1e3),
    ("rmse_residual_total", "resid.\nsum\n1e-3", 1e3),
    ("nees_mean", "NEES", 1.0),
    ("nis_mean", "NIS", 1.0),
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

WHEELS = 4  # of every plant that has wheels

_ANGLES = tuple((f"rmse_{name}_deg", name, 1.0) for name in ("phi", "theta", "psi", "body"))
_TRACKING = (("tracking_error_deg", "tracking\ndeg", 1.0),)
_PHASES = ("nominal", "fault", "recovery")
_DETECTION = (
    ("detection_delay_s", "all", "delay\ns", 1.0),
    ("false_alarm_fraction", "all", "false\nalarm\n%", 100.0),
    ("missed_fraction", "all", "missed\n\n%", 100.0),
    ("mode_fault_mean", "nominal", "mode\nbefore", 1.0),
    ("mode_fault_mean", "fault", "mode\nfault", 1.0),
    ("rmse_truth_rate", "all", "rate\nerror\n1e-3", 1e3),
    ("lost_definiteness", "all", "repairs", 1.0),
)


def _lookup(rows: Iterable[Row], phase: str) -> dict[tuple[str, str], float]:
    return {(row.subject, row.metric): row.mean for row in rows if row.phase == phase}


def estimators(rows: list[Row], observers: Iterable[str], published: Published | None, trials: int) -> Table:
    """The filters against the truth and against their readings, beside what the paper prints."""
    found, names = _lookup(rows, "all"), list(observers)
    dof = {name: _degrees_of_freedom(found, name) for name in names}
    several = sorted(set(dof.values()), reverse=True)
    bands = {n: "{:.2f} .. {:.2f}".format(*average_bounds(n, trials)) for n in several}
    complete = not found.get(("loop", "incomplete_readings"), 0.0)
    beside = not complete and any((name, "nis_dof_mean") in found for name in names)  # each NIS beside the dof of what was read
    caption = f"means over {counted(trials, 'trial')}"
    if several:
        what = "NEES and NIS" if complete else "NEES, and NIS of complete readings,"
        within = ", ".join(bands[n] if len(several) == 1 else f"{bands[n]} with {n} dof" for n in several)
        caption += f"; consistent {what} at a tick: {within} (95 %)"
    table = plain_table("Estimators: sums of RMSE against the truth, and consistency", caption)
    table.add_column("filter", overflow="fold")
    if len(several) > 1:
        table.add_column("dof", justify="right", no_wrap=True)
    for metric, name, _ in _ESTIMATORS:
        heading = name
        if metric == "nis_mean" and beside:
            heading += "\n(dof)"
        elif metric in ("nees_mean", "nis_mean") and len(several) == 1:
            heading += f"\n{'' if complete or metric == 'nees_mean' else '<= '}{several[0]}\ndof"
        table.add_column(heading, justify="right", no_wrap=True)
        if published and metric == "rmse_residual_total":
            table.add_column(f"paper\n{published.source}\n1e-3", justify="right", style="cyan", no_wrap=True)
    for name in names:
        cells = [str(dof[name])] if len(several) > 1 else []
        for metric, _, factor in _ESTIMATORS:
            value = found.get((name, metric))
            read = found.get((name, "nis_dof_mean")) if beside and metric == "nis_mean" else None
            cells.append(number(None if value is None else factor * value) + (f" ({number(read)})" if read is not None else ""))
            if published and metric == "rmse_residual_total":
                printed = published.values.get(name, {}).get(metric)
                cells.append(number(None if printed is None else factor * printed))
        table.add_row(name, *cells)
    return table


def _degrees_of_freedom(found: dict[tuple[str, str], float], name: str) -> int:
    """Of a filter's NEES and of the NIS of a complete reading: three of attitude, three of rate, one a wheel whose speed it estimates.

    A quaternion's norm says nothing, so that its four components count three (docs/consistency.md).
    """
    return 6 + (WHEELS if (name, "rmse_truth_wheel") in found else 0)


def made_with(tunings: Iterable[str | Tuning], sensors: SensorSettings) -> str:
    """Which tuning and sensors the twin's figures beside a paper's were made with."""
    said = sorted({one if isinstance(one, str) else "of the scenario's own" for one in tunings})
    chosen = next((name for name, settings in SENSOR_SETS.items() if settings == sensors), "of the scenario's own")
    own = "" if said == ["paper"] else "; the paper's Q and R: --set tuning=paper"
    return f"twin: tuning {' and '.join(said)}, sensors {chosen}{own}"


def residuals(rows: list[Row], published: Published, caption: str) -> Table:
    """The paper's own table, state by state: the twin's residual RMSE and, in colour, the printed one (both 1e-3)."""
    found = _lookup(rows, "all")
    names = [name for name in published.values if (name, "rmse_residual_q1") in found]
    table = plain_table(Text.assemble(f"Residual RMSE as in {published.source}, 1e-3: twin and ", paper("paper")), f"{caption}\n")
    table.add_column("state")
    for name in names:
        table.add_column(name, justify="right")
    for state in (*STATES, "total"):
        cells = []
        for name in names:
            printed = published.values[name].get(f"rmse_residual_{state}")
            twin, beside = (
                "-" if value is None else f"{1e3 * value:.4f}" for value in (found.get((name, f"rmse_residual_{state}")), printed)
            )
            cells.append(Text.assemble(twin, " ", paper(f"{beside:>6}")))
        table.add_row("sum" if state == "total" else state, *cells)
    return table


def campaign(rows: list[dict[str, Any]], point: dict[str, Any]) -> Table:
    """The metrics of a campaign's point: mean with its interval, and quantiles over trials."""
    settings = ", ".join(f"{key} = {value}" for key, value in point["settings"].items())
    table = plain_table("Over the trials" + (f" at {settings}" if settings else ""), _campaign_caption(point))
    table.add_column("filter", no_wrap=True)
    table.add_column("metric", no_wrap=True)
    for heading in ("n", "mean", "95 % of the mean", "5 %", "median", "95 %"):
        table.add_column(heading, justify="right")
    for row in rows:
        if row["phase"] == "all" and row["metric"] in _CAMPAIGN:
            name, factor = _CAMPAIGN[row["metric"]]
            low, high = row["mean_low"], row["mean_high"]
            interval = number(None) if low is None else f"{number(factor * low)} .. {number(factor * high)}"
            spread = (number(factor * row[q]) for q in ("q05", "q50", "q95"))
            table.add_row(row["subject"], name, str(row["n"]), number(factor * row["mean"]), interval, *spread)
    return table


def detected(found: dict[str, Any]) -> str:
    """How many faults were found, and how fast: delays that nobody saw the end of count as longer."""
    median = found["median_delay_s"]
    said = f"{found['faults_detected']} of {found['faults']} faults detected"
    said += f", {found['faults_missed']} missed, {found['faults_already_alarmed']} with an alarm that already stood"
    return f"{said}; median delay {number(median)} s" if median is not None else said


def _campaign_caption(point: dict[str, Any]) -> str:
    lines = [
        f"{d['who']} in {d['metric']}: {100 * d['share']:.1f} % of {d['n']} trials ({100 * d['low']:.1f} .. {100 * d['high']:.1f})"
        for d in point["beats_both"]
    ]
    lines += [f"{name}: {detected(found)}" for name, found in point["detection"].items() if found["faults"]]
    lines += [f"worst of {name}: trials {', '.join(str(trial) for trial, _ in found)}" for name, found in point["worst"].items() if found]
    if point["failed_trials"]:
        lines.append(f"failed: trials {', '.join(map(str, point['failed_trials'][:10]))}")
    return "\n".join(lines)


def loop(rows: list[Row]) -> str:
    """One line on the closed loop."""
    found = _lookup(rows, "all")
    values = [(found.get(("loop", metric)), label, unit, factor) for metric, label, unit, factor in _LOOP]
    parts = [f"{label} {number(None if value is None else factor * value)} {unit}".rstrip() for value, label, unit, factor in values]
    return "Loop: " + ", ".join(parts)


def loops(rows: list[Row], scenario: Scenario, trials: int) -> list[Table]:
    """Several closed loops on the same trials: how they track before, in and after the faults, and what they know of them."""
    published = scenario.published
    printed = published.values if published else {}
    found = {(row.subject, row.metric, row.phase): row.mean for row in rows}
    names, phases = list(scenario.loops), [p for p in ("all", *_PHASES) if any(row.phase == p for row in rows)]
    columns = _ANGLES if isinstance(scenario.reference, EulerRates) else _TRACKING
    out = []
    for phase in phases[1:] or phases:
        kept = [c for c in columns if any((name, c[0], phase) in found for name in names)]
        if not kept:
            continue
        table = plain_table(
            Text.assemble(
                f"Tracking error by the truth, RMSE in deg, phase {phase}", *((": twin and ", paper(published.source)) if published else ())
            )
        )
        table.add_column("loop", overflow="fold")
        for _, heading, _ in kept:
            table.add_column(heading, justify="right", no_wrap=True)
        for name in names:
            if (name, kept[0][0], phase) in found:
                table.add_row(name, *(_beside(found, printed, name, metric, phase, factor) for metric, _, factor in kept))
        out.append(table)
    table = plain_table("Effort, RMS a body axis in N m", f"means over {counted(trials, 'trial')}")
    table.add_column("loop", overflow="fold")
    for axis in "xyz":
        table.add_column(axis, justify="right", no_wrap=True)
    for name in names:
        table.add_row(name, *(_beside(found, printed, name, f"effort_rms_{axis}", "all", 1.0) for axis in "xyz"))
    out.append(table)
    shown = [c for c in _DETECTION if any((name, c[0], c[1]) in found for name in names)]
    table = plain_table(
        "What the loop's observer knows", "mode: mean probability that the wheels are faulty; rate error: sum of RMSE against the truth"
    )
    table.add_column("loop", overflow="fold")
    for _, _, heading, _ in shown:
        table.add_column(heading, justify="right", no_wrap=True)
    for name in names:
        values = [(found.get((name, metric, phase)), factor) for metric, phase, _, factor in shown]
        table.add_row(name, *(number(None if value is None else factor * value) for value, factor in values))
    return [*out, table, *learned(rows, scenario, trials)]


def _beside(
    found: dict[tuple[str, str, str], float], printed: dict[str, dict[str, float]], name: str, metric: str, phase: str, factor: float
) -> Text:
    """A number, and the printed one in colour if there is any."""
    value, said = found.get((name, metric, phase)), printed.get(name, {}).get(metric if phase == "all" else f"{metric}@{phase}")
    beside = paper(f" {number(factor * said):>5}") if said is not None else 6 * " " if printed else ""
    return Text.assemble(number(None if value is None else factor * value), beside)


def claims(found: list[Claim]) -> Table:
    """What a paper claims, and what became of it."""
    table = plain_table("Claims")
    table.add_column("claim", overflow="fold")
    for heading in ("printed", "found", "verdict"):
        table.add_column(heading, overflow="fold")
    for claim in found:
        table.add_row(claim.text, claim.printed, claim.found, claim.verdict)
    return table
