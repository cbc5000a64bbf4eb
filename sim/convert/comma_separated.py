"""Columns of a CSV file: with a heading or without, lines of remarks before it, any of the usual delimiters."""

from __future__ import annotations

import re
from csv import Error, reader
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray
from pyarrow import csv

from sim.bad_input import BadInput
from sim.convert.map_file import FileMap

DELIMITERS = ",;\t| "
LINES = 60  # among which the heading is
NOTHING = ("", "nan", "NaN", "NAN", "null", "NULL", "None", "N/A", "n/a", "NA", "-")


def columns(path: Path, file: FileMap) -> dict[str, NDArray[Any]]:
    """Of all that hold numbers, (rows,) each; time stamps as dates are ns since 1970. Raises BadInput."""
    with path.open(encoding="utf-8-sig", errors="replace") as text:
        lines = [line.rstrip("\r\n") for _, line in zip(range(LINES), text, strict=False)]
    delimiter = file.delimiter or _delimiter(lines)
    decimal = file.decimal or _decimal(lines, delimiter)
    skip = _heading(lines, delimiter) if file.skip_rows is None else file.skip_rows
    names = _parts(lines[skip] if skip < len(lines) else "", delimiter)
    numbered = any(_is_number(name, decimal) for name in names)  # a heading has none
    if numbered:
        names = [f"column{i + 1}" for i, _ in enumerate(names)]
    if twice := sorted({name for name in names if name and names.count(name) > 1}):
        raise BadInput(f"{path}: has two columns {', '.join(twice)}")
    try:
        table = csv.read_csv(
            path,
            read_options=csv.ReadOptions(column_names=names, skip_rows=skip + (not numbered), encoding="utf8"),
            parse_options=csv.ParseOptions(delimiter=delimiter, ignore_empty_lines=True),
            convert_options=csv.ConvertOptions(null_values=list(NOTHING), decimal_point=decimal, strings_can_be_null=True),
        )
    except pa.ArrowInvalid as broken:
        raise BadInput(
            f"{path}: cannot be read as CSV: {str(broken).splitlines()[0]}; [file] of a map has delimiter and skip_rows"
        ) from None
    return {name: found for name in table.column_names if name and (found := numbers(table[name])) is not None}


def numbers(column: pa.ChunkedArray) -> NDArray[Any] | None:
    """A column as an array, null being NaN; None if it holds no numbers."""
    kind = column.type
    if pa.types.is_timestamp(kind):
        column = column.cast(pa.timestamp("ns")).cast(pa.int64())
    elif pa.types.is_null(kind):
        column = column.cast(pa.float64())
    elif pa.types.is_boolean(kind):
        column = column.cast(pa.int8())
    elif not (pa.types.is_integer(kind) or pa.types.is_floating(kind)):
        return None
    if column.null_count:
        column = pc.fill_null(column.cast(pa.float64()), float("nan"))
    found: NDArray[Any] = column.to_numpy()
    return found


def _delimiter(lines: list[str]) -> str:
    """The one that cuts most lines into the same number of parts, and many."""

    def steady(delimiter: str) -> tuple[int, int]:
        parts = [len(_parts(line, delimiter)) for line in lines if line.strip()]
        most = max(set(parts), key=parts.count, default=1)
        return (parts.count(most) if most > 1 else 0, most)

    return max(DELIMITERS, key=steady)


def _parts(line: str, delimiter: str) -> list[str]:
    """A line cut where it is not in quotes."""
    try:
        return [part.strip() for row in reader([line], delimiter=delimiter, skipinitialspace=True) for part in row]
    except Error:  # of a part that is too long
        return line.split(delimiter)


def _decimal(lines: list[str], delimiter: str) -> str:
    """A comma where numbers have one, and no point."""
    text = "\n".join(lines)
    return "," if delimiter != "," and re.search(r"\d,\d", text) and not re.search(r"\d\.\d", text) else "."


def _heading(lines: list[str], delimiter: str) -> int:
    """Number of the first line that has as many parts as most have."""
    parts = [len(_parts(line, delimiter)) if line.strip() and not line.lstrip().startswith("#") else 0 for line in lines]
    there = [count for count in parts if count]
    usual = max(set(there), key=lambda count: (there.count(count), count), default=0)
    return parts.index(usual) if usual else 0


def _is_number(text: str, decimal: str) -> bool:
    try:
        float(text.replace(decimal, "."))
    except ValueError:
        return False
    return True
