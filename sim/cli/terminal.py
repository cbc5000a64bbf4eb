"""What the commands share at the terminal: consoles, exit codes, arguments, and where results go."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from sim.bad_input import BadInput
from sim.scenario import files

BAD_INPUT, FAILED, INTERRUPTED = 2, 3, 130

out, err = Console(highlight=False), Console(stderr=True, highlight=False, soft_wrap=True)

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
    elif folder.is_file():
        raise BadInput(f"--out {folder}: is a file; name a folder")
    elif folder.is_dir() and any(folder.iterdir()) and not overwrite:
        raise BadInput(f"--out {folder}: is not empty; {way_on}")
    nearest = folder
    while not nearest.exists():
        nearest = nearest.parent
    try:
        tempfile.TemporaryFile(dir=nearest).close()
    except OSError as refused:
        raise BadInput(f"--out {folder}: cannot be written ({refused.strerror}: {nearest}); name a folder that can") from None
    return folder
