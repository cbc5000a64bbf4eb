"""`nacs run`: simulate a scenario, print its table, and write recording, report and metrics."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from sim.bad_input import BadInput
from sim.campaign import cost
from sim.campaign.blocks import cut, simulate_all
from sim.campaign.draws import own
from sim.campaign.file import is_campaign, located
from sim.campaign.file import load as load_campaign
from sim.campaign.settings import Campaign
from sim.campaign.worker_processes import WorkersLost
from sim.cli.result_files import ResultFiles, interrupted_as
from sim.cli.run_output import RunResult, numbers_of
from sim.cli.terminal import Name, Overrides, Seed, Trials, err, load, out, output_folder
from sim.faults.parts import FAMILIES
from sim.loop.build import build
from sim.loop.recorder import Recorder
from sim.metrics.results import rows
from sim.metrics.trial_block import TrialBlock, join
from sim.outputs.output import Flown
from sim.outputs.register import OUTPUTS
from sim.replay.log_columns import columns_of
from sim.scenario.named_sections import names_taken
from sim.scenario.surroundings import surroundings
from sim.signals import SIGNALS
from sim.tables.register import tables_of
from sim.text.table_style import counted
from sim.user_code.user_code import UserCode

if TYPE_CHECKING:
    from sim.rerun.live import LiveStream
    from sim.rerun.live_curves import LiveCurves


_UNASKED = ", ".join(f"{key} ({output.file})" for key, output in OUTPUTS.items() if output.unasked)
_ASKED = ", ".join(f"{key} ({output.file})" for key, output in OUTPUTS.items() if not output.unasked)


def run(
    name: Name,
    trials: Trials = None,
    seed: Seed = None,
    folder: Annotated[Path | None, typer.Option("--out", help="folder for the results; default: a new one under runs/")] = None,
    overrides: Overrides = None,
    workers: Annotated[int, typer.Option(min=1, help="processes that share the trials; no number depends on it")] = 1,
    only_trial: Annotated[int | None, typer.Option(min=0, help="simulate this one trial of the run and record it")] = None,
    point: Annotated[int | None, typer.Option(min=0, help="of a campaign's grid, if SCENARIO is a campaign; default: 0")] = None,
    record_trials: Annotated[int, typer.Option(min=0, help="how many trials are recorded for Rerun")] = 1,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace what is in --out")] = False,
    observers: Annotated[
        list[str] | None,
        typer.Option(
            "--observer", metavar="FILE.py:CLASS", help="a filter of your own beside the scenario's; run as code (may be repeated)"
        ),
    ] = None,
    controller: Annotated[
        str | None, typer.Option(metavar="FILE.py:CLASS", help="a control law of your own in place of the scenario's; run as code")
    ] = None,
    export_log: Annotated[
        bool, typer.Option("--export-log", help="also write log.parquet: readings and commands of the recorded trials, for `nacs replay`")
    ] = False,
    also: Annotated[list[str] | None, typer.Option(metavar="OUTPUT", help=f"also write this: {_ASKED} (may be repeated)")] = None,
    without: Annotated[list[str] | None, typer.Option(metavar="OUTPUT", help=f"do not write this: {_UNASKED} (may be repeated)")] = None,
    live: Annotated[
        bool, typer.Option("--live", help="also stream the first trial to a Rerun viewer that is open on this machine")
    ] = False,
) -> None:
    """Simulate a scenario, print its table and write recording, report and metrics."""
    user_code = UserCode(tuple(observers or ()), controller)
    source = load_campaign(located(name)) if is_campaign(name) else None
    if source and (only_trial is None or trials is not None or seed is not None or overrides):
        raise BadInput(f"{name} is a campaign: fly one of its trials by --only-trial K (and --point P), or all by `nacs campaign {name}`")
    if point is not None and not source:
        raise BadInput(f"--point {point}: {name} is no campaign and has no grid")
    point = point or 0
    if source and not 0 <= point < len(source.points):
        raise BadInput(f"--point {point}: the grid of {name} has points 0 to {len(source.points) - 1}")
    loaded: Any = source.at(point) if source else load(name, trials, seed, overrides, user_code.names)
    if source and only_trial is not None:
        loaded = own(source, loaded, only_trial)
    slow = cost.check(loaded, loaded.run.trials if only_trial is None else 1, workers)
    numbers = numbers_of(loaded.run, only_trial)
    if live and workers > 1:
        raise BadInput("--live needs --workers 1: the first trial is streamed while it is simulated")
    asked = {*(also or ()), *(("log",) if export_log else ())}
    if both := sorted(asked & {*(without or ())}):
        raise BadInput(f"--also {both[0]} and --without {both[0]}: is it to be written or not? leave out one of the two")
    for option, named in (("--also", asked), ("--without", {*(without or ())})):
        if unknown := named - OUTPUTS.keys():
            raise BadInput(f"{option} {min(unknown)}: there is no such output; there are {', '.join(OUTPUTS)}")
    for key in sorted(asked):
        if (of := OUTPUTS[key].families) is not None and loaded.family not in of:
            raise BadInput(f"--also {key}: is of {' and '.join(FAMILIES[family] for family in of)}; {name} is of {FAMILIES[loaded.family]}")
    written = [output for key, output in OUTPUTS.items() if key in asked or (output.unasked and key not in (without or ()))]
    if (asked or live) and not record_trials:
        option = "--live shows" if not asked else "--export-log writes" if export_log else f"--also {min(asked)} writes"
        raise BadInput(f"{option} the recorded trials and --record-trials 0 records none")
    target = output_folder(folder, name, overwrite)
    user_code.check(surroundings(loaded), names_taken(loaded))
    for warning in [*loaded.warnings(), *slow]:
        err.print(f"warning: {warning}", style="yellow")
    stream = _live_stream(loaded, name, user_code) if live else None
    started = time.perf_counter()
    watched = stream.on_tick if stream else None
    files = ResultFiles(target)
    with interrupted_as(f"what was written until then is whole, in {target}; the same command with --overwrite writes all"):
        with SIGNALS.held():  # from the first trial that is finished until it is on the disk
            blocks, stopped, unfinished = _simulate(loaded, source, numbers, numbers[:record_trials], workers, user_code, watched)
            if stream:
                stream.close()
            finished, metrics, recordings = join(blocks)
            broken = sorted(one for block in blocks for one in block.lost)
            if not recordings:
                recordings = next((block.recordings for block in blocks if block.recordings), {})
            wall = time.perf_counter() - started
            reasons = [block.failure for block in blocks if block.failure] + [str(one) for one in broken]
            ended = RunResult(name, loaded, len(loaded.loop_names), len(numbers), finished, metrics, wall, reasons, stopped, unfinished)
            if not len(finished) and not recordings:
                ended.exit_without_result()
            ended.write_figures(files, **user_code.described)
        if recordings:
            flown = Flown(name, loaded, recordings, user_code.law, _configuration(loaded, user_code))
            for output in written:
                files.write(output.file, lambda path, output=output: output.write(path, flown))  # type: ignore[misc]
        if overwrite:
            files.remove_others(output.file for output in OUTPUTS.values())
        if statistics := rows(ended.metrics):
            ended.print_header()
            for table in tables_of(statistics, loaded, len(finished), user_code.names, user_code.law):
                out.print(table)
        ended.print_files(files)


def _live_stream(loaded: Any, name: str, user_code: UserCode) -> LiveStream | LiveCurves:
    from sim.rerun.live import LiveStream  # Rerun takes half a second to import
    from sim.rerun.live_curves import LiveCurves

    configuration = _configuration(loaded, user_code)
    try:
        if loaded.loops:
            return LiveCurves(name, loaded.loop_names, columns_of(loaded).layout, configuration)
        return LiveStream(name, build(loaded, np.zeros(1, dtype=np.int64), user_code), loaded.law.feedback, configuration)
    except ConnectionError as refused:
        raise BadInput(f"--live: {refused}") from None


def _simulate(
    loaded: Any,
    source: Campaign | None,
    numbers: Any,
    recorded: Any,
    workers: int,
    user_code: UserCode,
    stream: Callable[[str, int, Recorder], None] | None,
) -> tuple[list[TrialBlock], bool, str | None]:
    """Blocks that finished, whether the user stopped the rest, and why else some are missing."""
    blocks: list[TrialBlock] = []
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("trial-s"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    try:
        with SIGNALS.heeded(), Progress(*columns, console=err, transient=True, disable=not err.is_terminal) as bar:
            seconds = loaded.run.tick_s
            task = bar.add_task(counted(len(numbers), "trial"), total=round(seconds * loaded.run.ticks * len(numbers)))
            for block in simulate_all(
                loaded,
                cut(numbers, workers),
                recorded,
                workers,
                lambda ticks: bar.advance(task, seconds * ticks),
                user_code,
                source,
                stream,
            ):
                blocks.append(block)
    except KeyboardInterrupt:
        return blocks, True, None
    except WorkersLost as lost:
        return blocks, False, str(lost)
    return blocks, False, None


def _configuration(loaded: Any, user_code: UserCode) -> dict[str, Any]:
    configuration: dict[str, Any] = loaded.model_dump(mode="json", exclude_none=True)
    return configuration | user_code.described
