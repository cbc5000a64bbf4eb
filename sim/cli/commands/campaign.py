"""`nacs campaign`: fly thousands of trials that differ, keep what is finished, and say what holds with which probability."""

from __future__ import annotations

import json
import resource
import shlex
import time
from functools import partial
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer
from pydantic import ValidationError

from models.plants.register.entries import kind_of
from sim.bad_input import BadInput
from sim.campaign import cost
from sim.campaign.draws import banded, check_draws
from sim.campaign.engines import Engine, SchedulerLost, engine
from sim.campaign.file import CAMPAIGNS, load, located
from sim.campaign.settings import Campaign
from sim.campaign.shard import Job, fly
from sim.campaign.shard_files import BANDS, CONSISTENCY, DamagedShard
from sim.campaign.store import Store
from sim.campaign.summary import (
    Distribution,
    beats_both,
    detection,
    distributions,
    duels,
    ensemble_consistency,
    operating_characteristic,
    summarize,
    worst,
)
from sim.campaign.worker_processes import WorkersLost
from sim.cli.result_files import ResultFiles, interrupted_as
from sim.cli.terminal import FAILED, INTERRUPTED, err, out, output_folder
from sim.metrics.results import versions, write_json
from sim.outputs.recording import how_to_open
from sim.processor import described
from sim.scenario import files
from sim.scenario.validation import first_error
from sim.signals import AS_BEFORE, SIGNALS
from sim.tables import one_body as tables
from sim.text.progress import Work
from sim.text.table_style import counted
from sim.text.toml_text import is_there
from sim.whole_file import NotWritten

BASELINES = ("ekf", "sif")
WAY_ON = "name another folder, or go on with it by --resume"


def campaign(
    file: Annotated[str, typer.Argument(metavar="FILE", help="campaign file, or the name of one that comes with the twin")],
    folder: Annotated[Path | None, typer.Option("--out", help="folder for the results; default: a new one under runs/")] = None,
    workers: Annotated[int, typer.Option(min=1, help="processes; no number depends on it")] = 2,
    engine_name: Annotated[str, typer.Option("--engine", help="local, or dask")] = "local",
    scheduler: Annotated[str | None, typer.Option(help="address of a running dask scheduler; default: a local cluster")] = None,
    trials: Annotated[int | None, typer.Option(help="number of trials; default: the file's")] = None,
    seed: Annotated[int | None, typer.Option(help="root seed; default: the file's")] = None,
    shard: Annotated[int | None, typer.Option(help="trials that are simulated together; no number depends on it")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="do only what is missing in --out")] = False,
    mixed: Annotated[
        bool,
        typer.Option("--mixed-processors", help="let processors of several kinds compute it: equal to 1e-11, then, not to the bit"),
    ] = False,
) -> None:
    """Fly a campaign: a scenario with dispersions and grids over many trials."""
    if engine_name not in ("local", "dask"):
        raise BadInput(f"--engine {engine_name}: must be local or dask")
    if scheduler is not None and engine_name != "dask":
        raise BadInput(f"--scheduler {scheduler}: is dask's; add --engine dask")
    if resume and folder is None:
        raise BadInput("--resume needs --out: the folder of the campaign to go on with")
    loaded = _load(file, trials, seed, shard, workers)
    target = folder if resume and folder else output_folder(folder, f"campaigns/{Path(file).stem}", False, WAY_ON)
    bases = [loaded.at(point) for point in range(len(loaded.points))]
    scenarios = [json.dumps(files.dumped(base)) for base in bases]
    jobs = _jobs(loaded, scenarios)
    store = Store(target, loaded, scenarios)
    if resume:
        store.check()
    for base in bases:
        check_draws(loaded, base)
    typed = {"--trials": trials, "--seed": seed, "--shard": shard, "--engine": engine_name, "--scheduler": scheduler}
    again = shlex.join(
        [
            *("nacs", "campaign", file, "--resume", "--out", str(target)),
            *(part for option, value in typed.items() if value not in (None, "local") for part in (option, str(value))),
            *(("--mixed-processors",) if mixed else ()),
        ]
    )
    started = time.perf_counter()
    try:
        with engine(engine_name, workers, scheduler) as running:
            store.begin(running.processors(), mixed)
            todo, damaged = store.missing(jobs)
            if damaged:
                err.print(f"warning: {counted(damaged, 'shard')} {'are' if damaged > 1 else 'is'} damaged and flown again", style="yellow")
            ended = _fly(todo, store, running, mixed)
        if ended.left:
            everything = sum(job.stop - job.start for job in jobs)
            err.print(f"{ended.reason}: {ended.left} of {counted(everything, 'trial')} are left; go on with: {again}")
            raise typer.Exit(ended.code)
        with interrupted_as(f"all trials are flown and kept; sum them up with: {again}"):
            _conclude(loaded, jobs, store, time.perf_counter() - started, again)
    except KeyboardInterrupt:
        err.print(f"interrupted: go on with: {again}" if store.is_begun else AS_BEFORE)
        raise typer.Exit(INTERRUPTED) from None
    except NotWritten as refused:
        err.print(f"error: {refused}", style="red")
        raise typer.Exit(FAILED) from None
    except Exception as wrong:
        if store.is_begun and not isinstance(wrong, BadInput | typer.Exit):
            wrong.add_note(f"go on with: {again}")
        raise


