"""What a block of trials gave that were simulated together, and blocks put together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.loop.lost_trials import LostTrial
from sim.loop.recording import Recording
from sim.metric import Metric


@dataclass(frozen=True, eq=False)
class TrialBlock:
    """What a block of trials gave.

    Attributes:
      trials: numbers of those that did not break down, (trials,).
      metrics: one value a trial each.
      recordings: of every closed loop, by name: the trials that were to be recorded, and of one that broke down what there was until then.
      lost: trials that broke down.
      failure: what went wrong with the block as a whole; there are no metrics then.
    """

    trials: NDArray[np.int64]
    metrics: list[Metric]
    recordings: dict[str, Recording]
    lost: tuple[LostTrial, ...] = ()
    failure: str | None = None


def join(blocks: list[TrialBlock]) -> tuple[NDArray[np.int64], list[Metric], dict[str, Recording]]:
    """Trials in order, with their metrics and recordings, of blocks that finished in any order."""
    blocks = sorted((block for block in blocks if len(block.trials) and block.metrics), key=lambda block: int(block.trials[0]))
    if not blocks:
        return np.zeros(0, dtype=np.int64), [], {}
    rows: dict[tuple[str, str, str, str], list[tuple[int, NDArray[np.floating]]]] = {}
    for number, block in enumerate(blocks):
        for metric in block.metrics:
            rows.setdefault(metric.key, []).append((number, metric.values))
    metrics = []
    for key, parts in rows.items():
        found = dict(parts)
        # a phase that no trial of a block has is no number there
        values = [found.get(number, np.full(len(block.trials), np.nan)) for number, block in enumerate(blocks)]
        metrics.append(Metric(*key, np.concatenate(values)))
    parts_of: dict[str, list[Recording]] = {}
    for block in blocks:
        for name, recording in block.recordings.items():
            parts_of.setdefault(name, []).append(recording)
    return np.concatenate([block.trials for block in blocks]), metrics, {name: Recording.join(parts) for name, parts in parts_of.items()}
