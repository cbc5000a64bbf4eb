"""Signals as a MAT file: a struct for each loop, with an array for each signal and a struct of what they are."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import savemat

from sim.bad_input import BadInput
from sim.export.export_format import ExportFormat
from sim.series.signals.signal import LoopSignals, Signals

LONGEST = 63  # characters of a name in MATLAB
LARGEST = 2**31 - 1  # bytes of an array in a MAT file of version 5


def valid_names(names: Iterable[str]) -> dict[str, str]:
    """Each name as MATLAB takes it: letters, digits and underscores, a letter first, at most 63 of them, and no two alike."""
    found: dict[str, str] = {}
    taken: set[str] = set()
    for name in names:
        plain = re.sub(r"[^A-Za-z0-9_]", "_", name)
        plain = (plain if re.match(r"[A-Za-z]", plain) else f"x{plain}")[:LONGEST]
        one, number = plain, 1
        while one in taken:
            number += 1
            one = f"{plain[: LONGEST - 1 - len(str(number))]}_{number}"
        found[name] = one
        taken.add(one)
    return found


def _loop(loop: LoopSignals) -> dict[str, Any]:
    """Arrays (trials, [agents,] ticks, ...) by name, beside `time`, `trial`, `agent` and `about`."""
    names = valid_names(["time", "trial", "agent", "about", *(signal.variable for signal in loop)])
    arrays = {names[signal.variable]: np.asarray(signal.values) for signal in loop}
    about = {
        names[signal.variable]: {
            "name": signal.name,
            "unit": signal.unit,
            "frame": signal.frame,
            "meaning": signal.meaning,
            "axes": ", ".join(signal.dims),
            "columns": np.array(signal.columns, dtype=object),
        }
        for signal in loop
    }
    agents = {"agent": loop.agent_numbers} if loop.agents is not None else {}
    return {"time": loop.time, "trial": loop.trials, **agents, "about": about, **arrays}


def _write(path: Path, signals: Signals) -> None:
    loops = valid_names(signals.loops)
    for signal in (one for loop in signals.loops.values() for one in loop):
        if signal.values.nbytes > LARGEST:
            size = f"{signal.values.nbytes / 1e9:.1f} GB"
            raise BadInput(f"--to mat: {signal.name} has {size}, a MAT file of version 5 holds 2 GB; record fewer trials, or --to netcdf")
    with path.open("wb") as file:  # given a path, it would add a suffix
        savemat(
            file,
            {loops[name]: _loop(loop) for name, loop in signals.loops.items()},
            long_field_names=True,
            do_compression=True,
            oned_as="column",
        )


FORMAT = ExportFormat("mat", ".mat", _write)
