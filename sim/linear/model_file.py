"""A linear model as a file for other tools: NumPy's `.npz`, or `.mat` for MATLAB, whose `ss(A, B, C, D)` takes its arrays."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import savemat

from sim.linear.linear_model import LinearModel


def _npz(path: Path, arrays: dict[str, Any]) -> None:
    with path.open("wb") as file:  # given a path, it would add a suffix
        np.savez(file, **arrays)


def _mat(path: Path, arrays: dict[str, Any]) -> None:
    texts = {name: array.astype(object) for name, array in arrays.items() if getattr(array, "dtype", np.dtype(float)).kind == "U"}
    with path.open("wb") as file:
        savemat(file, arrays | texts, oned_as="column")


WRITERS: dict[str, Callable[[Path, dict[str, Any]], None]] = {".npz": _npz, ".mat": _mat}


def write(path: Path, model: LinearModel, suffix: str) -> None:
    """Write A, B, C, D, drift, point, dt (0: continuous) and names and units of states, inputs and outputs in the format of a suffix."""
    WRITERS[suffix](path, model.arrays())
