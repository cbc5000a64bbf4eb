"""`recording.rrd` of a run, by kind of scenario."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from sim.loop.recording import Recording
from sim.plant.kinds import compile_plant
from sim.rerun import consensus, formation, loops, sink
from sim.scenario.one_body import Scenario

Recordings = dict[str, Recording]
Configuration = dict[str, Any]


def write_recording(path: Path, name: str, scenario: Any, recordings: Recordings, configuration: Configuration) -> None:
    """Write the recorded trials of every loop.

    Args:
      path: of the file.
      name: of the scenario.
      scenario: that was flown.
      recordings: by loop.
      configuration: what the recording says of how it was made.
    """
    WRITERS[scenario.family](path, name, scenario, recordings, configuration)


def _body(path: Path, name: str, scenario: Scenario, recordings: Recordings, configuration: Configuration) -> None:
    if "loop" in recordings:
        assembly = compile_plant(scenario.plant)
        sink.write_recording(path, name, recordings["loop"], assembly, scenario.law.feedback, configuration)
    else:
        loops.write_loops(path, name, scenario, recordings, configuration)


WRITERS: dict[str, Callable[[Path, str, Any, Recordings, Configuration], None]] = {
    "body": _body,
    "formation": formation.write_formation,
    "consensus": consensus.write_recording,
}
