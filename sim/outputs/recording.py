"""`recording.rrd`: the recorded trials of every loop for the Rerun viewer."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

from sim.outputs.output import Flown, Output


def _write(path: Path, flown: Flown) -> None:
    from sim.rerun.register import write_recording

    write_recording(path, flown.name, flown.scenario, flown.recordings, flown.configuration)


def how_to_open(recording: Path) -> str:
    """The command that opens a recording in Rerun, as a person would type it here."""
    viewer = "rerun" if shutil.which("rerun") else str(Path(sys.executable).with_name("rerun"))
    inside = Path(viewer).is_absolute() and Path(viewer).is_relative_to(Path.cwd())
    return f"{os.path.relpath(viewer) if inside else viewer} {recording}"


OUTPUT = Output("recording", "recording.rrd", _write, unasked=True, hint=lambda path: ("Open it", how_to_open(path)))
