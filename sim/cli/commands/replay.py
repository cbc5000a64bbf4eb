"""`nacs replay`: run filters over a flight log, print their table, and write their estimates and a picture."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from sim.bad_input import BadInput
from sim.cli.plausible_log import check_plausible
from sim.cli.result_files import ResultFiles, interrupted_as
from sim.cli.terminal import FAILED, INTERRUPTED, Overrides, err, out, output_folder
from sim.metrics.results import Row, rows, write_summary
from sim.scenario.files import AnyScenario, parse_override
from sim.scenario.named_sections import names_taken
from sim.scenario.surroundings import surroundings
from sim.signals import SIGNALS
from sim.text.progress import Work
from sim.text.table_style import counted
from sim.user_code.user_code import UserCode

FILES = ESTIMATES, SUMMARY, PICTURE = "estimates.parquet", "summary.json", "replay.png"

# metric, heading, factor; the second group needs the truth
_COLUMNS = (
    ("rmse_residual_quaternion", "resid.\nq\n1e-3", 1e3),
    ("rmse_residual_rate", "resid.\nrate\n1e-3", 1e3),
    ("nis_mean", "NIS", 1.0),
    ("nis_dof_mean", "of\ndof", 1.0),
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
    trust: Annotated[bool, typer.Option("--trust", help="go on with a log in which units, order or signs look wrong")] = False,
    folder: Annotated[Path | None, typer.Option("--out", help="folder for the results; default: a new one under runs/")] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace what is in --out")] = False,
) -> None:
    """Run filters over a flight log, print their table, and write their estimates and a picture."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    from sim.replay.estimates import estimates
    from sim.replay.flight_log import read
    from sim.replay.log_columns import columns_of
    from sim.replay.log_file import LogFile
    from sim.replay.metrics import evaluate
    from sim.replay.replay import Replayed
    from sim.replay.replay import replay as run_over
    from sim.replay.setting import choose, setting, why_not
    from sim.report.logs.replay import write_picture

    file = LogFile.opened(log)
    said = file.about
    scenario = setting(said, str(log), tuning, dict(parse_override(text) for text in overrides or []))
    user_code = UserCode(tuple(observers or ()))
    user_code.check(surroundings(scenario), names_taken(scenario))
    blocks = read(file, columns_of(scenario))
    if strange := sorted({block.loop for block in blocks} - set(scenario.loop_names)):
        raise BadInput(f"{log}: column loop says {', '.join(strange)}; its scenario has {', '.join(scenario.loop_names)}")
    wanted = filters or []
    chosen = {loop: choose(scenario, said, loop, wanted, bool(observers)) for loop in dict.fromkeys(block.loop for block in blocks)}
    skipped = {loop: reason for loop in chosen if (reason := why_not(scenario, loop))}
    for reason in skipped.values():
        err.print(f"warning: {reason}; it is not replayed", style="yellow")
    blocks = [block for block in blocks if block.loop not in skipped and (chosen[block.loop][1] or observers)]
    if not blocks:
        raise BadInput(f"{log}: no loop of it has a filter to be run; name one by --filter or --observer")
    check_plausible(log, blocks, scenario, trust)
    target = output_folder(folder, str(Path("replay") / log.stem), overwrite)
    for note in (note for block in blocks for note in block.notes):
        err.print(f"warning: {note}", style="yellow")
    started = time.perf_counter()
    replayed, stopped = list[Replayed](), False
    files = ResultFiles(target)
    with interrupted_as(f"what was written until then is whole, in {target}; the same command with --overwrite writes all"):
        with SIGNALS.held():  # from the first part that is replayed until it is on the disk
            try:
                with SIGNALS.heeded(), Work(err, "ticks") as work:
                    for number, block in enumerate(blocks, 1):
                        part = f"part {number} of {len(blocks)}"
                        replayed.append(run_over(block, chosen[block.loop][0], user_code, partial(work.report, part)))
            except KeyboardInterrupt:
                stopped = True
            wall = time.perf_counter() - started
            lost = [one for block in replayed for one in block.recording.lost]
            whole = [sound for block in replayed if len((sound := block.sound()).recording.trials)]
            parts = [part for block in replayed for part in block.broken()]
            if not whole and not parts:
                nothing = "interrupted: nothing was replayed yet, nothing was written; the same command begins anew"
                err.print(nothing if stopped else f"error: {lost[0]}")
                raise typer.Exit(INTERRUPTED if stopped else FAILED)
            trials = len({int(trial) for one in whole for trial in one.recording.trials})
            seconds = sum(float((one.recording.time[-1] + one.recording.dt) * len(one.recording.trials)) for one in (*whole, *parts))
            table = pa.concat_tables([estimates(one) for one in (*whole, *parts)], promote_options="default")
            metrics = evaluate(whole, scenario) if whole else []
            files.write(ESTIMATES, lambda path: pq.write_table(table, path))
            files.write(
                SUMMARY,
                lambda path: write_summary(path, str(log), scenario.run.seed, trials, wall, seconds, metrics, **user_code.described),
            )
        shown = (*whole, *parts)[0]
        if shown.recording.observers:
            files.write(PICTURE, lambda path: write_picture(path, f"Replay of {log.name}", shown.recording, shown.layout))
        if overwrite:
            files.remove_others(FILES)
        what = f": {counted(trials, 'trial')}, {seconds:.0f} s, filters set up for {_origin(said, scenario)}\n"
        out.print(Text.assemble((f"Replay of {log}", "bold"), what))
        if statistics := rows(metrics):
            out.print(_table(statistics))
        for label, name in (("Estimates", ESTIMATES), ("Summary", SUMMARY), ("Picture", PICTURE)):
            if name in files:
                out.print(f"{label:<10} {target / name}")
        told = [f"{lost[0]}; what was estimated until then is in {target}"] if lost else []
        if troubles := [*told, *([files.refusal] if files.refusal else [])]:
            err.print(f"error: {'; '.join(troubles)}")
            raise typer.Exit(FAILED)
        if stopped:
            err.print(
                f"interrupted: {len(replayed)} of {len(blocks)} parts of the log were replayed and are in {target}; "
                "the same command with --overwrite replays all"
            )
            raise typer.Exit(INTERRUPTED)


def _origin(about: dict[str, object], scenario: AnyScenario) -> str:
    return str(about.get("scenario", "a scenario without a name")) if "settings" in about else f"the NACS as published ({scenario.source})"


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
