"""`nacs run` of a scenario of several agents: simulate, print its tables, and write recording, report and metrics."""

from __future__ import annotations

import time
from collections.abc import Iterator
from concurrent.futures import as_completed
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from sim.campaign.blocks import Shard, cut, join
from sim.campaign.engines import processes, stop
from sim.cli import families
from sim.cli.families import Family, Settings
from sim.cli.run_output import RECORDING, REPORT, Ended, numbers_of
from sim.cli.terminal import err, out, output_folder
from sim.metrics.results import rows
from sim.plant.batch import SimulationFailed
from sim.scenario.one_body import parse_override


class Asked(NamedTuple):
    """What the command line says."""

    name: str
    changes: dict[str, Any]
    folder: Path | None
    workers: int
    only_trial: int | None
    record_trials: int
    overwrite: bool


class Block(NamedTuple):
    """What some trials gave."""

    shard: Shard
    flown: dict[str, Any]


def run(family: Family, asked: Asked) -> None:
    """Simulate, print, write."""
    loaded = families.load(asked.name, asked.changes)
    numbers = numbers_of(loaded.run, asked.only_trial)
    target = output_folder(asked.folder, asked.name, asked.overwrite)
    for warning in family.warnings(loaded):
        err.print(f"warning: {warning}", style="yellow", markup=False)
    started = time.perf_counter()
    blocks, stopped = _simulate(family, loaded, asked, numbers)
    failure = next((block.shard.failure for block in blocks if block.shard.failure), None)
    finished, metrics, _ = join([block.shard for block in blocks])
    wall = time.perf_counter() - started
    ended = Ended(asked.name, loaded, len(loaded.loops), len(numbers), finished, metrics, wall, failure, stopped)
    if not len(finished):
        ended.give_up()
    flown = next((block.flown for block in blocks if block.flown), {})
    ended.write_figures(target, asked.overwrite)
    if flown:
        configuration: Any = loaded
        family.write_report(target / REPORT, asked.name, loaded, flown)
        family.write_recording(target / RECORDING, asked.name, loaded, flown, configuration.model_dump(mode="json", exclude_none=True))
    ended.say_what()
    for table in family.tables(rows(metrics), loaded, len(finished)):
        out.print(table)
    ended.say_where(target)


def changes_of(overrides: list[str] | None, trials: int | None, seed: int | None) -> dict[str, Any]:
    """Dotted keys that the command line sets."""
    changes: dict[str, Any] = dict(parse_override(text) for text in overrides or [])
    return changes | ({} if trials is None else {"run.trials": trials}) | ({} if seed is None else {"run.seed": seed})


def _simulate(family: Family, loaded: Settings, asked: Asked, numbers: NDArray[np.int64]) -> tuple[list[Block], bool]:
    """Blocks that finished, and whether the user stopped the rest."""
    blocks: list[Block] = []
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=err, transient=True) as bar:
        task = bar.add_task(f"{len(numbers)} trials", total=len(numbers) * loaded.run.ticks * len(loaded.loops))
        try:
            for block in _blocks(family, loaded, asked, numbers, lambda done: bar.advance(task, done)):
                blocks.append(block)
                if block.shard.failure:
                    break
        except KeyboardInterrupt:
            return blocks, True
    return blocks, False


def _blocks(family: Family, loaded: Settings, asked: Asked, numbers: NDArray[np.int64], progress: Any) -> Iterator[Block]:
    cuts, recorded = cut(numbers, asked.workers), numbers[: asked.record_trials]
    if asked.workers == 1:
        for trials in cuts:
            size = len(trials)
            yield _fly(family, loaded, trials, recorded, lambda _: progress(size))  # noqa: B023  # called before the next
        return
    pool = processes(min(asked.workers, len(cuts)))
    try:
        waiting = [pool.submit(fly_again, asked.name, asked.changes, trials, recorded) for trials in cuts]
        for done in as_completed(waiting):
            block = done.result()
            progress(len(block.shard.trials) * loaded.run.ticks * len(loaded.loops))
            yield block
    finally:
        stop(pool)


def fly_again(name: str, changes: dict[str, Any], trials: NDArray[np.int64], recorded: NDArray[np.int64]) -> Block:
    """A block of trials in a process of its own."""
    family = families.family_of(name)
    assert family is not None
    return _fly(family, families.load(name, changes), trials, recorded, None)


def _fly(family: Family, loaded: Settings, trials: NDArray[np.int64], recorded: NDArray[np.int64], on_tick: Any) -> Block:
    wanted = recorded[np.isin(recorded, trials)]
    try:
        metrics, flown = family.simulate(loaded, trials, wanted, on_tick)
    except SimulationFailed as failure:
        return Block(Shard(trials, [], {}, str(failure)), {})
    return Block(Shard(trials, metrics, {}), flown if len(wanted) else {})
