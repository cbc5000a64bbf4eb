"""The command from outside: what it prints, leaves and returns."""

from __future__ import annotations

import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from sim.campaign import blocks
from sim.plant.batch import Plant

QUICK = ("--set", "run.ticks=30", "--set", "faults=[]")


def test_parameters_shows_values_with_provenance(nacs) -> None:
    result = nacs("parameters", "nacs/fault-free", "--set", "plant.mass_kg=3.5")
    assert "mass_kg" in result.out
    assert "3.5" in result.out
    assert "hypothesis" in result.out


def test_parameters_are_those_of_several_agents_too(nacs) -> None:
    result = nacs("parameters", "consensus/fault-free", "--set", "plant.mass_kg=1.375")
    assert result.code == 0, result.err
    assert "1.375 kg" in result.out


def test_run_says_how_to_open_the_recording(nacs, tmp_path) -> None:
    result = nacs("run", "nacs/disturbance", *QUICK, "--trials", 2)
    assert result.code == 0, result.err
    assert "runs/nacs/disturbance/recording.rrd" in result.out
    assert nacs("run", "nacs/disturbance", *QUICK, "--trials", 2).code == 0
    assert (tmp_path / "runs" / "nacs" / "disturbance-2").is_dir()  # the first is kept


def test_trials_are_tidy(nacs, tmp_path) -> None:
    assert nacs("run", "nacs/disturbance", *QUICK, "--trials", 3, "--seed", 9, "--out", "it").code == 0
    table = pq.read_table(tmp_path / "it" / "trials.parquet")
    assert table.column_names == ["scenario", "trial", "seed", "subject", "metric", "phase", "unit", "value"]
    assert set(table["seed"].to_pylist()) == {9}
    values = [row["value"] for row in table.to_pylist() if (row["subject"], row["metric"]) == ("ekf", "nis_mean")]
    rows = json.loads((tmp_path / "it" / "summary.json").read_text())["rows"]
    row = next(r for r in rows if (r["subject"], r["metric"]) == ("ekf", "nis_mean"))
    assert row["n"] == 3
    assert row["mean"] == pytest.approx(np.mean(values))
    assert row["std"] == pytest.approx(np.std(values, ddof=1))


def test_overwrite_replaces_results_and_leaves_other_files(nacs, tmp_path) -> None:
    (tmp_path / "it").mkdir()
    (tmp_path / "it" / "notes.txt").write_text("mine")
    assert nacs("run", "nacs/disturbance", *QUICK, "--trials", 1, "--out", "it", "--overwrite").code == 0
    assert (tmp_path / "it" / "notes.txt").read_text() == "mine"
    assert (tmp_path / "it" / "recording.rrd").is_file()


def test_an_unstable_simulation_says_trial_and_time_and_keeps_what_was_recorded(nacs, tmp_path, monkeypatch) -> None:
    advance = Plant.advance

    def sabotage(self, wheel_torque, torque_B, steps):
        if self.truth().time > 0.95:
            wheel_torque = wheel_torque.copy()
            wheel_torque[1] = np.nan
        advance(self, wheel_torque, torque_B, steps)

    monkeypatch.setattr(Plant, "advance", sabotage)
    result = nacs("run", "nacs/fault-free", "--set", "run.ticks=30", "--trials", 3, "--out", "it")
    assert result.code == 3
    assert "trial 1 failed at t = 1.000 s" in result.err
    assert "mjWARN_BADCTRL" in result.err
    assert (tmp_path / "it" / "recording.rrd").is_file()


def test_an_interrupt_keeps_the_shards_that_were_finished(nacs, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(blocks, "TRIALS_PER_BLOCK", 2)
    simulate = blocks.simulate

    def interrupted(scenario, trials, *rest):
        if trials[0] >= 2:
            raise KeyboardInterrupt
        return simulate(scenario, trials, *rest)

    monkeypatch.setattr(blocks, "simulate", interrupted)
    result = nacs("run", "nacs/disturbance", *QUICK, "--trials", 6, "--out", "it")
    assert result.code == 130
    assert "2 of 6 trials" in result.err
    assert set(pq.read_table(tmp_path / "it" / "trials.parquet")["trial"].to_pylist()) == {0, 1}


def test_an_interrupt_before_a_shard_is_finished_writes_nothing(nacs, tmp_path, monkeypatch) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(blocks, "simulate", interrupted)
    assert nacs("run", "nacs/disturbance", *QUICK).code == 130
    assert not list(tmp_path.iterdir())


def test_missing_readings_are_counted(nacs, tmp_path) -> None:
    arguments = [
        "run",
        "nacs/fault-free",
        "--set",
        "run.ticks=200",
        "--set",
        "sensors.dropout_probability=0.1",
        "--trials",
        2,
        "--out",
        "it",
    ]
    result = nacs(*arguments)
    assert result.code == 0
    rows = json.loads((tmp_path / "it" / "summary.json").read_text())["rows"]
    count = next(r["mean"] for r in rows if r["metric"] == "missing_readings")
    assert 35 < count < 75  # 200 ticks, each of three sensors silent with probability 0.1: 54 expected
