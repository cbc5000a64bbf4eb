"""`nacs new` and `nacs schema`: a scenario file to begin with, and what editors need to know of such files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from sim.bad_input import BadInput
from sim.cli.result_files import ResultFiles, interrupted_as
from sim.cli.terminal import out
from sim.replay.setting import DEFAULT
from sim.scenario import extension, files
from sim.scenario.described.commented import commented
from sim.scenario.described.schema import Schema
from sim.text.names import WHAT_A_NAME_IS, is_a_name
from sim.text.one_line import one_line


def new(
    name: Annotated[str, typer.Argument(metavar="NAME", help="of the file, which is called NAME.toml")],
    base: Annotated[str, typer.Option("--from", metavar="SCENARIO", help="scenario that it begins as, by name or path")] = DEFAULT,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace the file if it is there")] = False,
) -> None:
    """Write a scenario file with unit, default and meaning beside every key; it flies as it is."""
    path = Path(name if name.endswith(".toml") else f"{name}.toml")
    shown = one_line(str(path), 200)
    if not is_a_name(path.stem):
        raise BadInput(f"{shown}: cannot be a scenario's name: {WHAT_A_NAME_IS}")
    if path.is_dir():
        raise BadInput(f"{shown}: is a folder")
    if path.exists() and not overwrite:
        raise BadInput(f"{shown}: is there already; take another name or add --overwrite")
    scenario: Any = files.load(base)
    data = extension.read(extension.find(base), base)
    head = (
        f"# Made of {base} by `nacs new`; `nacs run {path}` flies it. docs/scenario-files.md has every key.\n"
        "# `# key = value` is a key that is not set, and what it then is: take the mark away to set it.\n"
        "# `# key: ...` is one without a value.\n\n"
    )
    results = ResultFiles(path.parent)
    with interrupted_as("nothing was written; the same command begins anew"):
        text = head + commented(data, files.dumped(scenario), scenario.family, Schema())
        results.write(path.name, lambda place: place.write_text(text, encoding="utf-8"))
    results.end_if_refused()
    out.print(f"{'Scenario':<10} {path}\n{'Fly it':<10} nacs run {path}")


def schema() -> None:
    """Print the JSON schema of scenario files, with which editors check and complete them."""
    typer.echo(json.dumps(Schema().whole(), indent=1, ensure_ascii=False))  # long, and nothing to be laid out
