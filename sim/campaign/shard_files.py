"""Shards on disk that can be trusted: three tables each, and a seal that holds what they are and the checksum of every file."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from sim.campaign.shard import BANDS_SCHEMA, CONSISTENCY_SCHEMA, METRIC_SCHEMA, Job, Tables
from sim.whole_file import write_whole

METRICS, BANDS, CONSISTENCY, SEAL = ".parquet", ".bands", ".consistency", ".seal"
SCHEMAS = {BANDS: BANDS_SCHEMA, CONSISTENCY: CONSISTENCY_SCHEMA, METRICS: METRIC_SCHEMA}


class DamagedShard(RuntimeError):
    """A shard is not what was written, or not of this campaign; the message is one line."""


class ShardFiles:
    """The shards of one campaign in a folder.

    Args:
      folder: where they are.
      campaign: that they belong to: a digest of all that decides their numbers but the processor.
      seed: root seed of the campaign.
    """

    def __init__(self, folder: Path, campaign: str, seed: int) -> None:
        self.folder, self.campaign, self.seed = folder, campaign, seed

    def path(self, point: int, start: int, suffix: str = METRICS) -> Path:
        """A file of a shard."""
        return self.folder / f"point-{point:04d}-trial-{start:08d}{suffix}"

    def write(self, tables: Tables) -> None:
        """Write a shard; its seal comes last and says that all is there. Raises NotWritten."""
        digests = {}
        for suffix, table in ((BANDS, tables.bands), (CONSISTENCY, tables.consistency), (METRICS, tables.metrics)):
            sink = pa.BufferOutputStream()
            pq.write_table(table, sink)
            content = sink.getvalue().to_pybytes()
            digests[suffix] = hashlib.sha256(content).hexdigest()
            write_whole(self.path(tables.point, tables.start, suffix), content)
        stop = int(tables.metrics["trial"][-1].as_py()) + 1
        held = self._held(Job("", "", tables.point, tables.start, stop)) | {"processor": tables.processor, "sha256": digests}
        write_whole(self.path(tables.point, tables.start, SEAL), json.dumps({"held": held, "sha256": _digest(held)}, indent=1).encode())

    def table(self, job: Job, suffix: str) -> pa.Table:
        """A table of a shard, of the very bytes that were checked; raises DamagedShard."""
        return self._checked(job, suffix, self._seal(job))

    def processor(self, job: Job) -> str:
        """Which processor computed a shard; raises DamagedShard."""
        return str(self._seal(job)["processor"])

    def is_sound(self, job: Job, processors: Collection[str]) -> bool:
        """Whether a shard is whole, of this campaign, and computed by one of some processors."""
        try:
            seal = self._seal(job)
            for suffix in SCHEMAS:
                self._checked(job, suffix, seal)
        except DamagedShard:
            return False
        return seal["processor"] in processors

    def is_there(self, job: Job) -> bool:
        """Whether something of a finished shard is there, sound or not."""
        return any(self.path(job.point, job.start, suffix).exists() for suffix in (METRICS, SEAL))

    def _held(self, job: Job) -> dict[str, object]:
        return {"campaign": self.campaign, "seed": self.seed, "point": job.point, "start": job.start, "stop": job.stop}

    def _seal(self, job: Job) -> dict[str, Any]:
        """What the seal of a shard holds, once it is known that it is sound and that of this job."""
        path = self.path(job.point, job.start, SEAL)
        try:
            said = json.loads(path.read_bytes())
            held, digest = said["held"], said["sha256"]
            if digest != _digest(held) or not self._held(job).items() <= held.items():
                raise DamagedShard(f"{path}: is damaged, or of another campaign")
        except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
            raise DamagedShard(f"{path}: is missing or damaged") from None
        return dict(held)

    def _checked(self, job: Job, suffix: str, seal: dict[str, Any]) -> pa.Table:
        path = self.path(job.point, job.start, suffix)
        try:
            content = path.read_bytes()
        except OSError as refused:
            raise DamagedShard(f"{path}: {refused.strerror}") from None
        if hashlib.sha256(content).hexdigest() != seal["sha256"].get(suffix):
            raise DamagedShard(f"{path}: is not what was written: its checksum differs")
        table = pq.read_table(pa.BufferReader(content))
        if not table.schema.equals(SCHEMAS[suffix]):
            raise DamagedShard(f"{path}: has other columns")
        if suffix == METRICS:
            numbers = {name: np.unique(np.asarray(table[name])) for name in ("point", "trial", "seed")}
            wanted = {"point": [job.point], "trial": range(job.start, job.stop), "seed": [self.seed]}
            if wrong := [name for name, values in wanted.items() if numbers[name].tolist() != list(values)]:
                raise DamagedShard(f"{path}: another {wrong[0]} than was to be flown")
        return table


def _digest(held: object) -> str:
    return hashlib.sha256(json.dumps(held, sort_keys=True).encode()).hexdigest()
