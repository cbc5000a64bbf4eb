"""Campaigns that lose nothing: shards that can be trusted, manifests of any shape, lost workers, mixed processors, signals."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from sim.bad_input import BadInput
from sim.campaign import engines
from sim.campaign import shard as campaign_shard
from sim.campaign.file import load
from sim.campaign.shard import Job, Tables, fly
from sim.campaign.shard_files import BANDS, CONSISTENCY, METRICS, SEAL, DamagedShard
from sim.campaign.store import Store
from sim.campaign.worker_processes import WorkersLost, in_processes
from sim.processor import processor
from sim.scenario.files import dumped

MADE_UP = Path(__file__).parent / "made_up"
HERE = "x86_64 openblas Here"
TEXT = """
title = "short"
scenario = "mine-too.toml"
seed = 11
trials = 6
shard = 3
metrics = ["rmse_truth_*", "nis_mean"]

[dispersion]
"plant.inertia_kg_m2.1" = { uniform = [0.0150, 0.0196] }
"""


def write(folder: Path) -> Path:
    """A campaign of a scenario file beside it."""
    folder.mkdir(exist_ok=True)
    (folder / "mine.toml").write_text(TEXT.replace("mine-too.toml", "nacs/fault-free") + "\n[override]\nrun.ticks = 20\n")
    return folder / "mine.toml"


def store_of(path: Path, folder: Path) -> tuple[Store, list[Job]]:
    """Store of a campaign, and its jobs."""
    campaign = load(path)
    scenarios = [json.dumps(dumped(campaign.at(0)))]
    jobs = [Job(campaign.model_dump_json(), scenarios[0], 0, start, start + campaign.shard) for start in range(0, 6, 3)]
    return Store(folder, campaign, scenarios), jobs


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Tables]]:
    """Both shards of a campaign, flown once."""
    path = write(tmp_path_factory.mktemp("flown"))
    _, jobs = store_of(path, path.parent / "out")
    return path, [fly(job) for job in jobs]


@pytest.fixture
def kept(flown: tuple[Path, list[Tables]], tmp_path: Path) -> tuple[Store, list[Job], list[Tables]]:
    """Both shards on disk."""
    path, tables = flown
    store, jobs = store_of(path, tmp_path / "out")
    store.begin({tables[0].processor}, mixed=False)
    for one in tables:
        store.keep(one, mixed=False)
    return store, jobs, tables


# shards -----------------------------------------------------------------------------------------------------------------------


def test_what_was_kept_is_read_as_it_was(kept) -> None:
    store, jobs, tables = kept
    assert store.missing(jobs) == ([], 0)
    for job, one in zip(jobs, tables, strict=True):
        for suffix, table in ((METRICS, one.metrics), (BANDS, one.bands), (CONSISTENCY, one.consistency)):
            assert store.shards.table(job, suffix).equals(table)


@pytest.mark.parametrize("suffix", [METRICS, BANDS, CONSISTENCY, SEAL])
def test_no_flipped_bit_of_a_shard_is_taken_for_a_number(kept, suffix: str) -> None:
    store, jobs, _ = kept
    path = store.shards.path(0, 0, suffix)
    content = path.read_bytes()
    for bit in np.random.default_rng(1).integers(0, 8 * len(content), 40):
        flipped = bytearray(content)
        flipped[bit // 8] ^= 1 << (bit % 8)
        path.write_bytes(flipped)
        left, damaged = store.missing(jobs)
        if left:
            assert (left, damaged) == (jobs[:1], 1), bit
            with pytest.raises(DamagedShard):
                store.shards.table(jobs[0], suffix if suffix != SEAL else METRICS)
        else:  # a blank of the seal became another
            assert suffix == SEAL
            assert json.loads(flipped) == json.loads(content)
    path.write_bytes(content)
    assert store.missing(jobs) == ([], 0)


def _other_trial(tables: Tables) -> Tables:
    return tables._replace(metrics=tables.metrics.filter(pa.array(np.asarray(tables.metrics["trial"]) != 1)))


def _column(tables: Tables, name: str, value: float) -> Tables:
    place = tables.metrics.schema.get_field_index(name)
    array = pa.array([value] * len(tables.metrics), tables.metrics.schema.field(name).type)
    return tables._replace(metrics=tables.metrics.set_column(place, name, array))


UNSOUND = {
    "a trial in the middle is missing": _other_trial,
    "another point": lambda t: _column(t, "point", 1),
    "another seed": lambda t: _column(t, "seed", 12),
    "other columns": lambda t: t._replace(metrics=t.metrics.drop_columns(["reason"])),
    "other columns of the bands": lambda t: t._replace(bands=t.consistency),
    "another processor": lambda t: t._replace(processor="x86_64 openblas Other"),
}


@pytest.mark.parametrize("what", UNSOUND)
def test_a_shard_that_is_sealed_but_is_not_the_one_wanted_is_flown_again(kept, what: str) -> None:
    store, jobs, tables = kept
    store.shards.write(UNSOUND[what](tables[0]))
    assert store.missing(jobs) == (jobs[:1], 1)


@pytest.mark.parametrize("suffix", [METRICS, BANDS, CONSISTENCY])
def test_a_file_of_another_shard_or_with_other_numbers_is_found(kept, suffix: str) -> None:
    store, jobs, _ = kept
    path, other = (store.shards.path(0, start, suffix) for start in (0, 3))
    mine = path.read_bytes()
    path.write_bytes(other.read_bytes())
    assert store.missing(jobs) == (jobs[:1], 1)
    table = pq.read_table(pa.BufferReader(mine))
    pq.write_table(table.slice(0, len(table) // 2), path)
    assert store.missing(jobs) == (jobs[:1], 1)
    path.unlink()
    assert store.missing(jobs)[0] == jobs[:1]


def test_a_shard_of_another_campaign_is_not_taken(kept, tmp_path: Path) -> None:
    store, jobs, tables = kept
    other = store_of(write(tmp_path / "b"), tmp_path / "other")[0]
    other.campaign = other.campaign.model_copy(update={"seed": 12})
    changed = Store(tmp_path / "other", other.campaign, ["{}"])
    changed.begin({tables[0].processor}, mixed=False)
    changed.shards.folder.mkdir()
    for suffix in (METRICS, BANDS, CONSISTENCY, SEAL):
        shutil.copy(store.shards.path(0, 0, suffix), changed.shards.path(0, 0, suffix))
    assert changed.missing(jobs)[0] == jobs


def test_a_shard_that_changes_before_it_is_merged_stops_the_merge(kept) -> None:
    store, jobs, _ = kept
    path = store.shards.path(0, 3)
    path.write_bytes(path.read_bytes()[:-9] + b"x" + path.read_bytes()[-8:])
    with pytest.raises(DamagedShard, match=r"trial-00000003\.parquet: is not what was written"):
        store.merge(jobs)
    assert sorted(p.name for p in store.folder.iterdir()) == ["manifest.json", "shards"]


# manifest ---------------------------------------------------------------------------------------------------------------------

SHAPES = [
    "{}", "[]", "null", "3", '"text"', "", "{", '{"campaign": null, "scenarios": [], "code": "", "processors": []}',
    '{"campaign": {}, "scenarios": {}, "code": "", "processors": []}', '{"campaign": {}, "scenarios": [], "code": 3, "processors": []}',
    '{"campaign": {}, "scenarios": [], "code": "", "processors": [3]}', '{"campaign": {}, "scenarios": [], "code": ""}',
    "[" * 100_000, "\x00\xff\xfe",
]  # fmt: skip


@pytest.mark.parametrize("content", SHAPES, ids=range(len(SHAPES)))
def test_a_manifest_of_any_shape_is_one_line(nacs, tmp_path: Path, content: str) -> None:
    file = write(tmp_path / "in")
    (tmp_path / "it").mkdir()
    (tmp_path / "it" / "manifest.json").write_bytes(content.encode("latin-1"))
    result = nacs("campaign", file, "--out", "it", "--resume")
    assert (result.code, result.err.count("\n")) == (2, 1), result.err
    assert "it/manifest.json is no campaign's manifest" in result.err
    assert (tmp_path / "it" / "manifest.json").read_bytes() == content.encode("latin-1")


def test_resume_goes_by_content_not_by_paths(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = Path(campaign_shard.files.__file__).parent / "scenarios" / "nacs" / "fault-free.toml"
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "mine.toml").write_text(TEXT)
        shutil.copy(scenario, tmp_path / name / "mine-too.toml")
    monkeypatch.chdir(tmp_path / "a")
    store_of(Path("mine.toml"), Path("out"))[0].begin({HERE}, mixed=False)
    monkeypatch.chdir(tmp_path)
    store_of(Path("a/mine.toml"), Path("a/out"))[0].check()
    shutil.move(tmp_path / "a" / "out", tmp_path / "moved")
    store = store_of(tmp_path / "b" / "mine.toml", tmp_path / "moved")[0]
    store.check()
    assert store.processors == (HERE,)
    other = tmp_path / "b" / "mine-too.toml"
    changed = other.read_text().replace("ticks = 1000", "ticks = 999")
    assert changed != other.read_text()
    other.write_text(changed)
    with pytest.raises(BadInput, match="scenario file changed"):
        store_of(tmp_path / "b" / "mine.toml", tmp_path / "moved")[0].check()


def test_what_a_campaign_cannot_do_leaves_nothing(nacs, tmp_path: Path) -> None:
    file = write(tmp_path / "in")
    text = file.read_text()
    for policy in ("redraw", "refuse"):
        file.write_text(text.replace("[0.0150, 0.0196]", "[1, 2]").replace("seed = 11", f'seed = 11\nnon_physical = "{policy}"'))
        result = nacs("campaign", file, "--out", "it", "--workers", 1)
        assert (result.code, result.err.count("\n")) == (2, 1), result.err
        assert "narrow the dispersion" in result.err
        assert not (tmp_path / "it").exists()
    file.write_text(text)
    result = nacs("campaign", file, "--out", "it", "--engine", "dask", "--scheduler", "tcp://127.0.0.1:9")
    assert (result.code, result.err.count("\n")) == (2, 1), result.err
    assert not (tmp_path / "it").exists()
    (tmp_path / "it").mkdir()
    (tmp_path / "it" / "notes").touch()
    result = nacs("campaign", file, "--out", "it")
    assert result.code == 2
    assert "--resume" in result.err
    assert "--overwrite" not in result.err


def test_resume_begins_what_was_killed_before_its_manifest(nacs, tmp_path: Path) -> None:
    file = write(tmp_path / "in")
    (tmp_path / "it").mkdir()
    (tmp_path / "it" / ".manifest-999999999-01234567.part.json").write_text("{")
    again = nacs("campaign", file, "--out", "it", "--resume", "--workers", 1)
    assert again.code == 0, again.err
    assert sorted(path.name for path in (tmp_path / "it").iterdir() if path.is_file()) == [
        "manifest.json", "recording.rrd", "report.png", "summary.json", "trials.parquet",
    ]  # fmt: skip


@pytest.mark.parametrize("begun", [False, True])
def test_a_campaign_that_is_interrupted_outside_its_flight_says_how_to_go_on(
    nacs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, begun: bool
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    file = write(tmp_path / "in")
    monkeypatch.setattr(Store, "missing" if begun else "begin", interrupted)
    result = nacs("campaign", file, "--out", "it")
    way_on = f"go on with: nacs campaign {file} --resume --out it" if begun else "nothing was begun; the same command begins anew"
    assert (result.code, result.err) == (130, f"interrupted: {way_on}\n")
    assert (tmp_path / "it").exists() == begun


def test_a_failure_that_nobody_expected_says_how_a_campaign_goes_on(nacs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuses(*_: object) -> None:
        raise np.linalg.LinAlgError("Singular matrix")

    file = write(tmp_path / "in")
    monkeypatch.delenv("NACS_TRACEBACK")
    monkeypatch.setattr("sim.cli.commands.campaign._fly", refuses)
    result = nacs("campaign", file, "--out", "it")
    assert (result.code, result.err) == (
        3, f"error: numeric failure: Singular matrix; go on with: nacs campaign {file} --resume --out it\n",
    )  # fmt: skip


# processors -------------------------------------------------------------------------------------------------------------------


@pytest.mark.skipif("openblas" not in processor(), reason="another BLAS")
def test_the_processor_is_the_kernel_that_blas_chose() -> None:
    script = "from sim.processor import processor; print(processor())"
    said = []
    for kernel in ("Haswell", "Prescott"):  # OpenBLAS takes this for what the processor is
        environment = os.environ | {"OPENBLAS_CORETYPE": kernel}
        said.append(subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True).stdout)
    assert "Haswell" in said[0]
    assert "Haswell" not in said[1]


def test_processors_are_mixed_only_if_that_is_allowed(nacs, flown, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, tables = flown
    store, _ = store_of(path, tmp_path / "it")
    store.begin({HERE}, mixed=False)
    store.keep(tables[0]._replace(processor=HERE), mixed=False)
    before = (tmp_path / "it" / "manifest.json").read_bytes()
    monkeypatch.setattr(engines, "processor", lambda: "x86_64 openblas There")
    monkeypatch.setattr(campaign_shard, "processor", lambda: "x86_64 openblas There")
    refused = nacs("campaign", path, "--out", "it", "--resume", "--workers", 1)
    assert (refused.code, refused.err.count("\n")) == (2, 1), refused.err
    assert all(part in refused.err for part in (HERE, "x86_64 openblas There", "--mixed-processors"))
    assert (tmp_path / "it" / "manifest.json").read_bytes() == before
    allowed = nacs("campaign", path, "--out", "it", "--resume", "--workers", 1, "--mixed-processors")
    assert allowed.code == 0, allowed.err
    summary = json.loads((tmp_path / "it" / "summary.json").read_text())
    assert summary["processors"] == [HERE, "x86_64 openblas There"]
    assert "not to the bit" in summary["mixed_processors"]
    assert "not to the bit" in allowed.out
    # the manifest knows both now, and goes on asking
    assert nacs("campaign", path, "--out", "it", "--resume", "--workers", 1).code == 2


def test_a_block_of_another_processor_than_is_allowed_is_not_kept(flown, tmp_path: Path) -> None:
    path, tables = flown
    store, jobs = store_of(path, tmp_path / "it")
    store.begin({HERE}, mixed=False)
    with pytest.raises(BadInput, match="--mixed-processors"):
        store.keep(tables[0]._replace(processor="another"), mixed=False)
    assert store.missing(jobs) == (jobs, 0)
    store.keep(tables[0]._replace(processor="another"), mixed=True)
    assert store.missing(jobs)[0] == jobs[1:]


# workers ----------------------------------------------------------------------------------------------------------------------


def test_a_worker_that_is_killed_costs_its_job_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(MADE_UP)
    from mortal import dies_once  # noqa: PLC0415

    jobs = [(str(tmp_path), number) for number in range(5)]
    assert sorted(in_processes(dies_once, jobs, 2)) == [0, 2, 4, 6, 8]
    times = [len(list(tmp_path.glob(f"{number}-*"))) for number in range(5)]
    assert times == [1, 1, 2, 1, 1]


def test_a_job_that_kills_its_worker_is_given_up_after_three_times(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(MADE_UP)
    from mortal import dies_always  # noqa: PLC0415

    found = list[int]()
    jobs = [(str(tmp_path), number) for number in range(4)]
    with pytest.raises(WorkersLost, match="1 block of trials could not be flown: the worker process was lost 3 times"):
        found.extend(in_processes(dies_always, jobs, 2))
    assert sorted(found) == [0, 4, 6]
    assert [len(list(tmp_path.glob(f"{number}-*"))) for number in range(4)] == [1, 3, 1, 1]


@pytest.mark.parametrize("lost", [WorkersLost(1), engines.SchedulerLost("the dask scheduler was lost")], ids=["worker", "scheduler"])
def test_what_is_lost_ends_with_the_command_that_goes_on(nacs, flown, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lost) -> None:
    path, tables = flown

    def loses(_self: object, _function: object, _jobs: object) -> Iterator[Tables]:
        yield tables[0]
        raise lost

    monkeypatch.setattr(engines.Local, "map", loses)
    result = nacs("campaign", path, "--out", "it", "--workers", 2)
    assert (result.code, result.err.count("\n")) == (3, 1), result.err
    assert f"error: {lost}: 3 of 6 trials are left; go on with: nacs campaign {path} --resume --out it" in result.err
    assert (tmp_path / "it" / "shards" / "point-0000-trial-00000000.seal").is_file()


def test_a_run_that_lost_a_worker_keeps_the_other_blocks(nacs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def loses(function, jobs, _workers) -> Iterator[object]:
        yield function(jobs[1])
        raise WorkersLost(1)

    monkeypatch.setattr("sim.campaign.blocks.in_processes", loses)
    result = nacs("run", "nacs/fault-free", "--set", "run.ticks=20", "--trials", 4, "--workers", 2, "--out", "it", "--without", "report")
    assert (result.code, result.err.count("\n")) == (3, 1), result.err
    assert "2 of 4 trials were finished and kept in it" in result.err
    assert set(np.asarray(pq.read_table(tmp_path / "it" / "trials.parquet")["trial"])) == {2, 3}


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="no such signals here")
def test_sigterm_is_ctrl_c_for_a_campaign_in_processes(tmp_path: Path) -> None:
    file = write(tmp_path / "in")
    file.write_text(file.read_text().replace("trials = 6", "trials = 400"))
    command = [sys.executable, "-m", "sim.cli.main", "campaign", str(file), "--out", str(tmp_path / "it"), "--workers", "2"]
    running = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    end = time.monotonic() + 120
    while not list((tmp_path / "it").glob("shards/*.seal")) and running.poll() is None and time.monotonic() < end:
        time.sleep(0.05)
    running.send_signal(signal.SIGTERM)
    running.send_signal(signal.SIGHUP)  # a second one is heard and not heeded
    _, said = running.communicate(timeout=60)  # its pipes close when the last worker is gone
    assert running.returncode == 130, said
    assert len(said.splitlines()) == 1, said
    assert "trials are left; go on with: nacs campaign" in said
    assert not list((tmp_path / "it").rglob("*.part*"))
    sealed = len(list((tmp_path / "it").glob("shards/*.seal")))
    assert f"{400 - 3 * sealed} of 400" in said or sealed == 134
