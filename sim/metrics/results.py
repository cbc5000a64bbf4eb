"""What a run leaves on disk: `summary.json` for programs, `trials.parquet` for statistics; other programs rely on both formats."""

from __future__ import annotations

import json
import platform
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from sim.metric import Metric
from sim.processor import described, processor


class Row(NamedTuple):
    """A metric over trials; trials to which it does not apply are left out. One trial has no standard deviation."""

    subject: str
    metric: str
    phase: str
    unit: str
    mean: float
    std: float | None
    min: float
    max: float
    n: int


def rows(metrics: list[Metric]) -> list[Row]:
    """Statistics over trials (sample standard deviation); a metric that applies to no trial gives no row."""
    out = []
    for metric in metrics:
        values = metric.values[np.isfinite(metric.values)]
        if len(values):
            std = float(np.std(values, ddof=1)) if len(values) > 1 else None
            out.append(Row(*metric.key, float(np.mean(values)), std, float(values.min()), float(values.max()), len(values)))
    return out


def versions() -> dict[str, str]:
    """What the numbers were made with."""
    packages = ("nacs-twin", "mujoco", "numpy", "scipy", "rerun-sdk", "pyarrow")
    return {name: version(name) for name in packages} | {"python": platform.python_version(), "platform": sys.platform}


def write_summary(
    path: Path, scenario: str, seed: int, trials: int, wall_s: float, sim_s: float, metrics: list[Metric], **more: Any
) -> None:
    """Write `summary.json`; `sim_s` is the simulated time of all trials together."""
    content = {
        "scenario": scenario,
        "seed": seed,
        "trials": trials,
        "versions": versions(),
        **described([processor()]),
        "wall_s": round(wall_s, 3),
        "sim_s": sim_s,
        **more,
        "rows": [row._asdict() for row in rows(metrics)],
    }
    write_json(path, content)


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write a summary as JSON, for people to read too."""
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def write_trials(path: Path, scenario: str, seed: int, trials: NDArray[np.int64], metrics: list[Metric]) -> None:
    """Write `trials.parquet`."""
    pq.write_table(trials_table(scenario, seed, trials, metrics), path)


def trials_table(scenario: str, seed: int, trials: NDArray[np.int64], metrics: list[Metric]) -> pa.Table:
    """Metrics of every trial, one row a trial and metric."""
    repeat = len(trials)

    def column(values: list[str]) -> pa.Array:
        return pa.DictionaryArray.from_arrays(
            pa.array(np.repeat(np.arange(len(values), dtype=np.int32), repeat)), pa.array(values)
        ).dictionary_decode()

    total = repeat * len(metrics)
    return pa.table(
        {
            "scenario": column([scenario] * len(metrics)),
            "trial": pa.array(np.tile(trials, len(metrics)), pa.int64()),
            "seed": pa.array(np.full(total, seed), pa.int64()),
            "subject": column([m.subject for m in metrics]),
            "metric": column([m.metric for m in metrics]),
            "phase": column([m.phase for m in metrics]),
            "unit": column([m.unit for m in metrics]),
            "value": pa.array(np.concatenate([m.values for m in metrics]) if metrics else np.zeros(0), pa.float64()),
        }
    )
