"""What filters believed of a log, as a table."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa

from models.dynamics.state_layout import StateLayout
from sim.parts import Array
from sim.replay.replay import Replayed

STATISTICS = ("nis", "dof", "statistic", "declared")


def estimates(replayed: Replayed) -> pa.Table:
    """One row a filter, trial and tick; docs/replay.md defines the columns."""
    recording, layout = replayed.recording, replayed.layout
    ticks, trials, tables = recording.ticks, len(recording.trials), []

    def flat(channel: str) -> Array:
        """(ticks, trials, [agents,] ...) as (trials * ticks, agents or 1, ...)."""
        array = np.swapaxes(recording.channels[channel], 0, 1)
        return array.reshape(trials * ticks, 1 if channel == "time_s" else layout.agents or 1, -1)

    for name in recording.observers:
        columns: dict[str, Any] = {
            "trial": np.repeat(recording.trials, ticks),
            "tick": np.tile(np.arange(ticks), trials),
            "filter": pa.array([name] * (trials * ticks)),
            "loop": pa.array([replayed.loop] * (trials * ticks)),
            "time_s": flat("time_s")[:, 0, 0],
        }
        mean, sigma = flat(f"{name}/mean"), flat(f"{name}/sigma")
        for agent in np.arange(mean.shape[1]):
            before = "" if layout.agents is None else f"agent{agent + 1}_"
            columns |= {f"{before}{key}": mean[:, agent, i] for i, key in enumerate(layout.names[: mean.shape[-1]])}
            columns |= {f"{before}sigma_{key}": sigma[:, agent, i] for i, key in enumerate(error_names(layout)[: sigma.shape[-1]])}
            columns |= {f"{before}{part}": flat(f"{name}/{part}")[:, agent, 0] for part in STATISTICS}
            if recording.thresholds[name] is None:  # a filter without a detector says nothing about faults, not that there is none
                columns[f"{before}declared"] = pa.nulls(ticks * trials, pa.bool_())
        tables.append(pa.table(columns))
    return pa.concat_tables(tables, promote_options="default")


def error_names(layout: StateLayout) -> tuple[str, ...]:
    """Of the error coordinates: a quaternion's are those of a rotation vector."""
    turned = ("rotation1", "rotation2", "rotation3")
    return tuple(name for block in layout.blocks for name in (turned if len(block.names) > block.errors else block.names))
