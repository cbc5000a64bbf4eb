"""`detection.png`: the reference and what each detector of faults saw and declared, of the first recorded trial."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from sim.outputs.output import Flown, Output


def _write(path: Path, flown: Flown) -> None:
    from sim.report.detection import write_report

    write_report(path, flown.name, flown.scenario.title, flown.recordings)


def _missing(scenario: Any) -> str:
    """Why there would be nothing to see: of agents, and where no filter declares faults."""
    if scenario.family != "body":
        return "is of the detectors of one body, and this scenario is of several agents"
    if not any(settings.declares for settings in scenario.observers.values()):
        return "no observer of this scenario declares faults (types nis-switched and imm do)"
    return ""


OUTPUT = Output("detection", "detection.png", _write, missing=_missing)
