"""`log.parquet`: readings and commands of the recorded trials, which can be replayed."""

from __future__ import annotations

from pathlib import Path

from sim.outputs.output import Flown, Output


def _write(path: Path, flown: Flown) -> None:
    from sim.replay.flight_log import export

    export(path, flown.recordings, flown.scenario, flown.name)


OUTPUT = Output("log", "log.parquet", _write, hint=lambda path: ("Replay it", f"nacs replay {path}"))
