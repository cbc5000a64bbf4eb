"""A campaign's folder: shards that are there wholly or not at all, and what is needed to go on after an interruption."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

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
from sim.campaign.shard_files import METRICS, ShardFiles
from sim.metrics.results import versions
from sim.whole_file import remove_abandoned, whole_file, write_whole

SHARDS_AT_ONCE = 32
TRIALS_A_GROUP = 256  # of the merged table; on trial numbers, so that it is the same for any shard size


def fingerprint() -> str:
    """Hash of everything that decides numbers but the processor: the twin's own files, and the versions of what they call."""
    digest = hashlib.sha256(json.dumps(versions(), sort_keys=True).encode())
    for package in (models, sim, estimation, control):
        root = Path(next(iter(package.__path__)))
        for path in sorted(p for p in root.rglob("*") if p.suffix in (".py", ".xml", ".toml")):
            digest.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


class Store:
    """Folder of one campaign: `manifest.json`, `shards/`, and the merged results.

    Attributes:
      processors: kinds of processors whose shards count; those of the folder as soon as `check` or `begin` was called.
    """

    def __init__(self, folder: Path, campaign: Campaign, scenarios: list[str]) -> None:
        self.folder, self.campaign = folder, campaign
        self.processors: tuple[str, ...] = ()
        self._manifest = {"campaign": json.loads(campaign.model_dump_json()), "scenarios": scenarios, "code": fingerprint()}
        identity = self._manifest | {"campaign": _content(self._manifest["campaign"])}
        self.shards = ShardFiles(
            folder / "shards", hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest(), campaign.seed
        )

    @property
    def is_begun(self) -> bool:
        """Whether there is something to go on with."""
        return (self.folder / "manifest.json").is_file()

    def check(self) -> None:
        """Check that the folder is of the same campaign and the same code, whatever its files are called; tidy it.

        A folder in which a killed process did not even finish the manifest is one that is to be begun. Raises BadInput.
        """
        path = self.folder / "manifest.json"
        if self.folder.is_dir():
            remove_abandoned(self.folder)
            if not any(self.folder.iterdir()):
                return
        try:
            old = _manifest(json.loads(path.read_bytes()))
        except (OSError, ValueError, RecursionError):
            raise BadInput(f"--resume: {path} is no campaign's manifest; start anew with another --out") from None
        now, then = _content(self._manifest["campaign"]), _content(old["campaign"])
        keys = [key for key in {**now, **then} if now.get(key, ...) != then.get(key, ...)]
        if old["scenarios"] != self._manifest["scenarios"]:
            keys = keys or ["scenario file"]
        if keys:
            raise BadInput(f"--resume: {', '.join(keys)} changed since {self.folder} was begun; start anew with another --out")
        if old["code"] != self._manifest["code"]:
            raise BadInput(
                f"--resume: the twin's code or its libraries changed since {self.folder} was begun; start anew with another --out"
            )
        self.processors = tuple(old["processors"])
        remove_abandoned(self.shards.folder)

    def begin(self, processors: set[str], mixed: bool) -> None:
        """Write the manifest, once all else was checked.

        Args:
          processors: kinds of those that will compute.
          mixed: whether they may be several, or others than before.

        Raises:
          BadInput: they are and may not; nothing is written.
          NotWritten: the manifest cannot be.
        """
        together = tuple(sorted({*self.processors, *processors}))
        if len(together) > 1 and not mixed:
            raise BadInput(
                f"{self.folder}: {' and '.join(together)} would compute it together, which are equal to 1e-11 but not to the bit; "
                "allow it by --mixed-processors, or use one kind alone"
            )
        if self.processors != together:
            self.processors = together
            write_whole(self.folder / "manifest.json", json.dumps(self._manifest | {"processors": list(together)}, indent=1).encode())

    def missing(self, jobs: list[Job]) -> tuple[list[Job], int]:
        """Jobs without a sound shard, and how many of them had one that is not."""
        left = [job for job in jobs if not self.shards.is_sound(job, self.processors)]
        return left, sum(self.shards.is_there(job) for job in left)

    def keep(self, tables: Tables, mixed: bool) -> None:
        """Write a shard; raises NotWritten, or BadInput if another processor computed it than may be."""
        if tables.processor not in self.processors:
            self.begin({tables.processor}, mixed)
        self.shards.write(tables)

    def merge(self, jobs: list[Job]) -> Path:
        """All metrics in one table, in the order of points and trials; memory stays that of a few shards.

        Raises:
          DamagedShard: a shard is no longer what was written.
          NotWritten: the table cannot be.
        """
        path = self.folder / "trials.parquet"
        with whole_file(path) as temporary, pq.ParquetWriter(temporary, METRIC_SCHEMA) as writer:
            for group in self._groups(jobs):
                writer.write_table(group, row_group_size=len(group) or None)
        return path

    def used_processors(self, jobs: list[Job]) -> set[str]:
        """Kinds of processors that computed the shards; raises DamagedShard."""
        return {self.shards.processor(job) for job in jobs}

    def _groups(self, jobs: list[Job]) -> Iterator[pa.Table]:
        """Tables of TRIALS_A_GROUP trials each, whatever the shards."""
        held: pa.Table = METRIC_SCHEMA.empty_table()
        key: tuple[int, int] | None = None
        for job in jobs:
            table = self.shards.table(job, METRICS)
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
        """Whole numbers of all shards of some jobs added up by key; the same in any order. Raises DamagedShard."""
        held: list[pa.Table] = []
        for i, job in enumerate(jobs):
            held.append(self.shards.table(job, suffix))
            if len(held) > SHARDS_AT_ONCE or i == len(jobs) - 1:
                schema = held[0].schema
                grouped = pa.concat_tables(held).group_by(keys, use_threads=False).aggregate([(name, "sum") for name in number])
                held = [grouped.rename_columns([*keys, *number]).select(schema.names).cast(schema)]
        return held[0].sort_by([(key, "ascending") for key in keys])


def _content(campaign: Any) -> dict[str, Any]:
    """What a campaign says but the spelling of its scenario's path, which the scenarios themselves stand for."""
    return {key: value for key, value in campaign.items() if key != "scenario"}


def _manifest(data: Any) -> dict[str, Any]:
    """A manifest that was read, if it has the parts of one; raises ValueError."""
    kinds = {"campaign": dict, "scenarios": list, "code": str, "processors": list}
    if not isinstance(data, dict) or not all(isinstance(data.get(key), kind) for key, kind in kinds.items()):
        raise ValueError("no manifest")
    if not all(isinstance(name, str) for name in data["processors"]):
        raise ValueError("no manifest")
    return data
