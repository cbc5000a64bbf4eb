"""Tables of linear models and of margins."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from rich.table import Table

from sim.linear.linear_model import LinearModel
from sim.linear.margins import Margins
from sim.linear.of_loops import Case

# of the weakest of the three axes, the other two loops being closed as they are; `all`: of all three at once
COLUMNS = ("loop", "told", "believes", "is so", "gain", "gain, all", "deg", "ms", "disk", "disk, all")


def poles(model: LinearModel) -> Table:
    """Poles of a model in rad/s, with frequency and damping of those that ring."""
    table = Table(box=None, pad_edge=False)
    for column in ("pole, rad/s", "Hz", "damping"):
        table.add_column(column, justify="right")
    for pole in model.rates:
        if not np.isfinite(pole):
            table.add_row("delay", "", "")
        elif pole.imag >= 0.0:
            size = abs(pole)
            rings = pole.imag > 1e-9
            said = f"{pole.real:.4g} +- {pole.imag:.4g}i" if rings else f"{pole.real:.4g}"
            table.add_row(said, f"{size / (2.0 * np.pi):.4g}" if rings else "", f"{-pole.real / size:.3g}" if rings else "")
    return table


def margin_rows(cases: list[Case]) -> Iterator[tuple[str, ...]]:
    """Cells under COLUMNS, a row for each case."""
    for case in cases:
        situation, found = (case.loop, case.told, _mode(case.believed), _mode(case.mode)), case.margins
        if not found:
            yield (*situation, "switches", *[""] * 5)
        elif not found[0].stable:
            yield (*situation, "unstable", *[""] * 5)
        else:
            *single, every = found
            weakest = _weakest(single)
            yield (
                *situation,
                *(_gain(weakest), _gain(every)),
                *(f"{weakest.phase_deg:.3g}", f"{1e3 * weakest.delay_s:.3g}", f"{weakest.disk:.3g}", f"{every.disk:.3g}"),
            )


def margins(cases: list[Case]) -> Table:
    """The rows as a table, without columns that would be alike in all of them."""
    rows = list(margin_rows(cases))
    told, modes = any(case.told != "state" for case in cases), any(case.believed or case.mode for case in cases)
    shown = [True, told, modes, modes, *[True] * (len(COLUMNS) - 4)]
    table = Table(box=None, pad_edge=False)
    for i, column in enumerate(COLUMNS):
        if shown[i]:
            table.add_column(column.rpartition(", ")[2], no_wrap=True, justify="left" if i < 4 else "right")
    for row in rows:
        table.add_row(*(cell for cell, wanted in zip(row, shown, strict=True) if wanted))
    return table


def _mode(mode: int) -> str:
    return f"mode {mode + 1}" if mode else "healthy"


def _weakest(found: list[Margins]) -> Margins:
    """The least of each, over the axes."""
    return Margins(
        axis="weakest",
        stable=all(one.stable for one in found),
        gain_up=min(one.gain_up for one in found),
        gain_down=max(one.gain_down for one in found),
        phase_deg=min(one.phase_deg for one in found),
        delay_s=min(one.delay_s for one in found),
        disk=min(one.disk for one in found),
        crossover_rad_s=max(one.crossover_rad_s for one in found),
    )


def _gain(one: Margins) -> str:
    """Factors on the gain with which the loop is stable."""
    above = "" if np.isinf(one.gain_up) else f"< {one.gain_up:.3g}"
    below = f"> {one.gain_down:.3g}" if one.gain_down > 0.0 else ""
    return ", ".join(part for part in (below, above) if part) or "any"
