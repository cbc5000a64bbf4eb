"""Columns of a CSV file: with a heading or without, lines of remarks before it, any of the usual delimiters."""

from __future__ import annotations

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
    skip = _heading(lines, delimiter) if file.skip_rows is None else file.skip_rows
    names = _names(lines[skip] if skip < len(lines) else "", delimiter)
    numbered = any(_is_number(name, file.decimal) for name in names)  # a heading has none
    if numbered:
        names = [f"column{i + 1}" for i, _ in enumerate(names)]
    if twice := sorted({name for name in names if name and names.count(name) > 1}):
        raise BadInput(f"{path}: has two columns {', '.join(twice)}")
    try:
        table = csv.read_csv(
            path,
            read_options=csv.ReadOptions(column_names=names, skip_rows=skip + (not numbered), encoding="utf8"),
            parse_options=csv.ParseOptions(delimiter=delimiter, ignore_empty_lines=True),
            convert_options=csv.ConvertOptions(null_values=list(NOTHING), decimal_point=file.decimal, strings_can_be_null=True),
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
        parts = [line.count(delimiter) for line in lines if line.strip()]
        most = max(set(parts), key=parts.count, default=0)
        return (parts.count(most) if most else 0, most)

    return max(DELIMITERS, key=steady)


def _heading(lines: list[str], delimiter: str) -> int:
    """Number of the first line that has as many parts as the last ones."""
    parts = [line.count(delimiter) for line in lines]
    last = next((count for line, count in zip(reversed(lines), reversed(parts), strict=True) if line.strip()), 0)
    return next((row for row, count in enumerate(parts) if count == last and not lines[row].lstrip().startswith("#")), 0)


def _names(line: str, delimiter: str) -> list[str]:
    return [part.strip().strip("\"'").strip() for part in line.split(delimiter)]


def _is_number(text: str, decimal: str) -> bool:
    try:
        float(text.replace(decimal, "."))
    except ValueError:
        return False
    return True
