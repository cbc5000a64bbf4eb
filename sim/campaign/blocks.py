"""Trials in shards: blocks that are simulated together, in this process or in several; no result depends on how they are cut."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import as_completed
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.campaign.draws import draw
from sim.campaign.engines import processes, stop
from sim.campaign.settings import Campaign
from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.loop.recorder import Recorder
from sim.loop.recording import RecordedRunFailed, Recording
from sim.metrics.antenna_study import Controllers, controllers, identified
from sim.metrics.evaluation import evaluate
from sim.metrics.one_body import Metric
from sim.plant.batch import SimulationFailed
from sim.user_code.user_code import UserCode

TRIALS_PER_SHARD = 64  # where the cost of a trial has stopped to fall; 0.1 GB of recording


@dataclass(frozen=True, eq=False)
class Shard:
    """What a block of trials gave; after a failure the recording ends early and there are no metrics.

    Attributes:
      trials: their numbers, (trials,).
      metrics: one value a trial each.
      recordings: of every closed loop, by name: the trials that were to be recorded; the failed one after a failure.
      failure: what went wrong.
    """

    trials: NDArray[np.int64]
    metrics: list[Metric]
    recordings: dict[str, Recording]
    failure: str | None = None


Progress = Callable[[float], None]


def cut(trials: NDArray[np.int64], workers: int) -> list[NDArray[np.int64]]:
    """Blocks of trials, at least one for each worker where there are enough trials."""
    count = max(int(np.ceil(len(trials) / TRIALS_PER_SHARD)), min(workers, len(trials)))
    return [block for block in np.array_split(trials, count) if len(block)]


def simulate(
    scenario: Any,
    trials: NDArray[np.int64],
    recorded: NDArray[np.int64],
    user_code: UserCode | None = None,
    campaign: Campaign | None = None,
    on_tick: Callable[[int, Recorder], None] | None = None,
) -> Shard:
    """Simulate a block of trials and evaluate it; a failed simulation is a result, not an exception.

    With a `campaign` each trial's plant, sensors, faults and start are those that it draws there.
    """
    variants = draw(campaign, scenario, trials).variants if campaign else None
    metrics: list[Metric] = []
    recordings: dict[str, Recording] = {}
    flown: dict[str, Controllers] = {}
    for name in scenario.loop_names:
        system = build(scenario, trials, user_code, variants, name)
        try:
            recording = run(system, on_tick, recorded)
        except RecordedRunFailed as failure:
            kept = failure.recording
            where = np.flatnonzero(kept.trials == failure.trial)
            text = str(failure) if name == "loop" else f"loop {name}: {failure}"
            return Shard(trials, [], {name: kept.select(where)} if kept.ticks and len(where) else {}, text)
        metrics += evaluate(scenario, name, system, recording)
        if (found := controllers(recording)) is not None:
            flown[name] = found
        keep = np.flatnonzero(np.isin(recording.trials, recorded))
        if len(keep):
            recordings[name] = recording.select(keep)
    settings = getattr(scenario, "identification", None)
    if settings is not None and {settings.adaptive, settings.nominal} <= flown.keys():
        try:
            more, findings = identified(scenario, flown, lambda single: build(single, trials, user_code, variants))
        except SimulationFailed as failure:
            return Shard(trials, [], recordings, f"identification: {failure}")
        metrics += more
        if (adaptive := recordings.get(settings.adaptive)) is not None:
            keep = np.flatnonzero(np.isin(trials, recorded))
            recordings[settings.adaptive] = replace(adaptive, findings={n: a[keep] for n, a in findings.items()})
    return Shard(trials, metrics, recordings)


def simulate_all(
    scenario: Any,
    blocks: list[NDArray[np.int64]],
    recorded: NDArray[np.int64],
    workers: int,
    progress: Progress,
    user_code: UserCode | None = None,
    campaign: Campaign | None = None,
    on_tick: Callable[[int, Recorder], None] | None = None,
) -> Iterator[Shard]:
    """Shards as they finish; `progress` is told how many trial-ticks were done, `on_tick` sees the first block if there is one worker."""
    loops = len(scenario.loop_names)
    if workers == 1:
        for number, block in enumerate(blocks):

            def tick(k: int, recorder: Recorder, size: int = len(block), first: bool = number == 0) -> None:
                progress(size / loops)
                if on_tick and first:
                    on_tick(k, recorder)

            yield simulate(scenario, block, recorded, user_code, campaign, tick)
        return
    pool = processes(min(workers, len(blocks)))
    try:
        waiting = [pool.submit(simulate, scenario, block, recorded, user_code, campaign) for block in blocks]
        for done in as_completed(waiting):
            shard = done.result()
            progress(len(shard.trials) * scenario.run.ticks)
            yield shard
    finally:
        stop(pool)


def join(shards: list[Shard]) -> tuple[NDArray[np.int64], list[Metric], dict[str, Recording]]:
    """Trials in order, with their metrics and recordings, of shards that finished in any order."""
    shards = sorted((s for s in shards if s.metrics), key=lambda s: int(s.trials[0]))
    if not shards:
        return np.zeros(0, dtype=np.int64), [], {}
    rows: dict[tuple[str, str, str, str], list[tuple[int, NDArray[np.floating]]]] = {}
    for number, shard in enumerate(shards):
        for metric in shard.metrics:
            rows.setdefault(metric[:4], []).append((number, metric.values))
    metrics = []
    for key, parts in rows.items():
        found = dict(parts)
        # a phase that no trial of a shard has is no number there
        values = [found.get(number, np.full(len(shard.trials), np.nan)) for number, shard in enumerate(shards)]
        metrics.append(Metric(*key, np.concatenate(values)))
    parts_of: dict[str, list[Recording]] = {}
    for shard in shards:
        for name, recording in shard.recordings.items():
            parts_of.setdefault(name, []).append(recording)
    return np.concatenate([s.trials for s in shards]), metrics, {name: Recording.join(parts) for name, parts in parts_of.items()}
