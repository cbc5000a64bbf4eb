"""Several closed loops on the same trials: what they share, what a user can get wrong, and what their metrics say."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from models.attitude import quaternion
from models.attitude.euler_angles import from_euler_313
from sim.campaign.blocks import simulate
from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.metrics.one_body import evaluate
from sim.scenario.files import load

MODES = "[[],[{kind='float',wheel=1}]]"
WRONG = [
    ("observers.imm.transition=[[0.9,0.2],[0.0,1.0]]", ["observers.imm.transition.0", "sum to one", "1.1"]),
    ("observers.imm.transition=[[1.0]]", ["observers.imm.transition", "2 rows of 2"]),
    ("observers.imm.initial=[0.5,0.6]", ["observers.imm.initial", "sum to one", "1.1"]),
    ("observers.imm.initial=[1.0]", ["observers.imm.initial", "1 probabilities for 2 modes"]),
    ("observers.imm.modes=[[]]", ["observers.imm.modes", "two modes"]),
    (f"observers.imm.modes={MODES.replace('wheel=1', 'wheel=5')}", ["observers.imm.modes.1", "no wheel 5", "1 to 4"]),
    ("observers.imm.filter.type=imm", ["observers.imm.filter: no type is called 'imm'; there are ekf, mekf, sif, ukf"]),
    ("observers.imm.floor=0.3", ["observers.imm.floor", "less than 0.1"]),
    ("loops.pd-imm.control.proportional_nm=[70.0]", ["loops.pd-imm.control.proportional_nm", "1 gains for the 2 modes of imm"]),
    ("loops.pd-ukf.control.proportional_nm=[70.0,100.0]", ["loops.pd-ukf.control.proportional_nm", "2 gains for the 1 modes of ukf"]),
    ("loops.pd-ukf.control.feedback=kf", ["loops.pd-ukf.control.feedback", "'kf'", "ukf, imm, truth, measurement"]),
    ("loops.pd-ukf.control.allocation={type='mode-weighted'}", ["loops.pd-ukf.control.allocation", "type imm"]),
    ("loops.pd-ukf.watching=['kf']", ["loops.pd-ukf.watching", "'kf'"]),
    ("control={type='pd',feedback='ukf'}", ["control", "either [control]", "[loops.NAME.control]"]),
    ("observers.ukf.tuning={process_noise=[1,1,1],measurement_noise=[1e-30,1,1],boundary_layer=[1,1,1]}",
     ["observers.ukf.tuning.measurement_noise", "singular", "1e-16"]),
    ("plant.wheel_layout=box", ["plant.wheel_layout", "'crossed'", "'pyramid'"]),
]  # fmt: skip


@pytest.mark.parametrize(("setting", "wanted"), WRONG, ids=[s for s, _ in WRONG])
def test_a_wrong_setting_is_one_line_naming_file_and_key(nacs, tmp_path: Path, setting: str, wanted: list[str]) -> None:
    result = nacs("run", "wmap/compare", "--set", setting)
    assert result.code == 2
    assert result.out == ""
    assert result.err.startswith("error: ")
    assert result.err.count("\n") == 1
    for part in wanted:
        assert part in result.err
    assert not list(tmp_path.iterdir())


def test_a_mode_that_loses_an_axis_is_a_warning_with_the_axis(nacs) -> None:
    crippled = "observers.imm.modes=[[],[{kind='float',wheel=1},{kind='float',wheel=2}]]"
    result = nacs("run", "wmap/pd-imm", "--trials", 1, "--set", "run.ticks=9", "--set", "faults=[]", "--set", crippled, "--out", "it")
    assert result.code == 0, result.err
    assert "warning: observers.imm.modes.1: its wheels give no torque about [1.00, 0.00, 0.00] in B" in result.err


def test_a_cross_check_of_agents_shows_all_models(nacs, tmp_path: Path) -> None:
    short = ("--set", "run.ticks=201", "--set", "phases={}", "--trials", 2)
    result = nacs("crosscheck", "formation/fault-free", *short, "--out", "it")
    assert result.code == 0, result.err
    assert "true inertia stays within 0.0001 deg" in " ".join(result.out.split())
    assert {path.name for path in (tmp_path / "it").iterdir()} == {"crosscheck.png", "summary.json"}
    planar = nacs("crosscheck", "consensus/fault-free", "--set", "run.ticks=101", "--trials", 1, "--loop", "none", "--out", "planar")
    assert planar.code == 0, planar.err
    refused = nacs("crosscheck", "formation/fault-free", *short, "--model", "exact")
    assert (refused.code, refused.err) == (2, "error: --model: is for one body; of several agents all models are shown\n")


def test_a_trial_of_a_campaign_of_several_loops_can_be_flown_alone(nacs, tmp_path: Path) -> None:
    (tmp_path / "c.toml").write_text(
        "title = 'T'\nscenario = 'wmap/pd-imm'\ntrials = 3\nseed = 1\n[override]\n\"run.ticks\" = 40\nfaults = []\n"
        '[dispersion]\n"observers.imm.stay_probability" = { uniform = [0.99, 0.999] }\n'
    )
    flown = nacs("campaign", "c.toml", "--out", "all")
    assert flown.code == 0, flown.err
    alone = nacs("run", "c.toml", "--only-trial", 2, "--out", "one")
    assert alone.code == 0, alone.err
    rows = pq.read_table(tmp_path / "all" / "trials.parquet").to_pylist()
    wanted = {(r["subject"], r["metric"], r["phase"]): r["value"] for r in rows if r["trial"] == 2 and r["metric"] == "tracking_error_deg"}
    found = {(r["subject"], r["metric"], r["phase"]): r["value"] for r in pq.read_table(tmp_path / "one" / "trials.parquet").to_pylist()}
    assert wanted
    assert all(found[key] == value for key, value in wanted.items())


SHORT = {"run.ticks": 150, "faults": [{"kind": "float", "wheel": 1, "start_s": 8.0, "duration_s": 7.0}]}


def test_loops_share_their_trials_and_a_loop_is_the_same_alone() -> None:
    both = load("wmap/compare", SHORT)
    alone = load("wmap/pd-imm", SHORT)
    many, one = (simulate(s, np.arange(3), np.arange(3)).recordings for s in (both, alone))
    for channel, values in one["pd-imm"].channels.items():
        np.testing.assert_array_equal(many["pd-imm"].channels[channel], values, err_msg=channel)
    start = many["pd-ukf"].channels["reading"][0]
    for name, recording in many.items():
        np.testing.assert_array_equal(recording.channels["reading"][0], start, err_msg=name)
    assert not many["pd-imm-no-fault"].occurrences
    assert many["pd-imm"].occurrences


def test_a_trial_is_the_same_in_any_batch() -> None:
    scenario = load("wmap/smc-imm", SHORT)
    alone, among = (simulate(scenario, trials, trials).recordings["smc-imm"] for trials in (np.array([2]), np.arange(4)))
    for channel, values in alone.channels.items():
        if not channel.startswith("reference/"):
            np.testing.assert_array_equal(among.channels[channel][:, 2:3], values, err_msg=channel)


def test_the_start_is_the_papers() -> None:
    system = build(load("wmap/pd-ukf").singles()["pd-ukf"], np.arange(2))
    truth = system.plant.truth()
    np.testing.assert_allclose(quaternion.angle(truth.q_BN, from_euler_313(np.radians([0.0, 22.5, 60.0]))), 0.0, atol=1e-7)
    np.testing.assert_allclose(truth.omega_BN_B, np.radians(0.57) * np.ones((2, 3)))
    np.testing.assert_array_equal(truth.omega_wheel, 0.0)


def test_metrics_of_a_loop_are_what_they_say() -> None:
    single = load("wmap/pd-imm", SHORT).singles()["pd-imm"]
    system = build(single, np.arange(2))
    recording = run(system)
    found = {(m.metric, m.phase): m.values for m in evaluate(recording, system.plant.assembly, "pd-imm", single)}
    channels, before = recording.channels, slice(0, 80)
    torque, modes = channels["torque_B"], channels["imm/modes"]
    np.testing.assert_allclose(found["effort_rms_y", "all"], np.sqrt(np.mean(torque[..., 1] ** 2, axis=0)))
    np.testing.assert_allclose(found["mode_fault_mean", "nominal"], 1.0 - np.mean(modes[before, :, 0], axis=0))
    np.testing.assert_allclose(found["false_mode_fraction", "nominal"], np.mean(modes[before, :, 0] < 0.5, axis=0))
    np.testing.assert_array_equal(found["lost_definiteness", "all"], 0.0)
    axis = channels["reference/q"][before, None]
    np.testing.assert_allclose(
        found["rmse_body_deg", "nominal"],
        np.degrees(np.sqrt(np.mean(quaternion.angle(channels["truth/state"][before, :, :4], axis) ** 2, axis=0))),
    )
    assert np.max(np.abs(torque)) <= 1.0


def test_an_angle_of_the_spin_alone_is_an_error_of_psi() -> None:
    single = load("wmap/pd-ukf", SHORT | {"run.ticks": 30, "faults": []}).singles()["pd-ukf"]
    system = build(single, np.arange(1))
    recording = run(system)
    turned = quaternion.multiply(from_euler_313(np.radians([0.0, 0.0, 30.0])), recording.channels["reference/q"][:, None])
    recording.channels["truth/state"][..., :4] = turned
    found = {m.metric: m.values[0] for m in evaluate(recording, system.plant.assembly, "pd-ukf", single) if m.phase == "all"}
    assert found["rmse_psi_deg"] == pytest.approx(30.0)
    assert found["rmse_body_deg"] == pytest.approx(30.0)
    assert found["rmse_phi_deg"] == pytest.approx(0.0, abs=1e-6)
    assert found["rmse_theta_deg"] == pytest.approx(0.0, abs=1e-6)


def test_a_run_of_several_loops_leaves_its_files_and_table(nacs, tmp_path: Path) -> None:
    fault = "faults=[{kind='float',wheel=1,start_s=3.0,duration_s=3.0}]"
    result = nacs("run", "wmap/compare", "--trials", 2, "--set", "run.ticks=60", "--set", fault, "--out", "it")
    assert result.code == 0, result.err
    assert {p.name for p in (tmp_path / "it").iterdir()} == {
        "recording.rrd",
        "report.png",
        "signals.parquet",
        "summary.json",
        "trials.parquet",
    }
    summary = json.loads((tmp_path / "it" / "summary.json").read_text())
    wanted = {"pd-ukf", "pd-imm", "smc-ukf", "smc-imm", "pd-imm-realloc", "smc-imm-realloc", "pd-fault-gains", "smc-fault-gains"}
    assert wanted <= {row["subject"] for row in summary["rows"]}
    assert "table II" in result.out
    assert max(len(line) for line in result.out.splitlines() if "runs/" not in line and "it/" not in line) <= 80
