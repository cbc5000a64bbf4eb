"""A campaign's folder: shards that are there wholly or not at all, and what is needed to go on after an interruption."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

import control
import estimation
import models
import sim
from sim.bad_input import BadInput
from sim.campaign.settings import Campaign
from sim.campaign.shard import METRIC_SCHEMA, Job, Tables
from sim.metrics.results import versions

SHARDS_AT_ONCE = 32
TRIALS_A_GROUP = 256  # of the merged table; on trial numbers, so that it is the same for any shard size


def fingerprint() -> str:
    """Hash of everything that decides numbers: the twin's own files, and the versions of what they call."""
    digest = hashlib.sha256(json.dumps(versions(), sort_keys=True).encode())
    for package in (models, sim, estimation, control):
        root = Path(next(iter(package.__path__)))
        for path in sorted(p for p in root.rglob("*") if p.suffix in (".py", ".xml", ".toml")):
            digest.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


class Store:
    """Folder of one campaign: `manifest.json`, `shards/`, and the merged results."""

    def __init__(self, folder: Path, campaign: Campaign, scenarios: list[str]) -> None:
        self.folder, self.campaign = folder, campaign
        self._manifest = {"campaign": json.loads(campaign.model_dump_json()), "scenarios": scenarios, "code": fingerprint()}

    def open(self, resume: bool) -> None:
        """Begin a new folder, or check that an old one is of the same campaign and the same code; raises BadInput."""
        path = self.folder / "manifest.json"
        if not resume:
            _write(path, json.dumps(self._manifest, indent=1).encode())
            return
        try:
            old = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            raise BadInput(f"--resume: {path} is no campaign's manifest; start anew with another --out") from None
        if old["campaign"] != self._manifest["campaign"] or old["scenarios"] != self._manifest["scenarios"]:
            now, then = self._manifest["campaign"], old["campaign"]
            assert isinstance(now, dict)
            keys = [key for key in now if now[key] != then.get(key)] or ["scenario file"]
            raise BadInput(f"--resume: {', '.join(keys)} changed since {self.folder} was begun; start anew with another --out")
        if old["code"] != self._manifest["code"]:
            raise BadInput(
                f"--resume: the twin's code or its libraries changed since {self.folder} was begun; start anew with another --out"
            )

    def path(self, point: int, start: int) -> Path:
        """File of a shard."""
        return self.folder / "shards" / f"point-{point:04d}-trial-{start:08d}.parquet"

    def missing(self, jobs: list[Job]) -> tuple[list[Job], int]:
        """Jobs without a readable shard, and how many of them had an unreadable one."""
        left, corrupt = [], 0
        for job in jobs:
            path = self.path(job.point, job.start)
            sound = path.is_file() and _is_sound(path, job)
            corrupt += path.is_file() and not sound
            if not sound:
                left.append(job)
        return left, corrupt

    def keep(self, tables: Tables) -> None:
        """Write a shard; the metrics come last, so that their file says that all is there."""
        path = self.path(tables.point, tables.start)
        for table, suffix in ((tables.bands, ".bands"), (tables.consistency, ".consistency"), (tables.metrics, ".parquet")):
            sink = pa.BufferOutputStream()
            pq.write_table(table, sink)
            _write(path.with_suffix(suffix), sink.getvalue().to_pybytes())

    def merge(self, jobs: list[Job]) -> Path:
        """All metrics in one table, in the order of points and trials; memory stays that of a few shards."""
        path = self.folder / "trials.parquet"
        temporary = path.with_suffix(".part")
        with pq.ParquetWriter(temporary, METRIC_SCHEMA) as writer:
            for group in self._groups(jobs):
                writer.write_table(group, row_group_size=len(group) or None)
        os.replace(temporary, path)
        return path

    def _groups(self, jobs: list[Job]) -> Iterator[pa.Table]:
        """Tables of TRIALS_A_GROUP trials each, whatever the shards."""
        held: pa.Table = METRIC_SCHEMA.empty_table()
        key: tuple[int, int] | None = None
        for job in jobs:
            table = pq.read_table(self.path(job.point, job.start))
            groups = np.asarray(table["trial"]) // TRIALS_A_GROUP
            for group in np.unique(groups):
                part = table.filter(pa.array(groups == group))
                if key is not None and key != (job.point, int(group)):
                    yield held.combine_chunks()
                    held = METRIC_SCHEMA.empty_table()
                held, key = pa.concat_tables([held, part]), (job.point, int(group))
        if key is not None:
            yield held.combine_chunks()

    def add_up(self, jobs: list[Job], suffix: str, keys: list[str], number: list[str]) -> pa.Table:
        """Whole numbers of all shards of some jobs added up by key; the same in any order."""
        held: list[pa.Table] = []
        for i, job in enumerate(jobs):
            held.append(pq.read_table(self.path(job.point, job.start).with_suffix(suffix)))
            if len(held) > SHARDS_AT_ONCE or i == len(jobs) - 1:
                schema = held[0].schema
                grouped = pa.concat_tables(held).group_by(keys, use_threads=False).aggregate([(name, "sum") for name in number])
                held = [grouped.rename_columns([*keys, *number]).select(schema.names).cast(schema)]
        return held[0].sort_by([(key, "ascending") for key in keys])


def _is_sound(path: Path, job: Job) -> bool:
    try:
        tables = [pq.read_table(path.with_suffix(suffix)) for suffix in (".bands", ".consistency", ".parquet")]
    except (OSError, pa.ArrowInvalid):
        return False
    trials = tables[-1]["trial"]
    return len(trials) > 0 and trials[0].as_py() == job.start and trials[len(trials) - 1].as_py() == job.stop - 1


def _write(path: Path, content: bytes) -> None:
    """Write a file wholly or not at all."""
    temporary = path.with_suffix(path.suffix + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with temporary.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except OSError as refused:
        temporary.unlink(missing_ok=True)
        raise BadInput(f"{path} cannot be written: {refused.strerror}; what was finished is kept, go on with --resume") from None
