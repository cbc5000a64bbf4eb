"""Signals as comma-separated values: the long table of `signals.parquet`, for whatever reads text."""

from __future__ import annotations

from pathlib import Path

from pyarrow import csv

from sim.export.export_format import ExportFormat
from sim.series.signals import long_table
from sim.series.signals.signal import Signals


def _write(path: Path, signals: Signals) -> None:
    schema = long_table.table_schema(signals, "")
    with csv.CSVWriter(path, schema) as file:
        for table in long_table.tables(signals, schema):
            file.write_table(table)


FORMAT = ExportFormat("csv", ".csv", _write)
