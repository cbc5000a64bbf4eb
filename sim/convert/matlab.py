"""Columns of a MAT file: arrays and fields of structs; of a matrix each column, counted from one."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from sim.bad_input import BadInput
from sim.convert import hierarchical
from sim.convert.hierarchical import of_array
from sim.convert.map_file import FileMap


def columns(path: Path, file: FileMap) -> dict[str, NDArray[Any]]:
    """`log.q(1)` is the first column of the field `q` of the struct `log`; raises BadInput."""
    try:
        whole = loadmat(path, simplify_cells=True)
    except NotImplementedError:  # version 7.3, which is HDF5
        return hierarchical.columns(path, file)
    except (MatReadError, ValueError, TypeError) as broken:
        raise BadInput(f"{path}: cannot be read as a MAT file: {(str(broken).splitlines() or ['damaged'])[0]}") from None
    return dict(_below("", {name: value for name, value in whole.items() if not name.startswith("__")}))


def _below(name: str, value: Any) -> Iterator[tuple[str, NDArray[Any]]]:
    """All columns in a value."""
    if isinstance(value, dict):
        for key, part in value.items():
            yield from _below(f"{name}.{key}" if name else key, part)
    elif isinstance(value, np.ndarray):
        yield from of_array(name, value)
