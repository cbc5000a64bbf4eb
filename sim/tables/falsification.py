"""Which candidate controllers a log falsifies, for a person at a terminal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rich.table import Table

from sim.replay.falsification import TESTS, AxisVerdict
from sim.text.table_style import counted, number, plain_table

MOST_ROWS = 40
AXIS = ("x (elevation)", "y", "z (azimuth)")


def candidates(several: Sequence[AxisVerdict]) -> Table:
    """Candidates of one axis by one loop's flights, trials of all blocks together: falsified by any of them is falsified."""
    first = several[0]
    ratio = np.concatenate([one.verdict.ratio for one in several], axis=1)  # (candidates, trials, tests)
    when = np.concatenate([one.when(one.verdict.first) for one in several], axis=1)
    falsified = np.isfinite(when).any(axis=-1)
    told = np.isfinite(ratio).any(axis=-1)
    count, gone = told.shape[1], falsified.any(axis=1)
    asked = first.asked
    caption = (
        f"asked: |T_er| < {number(asked.error_bound)}, |T_ur| < {number(asked.effort_limit)} N m/rad at high frequency, "
        f"less below {number(asked.zero * asked.pace)} rad/s; ratios: greatest of all instants, falsified from 1 on"
    )
    unfit = int(np.sum(gone))
    heading = f"axis {AXIS[first.axis]}, data of {first.loop}: {unfit} of {counted(len(gone), 'candidate')} falsified"
    table = plain_table(heading, caption + (f"; the first {MOST_ROWS} of {len(gone)} are shown" if len(gone) > MOST_ROWS else ""))
    table.add_column("candidate", overflow="fold")
    for column in ("verdict", f"in flights\nof {count}", "first\nat s", "by", "error\nratio", "effort\nratio"):
        table.add_column(column, justify="left" if column in ("verdict", "by") else "right", no_wrap=True)
    for i, name in enumerate(first.names[:MOST_ROWS]):
        verdict = "falsified" if gone[i] else "not falsified" if told[i].any() else "too little data"
        instant = np.nanmin(when[i]) if gone[i] else None
        by = TESTS[int(np.argwhere(when[i] == instant)[0, -1])] if gone[i] else "-"
        greatest = [number(float(np.nanmax(ratio[i, :, k])) if np.isfinite(ratio[i, :, k]).any() else None) for k in (0, 1)]
        table.add_row(name, verdict, str(int(np.sum(falsified[i]))), number(instant), by, *greatest)
    return table
