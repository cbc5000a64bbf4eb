"""`nacs run`: simulate a scenario, print its table, and write recording, report and metrics."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from sim.bad_input import BadInput
from sim.campaign.blocks import Shard, cut, join, simulate_all
from sim.campaign.draws import alone, picked
from sim.campaign.file import is_campaign
from sim.campaign.file import load as load_campaign
from sim.campaign.settings import Campaign, batched
from sim.cli import agents as command_family
from sim.cli import families
from sim.cli.run_output import LOG, RECORDING, REPORT, Ended, numbers_of
from sim.cli.terminal import Name, Overrides, Seed, Trials, err, load, out, output_folder
from sim.loop.build import build
from sim.loop.recording import Recorder, Recording
from sim.metrics.claims import CLAIMS
from sim.metrics.results import Row, rows
from sim.plant.kinds import compile_plant
from sim.scenario.one_body import Scenario
from sim.tables import antenna as antenna_tables
from sim.tables import one_body as tables
from sim.tables import windows as window_tables
from sim.user_code.guests import Guests

if TYPE_CHECKING:
    from sim.rerun.live import LiveStream


def run(
    name: Name,
    trials: Trials = None,
    seed: Seed = None,
    folder: Annotated[Path | None, typer.Option("--out", help="folder for the results; default: a new one under runs/")] = None,
    overrides: Overrides = None,
    workers: Annotated[int, typer.Option(min=1, help="processes that share the trials; no number depends on it")] = 1,
    only_trial: Annotated[int | None, typer.Option(min=0, help="simulate this one trial of the run and record it")] = None,
    point: Annotated[int, typer.Option(min=0, help="of a campaign's grid, if SCENARIO is a campaign file")] = 0,
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
    live: Annotated[
        bool, typer.Option("--live", help="also stream the first trial to a Rerun viewer that is open on this machine")
    ] = False,
) -> None:
    """Simulate a scenario, print its table and write recording, report and metrics."""
    if (family := families.family_of(name)) is not None:
        if observers or controller or export_log or live or point:
            raise BadInput(f"{name} is of several agents; --observer, --controller, --export-log, --live and --point are for one body")
        changes = command_family.changes_of(overrides, trials, seed)
        command_family.run(family, command_family.Asked(name, changes, folder, workers, only_trial, record_trials, overwrite))
        return
    guests = Guests(tuple(observers or ()), controller)
    source = load_campaign(Path(name)) if is_campaign(name) else None
    if source and (only_trial is None or trials or seed or overrides):
        raise BadInput(f"{name} is a campaign: fly one of its trials by --only-trial K (and --point P), or all by `nacs campaign {name}`")
    if source and not 0 <= point < len(source.points):
        raise BadInput(f"--point {point}: the grid of {name} has points 0 to {len(source.points) - 1}")
    base = source.at(point) if source else load(name, trials, seed, overrides, guests.names)
    if source and only_trial is not None and (family := families.of(base)) is not None:
        changes = source.changes(point) | picked(source, only_trial)
        asked = command_family.Asked(source.scenario, changes, folder, workers, only_trial, record_trials, overwrite)
        command_family.run(family, asked)
        return
    assert isinstance(base, Scenario)
    loaded = base
    if source and only_trial is not None and not batched(loaded):
        own, source = alone(source, loaded, only_trial), None
        assert isinstance(own, Scenario)
        loaded = own
    numbers = numbers_of(loaded.run, only_trial)
    if live and workers > 1:
        raise BadInput("--live needs --workers 1: the first trial is streamed while it is simulated")
    if export_log and not record_trials:
        raise BadInput("--export-log writes the recorded trials and --record-trials 0 records none")
    if loaded.loops and (guests.names or guests.controller or live or export_log):
        raise BadInput(f"{name} flies several loops; --observer, --controller, --live and --export-log need a scenario with one [control]")
    target = output_folder(folder, name, overwrite)
    guests.check(loaded)
    for warning in loaded.warnings():
        err.print(f"warning: {warning}", style="yellow", markup=False)
    stream = _live_stream(loaded, name, guests) if live else None
    started = time.perf_counter()
    shards, stopped = _simulate(loaded, source, numbers, numbers[:record_trials], workers, guests, stream.on_tick if stream else None)
    if stream:
        stream.close()
    failure = next((shard for shard in shards if shard.failure), None)
    finished, metrics, recordings = join(shards)
    if failure and failure.recordings:
        recordings = failure.recordings
    wall = time.perf_counter() - started
    reason = failure.failure if failure else None
    ended = Ended(name, loaded, len(loaded.singles()), len(numbers), finished, metrics, wall, reason, stopped)
    if not len(finished) and not recordings:
        ended.give_up()
    ended.write_figures(target, overwrite, **guests.described)
    _draw(target, name, loaded, guests, recordings)
    if export_log and recordings:
        from sim.replay.flight_log import export

        export(target / LOG, recordings["loop"], loaded, name)
    _show(ended, loaded, guests)
    ended.say_where(target)


def _live_stream(loaded: Scenario, name: str, guests: Guests) -> LiveStream:
    from sim.rerun.live import LiveStream  # Rerun takes half a second to import

    try:
        return LiveStream(name, build(loaded, np.zeros(1, dtype=np.int64), guests), _configuration(loaded, guests))
    except ConnectionError as refused:
        raise BadInput(f"--live: {refused}") from None


def _simulate(
    loaded: Scenario,
    source: Campaign | None,
    numbers: Any,
    recorded: Any,
    workers: int,
    guests: Guests,
    stream: Callable[[int, Recorder], None] | None,
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
                loaded, cut(numbers, workers), recorded, workers, lambda ticks: bar.advance(task, seconds * ticks), guests, source, stream
            ):
                shards.append(shard)
                if shard.failure:
                    break
        except KeyboardInterrupt:
            return shards, True
    return shards, False


def _draw(target: Path, name: str, loaded: Scenario, guests: Guests, recordings: dict[str, Recording]) -> None:
    from sim.report import antenna as report_antenna
    from sim.report import loops as report_loops
    from sim.report import page as report  # Matplotlib and Rerun take a second to import
    from sim.rerun.loops import write_loops
    from sim.rerun.sink import write_recording
    from sim.series.antenna import is_antenna

    configuration = _configuration(loaded, guests)
    if recordings and is_antenna(loaded, recordings):
        report_antenna.write_report(target / REPORT, name, loaded, recordings)
        write_loops(target / RECORDING, name, loaded, recordings, configuration)
    elif "loop" in recordings:
        recording, assembly = recordings["loop"], compile_plant(loaded.plant)
        report.write_report(target / REPORT, name, loaded.title, recording, _closed_by(loaded, guests))
        write_recording(target / RECORDING, name, recording, assembly, loaded.law.feedback, configuration)
    elif recordings:
        report_loops.write_report(target / REPORT, name, loaded, recordings)
        write_loops(target / RECORDING, name, loaded, recordings, configuration)


def _configuration(loaded: Scenario, guests: Guests) -> dict[str, Any]:
    return loaded.model_dump(mode="json", exclude_none=True) | guests.described


def _closed_by(loaded: Scenario, guests: Guests) -> str:
    return loaded.law.feedback + (f" by {guests.law}" if guests.law else "")


def _show(ended: Ended, loaded: Scenario, guests: Guests) -> None:
    statistics, finished = rows(ended.metrics), len(ended.trials)
    if not statistics:
        return
    ended.say_what()
    if loaded.loops:
        for table in _several(statistics)(statistics, loaded, finished):
            out.print(table)
        if loaded.claims:
            out.print(tables.claims(CLAIMS[loaded.claims](statistics)))
        return
    if loaded.published:
        out.print(tables.residuals(statistics, loaded.published))
    out.print(tables.estimators(statistics, [*loaded.observers, *guests.names], loaded.published, finished))
    out.print(f"{tables.loop(statistics)}{f', controller {guests.law}' if guests.law else ''}")


def _several(statistics: list[Row]) -> Callable[[list[Row], Scenario, int], list[Table]]:
    """Tables of several loops, by what was measured of them."""
    measured = {row.metric for row in statistics}
    if "rms_pointing_deg" in measured:
        return antenna_tables.antenna
    return window_tables.windows if "rms_rate_error" in measured else tables.loops
