"""Consensus tracking as a kind of scenario: what the command needs to check, fly, judge and show it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from sim.loop.consensus import Flown, fly
from sim.metrics.consensus import WINDOWS_S, evaluate
from sim.metrics.one_body import Metric
from sim.metrics.results import Row
from sim.scenario.consensus import ConsensusScenario, Marginalised
from sim.tables.style import number, plain_table

Integers = NDArray[np.int64]

CROWD = 400  # trial particles of a marginalised filter that take about a minute for 20 s


@dataclass(frozen=True)
class ConsensusFamily:
    """Agents that follow a leader; see the functions of the same names in other families."""

    settings: type[ConsensusScenario] = ConsensusScenario

    def simulate(
        self, scenario: ConsensusScenario, trials: Integers, recorded: Integers, on_tick: Callable[[int], None] | None = None
    ) -> tuple[list[Metric], dict[str, Flown]]:
        """Fly all loops of the given trials, one loop after the other, and keep those trials that are recorded.

        Args:
          scenario: checked.
          trials: their numbers, (n,).
          recorded: numbers of those to be kept, (m,).
          on_tick: called after every tick of every loop with how many ticks are done, of loops times ticks.

        Raises:
          SimulationFailed: with trial, time and cause.
        """
        metrics: list[Metric] = []
        kept: dict[str, Flown] = {}
        ticks = scenario.run.ticks
        for number_of_loop, (name, loop) in enumerate(scenario.loops.items()):

            def tell(tick: int, done: int = number_of_loop * ticks) -> None:
                if on_tick:
                    on_tick(done + tick)

            flown = fly(name, loop, scenario, trials, tell)
            metrics += evaluate(name, flown)
            kept[name] = flown.of(np.flatnonzero(np.isin(trials, recorded)))
        return metrics, kept

    def tables(self, rows: list[Row], scenario: ConsensusScenario, trials: int) -> list[Table]:
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
                told = (
                    (f"from {last.max:.2f} s" if last and last.n == trials else "not all")
                    if metric == "aem"
                    else f"{last.n if last else 0}"
                )
                table.add_row(name, *(number(1e3 * row.mean) if row else number(None) for row in cells), told)
            out.append(table)
        return out

    def write_report(self, path: Path, name: str, scenario: ConsensusScenario, flown: dict[str, Flown]) -> None:
        """`report.png` of the first recorded trial."""
        from sim.report.consensus import write_report  # Matplotlib takes a second to import

        write_report(path, name, scenario, flown)

    def write_recording(
        self, path: Path, name: str, scenario: ConsensusScenario, flown: dict[str, Flown], configuration: dict[str, Any]
    ) -> None:
        """`recording.rrd` of all recorded trials."""
        from sim.rerun.consensus import write_recording

        write_recording(path, name, scenario, flown, configuration)

    def warnings(self, scenario: ConsensusScenario) -> list[str]:
        """What a person should know before flying it."""
        slow = [name for name, loop in scenario.loops.items() if isinstance(loop, Marginalised)]
        work = sum(loop.particles for loop in scenario.loops.values() if isinstance(loop, Marginalised)) * scenario.run.trials
        if work * scenario.run.ticks > CROWD * 2000:
            return [f"{', '.join(slow)}: {work} trials x particles of six agents take minutes; fewer --trials are quicker"]
        return []


FAMILY = ConsensusFamily()
