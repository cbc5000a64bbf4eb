"""Table of what observers learned of the unmodelled torque, and of what their loops made of it."""

from __future__ import annotations

from rich.table import Table

from sim.metrics.results import Row
from sim.scenario.one_body import Scenario
from sim.text.table_style import counted, number, plain_table

# metric, heading, factor
_COLUMNS = (
    ("tracking_error_deg", "track.\nerror\nmdeg", 1e3),
    ("attitude_error_deg", "attit.\nerror\nmdeg", 1e3),
    ("rmse_truth_rate", "rates'\nerror\nmrad/s", 1e3),
    ("nis_mean", "NIS\n\n6 dof", 1.0),
    ("nis_inside_share", "inside\n95 %\n%", 100.0),
    ("learned_torque_error", "torque\nerror\nuN m", 1e6),
    ("unmodelled_torque", "of the\ntrue\nuN m", 1e6),
    ("learned_torque_relative", "that\nis\n%", 100.0),
)


def learned(rows: list[Row], scenario: Scenario, trials: int) -> list[Table]:
    """One table for each window of time, or for the whole run; none where nobody learns."""
    found = {(row.subject, row.metric, row.phase): row.mean for row in rows}
    names = list(scenario.loops)
    out = []
    for phase in scenario.phases or ("all",):
        if not any((name, "learned_torque_error", phase) in found for name in names):
            continue
        spanned = f"{phase} s" if phase in scenario.phases else "the whole run"
        caption = f"means over {counted(trials, 'trial')} of RMS; torques: RMS a body axis, learned minus true; rates: sum of three"
        table = plain_table(f"Unmodelled torque: tracking and learning, {spanned}", caption)
        table.add_column("loop", overflow="fold")
        for _, heading, _ in _COLUMNS:
            table.add_column(heading, justify="right", no_wrap=True)
        for name in names:
            values = [(found.get((name, metric, phase)), factor) for metric, _, factor in _COLUMNS]
            table.add_row(name, *(number(None if value is None else factor * value) for value, factor in values))
        out.append(table)
    return out
