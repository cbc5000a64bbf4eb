"""`nacs export-fmu`: the plant with its sensors for Simulink and other simulators."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from sim.bad_input import BadInput
from sim.cli.result_files import ResultFiles, interrupted_as
from sim.cli.terminal import Name, Overrides, Seed, load, out
from sim.fmu import fmu_file

_VERSIONS = " or ".join(fmu_file.STANDARDS)


def export_fmu(
    name: Name,
    file: Annotated[Path, typer.Option("--out", metavar="FILE", help="where to")] = Path("plant.fmu"),
    version: Annotated[str, typer.Option("--fmi", metavar="VERSION", help=f"of the interface, {_VERSIONS}")] = "3",
    seed: Seed = None,
    overrides: Overrides = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace the file if it is there")] = False,
) -> None:
    """Write the plant with its sensors as an FMU: torques in, readings and truth out, for co-simulation."""
    loaded: Any = load(name, None, seed, overrides)
    fmu_file.check(loaded, version)
    if file.is_dir():
        raise BadInput(f"--out {file}: is a folder; name a file")
    if file.exists() and not overwrite:
        raise BadInput(f"--out {file}: is there already; name another file or add --overwrite")
    files = ResultFiles(file.parent)
    with interrupted_as("nothing was written; the same command begins anew"):
        files.write(file.name, lambda path: fmu_file.write(path, loaded, version))
    files.end_if_refused()
    out.print(f"FMI {version}.0    {file}")
