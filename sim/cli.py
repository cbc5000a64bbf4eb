"""The command `nacs`."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from sim import scenario as scenarios
from sim import tables
from sim.build import build
from sim.metrics import Metric
from sim.recording import Recorder, Recording
from sim.results import rows, write_summary, write_trials
from sim.scenario import BadInput, Scenario
from sim.shards import Shard, cut, join, simulate_all

BAD_INPUT, FAILED, INTERRUPTED = 2, 3, 130

app = typer.Typer(
    help="Digital twin of the NACS, an air-bearing CubeSat testbed with four reaction wheels.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
out, err = Console(highlight=False), Console(stderr=True, highlight=False, soft_wrap=True)

Name = Annotated[str, typer.Argument(metavar="SCENARIO", help="family/name as `nacs list` shows it, or a path to a TOML file")]
Trials = Annotated[int | None, typer.Option(help="number of trials; default: the scenario's")]
Seed = Annotated[int | None, typer.Option(help="root seed; default: the scenario's")]
Overrides = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="take this instead of what the file says (may be repeated)")
]


@app.command("list")
def list_scenarios() -> None:
    """Show the scenarios that come with the twin."""
    table = Table(box=None, pad_edge=False)
    table.add_column("name", no_wrap=True, style="bold")
    table.add_column("what it shows, and where it comes from")
    for name in scenarios.names():
        found = scenarios.load(name)
        table.add_row(name, f"{found.title} [dim]({found.source})[/]")
    out.print(table)


@app.command("parameters")
def show_parameters(
    scenario: Name = "nacs/fault-free",
    overrides: Overrides = None,
) -> None:
    """Show every parameter of a scenario's plant: value, unit and where it comes from."""
    loaded = _load(scenario, None, None, overrides)
    table = Table(box=None, pad_edge=False)
    table.add_column("parameter", no_wrap=True, style="bold")
    table.add_column("value", overflow="fold")
    table.add_column("what it is, and where its value comes from")
    for name, value, unit, meaning, provenance in loaded.plant.table():
        table.add_row(name, f"{value} {unit}", f"{meaning} [dim]({provenance})[/]")
    out.print(table)


@app.command("run")
def run_scenario(
    name: Name,
    trials: Trials = None,
    seed: Seed = None,
    folder: Annotated[Path | None, typer.Option("--out", help="folder for the results; default: a new one under runs/")] = None,
    overrides: Overrides = None,
    workers: Annotated[int, typer.Option(min=1, help="processes that share the trials; no number depends on it")] = 1,
    only_trial: Annotated[int | None, typer.Option(min=0, help="simulate this one trial of the run and record it")] = None,
    record_trials: Annotated[int, typer.Option(min=0, help="how many trials are recorded for Rerun")] = 1,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace what is in --out")] = False,
    live: Annotated[
        bool, typer.Option("--live", help="also stream the first trial to a Rerun viewer that is open on this machine")
    ] = False,
) -> None:
    """Simulate a scenario, print its table and write recording, report and metrics."""
    loaded = _load(name, trials, seed, overrides)
    numbers = np.arange(loaded.run.trials) if only_trial is None else np.array([only_trial])
    if only_trial is not None and only_trial >= loaded.run.trials:
        raise BadInput(f"--only-trial {only_trial}: the run has trials 0 to {loaded.run.trials - 1}")
    if live and workers > 1:
        raise BadInput("--live needs --workers 1: the first trial is streamed while it is simulated")
    target = _output_folder(folder, name, overwrite)
    stream = _live_stream(loaded, name) if live else None
    started = time.perf_counter()
    shards, stopped = _simulate(loaded, numbers, numbers[:record_trials], workers, stream)
    failure = next((shard for shard in shards if shard.failure), None)
    finished, metrics, recording = join(shards)
    if failure and failure.recording:
        recording = failure.recording
    if not len(finished) and recording is None:
        err.print(
            "interrupted before a trial was finished; nothing was written" if stopped else f"error: {failure.failure if failure else ''}"
        )
        raise typer.Exit(INTERRUPTED if stopped else FAILED)
    wall = time.perf_counter() - started
    _write(target, name, loaded, finished, metrics, recording, wall, overwrite)
    _show(loaded, len(finished), metrics, target, recording, wall)
    if failure:
        err.print(f"error: {failure.failure}; what was recorded until then is in {target}")
        raise typer.Exit(FAILED)
    if stopped:
        err.print(f"interrupted: {len(finished)} of {len(numbers)} trials were finished and kept in {target}")
        raise typer.Exit(INTERRUPTED)


@app.command("view")
def view_scenario(name: Name, seed: Seed = None, overrides: Overrides = None) -> None:
    """Fly the first trial of a scenario in MuJoCo's own viewer, in real time."""
    loaded = _load(name, 1, seed, overrides)
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise BadInput("nacs view needs a display and found none; `nacs run` writes a recording that can be opened elsewhere")
    from sim.viewer import fly  # the viewer opens windows when imported

    fly(loaded)


