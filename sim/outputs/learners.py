"""`learners.png`: dynamics, commands, motion and errors of every loop of agents that learn, over time."""

from __future__ import annotations

from pathlib import Path

from sim.outputs.output import Flown, Output, not_of


def _write(path: Path, flown: Flown) -> None:
    from sim.report.agents.learners import write_learners

    write_learners(path, flown.name, flown.scenario, flown.recordings)


OUTPUT = Output("learners", "learners.png", _write, missing=not_of("consensus"))
