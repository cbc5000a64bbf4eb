"""The plant with its sensors for other simulators."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from nacs.arguments import path as as_path
from nacs.errors import in_one_line
from nacs.nacs_error import NacsError
from nacs.scenarios import Source, load
from sim.fmu import fmu_file
from sim.whole_file import whole_file


def export_fmu(
    scenario: Source,
    file: str | Path,
    *,
    version: str | int = "3",
    set: Mapping[str, Any] | None = None,  # as the command calls it
    seed: int | None = None,
    overwrite: bool = False,
) -> Path:
    """Write plant and sensors as an FMU for co-simulation, as `nacs export-fmu` does; needs the extra `fmi`.

    >>> nacs.export_fmu("nacs/fault-free", "plant.fmu").name
    'plant.fmu'

    Args:
      scenario: of one body, as for `nacs.run`.
      file: where to.
      version: of the interface, 3 or 2.
      set: dotted keys to values, taken instead of what the scenario says.
      seed: root seed; default: the scenario's.
      overwrite: replace the file if it is there.

    Raises:
      NacsError: bad input, a package that is not there, or a file that cannot be written.
    """
    loaded, path = load(scenario, set=set, seed=seed), as_path("file", file)
    with in_one_line():
        fmu_file.check(loaded, str(version))
        if path.exists() and not overwrite:
            raise NacsError(f"{path}: is there already; name another file or say overwrite=True")
        with whole_file(path) as temporary:
            fmu_file.write(temporary, loaded, str(version))
    return path
