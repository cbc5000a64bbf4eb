"""Tables of antenna mapping for a person at a terminal."""

from __future__ import annotations

from rich.table import Table

from sim.controllers.settings import UnfalsifiedSettings
from sim.metrics.results import Row
from sim.scenario.one_body import Scenario
from sim.text.table_style import counted, number, plain_table

_SWITCHING = (  # metric, whether it is shown over lambda
    ("switches", False),
    ("first_switch_s", False),
    ("from_grid", False),
    ("natural_frequency", True),
    ("damping_ratio", False),
    ("integral_per_s", False),
    ("theta_1", False),
    ("theta_2", False),
)
_CONTROLLERS = ("initial", "nominal", "final")


def antenna(rows: list[Row], scenario: Scenario, trials: int) -> list[Table]:
    """Antenna mapping: how the loops point and what it takes, what they switched to, and what that truly is."""
    found = {(row.subject, row.metric, row.phase): row.mean for row in rows}
    channels = [c for c in ("azimuth", "elevation") if any(row.subject == c for row in rows)]
    names = list(scenario.loop_names)
    table = plain_table(
        "Pointing error and torque, RMS of the second half of the run",
        f"means over {counted(trials, 'trial')}" + (f"; ratio: {names[0]} over {names[-1]}" if len(names) > 1 else ""),
    )
    table.add_column("channel")
    for unit in ("deg", "N m"):
        for name in names:
            table.add_column(f"{name}\n{unit}", justify="right")
        if len(names) > 1:
            table.add_column("\nratio", justify="right")
    for channel in channels:
        cells = []
        for metric in ("rms_pointing_deg", "rms_torque"):
            values = [found.get((channel, metric, name)) for name in names]
            cells += [number(value) for value in values]
            if len(names) > 1:
                cells.append(number(values[0] / values[-1] if values[0] is not None and values[-1] else None))
        table.add_row(channel, *cells)
    out = [table]
    if any((channel, "switches", "all") in found for channel in channels):
        adaptive = next(
            single.law for single in scenario.singles().values() if isinstance(single.law, UnfalsifiedSettings) and not single.law.frozen
        )
        caption = "natural frequency and damping on the true, rigid inertia; theta = (1/C_p, C_d/C_p)"
        table = plain_table("Controllers that the data chose", caption)
        table.add_column("channel")
        heads = (
            "switches",
            "first\ns",
            "from\ngrid",
            "frequency\n/ lambda",
            "damping",
            "C_I / C_p\n1/s",
            "theta_1\nrad/(N m)",
            "theta_2\ns",
        )
        shown = [
            (m, over, head) for (m, over), head in zip(_SWITCHING, heads, strict=True) if any((c, m, "all") in found for c in channels)
        ]
        for _, _, heading in shown:
            table.add_column(heading, justify="right")
        for channel in channels:
            values = [found.get((channel, metric, "all")) for metric, _, _ in shown]
            factors = [1.0 / adaptive.pace_rad_s if over_pace else 1.0 for _, over_pace, _ in shown]
            table.add_row(channel, *(number(None if v is None else f * v) for v, f in zip(values, factors, strict=True)))
        out.append(table)
    if any(row.metric == "sup_w1_ter" for row in rows):
        worst = {(row.subject, row.metric, row.phase): row.max for row in rows}
        table = plain_table(
            "What they truly are: greatest weighted responses, identified", "worst trial; below 1: the specification is met"
        )
        table.add_column("channel")
        for weighted in ("|W1 T_er|", "|W2 T_ur|"):
            for phase in _CONTROLLERS:
                table.add_column(f"{weighted}\n{phase}", justify="right")
        for channel in channels:
            cells = [number(worst.get((channel, metric, phase))) for metric in ("sup_w1_ter", "sup_w2_tur") for phase in _CONTROLLERS]
            table.add_row(channel, *cells)
        out.append(table)
    return out
