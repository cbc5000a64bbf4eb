"""Tables of loops without a rate gyro: errors of the estimates in each window of time, and what became of body and filter."""

from __future__ import annotations

from rich.table import Table
from rich.text import Text

from sim.metrics.results import Row
from sim.scenario.one_body import Scenario
from sim.text.table_style import counted, number, paper, plain_table

_ERRORS = (("rms_rate_error", "rate, 1e-3 rad/s of an axis", 1e3), ("rms_attitude_error", "attitude, 1e-3 of q1, q2, q3", 1e3))
_ENDS = (
    ("tracking_error_deg", "tracking\nall, deg"),
    ("final_attitude", "attitude\nat last"),
    ("ess_median", "median\nESS"),
    ("lost", "trials\nlost"),
)
_REGION = (("state", "body in\nregion, s"), ("estimate", "estimate in\nregion, s"))


def windows(rows: list[Row], scenario: Scenario, trials: int) -> list[Table]:
    """Errors in the windows that the run reached, then how body and filter ended; printed values in colour."""
    found = {(row.subject, row.metric, row.phase): row for row in rows}
    subjects = _subjects(scenario)
    spans = [name for name in scenario.phases if any((subject, "rms_rate_error", name) in found for subject in subjects)]
    tables = []
    for metric, what, factor in _ERRORS:
        table = plain_table(f"RMS error of the estimate: {what}", f"means over {counted(trials, 'trial')}")
        table.add_column("loop", overflow="fold")
        for name in spans:
            table.add_column(f"{name} s", justify="right", no_wrap=True)
        for subject in subjects:
            cells = [found.get((subject, metric, name)) for name in spans]
            if any(cells):
                table.add_row(subject, *(number(row and factor * row.mean) for row in cells))
        tables.append(table)
    return [*tables, _ends(found, scenario, trials)]


def _subjects(scenario: Scenario) -> list[str]:
    """Every loop, and the filters that watch it."""
    return [subject for name, loop in scenario.loops.items() for subject in (name, *(f"{name}/{one}" for one in loop.watching))]


def _ends(found: dict[tuple[str, str, str], Row], scenario: Scenario, trials: int) -> Table:
    published = scenario.published
    printed = published.values if published else {}
    shown = [column for column in _ENDS if any((loop, column[0], "all") in found for loop in _subjects(scenario))]
    table = plain_table(
        Text.assemble("Body and filter", *(("; ", paper(published.source)) if published else ())),
        f"region: |q_i| < 1e-3 and rates < 50e-6 rad/s, first time, mean of the trials that came there (how many of {trials})",
    )
    table.add_column("loop", overflow="fold")
    for heading in [heading for _, heading in (*_REGION, *shown)]:
        table.add_column(heading, justify="right", no_wrap=True)
    for loop in _subjects(scenario):
        cells: list[str | Text] = []
        for phase, _ in _REGION:
            row = found.get((loop, "time_to_region_s", phase))
            said = printed.get(loop, {}).get(f"time_to_region_s@{phase}")
            estimated = phase == "state" or (loop, "lost", "all") in found
            value = f"{row.mean:.0f} ({row.n})" if row else "never" if estimated else number(None)
            cells.append(Text.assemble(value, *((" ", paper(f"{said:.0f}")) if said is not None else ())))
        for metric, _ in shown:
            row = found.get((loop, metric, "all"))
            cells.append(number(row and row.mean * (trials if metric == "lost" else 1.0)))
        table.add_row(loop, *cells)
    return table
