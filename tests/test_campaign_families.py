"""Campaigns of scenarios of several agents: grids flown in batches, dispersions trial by trial, tables and a picture along the grid."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from matplotlib import image

from sim.campaign.blocks import simulate
from sim.campaign.draws import picked
from sim.campaign.file import CAMPAIGNS
from sim.campaign.file import load as load_campaign
from sim.campaign.shard import fly
from sim.cli.commands.campaign import _jobs
from sim.loop.lost_trials import LostTrial
from sim.metrics.trial_block import TrialBlock
from sim.report.campaign.sweep import abscissa
from sim.scenario.files import check, dumped, load

SHORT = """
[override]
"run.ticks" = 60
"phases.transient" = [0.0, 0.2]
"phases.settled" = [0.3, 0.6]
"""
SWEEP = f"""
title = "Short"
scenario = "formation/message-loss"
seed = 5
trials = 3
shard = 2
metrics = ["fkae@settled", "peak_torque@all"]
{SHORT}
[grid]
"graph.when_lost" = ["hold", "skip"]
"faults.0.probability" = [0.0, 0.5, 0.9]
"""
DISPERSED = (
    SWEEP.partition("[grid]")[0]
    + """
[dispersion]
"faults.0.probability" = { uniform = [0.0, 0.9] }
"loops.aukf.law.k1" = { uniform = [0.4, 0.6] }
"""
)


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "some.toml"
    path.write_text(text)
    return path


def values(path: Path, **wanted: Any) -> dict[tuple[str, str, str], float]:
    rows = pq.read_table(path / "trials.parquet").to_pylist()
    return {
        (row["subject"], row["metric"], row["phase"]): row["value"]
        for row in rows
        if row["subject"] not in ("draw", "loop") and all(row[k] == v for k, v in wanted.items())
    }


@pytest.mark.parametrize("name", ["formation/no-command", "formation/nacs-faults", "consensus/dynamics"])
def test_a_scenario_survives_being_written_and_read(name):
    settings = load(name, {})
    again = check(json.loads(json.dumps(dumped(settings))), "again", {})
    assert type(again) is type(settings)
    assert dumped(again) == dumped(settings)


def test_a_sweep_gives_what_single_runs_give_and_shows_it(nacs, tmp_path):
    write(tmp_path, SWEEP)
    result = nacs("campaign", "some.toml", "--out", "c", "--workers", 1)
    assert result.code == 0, result.err
    assert "fkae, settled" in result.out
    assert "transient" not in result.out
    assert max(len(line) for line in result.out.splitlines()) <= 80
    assert image.imread(tmp_path / "c" / "report.png").shape[0] > 300
    for point, trial in ((1, 0), (4, 2)):
        single = nacs("run", "some.toml", "--only-trial", trial, "--point", point, "--out", f"r{point}")
        assert single.code == 0, single.err
        found = values(tmp_path / "c", point=point, trial=trial)
        once = values(tmp_path / f"r{point}")
        assert set(found) == {(loop, *what) for loop in ("truth", "aukf") for what in (("fkae", "settled"), ("peak_torque", "all"))}
        assert all(once[key] == value for key, value in found.items())


def test_a_shard_s_size_changes_nothing(nacs, tmp_path):
    write(tmp_path, SWEEP)
    for name, shard in (("one", 1), ("three", 3)):
        assert nacs("campaign", "some.toml", "--out", name, "--workers", 1, "--shard", shard).code == 0
    assert pq.read_table(tmp_path / "one" / "trials.parquet").equals(pq.read_table(tmp_path / "three" / "trials.parquet"))


def test_what_is_dispersed_is_drawn_for_each_trial(nacs, tmp_path):
    campaign = load_campaign(write(tmp_path, DISPERSED))
    result = nacs("campaign", "some.toml", "--out", "c", "--workers", 1)
    assert result.code == 0, result.err
    rows = pq.read_table(tmp_path / "c" / "trials.parquet").to_pylist()
    drawn = [row["value"] for row in rows if row["subject"] == "draw" and row["metric"] == "faults.0.probability"]
    assert len(set(drawn)) == 3
    assert drawn == [picked(campaign, trial)["faults.0.probability"] for trial in range(3)]
    single = nacs("run", "some.toml", "--only-trial", 1, "--out", "r")
    assert single.code == 0, single.err
    assert values(tmp_path / "c", trial=1).items() <= values(tmp_path / "r").items()


def test_a_trial_that_fails_harms_no_other(tmp_path, monkeypatch):
    campaign = load_campaign(write(tmp_path, SWEEP.replace("shard = 2", "shard = 3")))

    def failing(scenario, trials, recorded, campaign=None):
        whole = simulate(scenario, trials, recorded, campaign=campaign)
        alive = whole.trials[whole.trials != 1]
        metrics = [metric.of(whole.trials, alive) for metric in whole.metrics]
        return TrialBlock(alive, metrics, {}, (LostTrial(1, 10, 0.1, "it broke"),))

    monkeypatch.setattr("sim.campaign.shard.simulate", failing)
    job = _jobs(campaign, [json.dumps(dumped(campaign.at(0)))])[0]
    rows = fly(job).metrics.to_pylist()
    failed = {row["trial"]: (row["value"], row["reason"]) for row in rows if row["metric"] == "failed"}
    assert [failed[trial][0] for trial in range(3)] == [0.0, 1.0, 0.0]
    assert "it broke" in failed[1][1]
    measured = {row["trial"] for row in rows if row["metric"] == "fkae"}
    assert measured == {0, 2}


def test_curves_run_along_the_longest_key_of_numbers(tmp_path):
    campaign = load_campaign(write(tmp_path, SWEEP))
    assert abscissa(campaign) == "faults.0.probability"
    assert abscissa(campaign.model_copy(update={"grid": {"graph.when_lost": ("hold", "skip")}})) is None
    np.testing.assert_array_equal([point["faults.0.probability"] for point in campaign.points[:3]], [0.0, 0.5, 0.9])


@pytest.mark.parametrize(
    ("old", "new", "wanted"),
    [
        ("0.9]", "1.5]", ["faults.0.probability", "1.5"]),
        ("graph.when_lost", "graph.when_last", ["graph.when_last", "unknown key"]),
        ("formation/message-loss", "formation/massage-loss", ["formation/massage-loss"]),
    ],
)
def test_a_wrong_key_is_one_line(nacs, tmp_path, old, new, wanted):
    write(tmp_path, SWEEP.replace(old, new))
    result = nacs("campaign", "some.toml", "--out", "c")
    assert result.code == 2
    assert result.err.count("\n") == 1
    assert all(part in result.err for part in wanted), result.err
    assert not (tmp_path / "c").exists()


@pytest.mark.parametrize("name", ["formation-message-loss", "formation-message-delay"])
def test_the_campaigns_that_come_along_are_sound(name):
    assert load_campaign(CAMPAIGNS / f"{name}.toml").points
