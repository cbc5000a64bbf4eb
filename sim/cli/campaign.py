"""`nacs campaign`: fly thousands of trials that differ, keep what is finished, and say what holds with which probability."""

from __future__ import annotations

import json
import resource
import time
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.text import Text

from models.plants.register.entries import kind_of
from sim.bad_input import BadInput
from sim.campaign.draws import banded
from sim.campaign.engines import engine
from sim.campaign.file import CAMPAIGNS, load
from sim.campaign.settings import Campaign
from sim.campaign.shard import Job, fly
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
from sim.cli.terminal import INTERRUPTED, err, out, output_folder
from sim.metrics.results import versions
from sim.outputs.recording import how_to_open
from sim.scenario import files
from sim.tables import one_body as tables

BASELINES = ("ekf", "sif")


class Rate(ProgressColumn):
    """Trials a second, once there is a first shard."""

    def render(self, task: Task) -> Text:
        """Text of the column."""
        return Text(f"{task.speed:.1f}/s" if task.speed else "")


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
) -> None:
    """Fly a campaign: a scenario with dispersions and grids over many trials."""
    if engine_name not in ("local", "dask"):
        raise BadInput(f"--engine {engine_name}: must be local or dask")
    if resume and folder is None:
        raise BadInput("--resume needs --out: the folder of the campaign to go on with")
    loaded = _load(file, trials, seed, shard)
    target = folder if resume and folder else output_folder(folder, f"campaigns/{Path(file).stem}", False)
    scenarios = [json.dumps(files.dumped(loaded.at(point))) for point in range(len(loaded.points))]
    jobs = _jobs(loaded, scenarios)
    store = Store(target, loaded, scenarios)
    store.open(resume)
    todo, corrupt = store.missing(jobs)
    if corrupt:
        err.print(f"{corrupt} shards could not be read and are done again")
    started = time.perf_counter()
    if not _fly(todo, store, engine_name, workers, scheduler):
        left = sum(job.stop - job.start for job in store.missing(jobs)[0])
        err.print(f"interrupted: {left} of {sum(j.stop - j.start for j in jobs)} trials are left; go on with --resume --out {target}")
        raise typer.Exit(INTERRUPTED)
    _conclude(loaded, jobs, store, time.perf_counter() - started)


def _load(file: str, trials: int | None, seed: int | None, shard: int | None) -> Campaign:
    path = Path(file) if file.endswith(".toml") else CAMPAIGNS / f"{file}.toml"
    if not file.endswith(".toml") and not path.is_file():
        raise BadInput(
            f"no campaign {file!r}; there are {', '.join(sorted(p.stem for p in CAMPAIGNS.glob('*.toml')))}, or give a .toml file"
        )
    loaded = load(path)
    changes = {key: value for key, value in (("trials", trials), ("seed", seed), ("shard", shard)) if value is not None}
    if any(value < (0 if key == "seed" else 1) for key, value in changes.items()):
        raise BadInput(f"--trials and --shard must be at least 1, --seed at least 0 (got {changes})")
    return Campaign.model_validate(loaded.model_dump() | changes)


def _jobs(loaded: Campaign, scenarios: list[str]) -> list[Job]:
    text = loaded.model_dump_json()
    edges = range(0, loaded.trials, loaded.shard)
    return [
        Job(text, scenario, point, start, min(start + loaded.shard, loaded.trials))
        for point, scenario in enumerate(scenarios)
        for start in edges
    ]


def _fly(todo: list[Job], store: Store, engine_name: str, workers: int, scheduler: str | None) -> bool:
    """Do the jobs and keep each as it comes; False if the user stopped."""
    size = {(job.point, job.start): job.stop - job.start for job in todo}
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), Rate(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=err, transient=True, speed_estimate_period=120) as bar:
        task = bar.add_task("trials", total=sum(size.values()))
        try:
            for done in engine(engine_name, workers, scheduler).map(fly, todo):
                store.keep(done)
                bar.advance(task, size[done.point, done.start])
        except KeyboardInterrupt:
            return False
    return True


def _conclude(loaded: Campaign, jobs: list[Job], store: Store, wall: float) -> None:
    """Merge, summarise, draw and print."""
    from sim.report.campaign import distributions as campaign_distributions  # Matplotlib takes half a second to import
    from sim.report.campaign import sweep as campaign_sweep
    from sim.report.campaign.page import write_report
    from sim.rerun.campaign import write_bands

    merged, first = store.merge(jobs), loaded.at(0)
    together, errors = banded(first, loaded), kind_of(first.plant).layout(first.plant).errors
    sweep = not together and campaign_sweep.abscissa(loaded) is not None
    rows, points = [], []
    for point, settings in enumerate(loaded.points):
        own = [job for job in jobs if job.point == point]
        found = list(distributions(merged, point))
        rows += [summarize(d, loaded.seed) for d in found if d.subject != "draw"]
        bands = store.add_up(own, ".bands", ["quantity", "observer", "tick", "bin"], ["count"])
        sums = store.add_up(own, ".consistency", ["statistic", "observer", "tick"], ["total", "count", "freedom"])
        consistency = ensemble_consistency(sums, errors)
        points.append(_point(point, settings, found, consistency))
        if not together and not sweep:
            out.print(campaign_distributions.table(found, points[-1]["failed_trials"], loaded.trials))
        if point == 0 and together:
            write_bands(store.folder / "recording.rrd", loaded, bands, first.run.tick_s)
        if point == 0 and together and points[0]["roc"]:
            write_report(store.folder / "report.png", loaded, found, points[0])
        elif point == 0 and not sweep:
            campaign_distributions.write_report(store.folder / "report.png", loaded, found)
    if sweep:
        _say_sweep(loaded, rows, points, store.folder)
    peak = max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)) / 1024
    content = {
        "campaign": loaded.title,
        "scenario": loaded.scenario,
        "seed": loaded.seed,
        "trials": loaded.trials,
        "versions": versions(),
        "wall_s": round(wall, 3),
        "peak_memory_mib": round(peak, 1),
        "points": points,
        "rows": rows,
    }
    (store.folder / "summary.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    for number, said in enumerate(points if together else []):
        out.print(tables.campaign([row for row in rows if row["point"] == number], said))
    flown = len(loaded.points) * loaded.trials
    out.print(f"\n{flown} trials in {wall:.0f} s; largest process {peak:.0f} MiB\nReport     {store.folder / 'report.png'}")
    if together:
        out.print(f"Recording  {store.folder / 'recording.rrd'}\nOpen it    {how_to_open(store.folder / 'recording.rrd')}")


def _say_sweep(loaded: Campaign, rows: list[dict[str, Any]], points: list[dict[str, Any]], folder: Path) -> None:
    """Picture and tables of a grid, and which trials failed."""
    from sim.report.campaign import sweep as campaign_sweep

    campaign_sweep.write_report(folder / "report.png", loaded, rows)
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
