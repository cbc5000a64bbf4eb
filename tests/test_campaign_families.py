"""Campaigns of scenarios of several agents: grids flown in batches, dispersions trial by trial, tables and a picture along the grid."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from matplotlib import image
from rich.console import Console

from sim.campaign.blocks import simulate
from sim.campaign.draws import picked
from sim.campaign.file import CAMPAIGNS
from sim.campaign.file import load as load_campaign
from sim.campaign.shard import fly
from sim.cli.commands.campaign import _jobs
from sim.loop.lost_trials import LostTrial
from sim.metrics.trial_block import TrialBlock
from sim.report.campaign.sweep import _facets, abscissa, operating_points, tables
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


def rows_of(points: int, silent: list[float], false: list[float]) -> list[dict[str, Any]]:
    common = {"unit": "1", "q05": 0.1, "q50": 0.2, "q95": 0.3, "n": 3}
    return [
        {"point": p, "subject": "nis", "metric": metric, "phase": phase, "mean": values[p], **common}
        for metric, phase, values in (("silent_fraction", "all", silent), ("false_alarm_fraction", "nominal", false))
        for p in range(points)
    ]


GRID = SWEEP[: SWEEP.index("[grid]")] + '[grid]\n"graph.when_lost" = ["hold", "skip"]\n"faults.0.probability" = [0.5, 0.1, 0.3]\n'


def test_operating_points_follow_the_key_in_order(tmp_path) -> None:
    campaign = load_campaign(write(tmp_path, GRID))
    silent, false = [0.5, 0.1, 0.3, 0.6, 0.2, 0.4], [0.05, 0.01, 0.03, 0.06, 0.02, 0.04]
    found = operating_points(campaign, "faults.0.probability", rows_of(6, silent, false))
    assert [line.settings for line in found] == [{"graph.when_lost": "hold"}, {"graph.when_lost": "skip"}]
    for line, first in zip(found, (0.1, 0.2), strict=True):
        assert line.values == (0.1, 0.3, 0.5)
        np.testing.assert_allclose(line.silent, [first, first + 0.2, first + 0.4])
        np.testing.assert_allclose(line.false, line.silent / 10)
    assert operating_points(campaign, "faults.0.probability", rows_of(6, silent, false)[:6]) == []


def test_a_table_of_a_grid_says_its_settings_beside_wide_figures(tmp_path) -> None:
    """Three keys and figures of many digits: subjects go to tables of their own before a setting loses its column."""
    campaign = load_campaign(write(tmp_path, GRID))
    rows = [
        {"point": p, "subject": subject, "metric": "m", "phase": "all", "unit": "1", "q05": 0.00123, "q50": 0.00456, "q95": 0.00789, "n": 3}
        for p in range(6)
        for subject in ("one", "two", "three", "four")
    ]
    console = Console(width=80, file=io.StringIO())
    for table in tables(campaign, rows):
        console.print(table)
    lines = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    settings = [line.split()[:2] for line in lines if line.split()[:1] in (["hold"], ["skip"])]
    assert len(settings) % 6 == 0
    assert settings[:6] == [[when, p] for when in ("hold", "skip") for p in ("0.5", "0.1", "0.3")]
    assert not any("…" in line for line in lines)


def test_more_combinations_than_dashes_have_panels_of_their_own() -> None:
    campaign = load_campaign(CAMPAIGNS / "nacs-detector-window.toml")
    assert _facets(campaign, "observers.nis-windowed.window") == [{"tuning": "consistent"}, {"tuning": "paper"}]
    few = load_campaign(CAMPAIGNS / "formation-message-loss.toml")
    assert _facets(few, "faults.0.probability") == [{}]


@pytest.mark.parametrize("name", ["nacs-detector-window", "nacs-detector-memory", "nacs-delay", "nacs-packet-loss"])
def test_every_point_of_the_detectors_campaigns_is_a_scenario(name: str) -> None:
    campaign = load_campaign(CAMPAIGNS / f"{name}.toml")
    for point, settings in enumerate(campaign.points):
        scenario = campaign.at(point)
        assert scenario.run.ticks == 500
        assert all(o.tuning == settings["tuning"] for o in scenario.observers.values())
