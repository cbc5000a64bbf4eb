"""`signals.parquet`: every quantity of the recorded trials, a column each, for whatever reads tables."""

from __future__ import annotations

from pathlib import Path

from sim.outputs.output import Flown, Output


def _write(path: Path, flown: Flown) -> None:
    from sim.series.signals import long_table
    from sim.series.signals.of_recordings import signals_of

    long_table.write(path, signals_of(flown.scenario, flown.recordings), flown.name)


OUTPUT = Output("signals", "signals.parquet", _write, unasked=True)
