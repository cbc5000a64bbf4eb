"""What the commands share at the terminal: consoles, exit codes, arguments, and where results go."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from sim.bad_input import BadInput
from sim.scenario import files
from sim.text.one_line import one_line

BAD_INPUT, FAILED, INTERRUPTED = 2, 3, 130

# no markup: what is printed holds names, titles and paths of the user's, in which a bracket is a bracket
out, err = Console(highlight=False, markup=False), Console(stderr=True, highlight=False, markup=False, soft_wrap=True)

Name = Annotated[str, typer.Argument(metavar="SCENARIO", help="family/name as `nacs list` shows it, or a path to a TOML file")]
Trials = Annotated[int | None, typer.Option(help="number of trials; default: the scenario's")]
Seed = Annotated[int | None, typer.Option(help="root seed; default: the scenario's")]
Overrides = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="take this instead of what the file says (may be repeated)")
]


def changes_of(overrides: list[str] | None, trials: int | None, seed: int | None) -> dict[str, Any]:
    """Dotted keys that the command line sets."""
    changes: dict[str, Any] = dict(files.parse_override(text) for text in overrides or [])
    return changes | ({} if trials is None else {"run.trials": trials}) | ({} if seed is None else {"run.seed": seed})


def load(name: str, trials: int | None, seed: int | None, overrides: list[str] | None, guests: tuple[str, ...] = ()) -> Any:
    """Scenario with what the command line says instead; `guests` are observers that the user brings along."""
    return files.load(name, changes_of(overrides, trials, seed), guests)


def output_folder(folder: Path | None, name: str, overwrite: bool, way_on: str = "name another folder or add --overwrite") -> Path:
    """Where results go; made only when there is something to write. `way_on` is what to do about a folder that is not empty."""
    if folder is None:
        stem = Path("runs") / Path(name).with_suffix("")
        if Path(name).is_absolute() or ".." in Path(name).parts:
            stem = Path("runs") / Path(name).stem
        folder, number = stem, 1
        while folder.exists():
            number += 1
            folder = stem.with_name(f"{stem.name}-{number}")
    try:
        return _checked(folder, overwrite, way_on)
    except OSError as refused:
        raise BadInput(f"--out {one_line(str(folder), 200)}: cannot be written ({refused.strerror}); name a folder that can") from None


def _checked(folder: Path, overwrite: bool, way_on: str) -> Path:
    """The folder, if results can be written there; raises BadInput, or OSError for a name that leads nowhere."""
    if folder.exists() and not folder.is_dir():
        raise BadInput(f"--out {folder}: is a file; name a folder")
    if folder.is_dir() and any(folder.iterdir()) and not overwrite:
        raise BadInput(f"--out {folder}: is not empty; {way_on}")
    nearest = folder
    while not nearest.exists():
        if nearest.is_symlink():
            raise BadInput(f"--out {folder}: {nearest} is a link that leads nowhere; name a folder")
        nearest = nearest.parent
    try:
        tempfile.TemporaryFile(dir=nearest).close()
    except OSError as refused:
        raise BadInput(f"--out {folder}: cannot be written ({refused.strerror}: {nearest}); name a folder that can") from None
    return folder