def _load(file: str, trials: int | None, seed: int | None, shard: int | None, workers: int) -> Campaign:
    path = located(file)
    if not file.endswith(".toml") and not is_there(path):
        raise BadInput(
            f"no campaign {file!r}; there are {', '.join(sorted(p.stem for p in CAMPAIGNS.glob('*.toml')))}, or give a .toml file"
        )
    loaded = load(path)
    changes = {key: value for key, value in (("trials", trials), ("seed", seed), ("shard", shard)) if value is not None}
    if any(value < (0 if key == "seed" else 1) for key, value in changes.items()):
        raise BadInput(f"--trials and --shard must be at least 1, --seed at least 0 (got {changes})")
    try:
        changed = Campaign.model_validate(loaded.model_dump() | changes)
    except ValidationError as invalid:
        raise BadInput(f"{file}: {first_error(invalid, changes, Campaign)}") from None
    for line in cost.check(changed.at(0), changed.trials * changed.size, workers, kept=False):
        err.print(f"warning: {line}", style="yellow")
    return changed


def _jobs(loaded: Campaign, scenarios: list[str]) -> list[Job]:
    text = loaded.model_dump_json()
    edges = range(0, loaded.trials, loaded.shard)
    return [
        Job(text, scenario, point, start, min(start + loaded.shard, loaded.trials))
        for point, scenario in enumerate(scenarios)
        for start in edges
    ]


class Ended(NamedTuple):
    """How flying ended.

    Attributes:
      left: trials that were not flown.
      code: exit code, and why, if there are any.
      reason: in words.
    """

    left: int
    code: int = 0
    reason: str = ""


def _fly(todo: list[Job], store: Store, running: Engine, mixed: bool) -> Ended:
    """Do the jobs and keep each as it comes."""
    size = {(job.point, job.start): job.stop - job.start for job in todo}
    left = everything = sum(size.values())
    try:
        with Work(err, "trials") as work:
            for done in running.map(fly, todo):
                with SIGNALS.held():
                    store.keep(done, mixed)
                    left -= size[done.point, done.start]
                work.advance("campaign", size[done.point, done.start], everything)
    except KeyboardInterrupt:
        return Ended(left, INTERRUPTED, "interrupted")
    except (NotWritten, WorkersLost, SchedulerLost, BadInput) as broken:
        return Ended(left, FAILED, f"error: {broken}")
    return Ended(0)


def _conclude(loaded: Campaign, jobs: list[Job], store: Store, wall: float, again: str) -> None:
    """Merge, summarise, draw and print; what cannot be written is told with the command that tries again."""
    results = ResultFiles(store.folder)
    try:
        _sum_up(loaded, jobs, store, wall, results)
    except (NotWritten, DamagedShard) as broken:
        err.print(f"error: {broken}; all trials are flown and kept, sum them up with: {again}", style="red")
        raise typer.Exit(FAILED) from None
    if results.refusal:
        err.print(f"error: {results.refusal}; all trials are kept, sum them up with: {again}", style="red")
        raise typer.Exit(FAILED)


