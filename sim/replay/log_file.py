"""The Parquet file of a flight log: what it says of itself, and its columns as numbers."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from sim.bad_input import BadInput
from sim.replay.log_columns import LogColumns

Array = NDArray[np.floating]

METADATA = b"nacs"
PAGE = "docs/replay.md says what a log holds"
MAGIC = b"PAR1"
LAST_TRIAL = 2**53  # beyond it columns of floating-point numbers skip whole ones


@dataclass(frozen=True, eq=False)
class LogFile:
    """A log that was read.

    Attributes:
      path: of the file.
      table: all of it.
      about: what it says of its scenario; nothing if it is a laboratory's.
    """

    path: Path
    table: pa.Table
    about: dict[str, Any]

    @classmethod
    def opened(cls, path: Path) -> LogFile:
        """Read a file; raises BadInput, one line, if it is no log."""
        try:
            if path.is_dir():
                raise BadInput(f"{path}: is a folder; name the file of a log, such as {path / 'log.parquet'}")
            with path.open("rb") as file:
                begins = file.read(4)
            if begins != MAGIC:
                raise BadInput(
                    f"{path}: cannot be read as a log: it is no Parquet file{_rather(path)}; docs/replay.md shows how to write one"
                )
            table = pq.ParquetFile(path).read()
        except FileNotFoundError:
            raise BadInput(f"{path}: does not exist; name the file of a log") from None
        except OSError as refused:
            raise BadInput(f"{path}: cannot be read: {refused.strerror or str(refused).splitlines()[0]}") from None
        except (pa.ArrowException, ValueError, KeyError, TypeError) as broken:
            if isinstance(broken, BadInput):
                raise
            raise BadInput(f"{path}: cannot be read as a log in Parquet: {(str(broken).splitlines() or ['damaged'])[0]}") from None
        twice = sorted({name for name in table.column_names if table.column_names.count(name) > 1})
        if twice:
            raise BadInput(f"{path}: has two columns {', '.join(twice)}")
        return cls(path, table, _about(path, (table.schema.metadata or {}).get(METADATA, b"{}")))

    def numbers(self, columns: LogColumns) -> dict[str, Array]:
        """What a replay needs of the columns, (rows,) each, null being NaN; raises BadInput for what is missing, strange or no number."""
        table, reading, known = self.table, columns.all(columns.reading), columns.all(columns.known)
        missing = [name for name in ("time_s", *reading, *known) if name not in table.column_names]
        if missing:
            raise BadInput(f"{self.path}: lacks columns {', '.join(missing)}; {PAGE}")
        kinds = {_unnumbered(name) for name in (*reading, *known)}
        foreign = [name for name in table.column_names if _unnumbered(name) in kinds and name not in (*reading, *known)]
        if foreign:
            raise BadInput(f"{self.path}: has columns {', '.join(foreign)}, which are of another plant than {columns.plant}; {PAGE}")
        if not table.num_rows:
            raise BadInput(f"{self.path}: is empty")
        wanted = {"trial", "time_s", "dt", "truth_fault", *reading, *known, *columns.truth}
        values = {name: self._column(name, (*reading, *known)) for name in table.column_names if name in wanted}
        trial = values.setdefault("trial", np.zeros(table.num_rows))
        wrong = (trial != np.round(trial)) | (trial < 0) | (trial > LAST_TRIAL)
        if wrong.any():
            row = int(np.flatnonzero(wrong)[0])
            raise BadInput(f"{self.path}: trial {trial[row]:g} in row {row}; trials are numbered 0, 1, 2, ...")
        return values

    def loops(self) -> NDArray[np.str_]:
        """Whose loop's log each row is of, (rows,)."""
        if "loop" not in self.table.column_names:
            return np.full(self.table.num_rows, "loop")
        column = self.table["loop"]
        if pa.types.is_dictionary(column.type):
            column = column.cast(column.type.value_type)
        if not (pa.types.is_string(column.type) or pa.types.is_large_string(column.type)) or column.null_count:
            raise BadInput(f"{self.path}: column loop holds {column.type}{' with gaps' * bool(column.null_count)}, not names of loops")
        return np.array(column.to_pylist(), dtype=str)

    def _column(self, name: str, may_be_missing: tuple[str, ...]) -> Array:
        """A column as numbers, null being NaN."""
        try:
            values = self.table[name].cast(pa.float64()).to_numpy()
        except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
            raise BadInput(f"{self.path}: column {name} holds {self.table[name].type}, not numbers") from None
        missing = name in may_be_missing or name.startswith("truth_")
        wrong = np.isinf(values) if missing else ~np.isfinite(values)
        if wrong.any():
            raise BadInput(f"{self.path}: column {name}, row {int(np.flatnonzero(wrong)[0])}: must be a finite number")
        return np.asarray(values, dtype=float)


def _about(path: Path, said: bytes) -> dict[str, Any]:
    """What the twin wrote of the scenario; raises BadInput if it did not write that."""
    try:
        about = json.loads(said)
    except (ValueError, RecursionError):
        about = None
    if not isinstance(about, dict) or not isinstance(about.get("settings", {}), dict) or not isinstance(about.get("scenario", ""), str):
        raise BadInput(f"{path}: its metadata are not what the twin writes")
    return about


def _unnumbered(name: str) -> str:
    """`agent_x` of `agent2_x1`; a name without a number at its end as it is."""
    return re.sub(r"^agent\d+_", "agent_", re.sub(r"\d+$", "", name)) if re.search(r"\d$", name) else f"{name} "


def _rather(path: Path) -> str:
    """What a file is if it is text."""
    return " but text" if path.suffix.lower() in {".csv", ".txt", ".tsv", ".dat"} else ""
