"""What to say of something that went wrong: one line, for the command as for whoever calls from Python."""

from __future__ import annotations

import os
import traceback

import numpy as np

from estimation.gaussian import LostDefiniteness
from sim.bad_input import BadInput
from sim.cli.terminal import BAD_INPUT, FAILED
from sim.plant.batch import SimulationFailed

SHOW_TRACEBACK = "NACS_TRACEBACK"  # environment variable: let an error through, for whoever looks for its cause


def in_words(wrong: Exception) -> tuple[int, str]:
    """Exit code, and what to say of something that went wrong where nobody expected it."""
    if isinstance(wrong, BadInput):
        return BAD_INPUT, str(wrong)
    if isinstance(wrong, OSError):
        place = f"{wrong.filename}: " if wrong.filename is not None else ""
        return FAILED, f"{place}{wrong.strerror or wrong}"
    if isinstance(wrong, MemoryError):
        return FAILED, "out of memory; fewer trials, ticks, recorded trials or workers need less"
    if isinstance(wrong, OverflowError):  # NumPy's numbers become infinite, those of the settings refuse to
        return BAD_INPUT, "a number of the input, or its square, is beyond what can be computed with"
    if isinstance(wrong, np.linalg.LinAlgError):
        return FAILED, f"numeric failure: {wrong}"
    if isinstance(wrong, RecursionError):
        return BAD_INPUT, "something that was read is nested too deeply"
    if isinstance(wrong, SimulationFailed | LostDefiniteness):
        return FAILED, str(wrong)
    frame = traceback.extract_tb(wrong.__traceback__)[-1]
    place = f"{os.path.basename(os.path.dirname(frame.filename))}/{os.path.basename(frame.filename)}:{frame.lineno}"
    what = f"{type(wrong).__name__}{f': {wrong}' if str(wrong) else ''}"
    return FAILED, f"{what} ({place}); this is a defect of the twin, {SHOW_TRACEBACK}=1 shows where it comes from"
