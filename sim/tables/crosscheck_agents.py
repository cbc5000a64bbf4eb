"""Table of a cross-check of several agents."""

from __future__ import annotations

import numpy as np
from rich.table import Table

from sim.crosscheck.agents import CHECKED_S, AgentsCrossCheck
from sim.text.table_style import number, plain_table


def divergence(found: AgentsCrossCheck) -> Table:
    """When each quantity passes its threshold in any agent, and how large it is in the worst agent, mean over trials."""
    caption = "greatest of all agents, mean over trials"
    if found.limit is not None:
        first = next(iter(found.quantities.values()))
        said = "stays" if found.passed else "does not stay"
        model, limit = next(iter(found.apart)), f"{found.limit:g} {first.unit}"
        caption += f"; {model} {said} within {limit} of the plant over {CHECKED_S:g} s ({found.reached:.1e})"
    table = plain_table(f"Divergence from the plant, open loop under the commands of {found.loop}", caption)
    for heading in ("model", "quantity"):
        table.add_column(heading, no_wrap=True)
    table.add_column("passes", justify="right", no_wrap=True)
    for tick in found.ticks:
        table.add_column(f"{found.time[tick]:g} s", justify="right")
    for model, quantities in found.apart.items():
        for name, apart in quantities.items():
            of = found.quantities[name]
            worst = np.max(apart, axis=-1)
            beyond = worst > of.threshold
            when = np.where(beyond.any(axis=0), found.time[np.argmax(beyond, axis=0)], np.inf)
            told = (
                f"{of.threshold:g} {of.unit} at {np.median(when):.3g} s"
                if np.isfinite(np.median(when))
                else f"{of.threshold:g} {of.unit} never"
            )
            cells = [_short(float(np.mean(worst[tick]))) for tick in found.ticks]
            table.add_row(model, f"{name} [{of.unit}]".replace("[", r"\["), told, *cells)
    return table


def _short(value: float) -> str:
    return f"{value:.1e}" if 0.0 < abs(value) < 1e-3 else number(value)
