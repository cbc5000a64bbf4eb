from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

from models.plants.inertia import why_impossible
from sim.bad_input import BadInput
from sim.campaign import store as campaign_store
from sim.campaign.draws import draw
from sim.campaign.file import CAMPAIGNS, load
from sim.campaign.shard import FIXED_POINT, Job, bin_values, fly
from sim.campaign.summary import Distribution, beats_both, duels, ensemble_consistency, operating_characteristic, summarize, worst
from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.plant.batch import Plant, SimulationFailed
from sim.rerun.campaign import quantiles

TEXT = """
title = "short"
scenario = "nacs/wheel-failure"
seed = 11
trials = 7
shard = 3
metrics = ["rmse_truth_*", "detection_delay_s", "peak_statistic", "nis_mean"]

[override]
run.ticks = 60
"faults.0.start_s" = 2.0
"faults.0.duration_s" = 2.0

[dispersion]
"plant.inertia_kg_m2.1" = { uniform = [0.0150, 0.0196] }
plant.centre_of_mass_um.0 = { normal = [0.0, 1.0] }
"plant.wheel_coulomb_nm" = { log_uniform = [3e-6, 3e-5] }
"sensors.gyro_noise_rad_s" = { log_uniform = [9e-4, 3.4e-3] }
"faults.0.start_s" = { uniform = [1.0, 3.0] }
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "mine.toml"
    path.write_text(TEXT)
    return path


def rows(folder: Path) -> object:
    return pq.read_table(folder / "trials.parquet")


def test_no_number_depends_on_shards_workers_or_engine(nacs, file: Path, tmp_path: Path) -> None:
    found = []
    for name, options in {
        "whole": ["--shard", 100, "--workers", 1],
        "cut": ["--shard", 2, "--workers", 1],
        "processes": ["--workers", 2],
        "cluster": ["--engine", "dask", "--workers", 2],
    }.items():
        result = nacs("campaign", file, "--out", name, *options)
        assert result.code == 0, result.err
        summary = json.loads((tmp_path / name / "summary.json").read_text())
        found.append((rows(tmp_path / name), summary["rows"], summary["points"]))
        assert (tmp_path / name / "report.png").is_file()
        assert (tmp_path / name / "recording.rrd").is_file()
    assert all(table.equals(found[0][0]) and rest == list(found[0][1:]) for table, *rest in found[1:])


def test_an_interrupted_campaign_goes_on_with_what_is_missing_alone(nacs, file: Path, tmp_path: Path, monkeypatch) -> None:
    assert nacs("campaign", file, "--out", "whole", "--workers", 1).code == 0
    original, flown = fly, []

    def stops(job: Job) -> object:
        if len(flown) == 2:
            raise KeyboardInterrupt
        flown.append(job.start)
        return original(job)

    monkeypatch.setattr("sim.cli.commands.campaign.fly", stops)
    interrupted = nacs("campaign", file, "--out", "part", "--workers", 1)
    assert interrupted.code == 130
    assert "1 of 7 trials are left" in interrupted.err
    assert flown == [0, 3]
    again: list[int] = []
    monkeypatch.setattr("sim.cli.commands.campaign.fly", lambda job: again.append(job.start) or original(job))
    assert nacs("campaign", file, "--out", "part", "--workers", 1, "--resume").code == 0
    assert again == [6]
    assert rows(tmp_path / "part").equals(rows(tmp_path / "whole"))


def test_a_corrupt_shard_is_done_again(nacs, file: Path, tmp_path: Path) -> None:
    assert nacs("campaign", file, "--out", "it", "--workers", 1).code == 0
    before = rows(tmp_path / "it")
    shard = sorted((tmp_path / "it" / "shards").glob("*.parquet"))[1]
    shard.write_bytes(shard.read_bytes()[:100])
    result = nacs("campaign", file, "--out", "it", "--workers", 1, "--resume")
    assert result.code == 0
    assert "1 shard is damaged and flown again" in result.err
    assert rows(tmp_path / "it").equals(before)


def test_resume_refuses_another_campaign_and_other_code(nacs, file: Path, monkeypatch) -> None:
    assert nacs("campaign", file, "--out", "it", "--workers", 1, "--trials", 3).code == 0
    changed = nacs("campaign", file, "--out", "it", "--resume", "--trials", 4)
    assert (changed.code, changed.err.count("\n")) == (2, 1)
    assert "trials changed" in changed.err
    monkeypatch.setattr(campaign_store, "fingerprint", lambda: "another")
    other = nacs("campaign", file, "--out", "it", "--resume", "--trials", 3)
    assert other.code == 2
    assert "code or its libraries changed" in other.err


def test_a_failed_trial_is_a_row_with_its_reason_and_harms_no_other(file: Path, monkeypatch) -> None:
    campaign = load(file)
    job = Job(campaign.model_dump_json(), campaign.at(0).model_dump_json(exclude_none=True), 0, 0, 4)
    sound = fly(job).metrics.to_pylist()
    original = Plant.advance

    def fails(self: Plant, wheel_torque: object, torque_B: object, steps: int) -> None:
        original(self, wheel_torque, torque_B, steps)
        if self.trials == 4:
            raise SimulationFailed(2, 1.0, "on purpose")

    monkeypatch.setattr(Plant, "advance", fails)
    found = fly(job).metrics.to_pylist()
    [row] = [r for r in found if r["reason"]]
    assert (row["trial"], row["metric"], row["value"]) == (2, "failed", 1.0)
    assert "on purpose" in row["reason"]
    assert [r for r in found if r["trial"] != 2] == [r for r in sound if r["trial"] != 2]


def test_one_trial_of_a_campaign_flies_again_to_the_bit(nacs, file: Path, tmp_path: Path) -> None:
    assert nacs("campaign", file, "--out", "all", "--workers", 1).code == 0
    result = nacs("run", file, "--only-trial", 4, "--out", "one")
    assert result.code == 0, result.err
    key = ("subject", "metric", "phase", "value")
    alone = {tuple(row[k] for k in key) for row in pq.read_table(tmp_path / "one" / "trials.parquet").to_pylist()}
    mine = [
        row for row in rows(tmp_path / "all").to_pylist() if row["trial"] == 4 and row["subject"] != "draw" and row["metric"] != "failed"
    ]
    assert mine
    assert {tuple(row[k] for k in key) for row in mine} <= alone
    assert (tmp_path / "one" / "recording.rrd").is_file()


def test_a_campaign_cannot_be_run_as_a_scenario(nacs, file: Path) -> None:
    result = nacs("run", file)
    assert (result.code, result.err.count("\n")) == (2, 1)
    assert "is a campaign" in result.err
    assert "--only-trial K" in result.err
    assert "--point 3" in nacs("run", file, "--only-trial", 0, "--point", 3).err


# draws ------------------------------------------------------------------------------------------------------------------------


def test_a_trial_draws_the_same_in_any_batch(file: Path) -> None:
    campaign = load(file)
    base = campaign.at(0)
    everyone, some = draw(campaign, base, np.arange(7)), draw(campaign, base, np.array([5, 2]))
    np.testing.assert_array_equal(some.values, everyone.values[[5, 2]])


def test_plants_differ_and_filters_believe_the_scenario(file: Path) -> None:
    campaign = load(file)
    base = campaign.at(0)
    drawn = draw(campaign, base, np.arange(7))
    system = build(base, np.arange(7), variants=drawn.variants)
    np.testing.assert_allclose(system.plant.inertia[:, 1, 1], drawn.values[:, 0])
    assert len(set(drawn.values[:, 0])) == 7
    np.testing.assert_array_equal(system.estimators[0].filter.process.inertia, base.plant.inertia)


def test_a_dispersed_trial_is_the_same_to_the_bit_alone_and_among_others(file: Path) -> None:
    campaign = load(file)
    base = campaign.at(0)
    alone, among = (run(build(base, trials, variants=draw(campaign, base, trials).variants)) for trials in (np.array([4]), np.arange(7)))
    for name, channel in among.channels.items():
        if not name.startswith("reference/"):
            np.testing.assert_array_equal(channel[:, 4], alone.channels[name][:, 0], err_msg=name)


def test_a_variant_flies_like_a_scenario_that_says_so(file: Path) -> None:
    campaign = load(file)
    base = campaign.at(0)
    drawn = draw(campaign, base, np.array([3]))
    plant = drawn.variants.plants[0]
    dispersed = build(base, np.array([3]), variants=drawn.variants).plant
    compiled = build(base.model_copy(update={"plant": plant}), np.array([3])).plant
    for simulated in (dispersed, compiled):
        simulated.start(
            np.array([0.02, -0.03, 0.05, 0.998]) / np.linalg.norm([0.02, -0.03, 0.05, 0.998]), np.array([0.1, -0.2, 0.3]), np.full(4, 40.0)
        )
        simulated.advance(np.full((1, 4), 1e-3), np.zeros((1, 3)), 50)
    np.testing.assert_allclose(dispersed.truth().state, compiled.truth().state, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("design", ["latin-hypercube", "sobol"])
def test_designs_fill_every_stratum(file: Path, design: str) -> None:
    file.write_text(TEXT.replace("trials = 7", f"trials = 16\ndesign = '{design}'"))
    campaign = load(file)
    values = draw(campaign, campaign.at(0), np.arange(16)).values[:, 0]
    assert sorted(np.floor(16 * (values - 0.0150) / 0.0046).astype(int)) == list(range(16))


def test_an_impossible_draw_is_drawn_again_or_refused(file: Path) -> None:
    wide = TEXT.replace("uniform = [0.0150, 0.0196]", "uniform = [0.001, 0.0196]")
    file.write_text(wide)
    campaign = load(file)
    drawn = draw(campaign, campaign.at(0), np.arange(40))
    assert (drawn.redrawn > 0).any()
    assert all(why_impossible(plant.inertia) is None for plant in drawn.variants.plants)
    file.write_text(wide.replace("seed = 11", 'seed = 11\nnon_physical = "refuse"'))
    strict = load(file)
    with pytest.raises(BadInput, match=r"trial \d+ draws .*inertia.*narrow the dispersion"):
        draw(strict, strict.at(0), np.arange(40))


WRONG = [
    ('"plant.inertia_kg_m2.1"', '"plant.inertias.1"', ["dispersion.plant.inertias.1", "dispersible are"]),
    ('"plant.inertia_kg_m2.1"', '"plant.inertia_kg_m2.9"', ["dispersion.plant.inertia_kg_m2.9", "no such key"]),
    ('"plant.inertia_kg_m2.1"', '"plant.wheel_mass_kg"', ["plant.wheel_mass_kg", "compiled model"]),
    ('"plant.inertia_kg_m2.1"', '"observers.ekf.alpha"', ["observers.ekf.alpha", "unknown key"]),
    ('"sensors.gyro_noise_rad_s"', '"sensors.gyro_nois"', ["sensors.gyro_nois"]),
    ("run.ticks = 60", "run.ticks = {}", ["run.ticks: must be a whole number"]),
    ("{ uniform = [0.0150, 0.0196] }", "{ uniform = [0.02, 0.01] }", ["dispersion.plant.inertia_kg_m2.1", "low < high"]),
    ("{ uniform = [0.0150, 0.0196] }", "{ uniform = [0.02] }", ["dispersion.plant.inertia_kg_m2.1.uniform"]),
    ("{ uniform = [0.0150, 0.0196] }", "{}", ["dispersion.plant.inertia_kg_m2.1", "give a number or one of"]),
    ("{ uniform = [1.0, 3.0] }", "{ uniform = [1.0, 30.0] }", ["faults.0.start_s", "32 s", "0 to 6 s"]),
    ("trials = 7", "trials = 0", ["trials", "greater than or equal to 1"]),
    ("trials = 7", "trials = 7\ntrails = 7", ["trails", "unknown key", "trials"]),
    ('"nacs/wheel-failure"', '"nacs/wheel-failur"', ["no scenario 'nacs/wheel-failur'", "nacs/wheel-failure"]),
    ("run.ticks = 60", "run.tick = 60", ["run.tick", "unknown key"]),
    ("title", "title title", ["TOML", "line 2"]),
]


@pytest.mark.parametrize(("old", "new", "wanted"), WRONG, ids=[new for _, new, _ in WRONG])
def test_a_wrong_campaign_is_one_line_and_writes_nothing(nacs, file: Path, tmp_path: Path, old: str, new: str, wanted: list[str]) -> None:
    file.write_text(TEXT.replace(old, new, 1))
    result = nacs("campaign", file)
    assert result.code == 2
    assert result.err.count("\n") == 1, result.err
    assert all(part in result.err for part in ["mine.toml", *wanted]), result.err
    assert [p.name for p in tmp_path.iterdir()] == ["mine.toml"]


@pytest.mark.parametrize(
    ("arguments", "wanted"),
    [
        (["none"], ["no campaign 'none'", "nacs-wheel-failure"]),
        (["none.toml"], ["no campaign file none.toml"]),
        (["nacs-wheel-failure", "--engine", "abacus"], ["--engine abacus", "local or dask"]),
        (["nacs-wheel-failure", "--scheduler", "tcp://127.0.0.1:9"], ["--scheduler tcp://127.0.0.1:9", "--engine dask"]),
        (["nacs-wheel-failure", "--resume"], ["--resume needs --out"]),
        (["nacs-wheel-failure", "--trials", "0"], ["--trials", "at least 1"]),
    ],
)
def test_a_wrong_argument_is_one_line(nacs, tmp_path: Path, arguments: list[str], wanted: list[str]) -> None:
    result = nacs("campaign", *arguments)
    assert (result.code, result.err.count("\n")) == (2, 1)
    assert all(part in result.err for part in wanted)
    assert not list(tmp_path.iterdir())


def test_a_scheduler_that_does_not_answer_is_one_line(nacs, file: Path) -> None:
    result = nacs("campaign", file, "--engine", "dask", "--scheduler", "tcp://127.0.0.1:9", "--out", "it")
    assert result.code == 2
    assert "no dask scheduler answers" in result.err


def test_a_full_disk_is_one_line_and_says_how_to_go_on(nacs, file: Path, monkeypatch) -> None:
    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    result = nacs("campaign", file, "--out", "it", "--workers", 1)
    assert (result.code, result.err.count("\n")) == (3, 1)
    assert "manifest.json cannot be written: No space left on device" in result.err


def test_a_disk_that_is_full_later_keeps_what_is_finished_and_says_how_to_go_on(nacs, file: Path, tmp_path: Path, monkeypatch) -> None:
    done, room = [], os.fsync
    limit = 6  # the manifest, a shard of four files, and one more

    def full(number: int) -> None:
        done.append(number)
        if len(done) > limit:
            raise OSError(28, "No space left on device")
        room(number)

    monkeypatch.setattr(os, "fsync", full)
    result = nacs("campaign", file, "--out", "it", "--workers", 1)
    assert (result.code, result.err.count("\n")) == (3, 1), result.err
    assert "No space left on device: 4 of 7 trials are left; go on with: nacs campaign" in result.err
    kept = sorted(path.suffix for path in (tmp_path / "it" / "shards").iterdir())
    assert kept == [".bands", ".bands", ".consistency", ".parquet", ".seal"]
    limit = 1000
    again: list[int] = []
    monkeypatch.setattr("sim.cli.commands.campaign.fly", lambda job: again.append(job.start) or fly(job))
    blocked = tmp_path / "it" / "report.png"
    blocked.mkdir()
    result = nacs("campaign", file, "--out", "it", "--workers", 1, "--resume")
    assert (result.code, result.err.count("\n")) == (3, 1), result.err
    assert "report.png cannot be written: Is a directory" in result.err
    assert "--resume" in result.err
    assert again == [3, 6]
    assert len(rows(tmp_path / "it").filter(pc.field("metric") == "failed")) == 7
    assert json.loads((tmp_path / "it" / "summary.json").read_text())["trials"] == 7


# summary ----------------------------------------------------------------------------------------------------------------------


def distribution(subject: str, metric: str, values: list[float], phase: str = "all") -> Distribution:
    return Distribution(0, subject, metric, phase, "1", np.arange(len(values)), np.array(values))


def test_the_interval_of_the_mean_covers_it_as_often_as_it_says() -> None:
    generator = np.random.default_rng(1)
    hits = 0
    for _ in range(100):
        row = summarize(distribution("a", "m", list(generator.exponential(size=60))), 3)
        hits += row["mean_low"] < 1.0 < row["mean_high"]
    assert 85 <= hits <= 99  # 95 expected; percentile intervals of a skewed quantity are a little short


def test_a_number_that_was_binned_is_found_again_within_half_a_bin() -> None:
    """Forty bins a decade from 1e-8 on: the middle of a bin is at most 10^(1/80) = 1.0292 off, and on average not at all."""
    value = 10.0 ** np.random.default_rng(4).uniform(-7.9, 7.9, 20_000)
    off = np.log10(bin_values(np.floor(40.0 * (np.log10(value) + 8.0)).astype(np.int64)) / value)
    assert np.abs(off).max() <= 1.0 / 80.0 + 1e-12
    assert abs(off.mean()) < 4 * (1.0 / 40.0) / 12**0.5 / 20_000**0.5


def test_duels_and_victories_count_trials() -> None:
    found = [distribution("h", "m", [1, 2, 3, 9]), distribution("ekf", "m", [2, 3, 4, 5]), distribution("sif", "m", [3, 1, 5, 6])]
    assert next(r for r in duels(found, "m") if r["who"] == "h < ekf")["share"] == 0.75
    assert beats_both(found, "h", "m", ("ekf", "sif"))["share"] == 0.5
    assert worst(found, "m", "h", 2) == [(3, 9.0), (2, 3.0)]


def test_the_operating_characteristic_falls_with_the_threshold() -> None:
    found = [
        distribution("h", "peak_statistic", [0.5, 0.9, 1.5, 0.7], "nominal"),
        distribution("h", "peak_statistic", [2.0, 3.0, 0.8, 5.0], "fault"),
    ]
    curve = operating_characteristic(found, "h")
    at_one = np.argmin(np.abs(curve["threshold"] - 1.0))
    assert (curve["false_alarm"][at_one], curve["detection"][at_one]) == (0.25, 0.75)
    assert (np.diff(curve["detection"]) <= 0).all()


def test_bands_and_sums_are_those_of_the_trials(file: Path) -> None:
    campaign = load(file)
    base = campaign.at(0)
    tables = fly(Job(campaign.model_dump_json(), base.model_dump_json(exclude_none=True), 0, 0, 7))
    drawn = draw(campaign, base, np.arange(7))
    recording = run(build(base, np.arange(7), variants=drawn.variants))
    told = tables.metrics.to_pylist()
    for place, key in enumerate(campaign.dispersion):
        own = [(row["trial"], row["value"]) for row in told if (row["subject"], row["metric"]) == ("draw", key)]
        assert own == list(enumerate(drawn.values[:, place].tolist()))
    assert [row["value"] for row in told if row["metric"] == "failed"] == [0.0] * 7
    assert not [row for row in told if row["metric"] == "redrawn"]
    ticks, found = quantiles(tables.bands, "rate_error_rad_s", "ekf")
    error = np.linalg.norm(recording.channels["ekf/mean"][ticks][..., 4:7] - recording.channels["truth/state"][ticks][..., 4:7], axis=-1)
    np.testing.assert_allclose(found[:, 1], np.sort(error, axis=1)[:, 3], rtol=0.04)  # half a bin of 40 a decade
    sums = tables.consistency.to_pylist()
    nees = [row["total"] / FIXED_POINT for row in sums if (row["statistic"], row["observer"]) == ("nees", "ekf")]
    np.testing.assert_allclose(nees, recording.channels["ekf/nees"].sum(axis=1), rtol=1e-5)
    nis = np.array(
        [(row["count"], row["freedom"]) for row in sums if (row["statistic"], row["observer"]) == ("nis", "ekf") and row["tick"]]
    )
    np.testing.assert_array_equal(nis, [[7, 70]] * (recording.ticks - 1))  # ten of each, since nothing is missing
    assert {row["observer"] for row in ensemble_consistency(tables.consistency, 10)} == set(recording.observers)


def test_the_campaigns_that_come_along_are_sound() -> None:
    for path in CAMPAIGNS.glob("*.toml"):
        assert load(path).trials >= 1


def test_workers_die_with_a_parent_that_is_killed(tmp_path: Path) -> None:
    script = tmp_path / "parent.py"
    script.write_text(
        "import os, signal, sys\n"
        "from sim.campaign.worker_processes import one_process\n"
        "if __name__ == '__main__':\n"
        "    pool = one_process()\n"
        "    print(pool.submit(os.getpid).result(), flush=True)\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    parent = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=False)
    worker = int(parent.stdout)
    for _ in range(100):
        try:
            os.kill(worker, 0)
        except ProcessLookupError:
            return
        if Path(f"/proc/{worker}/stat").is_file() and Path(f"/proc/{worker}/stat").read_text().split(")")[1].split()[0] == "Z":
            return
        time.sleep(0.1)
    pytest.fail(f"worker {worker} outlived its parent")
