"""A log that cannot be true is refused in one line, or taken as it is if the user says so."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from sim.bad_input import BadInput
from sim.cli.terminal import err
from sim.scenario.files import AnyScenario

if TYPE_CHECKING:
    from sim.replay.flight_log import FlightLog  # Arrow takes its time to import


def check_plausible(log: Path, blocks: list[FlightLog], scenario: AnyScenario, trust: bool) -> None:
    """One line of what does not fit in a log; raises BadInput unless it is trusted."""
    from sim.replay.plausibility import complaints

    where: dict[str, list[int]] = {}
    for trial, sentence in (found for block in blocks for found in complaints(block, scenario)):
        where.setdefault(sentence, []).append(trial)
    if not where:
        return
    every = len({int(trial) for block in blocks for trial in block.trials})
    parts = [sentence + ("" if len(set(trials)) == every else f" in trial {trials[0]}") for sentence, trials in where.items()]
    line = f"{log}: {'; '.join(parts)}"
    if not trust:
        raise BadInput(f"{line}; put it right (docs/replay.md has the units), or add --trust to take the log as it is")
    err.print(f"warning: {line}; taken as it is", style="yellow")
