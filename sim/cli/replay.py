"""`nacs replay`: run filters over a flight log, print their table, and write their estimates and a picture."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from sim.cli.terminal import FAILED, Overrides, err, out, output_folder
from sim.metrics.one_body import Metric
from sim.metrics.results import Row, rows, write_summary
from sim.scenario.files import parse_override
from sim.scenario.one_body import Scenario
from sim.user_code.user_code import UserCode

if TYPE_CHECKING:
    from sim.replay.filters_over_log import Replayed

FILES = ("estimates.parquet", "summary.json", "replay.png")

# metric, heading, factor; the second group needs the truth
_COLUMNS = (
    ("rmse_residual_quaternion", "resid.\nq\n1e-3", 1e3),
    ("rmse_residual_rate", "resid.\nrate\n1e-3", 1e3),
    ("nis_mean", "NIS\n10\ndof", 1.0),
    ("nis_inside_fraction", "NIS in\n95 %\n%", 100.0),
    ("white_fraction", "white\nlags\n%", 100.0),
    ("declared_fraction", "decl.\n\n%", 100.0),
    ("rmse_truth_quaternion", "truth\nq\n1e-3", 1e3),
    ("rmse_truth_rate", "truth\nrate\n1e-3", 1e3),
    ("nees_mean", "NEES\n10\ndof", 1.0),
)


def replay(
    log: Annotated[Path, typer.Argument(metavar="LOG.parquet", help="readings and commands; docs/replay.md says what it holds")],
    filters: Annotated[
        list[str] | None, typer.Option("--filter", help="a filter by name (may be repeated); default: all of the log's scenario")
    ] = None,
    observers: Annotated[
        list[str] | None, typer.Option("--observer", metavar="FILE.py:CLASS", help="a filter of your own; run as code (may be repeated)")
    ] = None,
    tuning: Annotated[str | None, typer.Option(help="tuning of all filters, `paper` or `consistent`; default: as the log says")] = None,
    overrides: Overrides = None,
    folder: Annotated[Path | None, typer.Option("--out", help="folder for the results; default: a new one under runs/")] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace what is in --out")] = False,
) -> None:
    """Run filters over a flight log, print their table, and write their estimates and a picture."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    from sim.plant.batch import SimulationFailed
    from sim.replay.filters_over_log import choose, estimates, setting
    from sim.replay.filters_over_log import replay as fly
    from sim.replay.flight_log import read
    from sim.report.replay import write_picture

    blocks, about = read(log)
    scenario = setting(about, str(log), tuning, dict(parse_override(text) for text in overrides or []))
    user_code = UserCode(tuple(observers or ()))
    user_code.check(scenario)
    wanted = filters or ([] if observers else list(about.get("settings", {}).get("observers", scenario.observers)))
    chosen = choose(scenario, wanted)
    target = output_folder(folder, str(Path("replay") / log.stem), overwrite)
    started = time.perf_counter()
    try:
        replayed = [fly(block, scenario, chosen, user_code) for block in blocks]
    except SimulationFailed as failure:
        err.print(f"error: {failure}")
        raise typer.Exit(FAILED) from None
    metrics = _evaluate(replayed, scenario)
    wall = time.perf_counter() - started
    trials = sum(len(block.trials) for block in blocks)
    seconds = sum(block.dt * block.reading.shape[0] * len(block.trials) for block in blocks)
    if overwrite and target.is_dir():
        for old in FILES:
            (target / old).unlink(missing_ok=True)
    target.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.concat_tables([estimates(one) for one in replayed]), target / "estimates.parquet")
    write_summary(target / "summary.json", str(log), scenario.run.seed, trials, wall, seconds, metrics, **user_code.described)
    write_picture(target / "replay.png", f"Replay of {log.name}", replayed[0].recording)
    out.print(f"[bold]Replay of {log}[/]: {trials} trials, {seconds:.0f} s, filters set up for {_origin(about, scenario)}\n")
    out.print(_table(rows(metrics), (*chosen, *user_code.names)))
    for label, name in (("Estimates", FILES[0]), ("Summary", FILES[1]), ("Picture", FILES[2])):
        out.print(f"{label:<10} {target / name}")


def _origin(about: dict[str, object], scenario: Scenario) -> str:
    return str(about["scenario"]) if "settings" in about else f"the NACS as published ({scenario.source})"


def _evaluate(replayed: list[Replayed], scenario: Scenario) -> list[Metric]:
    """The metrics of docs/metrics.md, and those of docs/replay.md, of every trial."""
    from models.plants.nacs import compile_nacs
    from sim.campaign.blocks import Shard, join
    from sim.metrics.one_body import evaluate
    from sim.replay.filters_over_log import judge

    assembly, shards = compile_nacs(scenario.testbed), []
    for one in replayed:
        recording, trials = one.recording, one.recording.trials
        metrics = [metric for metric in evaluate(recording, assembly) if metric.subject != "loop"]
        for name in recording.observers:
            fit = judge(one, name)
            extra = {"nis_inside_fraction": np.full(len(trials), fit.nis_inside), "white_fraction": np.full(len(trials), fit.white)}
            if recording.thresholds[name] is not None:
                extra["declared_fraction"] = np.mean(recording.channels[f"{name}/declared"], axis=0)
            metrics += [Metric(name, metric, "all", "1", values) for metric, values in extra.items()]
        shards.append(Shard(trials, metrics, {}))
    return join(shards)[1]


def _table(statistics: list[Row], names: tuple[str, ...]) -> Table:
    found = {(row.subject, row.metric): row.mean for row in statistics if row.phase == "all"}
    shown = [column for column in _COLUMNS if any((name, column[0]) in found for name in names)]
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=(0, 0, 0, 1))
    table.add_column("filter", no_wrap=True)
    for _, heading, _ in shown:
        table.add_column(heading, justify="right")
    for name in names:
        values = [found.get((name, metric)) for metric, _, _ in shown]
        cells = ["-" if v is None else f"{factor * v:.3g}" for v, (_, _, factor) in zip(values, shown, strict=True)]
        table.add_row(name, *cells)
    return table
