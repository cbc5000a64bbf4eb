"""The report of a run, by kind of scenario."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from sim.loop.recording import Recording
from sim.report import antenna, loops, page
from sim.report.agents import consensus, formation
from sim.scenario.one_body import Scenario
from sim.series.antenna import is_antenna
from sim.series.picture_style import STYLE
from sim.series.raster import write_png

Recordings = dict[str, Recording]


def draw_report(name: str, scenario: Any, recordings: Recordings, law: str | None = None) -> Figure:
    """Draw the first recorded trial of every loop.

    Args:
      name: of the scenario.
      scenario: that was flown.
      recordings: by loop.
      law: name of the user's own control law.
    """
    return REPORTS[scenario.family](name, scenario, recordings, law)


def write_report(path: Path, name: str, scenario: Any, recordings: Recordings, law: str | None = None) -> None:
    """Write the same as a picture, a PNG file at `path`."""
    with mpl.rc_context(STYLE):
        write_png(draw_report(name, scenario, recordings, law), path)


def _body(name: str, scenario: Scenario, recordings: Recordings, law: str | None) -> Figure:
    if is_antenna(scenario, recordings):
        return antenna.draw_report(name, scenario, recordings)
    if "loop" in recordings:
        closed_by = scenario.law.feedback + (f" by {law}" if law else "")
        return page.draw_report(name, scenario.title, recordings["loop"], closed_by)
    return loops.draw_report(name, scenario, recordings)


REPORTS: dict[str, Callable[[str, Any, Recordings, str | None], Figure]] = {
    "body": _body,
    "formation": lambda name, scenario, recordings, law: formation.draw_report(name, scenario, recordings),  # noqa: ARG005
    "consensus": lambda name, scenario, recordings, law: consensus.draw_report(name, scenario, recordings),  # noqa: ARG005
}
