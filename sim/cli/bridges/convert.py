"""`nacs convert`: read a laboratory's file as a flight log, or propose how it is to be read."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from sim.bad_input import BadInput
from sim.cli.plausible_log import check_plausible
from sim.cli.result_files import ResultFiles, interrupted_as
from sim.cli.terminal import err, out
from sim.replay.setting import DEFAULT
from sim.scenario import files
from sim.text.table_style import counted


def convert(
    source: Annotated[Path, typer.Argument(metavar="LAB.csv", help="columns of numbers: CSV, MAT, HDF5, or MCAP with JSON messages")],
    map_file: Annotated[Path | None, typer.Option("--map", metavar="MAP.toml", help="how its columns are read; docs/convert.md")] = None,
    file: Annotated[Path | None, typer.Option("--out", metavar="LOG.parquet", help="flight log to write; default: beside the file")] = None,
    inspect: Annotated[bool, typer.Option("--inspect", help="print a map that names and physics propose; writes nothing")] = False,
    scenario: Annotated[str | None, typer.Option(help="with --inspect: whose plant the file is of; default: the NACS as published")] = None,
    trust: Annotated[bool, typer.Option("--trust", help="go on with a log in which units, order or signs look wrong")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace the log if it is there")] = False,
) -> None:
    """Make a flight log, which `nacs replay` reads, of a laboratory's CSV, MAT, HDF5 or MCAP file."""
    if inspect:
        if map_file is not None or file is not None:
            raise BadInput("--inspect: proposes a map and writes nothing; leave --map and --out away")
        out.print(_proposal(source, scenario), soft_wrap=True, end="")
        return
    if map_file is None:
        raise BadInput(f"--map: is missing; `nacs convert {source} --inspect > map.toml` proposes one")
    if scenario is not None:
        raise BadInput("--scenario: belongs to --inspect; a map says it as scenario = ...")
    target = file or source.with_suffix(".parquet")
    if target.is_dir():
        raise BadInput(f"--out {target}: is a folder; name a file")
    if target.exists() and not overwrite:
        raise BadInput(f"--out {target}: is there already; name another file or add --overwrite")
    results = ResultFiles(target.parent)
    with interrupted_as("nothing was written; the same command begins anew"):
        table, said, unused = _converted(source, map_file, trust)
        results.write(target.name, lambda path: _write(table, path))
    results.end_if_refused()
    out.print(f"{said}\n{'Log':<10} {target}\n{'Replay it':<10} nacs replay {target}")
    if unused:
        out.print(f"{'Left out':<10} {', '.join(unused)}")


def _proposal(path: Path, scenario: str | None) -> str:
    """The map that is proposed, as a file."""
    from sim.convert.map_file import FileMap
    from sim.convert.proposal import proposed
    from sim.convert.source import Source
    from sim.loop.build import assembly_of
    from sim.replay.log_columns import columns_of

    settings = files.load(scenario or DEFAULT)
    source = Source.opened(path, FileMap())
    assembly: Any = assembly_of(settings)
    proposal = proposed(source, columns_of(settings), assembly.wheel_inertia, scenario)
    proposal.map()  # what is proposed can be read
    return proposal.toml(str(path))


def _converted(path: Path, map_file: Path, trust: bool) -> tuple[Any, str, list[str]]:
    """The log, what to say of it, and the columns that it leaves out."""
    from sim.convert import map_file as maps
    from sim.convert.mapped import Mapping
    from sim.convert.source import Source
    from sim.replay.flight_log import read
    from sim.replay.log_columns import columns_of
    from sim.replay.log_file import LogFile

    said = maps.read(map_file)
    settings = files.load(said.scenario or DEFAULT)
    loop = said.loop or settings.loop_names[0]
    if loop not in settings.loop_names:
        raise BadInput(f"{map_file}: loop = {loop!r}: {said.scenario or DEFAULT} has {', '.join(settings.loop_names)}")
    columns = columns_of(settings)
    mapping = Mapping(Source.opened(path, said.file), said, str(map_file), columns, loop)
    table = mapping.table()
    label = Path(f"{path} by {map_file}")
    blocks = read(LogFile(label, table, {}), columns)
    check_plausible(label, blocks, settings, trust)
    for note in (note for block in blocks for note in block.notes):
        err.print(f"warning: {note}", style="yellow")
    trials = sum(len(block.trials) for block in blocks)
    return table, f"{counted(table.num_rows, 'row')} of {counted(trials, 'trial')} of {columns.plant}", mapping.unused


def _write(table: Any, path: Path) -> None:
    import pyarrow.parquet as pq

    pq.write_table(table, path)
