"""The kind of scenario in which several spacecraft fly in formation: how it is read, flown, judged and shown."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from sim.faults.formation import Cut, Readings
from sim.loop.formation import Flown, fly
from sim.metrics.formation import evaluate
from sim.metrics.one_body import Metric
from sim.metrics.results import Row
from sim.plant.formation import compile_agents
from sim.randomness import Trials
from sim.scenario.formation import FormationPlantSettings, FormationScenario
from sim.tables.style import number, plain_table

_COLUMNS = (  # metric, heading, factor
    ("skae", "SKAE", 1.0),
    ("fkae", "FKAE", 1.0),
    ("formation_angle_deg", "apart\ndeg", 1.0),
    ("rms_velocity_error", "rate error\n1e-3/s", 1e3),
    ("peak_torque", "torque\nN m", 1.0),
)


@dataclass(frozen=True)
class FormationFamily:
    """Scenarios of plants of type formation or formation-nacs."""

    @property
    def settings(self) -> type[FormationScenario]:
        """Model of the files."""
        return FormationScenario

    def simulate(
        self, scenario: FormationScenario, trials: Trials, recorded: Trials, on_tick: Callable[[int], None] | None
    ) -> tuple[list[Metric], dict[str, Flown]]:
        """Fly all loops for the given trials; metrics, and by loop what is kept of them.

        Raises:
          SimulationFailed: with trial, time and cause.
        """
        assembly = compile_agents(scenario.plant)
        metrics: list[Metric] = []
        flown: dict[str, Flown] = {}
        for name in scenario.loops:
            flown[name] = fly(scenario, name, assembly, trials, recorded, on_tick)
            metrics += evaluate(flown[name], scenario)
        return metrics, flown

    def tables(self, rows: list[Row], scenario: FormationScenario, trials: int) -> list[Table]:
        """Errors of every loop in every phase, and when each formation settles."""
        found = {(row.subject, row.metric, row.phase): row for row in rows}
        subjects = list(dict.fromkeys(row.subject for row in rows))
        caption = f"means over {trials} trial{'s' if trials != 1 else ''}; rates are those of the modified Rodrigues parameters"
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

    def write_report(self, path: Path, name: str, scenario: FormationScenario, flown: dict[str, Flown]) -> None:
        """Draw `report.png`."""
        from sim.report.formation import write_formation_report

        write_formation_report(path, name, scenario, flown)

    def write_recording(
        self, path: Path, name: str, scenario: FormationScenario, flown: dict[str, Flown], configuration: dict[str, Any]
    ) -> None:
        """Write `recording.rrd`."""
        from sim.rerun.formation import write_formation

        write_formation(path, name, scenario, flown, configuration)

    def warnings(self, scenario: FormationScenario) -> list[str]:
        """What may be meant but deserves a word."""
        said = []
        if isinstance(scenario.plant, FormationPlantSettings) and scenario.plant.inertia_kg_m2 == "printed":
            said.append("plant.inertia_kg_m2: no rigid body has the printed tensors; they are flown all the same")
        if any(loop.law.acceleration_sign > 0 for loop in scenario.loops.values()):
            said.append("loops: with acceleration_sign = 1 the estimates of the leader's acceleration run away")
        if any(isinstance(fault, Readings) and np.abs(fault.bias) > 0 for fault in scenario.faults):
            said.append("faults: a bias that all readings share is followed by every filter, since nothing tells it from an attitude")
        for fault in scenario.faults:
            if isinstance(fault, Cut) and len({j for i, j in fault.links if i == 0}) >= len(scenario.graph.leader):
                said.append("faults: nobody sees the leader while all those links are cut")
        return said


FAMILY = FormationFamily()
