"""Columns of an HDF5 file, which MAT files of version 7.3 are too."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.bad_input import BadInput
from sim.convert.map_file import FileMap


def columns(path: Path, file: FileMap) -> dict[str, NDArray[Any]]:  # noqa: ARG001  # readers share one signature
    """`group.name(1)` is the first column of a data set; raises BadInput, or OSError for a file that is none."""
    if find_spec("netCDF4") is None:
        raise BadInput(f"{path}: is HDF5 and needs netCDF4: pip install 'nacs-twin[data]'; or save it in MATLAB by save(..., '-v7')")
    import netCDF4  # noqa: PLC0415  # of an extra

    with netCDF4.Dataset(path) as whole:
        return dict(_below("", whole))


def _below(prefix: str, group: Any) -> Iterator[tuple[str, NDArray[Any]]]:
    """All columns in a group."""
    for name, variable in group.variables.items():
        if variable.dtype is not str and getattr(variable.dtype, "kind", "") in "iuf":
            yield from of_array(
                f"{prefix}{name}", np.ma.filled(variable[...], np.nan) if variable.dtype.kind == "f" else variable[...].data
            )
    for name, inner in group.groups.items():
        yield from _below(f"{prefix}{name}.", inner)


def of_array(name: str, array: NDArray[Any]) -> Iterator[tuple[str, NDArray[Any]]]:
    """A vector as it is, a matrix column by column, its longer side being the rows; nothing of what is no numbers."""
    if array.dtype.kind not in "biuf" or array.size < 2:
        return
    flat = np.squeeze(array)
    if flat.ndim == 1:
        yield name, flat
    elif flat.ndim == 2:
        upright = flat if flat.shape[0] >= flat.shape[1] else flat.T
        for number, column in enumerate(upright.T, 1):
            yield f"{name}({number})", column
