"""What a campaign costs beyond its batches: draws, tables, shards on disk, and the conclusion."""

from __future__ import annotations

import io
import time
from collections import defaultdict
from collections.abc import Callable
from contextlib import ExitStack, redirect_stderr, redirect_stdout
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

from benchmarks.measure import one_core
from benchmarks.show import figure, table
from sim.campaign import shard as campaign_shard
from sim.campaign.store import Store
from sim.cli.commands import campaign as command_campaign

NAME = "nacs-wheel-failure"
SIZES = (50, 200)  # trials, in shards of 50

PARTS = {
    "batch": ((campaign_shard, "build"), (campaign_shard, "run"), (campaign_shard, "evaluate")),
    "shards": ((command_campaign, "fly"),),
    "disk": ((Store, "keep"), (Store, "merge")),
}


def spent(trials: int) -> dict[str, float]:
    """CPU seconds of `nacs campaign` in one process, and of its parts."""
    seconds: dict[str, float] = defaultdict(float)

    def clocked(part: str, work: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*args: Any, **kwargs: Any) -> Any:
            start = time.process_time()
            try:
                return work(*args, **kwargs)
            finally:
                seconds[part] += time.process_time() - start

        return timed

    with ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory())) / "campaign"
        stack.enter_context(redirect_stdout(io.StringIO()))
        stack.enter_context(redirect_stderr(io.StringIO()))
        for part, places in PARTS.items():
            for owner, name in places:
                stack.enter_context(patch.object(owner, name, clocked(part, getattr(owner, name))))
        clocked("all", command_campaign.campaign)(NAME, folder=folder, workers=1, trials=trials)
    return seconds


def campaign() -> None:
    """Print the table."""
    with one_core():
        spent(2)  # imports
        few, many = (spent(trials) for trials in SIZES)
    rows = []
    for name, trials, seconds in (
        (f"{SIZES[0]} trials", SIZES[0], few),
        (f"{SIZES[1]} trials", SIZES[1], many),
        ("each further trial", SIZES[1] - SIZES[0], {part: many[part] - few[part] for part in many}),
    ):
        batch, shards, disk = (seconds[part] for part in PARTS)
        parts = (batch, shards - batch, disk, seconds["all"] - shards - disk, seconds["all"] - batch)
        rows.append((name, *(figure(1e3 * part / trials) for part in parts)))
    table(
        f"The campaign {NAME}, ms of CPU a trial",
        ("", "batch", "draws, tables", "disk", "conclusion", "beyond the batch"),
        rows,
        "In one process on one core. batch: building, flying and evaluating the trials, which they would cost without a campaign; "
        "conclusion: intervals, report, recording of the ensemble; each further trial: the difference of the two rows.",
    )


if __name__ == "__main__":
    campaign()
