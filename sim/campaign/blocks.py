"""Trials in blocks that are simulated together, in this process or in several; no result depends on how they are cut."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.campaign.draws import draw
from sim.campaign.settings import Campaign
from sim.campaign.worker_processes import in_processes
from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.loop.lost_trials import LostTrial
from sim.loop.recorder import Recorder
from sim.loop.recording import Recording
from sim.metric import Metric
from sim.metrics.antenna_study import controllers, identified
from sim.metrics.evaluation import evaluate
from sim.metrics.trial_block import TrialBlock
from sim.plant.batch import SimulationFailed
from sim.user_code.user_code import UserCode

TRIALS_PER_BLOCK = 64  # where the cost of a trial has stopped to fall; 0.1 GB of recording


Progress = Callable[[float], None]


def cut(trials: NDArray[np.int64], workers: int) -> list[NDArray[np.int64]]:
    """Blocks of trials, at least one for each worker where there are enough trials."""
    count = max(int(np.ceil(len(trials) / TRIALS_PER_BLOCK)), min(workers, len(trials)))
    return [block for block in np.array_split(trials, count) if len(block)]


def simulate(
    scenario: Any,
    trials: NDArray[np.int64],
    recorded: NDArray[np.int64],
    user_code: UserCode | None = None,
    campaign: Campaign | None = None,
    on_tick: Callable[[str, int, Recorder], None] | None = None,
) -> TrialBlock:
    """Simulate a block of trials and evaluate it; a trial that breaks down harms no other.

    With a `campaign` each trial's plant, sensors, faults and start are those that it draws there.
    """
    variants = draw(campaign, scenario, trials).variants if campaign else None
    metrics: list[Metric] = []
    recordings: dict[str, Recording] = {}
    settings = getattr(scenario, "identification", None)
    whole: dict[str, Recording] = {}
    lost: dict[int, LostTrial] = {}
    for name in scenario.loop_names:
        system = build(scenario, trials, user_code, variants, name)
        recording = run(system, partial(on_tick, name) if on_tick else None, recorded)
        for one in recording.lost:
            told = one if name == "loop" else one._replace(cause=f"loop {name}: {one.cause}")
            lost[one.trial] = min(lost.get(one.trial, told), told, key=lambda broken: broken.tick)
        sound = recording.sound()
        if len(sound.flown):
            metrics += [metric.at(sound.flown, trials) for metric in evaluate(scenario, name, system, sound)]
        if settings is not None:
            whole[name] = recording
        shown = recording.select(np.flatnonzero(np.isin(recording.trials, _worth_recording(recording, recorded))))
        if len(shown.trials):
            recordings[name] = shown
    recordings = _kept(recordings, recorded, tuple(lost.values()))
    alive = np.array([trial for trial in trials.tolist() if trial not in lost], dtype=np.int64)
    own = (
        {name: controllers(recording.select(np.flatnonzero(np.isin(trials, alive)))) for name, recording in whole.items()}
        if settings
        else {}
    )
    flown = {name: found for name, found in own.items() if found is not None}
    if settings is not None and len(alive) and {settings.adaptive, settings.nominal} <= flown.keys():
        try:
            own_variants = variants.only(np.flatnonzero(np.isin(trials, alive))) if variants else None
            more, findings = identified(scenario, flown, lambda single: build(single, alive, user_code, own_variants))
        except (SimulationFailed, np.linalg.LinAlgError) as failure:
            return TrialBlock(alive, [], recordings, tuple(lost.values()), f"identification: {failure}")
        metrics += [metric.at(alive, trials) for metric in more]
        if (adaptive := recordings.get(settings.adaptive)) is not None:
            keep = np.flatnonzero(np.isin(alive, adaptive.trials))
            recordings[settings.adaptive] = replace(adaptive, findings={n: a[keep] for n, a in findings.items()})
    return TrialBlock(alive, [metric.of(trials, alive) for metric in metrics] if len(alive) else [], recordings, tuple(lost.values()))


def _kept(recordings: dict[str, Recording], recorded: NDArray[np.int64], lost: tuple[LostTrial, ...]) -> dict[str, Recording]:
    """What is left of the recordings of all loops.

    Of several loops the trials that broke down in none of them, or else the first that did and was recorded in all; of one loop both. All
    loops are as long.
    """
    broken = [one.trial for one in _first_first(lost) if all(one.trial in recording.trials for recording in recordings.values())]
    sound = [trial for trial in recorded.tolist() if trial not in {one.trial for one in lost}]
    keep = [*recorded.tolist(), *broken[:1]] if len(recordings) == 1 else sound or broken[:1]
    kept = {name: recording.select(np.flatnonzero(np.isin(recording.trials, keep))) for name, recording in recordings.items()}
    kept = {name: recording for name, recording in kept.items() if len(recording.trials)}
    end = max((recording.counted for recording in kept.values()), default=0)
    return {name: recording.until(end) for name, recording in kept.items()} if end else {}


def _worth_recording(recording: Recording, recorded: NDArray[np.int64]) -> NDArray[np.int64]:
    """Trials that are to be recorded; the first that broke down too, so that it can be looked at."""
    broken = [one.trial for one in _first_first(recording.lost)[:1]]
    return np.array([*recorded.tolist(), *broken], dtype=np.int64)


def _first_first(lost: tuple[LostTrial, ...]) -> list[LostTrial]:
    """By the tick at which they broke down, and of one tick by number: whoever asks gets the same first one."""
    return sorted(lost, key=lambda one: (one.tick, one.trial))


def simulate_all(
    scenario: Any,
    blocks: list[NDArray[np.int64]],
    recorded: NDArray[np.int64],
    workers: int,
    progress: Progress,
    user_code: UserCode | None = None,
    campaign: Campaign | None = None,
    on_tick: Callable[[str, int, Recorder], None] | None = None,
) -> Iterator[TrialBlock]:
    """Blocks as they finish; `progress` is told how many trial-ticks were done, `on_tick` sees the first block if there is one worker.

    Raises:
      WorkersLost: after all other blocks, if the process that flew one was lost time and again.
    """
    loops = len(scenario.loop_names)
    if workers == 1:
        for number, block in enumerate(blocks):

            def tick(loop: str, k: int, recorder: Recorder, size: int = len(block), first: bool = number == 0) -> None:
                progress(size / loops)
                if on_tick and first:
                    on_tick(loop, k, recorder)

            yield simulate(scenario, block, recorded, user_code, campaign, tick)
        return
    flown = in_processes(partial(simulate, scenario, recorded=recorded, user_code=user_code, campaign=campaign), blocks, workers)
    for finished in flown:
        progress((len(finished.trials) + len(finished.lost)) * scenario.run.ticks)
        yield finished
