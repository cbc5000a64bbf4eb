"""What a laboratory's file holds: columns of numbers by name, whichever kind of file it is."""

from __future__ import annotations

import difflib
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.bad_input import BadInput
from sim.convert import comma_separated, hierarchical, matlab, robot_log
from sim.convert.map_file import FileMap


class Reader(NamedTuple):
    """How one kind of file is read.

    Attributes:
      columns: of a file, whole numbers as they are; raises BadInput.
      needs: packages of the extra `data`.
    """

    columns: Callable[[Path, FileMap], dict[str, NDArray[Any]]]
    needs: tuple[str, ...] = ()


READERS = {
    **dict.fromkeys((".csv", ".txt", ".tsv", ".dat"), Reader(comma_separated.columns)),
    ".mat": Reader(matlab.columns),
    **dict.fromkeys((".h5", ".hdf5"), Reader(hierarchical.columns, ("netCDF4",))),
    ".mcap": Reader(robot_log.columns, ("mcap",)),
}


@dataclass(frozen=True, eq=False)
class Source:
    """A file that was read.

    Attributes:
      path: of the file.
      columns: (rows,) each, which may differ in length from column to column.
    """

    path: Path
    columns: dict[str, NDArray[Any]]

    @classmethod
    def opened(cls, path: Path, file: FileMap) -> Source:
        """Read a file; raises BadInput, one line, if it cannot be read."""
        reader = READERS.get(path.suffix.lower())
        if path.is_dir():
            raise BadInput(f"{path}: is a folder; name a file")
        if not path.is_file():
            raise BadInput(f"{path}: there is no such file")
        if reader is None:
            raise BadInput(f"{path}: files {path.suffix or 'without an ending'} are not known; there are {', '.join(READERS)}")
        if missing := [package for package in reader.needs if find_spec(package) is None]:
            raise BadInput(f"{path}: needs {' and '.join(missing)}: pip install 'nacs-twin[data]'")
        try:
            columns = reader.columns(path, file)
        except OSError as refused:
            raise BadInput(f"{path}: cannot be read: {refused.strerror or (str(refused).splitlines() or ['damaged'])[0]}") from None
        if not columns:
            raise BadInput(f"{path}: has no column of numbers")
        if max(len(column) for column in columns.values()) < 2:
            raise BadInput(f"{path}: has fewer than two rows of numbers")
        return cls(path, columns)

    def whole(self, name: str) -> NDArray[Any]:
        """A column as it stands in the file, whole numbers as such; raises BadInput if there is none."""
        if name not in self.columns:
            near = difflib.get_close_matches(name, self.columns, n=1)
            known = f"did you mean {near[0]!r}?" if near else f"there are {', '.join(self.columns)}"
            raise BadInput(f"{self.path}: has no column {name!r}; {known}")
        return self.columns[name]

    def numbers(self, name: str) -> np.ndarray[Any, np.dtype[np.float64]]:
        """The same as floating-point numbers, NaN where nothing is."""
        return np.asarray(self.whole(name), dtype=float)
