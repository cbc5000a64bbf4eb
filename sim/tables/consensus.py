"""Tables of consensus tracking."""

from __future__ import annotations

from rich.table import Table

from sim.metrics.consensus import WINDOWS_S
from sim.metrics.results import Row
from sim.scenario.consensus import ConsensusScenario
from sim.text.table_style import number, plain_table


def consensus(rows: list[Row], scenario: ConsensusScenario, trials: int) -> list[Table]:
    """AEM and the error of the learned dynamics in every window."""
    of = f"mean of {trials} trials" if trials > 1 else "one trial"
    phases = [phase for phase in (f"{a:g}-{b:g}s" for a, b in WINDOWS_S) if any(row.phase == phase for row in rows)] or ["all"]
    found = {(row.subject, row.metric, row.phase): row for row in rows}
    out = []
    for metric, title in (("aem", "Absolute error AEM, 1e-3 m"), ("dynamics_error", "Error of the learned dynamics, RMS, 1e-3 N")):
        table = plain_table(title, of if metric == "aem" else "lost: trials in which an agent flew off")
        table.add_column("loop", no_wrap=True)
        for phase in phases:
            table.add_column(phase, justify="right")
        table.add_column("AEM < 0.1 m" if metric == "aem" else "lost", justify="right")
        for name in scenario.loops:
            cells = [found.get((name, metric, phase)) for phase in phases]
            last = found.get((name, "settled_s", "all")) if metric == "aem" else found.get((name, "lost_s", "all"))
            told = (f"from {last.max:.2f} s" if last and last.n == trials else "not all") if metric == "aem" else f"{last.n if last else 0}"
            table.add_row(name, *(number(1e3 * row.mean) if row else number(None) for row in cells), told)
        out.append(table)
    return out