def _sum_up(loaded: Campaign, jobs: list[Job], store: Store, wall: float, results: ResultFiles) -> None:
    from sim.report.campaign import distributions as campaign_distributions  # Matplotlib takes half a second to import
    from sim.report.campaign import sweep as campaign_sweep
    from sim.report.campaign.page import write_report
    from sim.rerun.campaign import write_bands

    merged, first = store.merge(jobs), loaded.at(0)
    processors = described(store.used_processors(jobs))
    together, errors = banded(first, loaded), kind_of(first.plant).layout(first.plant).errors
    sweep = campaign_sweep.abscissa(loaded) is not None
    rows, points = [], []
    for point, settings in enumerate(loaded.points):
        own = [job for job in jobs if job.point == point]
        found = list(distributions(merged, point))
        rows += [summarize(d, loaded.seed) for d in found if d.subject != "draw"]
        bands = store.add_up(own, BANDS, ["quantity", "observer", "tick", "bin"], ["count"])
        sums = store.add_up(own, CONSISTENCY, ["statistic", "observer", "tick"], ["total", "count", "freedom"])
        consistency = ensemble_consistency(sums, errors)
        points.append(_point(point, settings, found, consistency))
        if not together and not sweep:
            out.print(campaign_distributions.table(found, points[-1]["failed_trials"], loaded.trials))
        if point == 0 and together:
            results.write("recording.rrd", partial(write_bands, campaign=loaded, bands=bands, dt=first.run.tick_s))
        if point == 0 and together and points[0]["roc"] and not sweep:
            results.write("report.png", partial(write_report, campaign=loaded, found=found, point=points[0]))
        elif point == 0 and not sweep:
            results.write("report.png", partial(campaign_distributions.write_report, campaign=loaded, found=found))
    if sweep:
        results.write("report.png", partial(campaign_sweep.write_report, campaign=loaded, rows=rows))
        _say_sweep(loaded, rows, points)
    peak = max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)) / 1024
    content = {
        "campaign": loaded.title,
        "scenario": loaded.scenario,
        "seed": loaded.seed,
        "trials": loaded.trials,
        "versions": versions(),
        **processors,
        "wall_s": round(wall, 3),
        "peak_memory_mib": round(peak, 1),
        "points": points,
        "rows": rows,
    }
    results.write("summary.json", partial(write_json, content=content))
    for number, said in enumerate(points if together and not sweep else []):
        out.print(tables.campaign([row for row in rows if row["point"] == number], said))
    flown = len(loaded.points) * loaded.trials
    out.print(f"\n{counted(flown, 'trial')} in {wall:.0f} s; largest process {peak:.0f} MiB")
    if "mixed_processors" in processors:
        out.print(f"Processors {'; '.join(map(str, store.processors))}: {processors['mixed_processors']}")
    if "report.png" in results:
        out.print(f"Report     {store.folder / 'report.png'}")
    if "recording.rrd" in results:
        out.print(f"Recording  {store.folder / 'recording.rrd'}\nOpen it    {how_to_open(store.folder / 'recording.rrd')}")


def _say_sweep(loaded: Campaign, rows: list[dict[str, Any]], points: list[dict[str, Any]]) -> None:
    """Tables of a grid, and which trials failed."""
    from sim.report.campaign import sweep as campaign_sweep

    for table in campaign_sweep.tables(loaded, rows):
        out.print(table)
    for point in points:
        if point["failed_trials"]:
            out.print(f"failed at {point['settings']}: trials {', '.join(map(str, point['failed_trials']))}")


def _point(point: int, settings: dict[str, object], found: list[Distribution], consistency: list[dict[str, object]]) -> dict[str, Any]:
    """What a point of the grid says beyond its metrics."""
    metrics = ("rmse_truth_quaternion", "rmse_truth_rate")
    hybrids = [d.subject for d in found if d.metric == "peak_statistic" and d.phase == "all"]
    subjects = {d.subject for d in found}
    both = [beats_both(found, h, m, BASELINES) for h in hybrids for m in metrics if subjects >= {*BASELINES}]
    curves = {h: operating_characteristic(found, h) for h in hybrids}
    failed = next((d for d in found if (d.subject, d.metric) == ("loop", "failed")), None)
    return {
        "point": point,
        "settings": settings,
        "failed_trials": [] if failed is None else [int(t) for t in failed.trials[failed.values > 0]],
        "beats_both": both,
        "duels": [row for m in metrics for row in duels(found, m)],
        "consistency": consistency,
        "detection": {h: detection(found, h) for h in hybrids},
        "roc": {h: {k: [round(float(x), 6) for x in v] for k, v in c.items()} for h, c in curves.items() if c},
        "worst": {h: worst(found, "rmse_truth_rate", h) for h in hybrids},
    }
