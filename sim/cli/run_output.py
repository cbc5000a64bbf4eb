"""What `nacs run` leaves in a folder and says in the end, of one body or of several agents."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import typer
from numpy.typing import NDArray
from rich.text import Text

from sim.bad_input import BadInput
from sim.cli.terminal import FAILED, INTERRUPTED, err, out
from sim.metric import Metric
from sim.metrics.results import write_summary, write_trials
from sim.outputs.register import OUTPUTS
from sim.scenario.files import AnyScenario
from sim.scenario.run import RunSettings
from sim.table_style import counted

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
    """

    name: str
    scenario: AnyScenario
    loops: int
    wanted: int
    trials: NDArray[np.int64]
    metrics: list[Metric]
    wall_s: float
    failures: list[str]
    stopped: bool

    @property
    def simulated_s(self) -> float:
        """Time of flight of all loops and trials together."""
        return self.scenario.run.tick_s * self.scenario.run.ticks * len(self.trials) * self.loops

    @property
    def _first(self) -> str:
        """The first that broke down, and how many more."""
        others = len(self.failures) - 1
        return self.failures[0] + (f"; and {others} more trial{'s' if others > 1 else ''}" if others else "")

    def exit_without_result(self) -> NoReturn:
        """Leave the command without a result."""
        err.print("interrupted before a trial was finished; nothing was written" if self.stopped else f"error: {self._first}")
        raise typer.Exit(INTERRUPTED if self.stopped else FAILED)

    def write_figures(self, folder: Path, overwrite: bool, **described: Any) -> None:
        """Make the folder, clear it of an older run if that was asked for, and write the metrics."""
        if overwrite and folder.is_dir():
            for old in (*(output.file for output in OUTPUTS.values()), SUMMARY, TRIALS):
                (folder / old).unlink(missing_ok=True)
        folder.mkdir(parents=True, exist_ok=True)
        seed = self.scenario.run.seed
        write_summary(folder / SUMMARY, self.name, seed, len(self.trials), self.wall_s, self.simulated_s, self.metrics, **described)
        write_trials(folder / TRIALS, self.name, seed, self.trials, self.metrics)

    def print_header(self) -> None:
        """Head of the tables."""
        out.print(Text.assemble((self.scenario.title, "bold"), "\n", (self.scenario.source, "dim"), "\n"))

    def print_files(self, folder: Path) -> None:
        """What it took and where everything is; leaves the command if not all trials were finished."""
        pace = self.simulated_s / self.wall_s
        out.print(
            f"\n{counted(len(self.trials), 'trial')}, {self.simulated_s:.0f} s of flight in {self.wall_s:.1f} s ({pace:.0f} x real time)"
        )
        for key, output in OUTPUTS.items():
            if (path := folder / output.file).is_file():
                for head, what in ((key.capitalize(), str(path)), *((output.hint(path),) if output.hint else ())):
                    out.print(f"{head:10} {what}")
        if self.failures:
            err.print(f"error: {self._first}; what was recorded until then is in {folder}")
            raise typer.Exit(FAILED)
        if self.stopped:
            err.print(f"interrupted: {len(self.trials)} of {self.wanted} trials were finished and kept in {folder}")
            raise typer.Exit(INTERRUPTED)


def numbers_of(run: RunSettings, only: int | None) -> NDArray[np.int64]:
    """Trials to be flown: all, or the one that was asked for; raises BadInput if there is no such trial."""
    if only is None:
        return np.arange(run.trials)
    if only >= run.trials:
        raise BadInput(f"--only-trial {only}: the run has trials 0 to {run.trials - 1}")
    return np.array([only])
