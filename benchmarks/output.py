"""What it costs to keep a run: time and size of every file that `nacs run` leaves."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.measure import cpu_seconds, interleave, one_core
from benchmarks.show import figure, table
from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.metrics.one_body import evaluate
from sim.metrics.results import write_summary, write_trials
from sim.report.register import write_report
from sim.rerun.sink import write_recording
from sim.scenario.files import load
from sim.scenario.one_body import Scenario

NAME = "nacs/wheel-failure"
ROUNDS = 5
SIZES = (1, 10)  # trials, all recorded


def writers(scenario: Scenario, trials: int, folder: Path) -> dict[str, Callable[[], object]]:
    """What is done after a run, by the file that it makes."""
    system = build(scenario, np.arange(trials))
    recording, assembly, seed = run(system), system.plant.assembly, scenario.run.seed
    metrics = evaluate(recording, assembly)
    feedback, settings = scenario.law.feedback, scenario.model_dump(mode="json", exclude_none=True)
    names = ("recording.rrd", "report.png", "trials.parquet", "summary.json")
    rrd, png, parquet, summary = (folder / name for name in names)
    return {
        "(metrics)": partial(evaluate, recording, assembly),
        rrd.name: partial(write_recording, rrd, NAME, recording, assembly, feedback, settings),
        png.name: partial(write_report, png, NAME, scenario, {"loop": recording}),
        parquet.name: partial(write_trials, parquet, NAME, seed, recording.trials, metrics),
        summary.name: partial(write_summary, summary, NAME, seed, trials, 1.0, 1.0, metrics),
    }


def output() -> None:
    """Print the table."""
    scenario, cells = load(NAME), dict[str, list[str]]()
    with one_core(), TemporaryDirectory() as name:
        folder = Path(name)
        for trials in SIZES:
            works = writers(scenario, trials, folder)
            taken = interleave(ROUNDS, [partial(cpu_seconds, work) for work in works.values()])
            for file, seconds in zip(works, taken, strict=True):
                path = folder / file
                size = figure(path.stat().st_size / 1024) if path.exists() else "-"
                cells.setdefault(file, []).extend((figure(1e3 * median(seconds)), size))
    table(
        f"Keeping a run of {NAME}, {scenario.run.ticks} ticks, five observers",
        ("", *(f"{trials} trial{'s' * (trials > 1)}, {unit}" for trials in SIZES for unit in ("ms", "KiB"))),
        [(file, *row) for file, row in cells.items()],
        f"CPU time on one core, medians of {ROUNDS} interleaved rounds. All trials are recorded; report.png shows the first.",
    )


if __name__ == "__main__":
    output()
