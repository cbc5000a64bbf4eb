"""`report.png` of a run, by kind of scenario."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from sim.loop.recording import Recording
from sim.report import antenna, loops, page
from sim.report.agents import consensus, formation
from sim.scenario.one_body import Scenario
from sim.series.antenna import is_antenna

Recordings = dict[str, Recording]


def write_report(path: Path, name: str, scenario: Any, recordings: Recordings, law: str | None = None) -> None:
    """Draw the first recorded trial of every loop.

    Args:
      path: of the picture.
      name: of the scenario.
      scenario: that was flown.
      recordings: by loop.
      law: name of the user's own control law.
    """
    REPORTS[scenario.family](path, name, scenario, recordings, law)


def _body(path: Path, name: str, scenario: Scenario, recordings: Recordings, law: str | None) -> None:
    if is_antenna(scenario, recordings):
        antenna.write_report(path, name, scenario, recordings)
    elif "loop" in recordings:
        closed_by = scenario.law.feedback + (f" by {law}" if law else "")
        page.write_report(path, name, scenario.title, recordings["loop"], closed_by)
    else:
        loops.write_report(path, name, scenario, recordings)


REPORTS: dict[str, Callable[[Path, str, Any, Recordings, str | None], None]] = {
    "body": _body,
    "formation": lambda path, name, scenario, recordings, law: formation.write_formation_report(path, name, scenario, recordings),  # noqa: ARG005
    "consensus": lambda path, name, scenario, recordings, law: consensus.write_report(path, name, scenario, recordings),  # noqa: ARG005
}
