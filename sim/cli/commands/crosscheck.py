"""`nacs crosscheck`: how far an analytic model is from the plant, from when on, and why."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.text import Text

from sim.bad_input import BadInput
from sim.campaign import cost
from sim.cli.result_files import ResultFiles, interrupted_as
from sim.cli.terminal import FAILED, Name, Overrides, Seed, err, load, out, output_folder
from sim.crosscheck import agents
from sim.crosscheck.divergence import thresholds
from sim.crosscheck.register import choose_loop, choose_model, family_of
from sim.crosscheck.study import CrossCheck, examine, metrics
from sim.metric import Metric
from sim.metrics.results import write_summary
from sim.outputs.recording import how_to_open
from sim.plant.batch import SimulationFailed
from sim.plant.kinds import compile_plant
from sim.scenario.one_body import Scenario
from sim.tables.crosscheck import tables
from sim.tables.crosscheck_agents import divergence
from sim.text.progress import Work

CHECK_FAILED = 1
FLIGHTS = 20  # of every trial: effects switched on and off alone, and what is printed
FILES = RECORDING, PICTURE, SUMMARY = "crosscheck.rrd", "crosscheck.png", "summary.json"


def crosscheck(
    name: Name = "nacs/fault-free",
    model: Annotated[
        str | None,
        typer.Option(
            metavar="VARIANT|FILE.py", help="of the testbed eq9-10 (default), exact, printed-..., or a file of yours, which is run"
        ),
    ] = None,
    loop: Annotated[
        str | None, typer.Option(metavar="NAME", help="whose control flies it, of a scenario of several loops; default: the first")
    ] = None,
    at: Annotated[list[float] | None, typer.Option(metavar="SECONDS", help="instant of attribution (may be repeated)")] = None,
    limits: Annotated[
        list[str] | None, typer.Option("--threshold", metavar="QUANTITY=VALUE", help="attitude (deg), rate, wheel, momentum or energy")
    ] = None,
    trials: Annotated[int, typer.Option(help="trials over which shares are averaged")] = 4,
    seed: Seed = None,
    folder: Annotated[Path | None, typer.Option("--out", help="folder for the results; default: a new one under runs/")] = None,
    overrides: Overrides = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace what is in --out")] = False,
) -> None:
    """Cross-check an analytic model with the plant: divergence, its causes, physics checks, and what fails as printed."""
    whole = load(name, trials, seed, overrides)
    flights = 1 if whole.family in agents.FAMILIES else FLIGHTS
    slow = cost.check(whole, trials, flights=flights)
    if whole.family in agents.FAMILIES:
        if model or limits:
            raise BadInput(f"--{'model' if model else 'threshold'}: is for one body; of several agents all models are shown")
        _of_agents(whole, name, loop, at, folder, overwrite, slow)
        return
    family, loaded = family_of(whole), choose_loop(whole, loop)
    chosen = choose_model(family, model, loaded.plant)
    wanted = thresholds(loaded, limits or [])
    instants = _instants(loaded, at, family.instants)
    target = output_folder(folder, str(Path("crosscheck") / name) if folder is None and not name.endswith(".toml") else name, overwrite)
    _warn(slow)
    started = time.perf_counter()
    with Work(err, "steps") as work:
        try:
            with interrupted_as("nothing was written; the same command begins anew"):
                found = examine(
                    loaded,
                    family,
                    chosen,
                    wanted,
                    instants,
                    work.report,
                )
        except SimulationFailed as failure:
            err.print(f"error: {failure}; nothing was written")
            raise typer.Exit(FAILED) from None
    wall = time.perf_counter() - started
    files = ResultFiles(target)
    with interrupted_as(f"what was written until then is whole, in {target}; the same command with --overwrite writes all"):
        _write(files, name, loaded, found, wall)
        if overwrite:
            files.remove_others(FILES)
        out.print(Text.assemble((f"Cross-check of {chosen.name}", "bold"), f" with {name}: {loaded.title}\n"))
        for table in tables(found):
            out.print(table)
        if PICTURE in files:
            out.print(f"Picture    {target / PICTURE}")
        if RECORDING in files:
            out.print(f"Recording  {target / RECORDING}")
            out.print(f"Open it    {how_to_open(target / RECORDING)}", soft_wrap=True)
        files.end_if_refused()
        if not found.passed:
            err.print("a check fails, or something printed does not fail as it must: see the tables", style="red")
            raise typer.Exit(CHECK_FAILED)


def _warn(lines: list[str]) -> None:
    for line in lines:
        err.print(f"warning: {line}", style="yellow")


def _of_agents(
    loaded: Any, name: str, loop: str | None, at: list[float] | None, folder: Path | None, overwrite: bool, slow: list[str]
) -> None:
    from sim.report.crosscheck.agents import write_agents_picture

    if loop is not None and loop not in loaded.loop_names:
        raise BadInput(f"--loop {loop}: no such loop; there are {', '.join(loaded.loop_names)}")
    instants = _instants(loaded, at, agents.INSTANTS_S)
    needed = min(loaded.run.ticks, round(max(instants) / loaded.run.tick_s) + 1)
    loaded = loaded.model_copy(update={"run": loaded.run.model_copy(update={"ticks": needed})})
    target = output_folder(folder, str(Path("crosscheck") / name) if folder is None and not name.endswith(".toml") else name, overwrite)
    _warn(slow)
    started = time.perf_counter()
    try:
        with (
            interrupted_as("nothing was written; the same command begins anew"),
            Work(err, "steps") as work,
        ):
            found = agents.examine(loaded, loop or loaded.loop_names[0], instants, work.report)
    except SimulationFailed as failure:
        err.print(f"error: {failure}; nothing was written")
        raise typer.Exit(FAILED) from None
    run = loaded.run
    values = [
        Metric(model, f"{quantity}_apart", f"{found.time[tick]:g}s", found.quantities[quantity].unit, apart[tick].max(axis=-1))
        for model, quantities in found.apart.items()
        for quantity, apart in quantities.items()
        for tick in found.ticks
    ]
    wall = time.perf_counter() - started
    seconds = run.tick_s * run.ticks * run.trials
    files = ResultFiles(target)
    with interrupted_as(f"what was written until then is whole, in {target}; the same command with --overwrite writes all"):
        files.write(SUMMARY, lambda path: write_summary(path, name, run.seed, run.trials, wall, seconds, values, passed=found.passed))
        files.write(PICTURE, lambda path: write_agents_picture(path, name, found))
        if overwrite:
            files.remove_others(FILES)
        out.print(Text.assemble((f"Cross-check of {name}", "bold"), f": {loaded.title}\n"))
        out.print(divergence(found))
        if PICTURE in files:
            out.print(f"Picture    {target / PICTURE}")
        files.end_if_refused()
        if not found.passed:
            raise typer.Exit(CHECK_FAILED)


def _instants(loaded: Scenario, at: list[float] | None, usual: tuple[float, ...]) -> tuple[float, ...]:
    last, tick_s = (loaded.run.ticks - 1) * loaded.run.tick_s, loaded.run.tick_s
    if last < tick_s:
        raise BadInput("run.ticks: a cross-check needs two ticks or more")
    if at is None:
        return tuple(s for s in usual if tick_s <= s <= last) or (last,)
    for instant in at:
        if not (math.isfinite(instant) and tick_s / 2 < instant <= last + 1e-9):
            raise BadInput(f"--at {instant:g}: must lie between {tick_s:g} s and the last tick, {last:g} s")
    return tuple(at)


def _write(files: ResultFiles, name: str, loaded: Scenario, found: CrossCheck, wall: float) -> None:
    from sim.report.crosscheck.one_body import write_picture  # Matplotlib and Rerun take a second to import
    from sim.rerun.crosscheck import write_crosscheck

    run, model = loaded.run, {"model": found.model.name, "thresholds": found.thresholds, "passed": found.passed}
    seconds = run.tick_s * run.ticks * run.trials
    files.write(SUMMARY, lambda path: write_summary(path, name, run.seed, run.trials, wall, seconds, metrics(found), **model))
    files.write(PICTURE, lambda path: write_picture(path, name, found))
    configuration = loaded.model_dump(mode="json", exclude_none=True)
    files.write(RECORDING, lambda path: write_crosscheck(path, name, found, compile_plant(loaded.plant), tables(found), configuration))
