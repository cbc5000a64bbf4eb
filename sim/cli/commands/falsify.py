"""`nacs falsify`: say which candidate controllers a flight log falsifies, though none of them need have flown it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.text import Text

from sim.bad_input import BadInput
from sim.cli.plausible_log import check_plausible
from sim.cli.result_files import ResultFiles, interrupted_as
from sim.cli.terminal import FAILED, Overrides, err, out, output_folder
from sim.scenario.files import parse_override
from sim.text.table_style import counted

FILES = SUMMARY, ROWS, PICTURE = "falsification.json", "falsification.parquet", "falsification.png"


def falsify(
    log: Annotated[Path, typer.Argument(metavar="LOG.parquet", help="flight log of one body, as for `nacs replay`")],
    candidates: Annotated[Path, typer.Option("--candidates", metavar="FILE.toml", help="candidate controllers and what is asked of them")],
    axes: Annotated[
        list[str] | None, typer.Option("--axis", help="x, y, z, azimuth (z) or elevation (x), may be repeated; default: the file's, or all")
    ] = None,
    loops: Annotated[
        list[str] | None, typer.Option("--loop", help="judge by the flights of this loop only (may be repeated); default: all, each alone")
    ] = None,
    overrides: Overrides = None,
    trust: Annotated[bool, typer.Option("--trust", help="go on with a log in which units, order or signs look wrong")] = False,
    folder: Annotated[Path | None, typer.Option("--out", help="folder for tables and a picture; default: nothing is written")] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace what is in --out")] = False,
) -> None:
    """Say which candidate controllers a flight log falsifies, though none of them need have flown it."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    from sim.loop.build import assembly_of
    from sim.replay.candidates import AXES, load
    from sim.replay.falsification import AxisVerdict
    from sim.replay.falsification import falsify as judge
    from sim.replay.flight_log import read
    from sim.replay.log_columns import columns_of
    from sim.replay.log_file import LogFile
    from sim.replay.setting import setting
    from sim.report.logs.falsification import write_picture
    from sim.tables.falsification import candidates as table_of

    if strange := [name for name in axes or () if name not in AXES]:
        raise BadInput(f"--axis {strange[0]}: no such axis; there are {', '.join(AXES)}")
    file, own = load(candidates)
    opened = LogFile.opened(log)
    scenario = setting(opened.about, str(log), None, dict(parse_override(text) for text in overrides or []))
    if scenario.family != "body":
        raise BadInput(f"{log}: is of several agents; candidates are judged by the log of one body")
    blocks = read(opened, columns_of(scenario))
    there = list(dict.fromkeys(block.loop for block in blocks))
    for kind, names, known in (("column loop says", there, scenario.loop_names), ("--loop", loops or (), there)):
        if unknown := [name for name in names if name not in known]:
            raise BadInput(f"{log}: {kind} {unknown[0]}; there are {', '.join(known)}")
    blocks = [block for block in blocks if not loops or block.loop in loops]
    check_plausible(log, blocks, scenario, trust)
    target = output_folder(folder, "", overwrite) if folder is not None else None
    chosen = list(dict.fromkeys(AXES[name] for name in axes or file.axes or ("x", "y", "z")))
    assembly, singles = assembly_of(scenario), scenario.singles()
    found: dict[tuple[str, int], list[AxisVerdict]] = {}
    for block in blocks:
        verdicts, notes = judge(str(log), block, singles[block.loop], assembly, file, own, chosen)
        for one in verdicts:
            found.setdefault((one.loop, one.axis), []).append(one)
        for note in (*block.notes, *notes):
            err.print(f"warning: {note}", style="yellow", markup=False)
    everything = [one for several in found.values() for one in several]
    trials = len({int(trial) for block in blocks for trial in block.trials})
    said = f": {counted(trials, 'trial')} of {', '.join(dict.fromkeys(loop for loop, _ in found))}\n"
    out.print(Text.assemble((f"Falsification by {log}", "bold"), said))
    for several in found.values():
        out.print(table_of(several))
    if target is None:
        return
    rows: list[dict[str, Any]] = [row for one in everything for row in one.rows()]
    files = ResultFiles(target)
    with interrupted_as(f"what was written until then is whole, in {target}"):
        asked = [{"loop": one.loop, "axis": "xyz"[one.axis], **one.asked._asdict()} for one in everything]
        said_of = {"log": str(log), "candidates": str(candidates), "asked": asked, "rows": rows}
        files.write(SUMMARY, lambda path: path.write_text(json.dumps(said_of, indent=1) + "\n", encoding="utf-8"))
        files.write(ROWS, lambda path: pq.write_table(pa.Table.from_pylist(rows), path))
        files.write(PICTURE, lambda path: write_picture(path, f"Falsification by {log.name}", everything))
        if overwrite:
            files.remove_others(FILES)
    for label, name in (("Verdicts", SUMMARY), ("Table", ROWS), ("Picture", PICTURE)):
        if name in files:
            out.print(f"{label:<10} {target / name}")
    if files.refusal:
        err.print(f"error: {files.refusal}", markup=False)
        raise typer.Exit(FAILED)
