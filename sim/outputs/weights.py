"""`weights.png`: the weights of all agents in every loop that learns, over time."""

from __future__ import annotations

from pathlib import Path

from sim.outputs.output import Flown, Output, not_of


def _write(path: Path, flown: Flown) -> None:
    from sim.report.agents.learners import write_weights

    write_weights(path, flown.name, flown.scenario, flown.recordings)


OUTPUT = Output("weights", "weights.png", _write, missing=not_of("consensus"))
