"""Tables of a formation."""

from __future__ import annotations

from rich.table import Table

from sim.metrics.results import Row
from sim.scenario.formation import FormationScenario
from sim.text.table_style import counted, number, plain_table

_COLUMNS = (  # metric, heading, factor
    ("skae", "SKAE", 1.0),
    ("fkae", "FKAE", 1.0),
    ("formation_angle_deg", "apart\ndeg", 1.0),
    ("rms_velocity_error", "rate error\n1e-3/s", 1e3),
    ("peak_torque", "torque\nN m", 1.0),
    ("nees_mean", "NEES\n6 dof", 1.0),
    ("nis_mean", "NIS\n3 dof", 1.0),
)


def formation(rows: list[Row], scenario: FormationScenario, trials: int) -> list[Table]:
    """Errors of every loop in every phase, and when each formation settles."""
    found = {(row.subject, row.metric, row.phase): row for row in rows}
    subjects = list(dict.fromkeys(row.subject for row in rows))
    caption = f"means over {counted(trials, 'trial')}; rates are those of the modified Rodrigues parameters"
    table = plain_table("Attitude errors of the formation", caption)
    table.add_column("subject")
    table.add_column("phase")
    for _, heading, _ in _COLUMNS:
        table.add_column(heading, justify="right")
    for subject in subjects:
        for i, phase in enumerate(dict.fromkeys(row.phase for row in rows)):
            cells = [found.get((subject, metric, phase)) for metric, _, _ in _COLUMNS]
            shown = [number(None if row is None else row.mean * factor) for row, (_, _, factor) in zip(cells, _COLUMNS, strict=True)]
            table.add_row(subject if not i else "", phase, *shown)
    settling = plain_table(f"Time after which FKAE stays below 0.1, of {trials}")
    settling.add_column("loop")
    for heading in ("settled", "mean, s", "least, s", "greatest, s"):
        settling.add_column(heading, justify="right")
    for loop in scenario.loops:
        row = found.get((loop, "settling_time_s", "all"))
        cells_of = ("0", *[number(None)] * 3) if row is None else (str(row.n), *map(number, (row.mean, row.min, row.max)))
        settling.add_row(loop, *cells_of)
    return [table, settling]
