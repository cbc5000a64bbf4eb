"""`report.png`: the first recorded trial of every loop as a picture."""

from __future__ import annotations

from pathlib import Path

from sim.outputs.output import Flown, Output


def _write(path: Path, flown: Flown) -> None:
    from sim.report.register import write_report

    write_report(path, flown.name, flown.scenario, flown.recordings, flown.law)


OUTPUT = Output("report", "report.png", _write, unasked=True)
