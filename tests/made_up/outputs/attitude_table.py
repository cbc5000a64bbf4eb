"""`attitude.csv`: the true attitude of the recorded trials: one file adds an output."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sim.outputs.output import Flown, Output


def _write(path: Path, flown: Flown) -> None:
    rows = [
        (recording.trials[trial], *row)
        for recording in flown.recordings.values()
        for trial in range(len(recording.trials))
        for row in np.column_stack([recording.time, recording.channels["truth/state"][:, trial, :4]])
    ]
    np.savetxt(path, rows, delimiter=",", header="trial,time_s,q1,q2,q3,q4", comments="")


OUTPUT = Output("attitude", "attitude.csv", _write, hint=lambda path: ("Plot it", f"python plot.py {path}"))
