"""Runs: a scenario is flown, and what was found of it is handed over as tables, signals and pictures."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from nacs.arguments import check_workers, path, whole
from nacs.errors import extra, in_one_line
from nacs.nacs_error import NacsError
from nacs.scenarios import Source, named, user_code_of
from sim.campaign import cost
from sim.campaign.blocks import cut, simulate_all
from sim.cli.result_files import ResultFiles
from sim.cli.run_output import RunResult
from sim.cli.terminal import output_folder
from sim.loop.lost_trials import LostTrial
from sim.loop.recording import Recording
from sim.metric import Metric
from sim.metrics.results import rows, trials_table
from sim.metrics.trial_block import join
from sim.outputs.output import Flown
from sim.outputs.register import OUTPUTS
from sim.scenario.files import AnyScenario
from sim.scenario.named_sections import names_taken
from sim.scenario.surroundings import surroundings
from sim.tables.register import tables_of
from sim.text.progress import Work
from sim.user_code.user_code import UserCode

if TYPE_CHECKING:
    import pandas
    import pyarrow
    import xarray
    from matplotlib.figure import Figure

RECORDED = 64  # trials that are recorded unless asked for otherwise


@dataclass(frozen=True, eq=False)
class Run:
    """A run that is over.

    Attributes:
      name: of the scenario.
      scenario: its checked settings.
      trials: numbers of the trials that were finished, (trials,).
      recordings: of the recorded trials, by loop.
      lost: trials that broke down, with time and cause.
      wall_s: what it took.
      user_code: filters and law of your own.
    """

    name: str
    scenario: AnyScenario
    trials: NDArray[np.int64]
    recordings: dict[str, Recording]
    lost: tuple[LostTrial, ...]
    wall_s: float
    user_code: UserCode
    _metrics: tuple[Metric, ...]

    @property
    def loops(self) -> tuple[str, ...]:
        """Names of the closed loops; a single one of one body is called `loop`."""
        return self.scenario.loop_names

    @property
    def metrics(self) -> pandas.DataFrame:
        """Every metric of every trial: a row each, with subject, metric, phase, unit and value; needs the extra `data`."""
        with in_one_line(), extra("pandas", "data"):
            frame: pandas.DataFrame = self.arrow.to_pandas()
            return frame

    @property
    def arrow(self) -> pyarrow.Table:
        """The same as an Arrow table: the content of `trials.parquet`."""
        return trials_table(self.name, self.scenario.run.seed, self.trials, list(self._metrics))

    @property
    def signals(self) -> xarray.Dataset:
        """What was recorded of the first loop, with axes trial, [agent,] time and components; needs the extra `data`."""
        return self.signals_of(self.loops[0])

    def signals_of(self, loop: str) -> xarray.Dataset:
        """What was recorded of a loop; raises NacsError if there is no such loop."""
        from sim.series.signals.dataset import dataset
        from sim.series.signals.of_recordings import signals_of

        with in_one_line():
            if not isinstance(loop, str) or loop not in self.loops:
                raise NacsError(f"loop {loop!r}: no such loop; there are {', '.join(self.loops)}")
            self._check_recorded()
            found: xarray.Dataset = dataset(signals_of(self.scenario, {loop: self.recordings[loop]}).loops[loop])
            return found

    def tables(self) -> list[Any]:
        """What the command prints of it: tables of `rich`, and lines of text."""
        statistics = rows(list(self._metrics))
        return tables_of(statistics, self.scenario, len(self.trials), self.user_code.names, self.user_code.law)

    def report(self) -> Figure:
        """The report of the first recorded trial as a figure of Matplotlib."""
        import matplotlib as mpl

        from sim.report.register import draw_report
        from sim.series.picture_style import STYLE

        self._check_recorded()
        with in_one_line(), mpl.rc_context(STYLE):
            return draw_report(self.name, self.scenario, self.recordings, self.user_code.law)

    def show(self) -> None:
        """Open the recording in the Rerun viewer."""
        self._check_recorded()
        recording = Path(tempfile.mkdtemp(prefix="nacs-")) / "recording.rrd"
        with in_one_line():
            OUTPUTS["recording"].write(recording, self._flown)
            subprocess.Popen([Path(sys.executable).with_name("rerun"), recording], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def save(self, folder: str | os.PathLike[str], *, overwrite: bool = False) -> Path:
        """Write what `nacs run` would leave in a folder.

        Args:
          folder: made if there is none.
          overwrite: replace what is in there.

        Raises:
          NacsError: the folder is not empty, or cannot be written.
        """
        with in_one_line():
            target = output_folder(path("folder", folder), self.name, overwrite, "name another folder, or say overwrite=True")
            files = ResultFiles(target)
            self._result.write_figures(files, **self.user_code.described)
            for output in OUTPUTS.values():
                if output.unasked and self.recordings:
                    files.write(output.file, lambda path, output=output: output.write(path, self._flown))  # type: ignore[misc]
            if files.refusal:
                raise NacsError(files.refusal, 3)
            if overwrite:
                files.remove_others(output.file for output in OUTPUTS.values())
            return target

    def _check_recorded(self) -> None:
        if not self.recordings:
            raise NacsError("no trial was recorded: run with record_trials=1 or more")

    @property
    def _flown(self) -> Flown:
        said = self.scenario.model_dump(mode="json", exclude_none=True) | self.user_code.described  # type: ignore[attr-defined]
        return Flown(self.name, self.scenario, self.recordings, self.user_code.law, said)

    @property
    def _result(self) -> RunResult:
        reasons, metrics = [str(one) for one in self.lost], list(self._metrics)
        return RunResult(self.name, self.scenario, len(self.loops), len(self.trials), self.trials, metrics, max(self.wall_s, 1e-9), reasons)

    def __str__(self) -> str:
        return _printed(self, width=100).export_text()

    def __repr__(self) -> str:
        return f"<Run of {self.name}: {len(self.trials)} trials, {len(self.lost)} lost>"

    def _repr_html_(self) -> str:
        return _printed(self, width=110).export_html(inline_styles=True, code_format="<pre style='line-height:1.2'>{code}</pre>")


def _printed(run: Run, width: int) -> Any:
    import io

    from rich.console import Console
    from rich.text import Text

    console = Console(record=True, file=io.StringIO(), width=width, highlight=False, markup=False)
    console.print(Text.assemble((run.scenario.title, "bold"), "\n", (run.scenario.source, "dim"), "\n"))
    for table in run.tables():
        console.print(table)
    return console


def run(
    scenario: Source = "nacs/fault-free",
    *,
    trials: int | None = None,
    seed: int | None = None,
    set: Mapping[str, Any] | None = None,  # as the command calls it
    observers: Sequence[Any] = (),
    controller: Any = None,
    workers: int = 1,
    record_trials: int = RECORDED,
    progress: bool = False,
) -> Run:
    """Simulate a scenario; nothing is written.

    >>> flown = nacs.run("nacs/fault-free", trials=2, set={"run.ticks": 50})
    >>> flown.signals.truth_rate.dims
    ('trial', 'time', 'axis')

    Args:
      scenario: name, path of a TOML file, the content of one as a dictionary, or settings that were loaded before.
      trials: number of trials; default: the scenario's.
      seed: root seed; default: the scenario's.
      set: dotted keys to values, taken instead of what the scenario says.
      observers: filters of your own beside the scenario's: classes, functions that make them, objects, or FILE.py:CLASS.
      controller: a control law of your own in place of the scenario's, likewise.
      workers: processes that share the trials; no number depends on it.
      record_trials: how many trials keep their signals; metrics are of all.
      progress: show on stderr how far it is.

    Raises:
      NacsError: bad input, or no trial could be finished.
    """
    user_code = user_code_of(observers, controller)
    with in_one_line():
        name, loaded = named(scenario, set, trials, seed, user_code)
        workers, record_trials = whole("workers", workers, 1), whole("record_trials", record_trials)
        check_workers(workers, (*observers, *(() if controller is None else (controller,))))
        cost.check(loaded, loaded.run.trials, workers)
        user_code.check(surroundings(loaded), names_taken(loaded))
        numbers, started = np.arange(loaded.run.trials), time.perf_counter()
        with Work(_console(progress), "trial-s") as work:
            seconds = loaded.run.tick_s
            everything = seconds * loaded.run.ticks * len(numbers)
            blocks = list(
                simulate_all(
                    loaded,
                    cut(numbers, workers),
                    numbers[:record_trials],
                    workers,
                    lambda ticks: work.advance(name, seconds * ticks, everything),
                    user_code,
                )
            )
        finished, metrics, recordings = join(blocks)
        broken = tuple(sorted(one for block in blocks for one in block.lost))
        if not len(finished):
            raise NacsError(str(broken[0]) if broken else next(b.failure for b in blocks if b.failure) or "nothing was flown", 3)
        return Run(name, loaded, finished, recordings, broken, time.perf_counter() - started, user_code, tuple(metrics))


def _console(shown: bool) -> Any:
    import io

    from rich.console import Console

    return Console(stderr=True) if shown else Console(file=io.StringIO())
