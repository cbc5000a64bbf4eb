"""`nacs export`: give the signals of a run to another tool."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

from sim.bad_input import BadInput
from sim.cli.result_files import ResultFiles, interrupted_as
from sim.cli.terminal import out
from sim.export.register import FORMATS
from sim.outputs.register import OUTPUTS
from sim.series.signals import long_table
from sim.text.one_line import one_line

SIGNALS_FILE = OUTPUTS["signals"].file
_FORMATS = ", ".join(FORMATS)


def export(
    run: Annotated[Path, typer.Argument(metavar="RUN", help=f"folder of a run, or its {SIGNALS_FILE}")],
    to: Annotated[str, typer.Option("--to", metavar="FORMAT", help=f"one of {_FORMATS}")],
    file: Annotated[Path | None, typer.Option("--out", metavar="FILE", help="where to; default: signals.FORMAT in the folder")] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace the file if it is there")] = False,
) -> None:
    """Write the signals of a run's recorded trials as CSV, MAT, NetCDF or MCAP."""
    if to not in FORMATS:
        raise BadInput(f"--to {to}: there is no such format; there are {_FORMATS}")
    kind = FORMATS[to]
    if missing := [package for package in kind.needs if find_spec(package) is None]:
        raise BadInput(f"--to {to} needs {' and '.join(missing)}: pip install 'nacs-twin[data]'")
    source = run / SIGNALS_FILE if run.is_dir() else run
    if not source.is_file():
        raise BadInput(f"{one_line(str(run), 200)}: has no {SIGNALS_FILE}; name the folder of a run, as `nacs run` leaves it")
    target = file or source.with_suffix(kind.suffix)
    if target.is_dir():
        raise BadInput(f"--out {target}: is a folder; name a file")
    if target.exists() and not overwrite:
        raise BadInput(f"--out {target}: is there already; name another file or add --overwrite")
    files = ResultFiles(target.parent)
    with interrupted_as("nothing was written; the same command begins anew"):
        signals = long_table.read(source)
        files.write(target.name, lambda path: kind.write(path, signals))
    files.end_if_refused()
    out.print(f"{to.upper():10} {target}")
