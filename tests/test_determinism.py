"""Trial i is the same trial whatever the batch: alone, in a batch of any size, in any process."""

from __future__ import annotations

import numpy as np
import pyarrow.parquet as pq
import pytest

from sim.campaign.blocks import cut, simulate
from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.metrics.one_body import evaluate
from sim.metrics.trial_block import join
from sim.scenario.files import load

SHORT = {"run.ticks": 120, "faults.0.start_s": 3.0, "faults.1.start_s": 7.0}
NOISY = {"sensors.jitter_s": 0.02, "sensors.latency_s": 0.05, "sensors.dropout_probability": 0.05}


@pytest.mark.parametrize("overrides", [SHORT, SHORT | NOISY], ids=["bench", "late and missing readings"])
@pytest.mark.parametrize("company", [[3], [3, 7], [0, 1, 2, 3], list(range(10))])
def test_every_channel_of_trial_3_is_the_same_to_the_bit(overrides: dict, company: list[int]) -> None:
    scenario = load("nacs/disturbance", overrides)
    alone = run(build(scenario, np.array([3]))).channels
    among = run(build(scenario, np.array(company)))
    place = company.index(3)
    for name, channel in among.channels.items():
        if not name.startswith("reference/"):
            np.testing.assert_array_equal(channel[:, place], alone[name][:, 0], err_msg=name)


def test_metrics_do_not_depend_on_how_the_trials_are_cut() -> None:
    scenario = load("nacs/disturbance", SHORT)
    trials, nothing = np.arange(7), np.zeros(0, dtype=int)
    whole = join([simulate(scenario, trials, nothing)])[1]
    parts = join([simulate(scenario, block, nothing) for block in reversed(cut(trials, 3))])[1]
    assert [m[:4] for m in whole] == [m[:4] for m in parts]
    for one, other in zip(whole, parts, strict=True):
        np.testing.assert_array_equal(one.values, other.values, err_msg=f"{one.subject} {one.metric}")


def test_two_seeds_differ() -> None:
    first, second = (run(build(load("nacs/fault-free", {"run.ticks": 3, "run.seed": seed}), np.arange(1))) for seed in (1, 2))
    assert not np.array_equal(first.channels["reading"], second.channels["reading"])


def test_no_metric_depends_on_the_workers(nacs, tmp_path) -> None:
    tables = []
    for workers in (1, 2):
        arguments = ["run", "nacs/disturbance", "--trials", 4, "--out", f"w{workers}", "--workers", workers]
        for key, value in SHORT.items():
            arguments += ["--set", f"{key}={value}"]
        assert nacs(*arguments).code == 0
        tables.append(pq.read_table(tmp_path / f"w{workers}" / "trials.parquet").to_pydict())
    assert tables[0].keys() == tables[1].keys()
    for name, column in tables[0].items():
        np.testing.assert_array_equal(column, tables[1][name], err_msg=name)  # a metric that a trial has not is NaN in both


def test_one_trial_run_alone_gives_its_metrics(nacs, tmp_path) -> None:
    common = ["run", "nacs/disturbance", "--trials", 5, "--set", "run.ticks=60", "--set", "faults=[]"]
    assert nacs(*common, "--out", "all").code == 0
    assert nacs(*common, "--out", "one", "--only-trial", 3).code == 0
    everyone, alone = (pq.read_table(tmp_path / folder / "trials.parquet").to_pylist() for folder in ("all", "one"))
    assert [row for row in everyone if row["trial"] == 3] == alone


def test_a_recording_replays_the_metrics_of_its_trials() -> None:
    scenario = load("nacs/wheel-failure", {"run.ticks": 60, "faults.0.start_s": 2.0, "faults.0.duration_s": 2.0})
    system = build(scenario, np.arange(4))
    recording = run(system)
    chosen = recording.select(np.array([2]))
    for whole, one in zip(evaluate(recording, system.plant.assembly), evaluate(chosen, system.plant.assembly), strict=True):
        np.testing.assert_array_equal(whole.values[2:3], one.values)