def _load(name: str, trials: int | None, seed: int | None, overrides: list[str] | None) -> Scenario:
    changes: dict[str, Any] = dict(scenarios.parse_override(text) for text in overrides or [])
    if trials is not None:
        changes["run.trials"] = trials
    if seed is not None:
        changes["run.seed"] = seed
    return scenarios.load(name, changes)


def _output_folder(folder: Path | None, name: str, overwrite: bool) -> Path:
    """Where results go; made only when there is something to write."""
    if folder is None:
        stem = Path("runs") / Path(name).with_suffix("")
        if Path(name).is_absolute() or ".." in Path(name).parts:
            stem = Path("runs") / Path(name).stem
        folder, number = stem, 1
        while folder.exists():
            number += 1
            folder = stem.with_name(f"{stem.name}-{number}")
    elif folder.is_file():
        raise BadInput(f"--out {folder}: is a file; name a folder")
    elif folder.is_dir() and any(folder.iterdir()) and not overwrite:
        raise BadInput(f"--out {folder}: is not empty; name another folder or add --overwrite")
    nearest = folder
    while not nearest.exists():
        nearest = nearest.parent
    try:
        tempfile.TemporaryFile(dir=nearest).close()
    except OSError as refused:
        raise BadInput(f"--out {folder}: cannot be written ({refused.strerror}: {nearest}); name a folder that can") from None
    return folder


def _live_stream(loaded: Scenario, name: str) -> Callable[[int, Recorder], None]:
    from sim.rerun_live import LiveStream  # Rerun takes half a second to import

    try:
        return LiveStream(name, build(loaded, np.zeros(1, dtype=np.int64)), loaded.model_dump(mode="json", exclude_none=True)).on_tick
    except ConnectionError as refused:
        raise BadInput(f"--live: {refused}") from None


def _simulate(
    loaded: Scenario, numbers: Any, recorded: Any, workers: int, stream: Callable[[int, Recorder], None] | None
) -> tuple[list[Shard], bool]:
    """Shards that finished, and whether the user stopped the rest; a failed one ends the run."""
    shards: list[Shard] = []
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("trial-s"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=err, transient=True) as bar:
        seconds = loaded.run.tick_s
        task = bar.add_task(f"{len(numbers)} trials", total=round(seconds * loaded.run.ticks * len(numbers)))
        try:
            for shard in simulate_all(
                loaded, cut(numbers, workers), recorded, workers, lambda ticks: bar.advance(task, seconds * ticks), stream
            ):
                shards.append(shard)
                if shard.failure:
                    break
        except KeyboardInterrupt:
            return shards, True
    return shards, False


def _write(
    target: Path,
    name: str,
    loaded: Scenario,
    finished: Any,
    metrics: list[Metric],
    recording: Recording | None,
    wall: float,
    overwrite: bool,
) -> None:
    from models.nacs import compile_nacs
    from sim.report import write_report  # Matplotlib and Rerun take a second to import
    from sim.rerun_sink import write_recording

    if overwrite and target.is_dir():
        for old in ("recording.rrd", "trials.parquet", "summary.json", "report.png"):
            (target / old).unlink(missing_ok=True)
    target.mkdir(parents=True, exist_ok=True)
    seed, simulated = loaded.run.seed, loaded.run.tick_s * loaded.run.ticks * len(finished)
    write_summary(target / "summary.json", name, seed, len(finished), wall, simulated, metrics)
    write_trials(target / "trials.parquet", name, seed, finished, metrics)
    if recording is not None:
        assembly = compile_nacs(loaded.plant)
        feedback = loaded.control.feedback
        write_report(target / "report.png", name, loaded.title, recording, feedback)
        write_recording(target / "recording.rrd", name, recording, assembly, feedback, loaded.model_dump(mode="json", exclude_none=True))


def _show(loaded: Scenario, finished: int, metrics: list[Metric], target: Path, recording: Recording | None, wall: float) -> None:
    statistics = rows(metrics)
    if statistics:
        out.print(f"[bold]{loaded.title}[/]\n[dim]{loaded.source}[/]\n")
        if loaded.published:
            out.print(tables.residuals(statistics, loaded.published))
        out.print(tables.estimators(statistics, loaded.observers, loaded.published, finished))
        out.print(tables.loop(statistics))
    simulated = loaded.run.tick_s * loaded.run.ticks * finished
    out.print(f"\n{finished} trials, {simulated:.0f} s of flight in {wall:.1f} s ({simulated / wall:.0f} x real time)")
    out.print(f"Report     {target / 'report.png'}")
    if recording is not None:
        viewer = "rerun" if shutil.which("rerun") else str(Path(sys.executable).with_name("rerun"))
        out.print(f"Recording  {target / 'recording.rrd'}\nOpen it    {_relative(viewer)} {target / 'recording.rrd'}")


def _relative(path: str) -> str:
    """A path inside this folder without the folder."""
    return os.path.relpath(path) if Path(path).is_absolute() and Path(path).is_relative_to(Path.cwd()) else path


def main() -> None:
    """Run the command; what the user got wrong is one line and exit code 2."""
    try:
        app()
    except BadInput as wrong:
        err.print(f"error: {wrong}", style="red", markup=False)
        sys.exit(BAD_INPUT)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
