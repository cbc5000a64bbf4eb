"""`nacs replay`: run filters over a flight log, print their table, and write their estimates and a picture."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from sim.bad_input import BadInput
from sim.cli.terminal import FAILED, Overrides, err, out, output_folder
from sim.metrics.results import Row, rows, write_summary
from sim.scenario.files import AnyScenario, parse_override
from sim.scenario.named_sections import names_taken
from sim.scenario.surroundings import surroundings
from sim.user_code.user_code import UserCode

FILES = ("estimates.parquet", "summary.json", "replay.png")

# metric, heading, factor; the second group needs the truth
_COLUMNS = (
    ("rmse_residual_quaternion", "resid.\nq\n1e-3", 1e3),
    ("rmse_residual_rate", "resid.\nrate\n1e-3", 1e3),
    ("nis_mean", "NIS", 1.0),
    ("nis_dof_mean", "its\ndof", 1.0),
    ("nis_inside_fraction", "NIS in\n95 %\n%", 100.0),
    ("white_fraction", "white\nlags\n%", 100.0),
    ("declared_fraction", "decl.\n\n%", 100.0),
    ("rmse_truth_quaternion", "truth\nq\n1e-3", 1e3),
    ("rmse_truth_rate", "truth\nrate\n1e-3", 1e3),
    ("rms_position_error", "truth\nplace\n1e-3 m", 1e3),
    ("rms_velocity_error", "truth\nrate\n1e-3", 1e3),
    ("nees_mean", "NEES", 1.0),
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
    from sim.replay.estimates import estimates
    from sim.replay.flight_log import about, read
    from sim.replay.log_columns import columns_of
    from sim.replay.metrics import evaluate
    from sim.replay.replay import replay as run_over
    from sim.replay.setting import choose, setting, why_not
    from sim.report.replay import write_picture

    said = about(log)
    scenario = setting(said, str(log), tuning, dict(parse_override(text) for text in overrides or []))
    user_code = UserCode(tuple(observers or ()))
    user_code.check(surroundings(scenario), names_taken(scenario))
    blocks = read(log, columns_of(scenario))
    wanted = filters or []
    chosen = {loop: choose(scenario, said, loop, wanted, bool(observers)) for loop in dict.fromkeys(block.loop for block in blocks)}
    skipped = {loop: reason for loop in chosen if (reason := why_not(scenario, loop))}
    for reason in skipped.values():
        err.print(f"warning: {reason}; it is not replayed", style="yellow", markup=False)
    blocks = [block for block in blocks if block.loop not in skipped and (chosen[block.loop][1] or observers)]
    if not blocks:
        raise BadInput(f"{log}: no loop of it has a filter to be run; name one by --filter or --observer")
    target = output_folder(folder, str(Path("replay") / log.stem), overwrite)
    started = time.perf_counter()
    try:
        replayed = [run_over(block, chosen[block.loop][0], user_code) for block in blocks]
    except SimulationFailed as failure:
        err.print(f"error: {failure}")
        raise typer.Exit(FAILED) from None
    metrics = evaluate(replayed, scenario)
    wall = time.perf_counter() - started
    trials = len({(int(trial)) for block in blocks for trial in block.trials})
    seconds = sum(block.dt * block.reading.shape[0] * len(block.trials) for block in blocks)
    if overwrite and target.is_dir():
        for old in FILES:
            (target / old).unlink(missing_ok=True)
    target.mkdir(parents=True, exist_ok=True)
    tables = [estimates(one) for one in replayed]
    pq.write_table(pa.concat_tables(tables, promote_options="default"), target / "estimates.parquet")
    write_summary(target / "summary.json", str(log), scenario.run.seed, trials, wall, seconds, metrics, **user_code.described)
    if replayed[0].recording.observers:
        write_picture(target / "replay.png", f"Replay of {log.name}", replayed[0].recording, replayed[0].layout)
    out.print(f"[bold]Replay of {log}[/]: {trials} trials, {seconds:.0f} s, filters set up for {_origin(said, scenario)}\n")
    out.print(_table(rows(metrics)))
    for label, name in (("Estimates", FILES[0]), ("Summary", FILES[1]), ("Picture", FILES[2])):
        if (target / name).is_file():
            out.print(f"{label:<10} {target / name}")


def _origin(about: dict[str, object], scenario: AnyScenario) -> str:
    return str(about["scenario"]) if "settings" in about else f"the NACS as published ({scenario.source})"


def _table(statistics: list[Row]) -> Table:
    names = list(dict.fromkeys(row.subject for row in statistics))
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
