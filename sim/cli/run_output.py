"""What `nacs run` leaves in a folder and says in the end, of one body or of several agents."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np
import typer
from numpy.typing import NDArray
from rich.text import Text

from sim.bad_input import BadInput
from sim.cli.result_files import ResultFiles
from sim.cli.terminal import FAILED, INTERRUPTED, err, out
from sim.metric import Metric
from sim.metrics.results import write_summary, write_trials
from sim.outputs.register import OUTPUTS
from sim.scenario.files import AnyScenario
from sim.scenario.run import RunSettings
from sim.text.table_style import counted

SUMMARY, TRIALS = "summary.json", "trials.parquet"


@dataclass(frozen=True, eq=False)
class RunResult:
    """A run that is over, wholly or in part.

    Attributes:
      name: of the scenario, as it was asked for.
      scenario: its settings.
      loops: closed loops flown on each trial.
      wanted: how many trials were asked for.
      trials: numbers of those that were finished.
      metrics: of those.
      wall_s: what it took.
      failures: what broke down.
      stopped: whether the user ended it.
      unfinished: why else trials are missing, in words.
    """

    name: str
    scenario: AnyScenario
    loops: int
    wanted: int
    trials: NDArray[np.int64]
    metrics: list[Metric]
    wall_s: float
    failures: list[str]
    stopped: bool = False
    unfinished: str | None = None

    @property
    def simulated_s(self) -> float:
        """Time of flight of all loops and trials together."""
        return self.scenario.run.tick_s * self.scenario.run.ticks * len(self.trials) * self.loops

    @property
    def _first(self) -> str:
        """The first that broke down, and how many more."""
        others = len(self.failures) - 1
        return self.failures[0] + (f"; and {counted(others, 'more trial')}" if others else "")

    def exit_without_result(self) -> NoReturn:
        """Leave the command without a result."""
        why = self._first if self.failures else f"{self.unfinished}; nothing was written"
        asked = "interrupted before a trial was finished: nothing was written; the same command begins anew"
        err.print(asked if self.stopped else f"error: {why}")
        raise typer.Exit(INTERRUPTED if self.stopped else FAILED)

    def write_figures(self, files: ResultFiles, **described: Any) -> None:
        """Write the metrics."""
        seed, count = self.scenario.run.seed, len(self.trials)
        files.write(
            SUMMARY, lambda path: write_summary(path, self.name, seed, count, self.wall_s, self.simulated_s, self.metrics, **described)
        )
        files.write(TRIALS, lambda path: write_trials(path, self.name, seed, self.trials, self.metrics))

    def print_header(self) -> None:
        """Head of the tables."""
        out.print(Text.assemble((self.scenario.title, "bold"), "\n", (self.scenario.source, "dim"), "\n"))

    def print_files(self, files: ResultFiles) -> None:
        """What it took and where everything is; leaves the command if not all trials were finished or not all files written."""
        pace, folder = self.simulated_s / self.wall_s, files.folder
        flown = f"{counted(len(self.trials), 'trial')}, {self.simulated_s:.0f} s of flight in {self.wall_s:.1f} s"
        out.print(f"\n{flown} ({pace:.0f} x real time)")
        for key, output in OUTPUTS.items():
            if output.file in files:
                path = folder / output.file
                for head, what in ((key.capitalize(), str(path)), *((output.hint(path),) if output.hint else ())):
                    out.print(f"{head:10} {what}")
        kept = f"{len(self.trials)} of {self.wanted} trials were finished and kept in {folder}"
        recorded = f"{self._first}; what was recorded until then is in {folder}" if self.failures else None
        unfinished = f"{self.unfinished}; {kept}; the same command flies one of the others by --only-trial" if self.unfinished else None
        if troubles := [trouble for trouble in (recorded, unfinished, files.refusal) if trouble]:
            err.print(f"error: {'; '.join(troubles)}")
            raise typer.Exit(FAILED)
        if self.stopped:
            err.print(f"interrupted: {kept}; the same command with --overwrite flies all")
            raise typer.Exit(INTERRUPTED)


def numbers_of(run: RunSettings, only: int | None) -> NDArray[np.int64]:
    """Trials to be flown: all, or the one that was asked for; raises BadInput if there is no such trial."""
    if only is None:
        return np.arange(run.trials)
    if only >= run.trials:
        raise BadInput(f"--only-trial {only}: the run has trials 0 to {run.trials - 1}")
    return np.array([only])
