"""`nacs linearize`: the plant of a scenario as a linear model, and the stability margins of its laws."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from sim.bad_input import BadInput
from sim.cli.result_files import ResultFiles, interrupted_as
from sim.cli.terminal import Name, Overrides, load, out
from sim.linear.linearize import WAYS, linearize
from sim.linear.model_file import WRITERS, write
from sim.linear.of_loops import cases
from sim.tables import linear as tables
from sim.text.table_style import counted


def linearize_scenario(
    name: Name = "nacs/fault-free",
    loop: Annotated[str | None, typer.Option(metavar="NAME", help="which of several loops; margins: default all")] = None,
    at: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="about where the first trial is then; default: at rest on the first reference")
    ] = None,
    file: Annotated[Path | None, typer.Option("--out", metavar="FILE", help="write the model, as .npz or .mat")] = None,
    sampled: Annotated[bool, typer.Option("--sampled", help="at the control period; default: continuous")] = False,
    way: Annotated[str, typer.Option(metavar="WAY", help="differences of the twin's step, or mujoco, its own derivatives")] = WAYS[0],
    margins: Annotated[bool, typer.Option("--margins", help="show gain, phase, delay and disk margins of the loops")] = False,
    flown: Annotated[bool, typer.Option("--flown", help="margins of the loops as they are flown, with their filters")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace the file if it is there")] = False,
    overrides: Overrides = None,
) -> None:
    """Linearise a plant with its sensors' delays: A, B, C, D, poles, and the margins of its control laws."""
    scenario = load(name, None, None, overrides)
    if file is not None:
        _check(file, overwrite)
    with interrupted_as("nothing was written"):
        model = linearize(scenario, loop, at, sampled, way)  # type: ignore[arg-type]  # refused in one line if it is no way
        out.print(
            f"{counted(len(model.A), 'state')}: {', '.join(model.state.names)}\n"
            f"{counted(model.B.shape[1], 'input')}: {', '.join(model.input.names)}\n"
            f"{counted(len(model.C), 'output')}: {', '.join(model.output.names)}\n"
            f"drift at the operating point, greatest: {np.max(np.abs(model.drift)):.3g}\n"
        )
        out.print(tables.poles(model))
        if margins or flown:
            out.print()
            out.print(tables.margins(cases(scenario, loop, at, flown)))
        if file is None:
            return
        files = ResultFiles(file.parent)
        files.write(file.name, lambda path: write(path, model, file.suffix))
    files.end_if_refused()
    out.print(f"\nmodel      {file}")


def _check(file: Path, overwrite: bool) -> None:
    """Raise BadInput if a model cannot be written there."""
    if file.suffix not in WRITERS:
        raise BadInput(f"--out {file}: must end in {' or '.join(WRITERS)}")
    if file.is_dir():
        raise BadInput(f"--out {file}: is a folder; name a file")
    if file.exists() and not overwrite:
        raise BadInput(f"--out {file}: is there already; name another file or add --overwrite")
