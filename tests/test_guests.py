"""A researcher's own filters and controllers: they join a run, and what is wrong in their file is one line naming it."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from rerun.chunk import RrdReader

from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.loop.recording import Recording
from sim.scenario.files import load
from sim.user_code.user_code import UserCode

DOCS = Path(__file__).parents[1] / "docs"
FILTER = f"{DOCS / 'examples' / 'complementary_filter.py'}:ComplementaryFilter"
LAW = f"{DOCS / 'examples' / 'feed_forward.py'}:FeedForward"
QUICK = ("nacs/disturbance", "--set", "run.ticks=40", "--set", "faults=[]", "--trials", 2)

# everything that a belief may hold, here from a built-in filter: a guest must then be its equal
WHOLE = """
from dataclasses import dataclass
from typing import Any, NamedTuple
import numpy as np
from estimation.extended_kalman import ExtendedFilter
from estimation.nis_switching import Fading, SwitchedGain
from estimation.state_space import Multiplicative

class Mine(NamedTuple):
    mean: Any
    covariance: Any
    nis: Any
    declared: Any
    statistic: Any
    inside: Any

@dataclass
class OwnMEKF2:
    setting: Any
    thresholds = (300.0, 200.0)

    def __post_init__(self):
        s = self.setting
        n = 6 + s.wheels
        half = np.diag(np.repeat([2e-10, 2.2e-7, 6.75e-3], [3, 3, s.wheels]))
        self.inside = ExtendedFilter(
            s.process_with_drag, half, s.measurement_noise, np.eye(n + 1)[3], np.ones(n),
            SwitchedGain(np.ones(n), Fading(0.9), n), Multiplicative(), process_noise_before=half)

    def told(self, b):
        return Mine(b.mean, b.covariance, b.nis, b.detection.declared, b.detection.statistic, b)

    def initial(self, measurement):
        return self.told(self.inside.initial(measurement))

    def step(self, belief, command, measurement, dt):
        return self.told(self.inside.step(belief.inside, command, measurement, dt))
"""


def fly(guests: UserCode, scenario: str = "nacs/disturbance", **more: object) -> Recording:
    settings = {"run.ticks": 60, "faults": []} | more
    return run(build(load(scenario, settings, guests.names), np.arange(3), guests))


def test_the_examples_of_the_page_join_table_metrics_report_and_recording(nacs, tmp_path: Path) -> None:
    result = nacs("run", *QUICK, "--observer", FILTER, "--controller", LAW, "--record-trials", 1, "--out", "it")
    assert result.code == 0, result.err
    assert re.search(r"complementary(-filter)? +[\d.]+", result.out)
    assert "controller feed-forward" in result.out
    assert "complementary-filter" in pq.read_table(tmp_path / "it" / "trials.parquet")["subject"].to_pylist()
    summary = json.loads((tmp_path / "it" / "summary.json").read_text())
    assert summary["guests"] == {"complementary-filter": FILTER, "feed-forward": LAW}
    values = {row["metric"]: row["mean"] for row in summary["rows"] if row["subject"] == "complementary-filter"}
    assert 0.0 < values["rmse_truth_rate"] < 0.02
    assert not {"nees_mean", "nis_mean"} & set(values)  # it claims no covariance
    entities = {chunk.entity_path for chunk in RrdReader(tmp_path / "it" / "recording.rrd").stream().to_chunks()}
    assert any("attitude/error/complementary" in str(entity).replace("\\", "") for entity in entities)
    assert (tmp_path / "it" / "report.png").is_file()


def test_the_page_shows_the_very_files() -> None:
    page = (DOCS / "extending.md").read_text()
    for name in ("complementary_filter", "feed_forward"):
        assert (DOCS / "examples" / f"{name}.py").read_text() in page
    code = [line for line in (DOCS / "examples" / "complementary_filter.py").read_text().splitlines() if line.strip()]
    assert len(code) <= 25


def test_a_guest_may_close_the_loop(nacs) -> None:
    one = ["run", *QUICK, "--observer", FILTER]
    result = nacs(*one, "--set", "control.feedback=complementary-filter", "--workers", 2)
    assert result.code == 0, result.err
    guests = UserCode((FILTER,))
    own, other = (fly(guests, **{"control.feedback": who}) for who in ("complementary-filter", "ekf"))
    assert not np.array_equal(own.channels["truth/state"], other.channels["truth/state"])


def test_a_controller_takes_the_place_of_the_scenarios() -> None:
    own, builtin = fly(UserCode(controller=LAW)), fly(UserCode())
    assert not np.array_equal(own.channels["torque_B"], builtin.channels["torque_B"])


def test_watching_guests_change_nothing() -> None:
    with_guest, without = fly(UserCode((FILTER,))), fly(UserCode())
    for name, channel in without.channels.items():
        np.testing.assert_array_equal(channel, with_guest.channels[name], err_msg=name)


def test_a_belief_with_everything_is_treated_as_a_built_in_one(nacs, tmp_path: Path) -> None:
    (tmp_path / "whole.py").write_text(WHOLE)
    guests = UserCode((f"{tmp_path / 'whole.py'}:OwnMEKF2",))
    assert guests.names == ("own-mekf2",)
    recording = fly(guests, **{"sensors.dropout_probability": 0.1, "tuning": "consistent"})
    for part in ("mean", "sigma", "nees", "nis"):
        np.testing.assert_allclose(recording.channels[f"own-mekf2/{part}"], recording.channels[f"mekf/{part}"], rtol=1e-9)
    assert recording.thresholds["own-mekf2"] == (300.0, 200.0)
    result = nacs("run", *QUICK, "--observer", "whole.py:OwnMEKF2", "--out", "it")
    assert result.code == 0, result.err
    metrics = {r["metric"] for r in json.loads((tmp_path / "it" / "summary.json").read_text())["rows"] if r["subject"] == "own-mekf2"}
    assert {"nees_mean", "nis_mean", "false_alarm_fraction"} <= metrics


def test_a_covariance_without_an_inverse_costs_the_nees_alone(nacs, tmp_path: Path) -> None:
    text = WHOLE.replace("b.covariance, b.nis", "0.0 * b.covariance, b.nis").replace("thresholds = (300.0, 200.0)", "name = 'flat'")
    (tmp_path / "flat.py").write_text(text)
    result = nacs("run", *QUICK, "--observer", "flat.py:OwnMEKF2", "--out", "it")  # declares faults without thresholds, too
    assert result.code == 0, result.err
    metrics = {r["metric"] for r in json.loads((tmp_path / "it" / "summary.json").read_text())["rows"] if r["subject"] == "flat"}
    assert "nees_mean" not in metrics
    assert {"nis_mean", "false_alarm_fraction"} <= metrics


def test_what_a_filter_declares_is_yes_or_no(nacs, tmp_path: Path) -> None:
    (tmp_path / "unsure.py").write_text(WHOLE.replace("b.detection.declared,", "np.where(b.nis > 0, np.nan, 0.0),"))
    result = nacs("run", *QUICK, "--observer", "unsure.py:OwnMEKF2", "--out", "it")
    assert result.code == 2
    assert result.err.count("\n") == 1, result.err
    assert "declared has no number at tick" in result.err


def test_a_filter_that_says_nothing_about_faults_is_not_one_that_never_alarms(nacs, tmp_path: Path) -> None:
    (tmp_path / "silent.py").write_text(WHOLE.replace("b.detection.declared,", "None,"))
    result = nacs("run", *QUICK, "--observer", "silent.py:OwnMEKF2", "--out", "it")
    assert result.code == 0, result.err
    found = {r["metric"] for r in json.loads((tmp_path / "it" / "summary.json").read_text())["rows"] if r["subject"] == "own-mekf2"}
    assert "nis_mean" in found
    assert not {m for m in found if m.startswith(("false_alarm", "fault", "missed", "silent", "detection", "peak_statistic"))}


GOOD = """
from typing import NamedTuple
import numpy as np
class Belief(NamedTuple):
    mean: np.ndarray
class Mine:
    def __init__(self, setting):
        pass
    def initial(self, measurement):
        return Belief(np.nan_to_num(measurement))
    def step(self, belief, command, measurement, dt):
        return Belief(np.where(np.isnan(measurement), belief.mean, measurement))
"""
STEP = "return Belief(np.where(np.isnan(measurement), belief.mean, measurement))"

WRONG_FILTERS = {
    "syntax": (GOOD.replace("pass", "pass)"), ["mine.py:8", "SyntaxError"]),
    "import": ("import nothing_of_that_name\n" + GOOD, ["mine.py:1", "ModuleNotFoundError", "nothing_of_that_name"]),
    "exit": ("import sys\nsys.exit(3)\n", ["mine.py:2", "SystemExit"]),
    "class": (GOOD.replace("class Mine", "class Yours"), ["no class Mine in mine.py", "Belief, Yours"]),
    "method": (GOOD.replace("def step", "def stepp"), ["mine.py:6: Mine", "has no method step"]),
    "arguments": (GOOD.replace("measurement, dt", "measurement"), ["mine.py:11: Mine.step", "TypeError", "positional arguments"]),
    "constructor": (GOOD.replace("pass", "raise ValueError('gain?')"), ["mine.py:8: Mine.__init__: ValueError: gain?"]),
    "initial": (GOOD.replace("np.nan_to_num", "np.nan_to_nom"), ["mine.py:10: Mine.initial: AttributeError", "nan_to_nom"]),
    "exception": (GOOD.replace(STEP, "return belief.mean[99]"), ["mine.py:12: Mine.step: IndexError", "(at tick 1)"]),
    "no mean": (GOOD.replace(STEP, "return 3"), ["mine.py:11: Mine.step: returned int without `mean`"]),
    "shape": (GOOD.replace(STEP, "return Belief(measurement[:, :7])"), ["mine.py:11: Mine.step: mean has shape (3, 7), needs (3, 11)"]),
    "text": (GOOD.replace(STEP, "return Belief('here')"), ["mine.py:11: Mine.step: mean has shape (), needs (3, 11) of numbers"]),
    "nan": (GOOD.replace(STEP, "return Belief(measurement * float('nan'))"), ["mine.py:11", "mean is not finite at tick 1"]),
    "gap": (GOOD.replace(STEP, "return Belief(measurement)"), ["mine.py:11", "not finite", "a missing reading is NaN"]),
    "period": (GOOD.replace(STEP, "return Belief(measurement)"), ["mine.py:11", "not finite", "a missing reading is NaN"]),
    "batch": (GOOD.replace(STEP, "return Belief(measurement.cumsum(axis=0))"), ["mine.py:11", "differently among others", "on the last"]),
    "thresholds": (
        GOOD.replace("ndarray\n", "ndarray\n    declared: bool = False\n").replace("def __init__", "thresholds = 3\n    def __init__"),
        ["mine.py:7: Mine: TypeError", "two numbers: on, off"],
    ),
    "taken": (GOOD.replace("def __init__", "name = 'sif'\n    def __init__"), ["--observer mine.py:Mine", "'sif'", "another `name"]),
    "reserved": (GOOD.replace("def __init__", "name = 'loop'\n    def __init__"), ["'loop'", "reserved"]),
}  # fmt: skip


@pytest.mark.parametrize("what", WRONG_FILTERS)
def test_a_wrong_filter_is_one_line_before_anything_runs(nacs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: str) -> None:
    text, wanted = WRONG_FILTERS[what]
    (tmp_path / "mine.py").write_text(text)
    monkeypatch.setattr("sim.cli.commands.run.simulate_all", None)  # a run would fail on this
    gaps = {"gap": ("--set", "sensors.dropout_probability=0.1"), "period": ("--set", "sensors.wheel_period_s=0.2")}.get(what, ())
    result = nacs("run", *QUICK, *gaps, "--observer", "mine.py:Mine")
    assert (result.code, result.err.count("\n"), result.out) == (2, 1, ""), result.err
    for part in wanted:
        assert part in result.err
    assert [path.name for path in tmp_path.iterdir()] == ["mine.py"]


LAW_TEXT = """
class Mine:
    def __init__(self, setting):
        pass
    def step(self, estimate, target):
        return estimate.omega_BN_B
"""

WRONG_LAWS = {
    "method": (LAW_TEXT.replace("step", "stepp"), ["mine.py:2: Mine", "no method step"]),
    "shape": (LAW_TEXT.replace("omega_BN_B", "q_BN"), ["mine.py:5: Mine.step", "(3, 4), needs (3, 3)"]),
    "nan": (LAW_TEXT.replace("omega_BN_B", "omega_BN_B * float('nan')"), ["mine.py:5: Mine.step", "not finite"]),
    "error": (LAW_TEXT.replace("estimate.omega_BN_B", "1 / 0"), ["mine.py:6: Mine.step: ZeroDivisionError"]),
    "batch": (LAW_TEXT.replace("omega_BN_B", "omega_BN_B.cumsum(axis=0)"), ["mine.py:5", "differently among others"]),
}


@pytest.mark.parametrize("what", WRONG_LAWS)
def test_a_wrong_law_is_one_line_before_anything_runs(nacs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: str) -> None:
    text, wanted = WRONG_LAWS[what]
    (tmp_path / "mine.py").write_text(text)
    monkeypatch.setattr("sim.cli.commands.run.simulate_all", None)
    result = nacs("run", *QUICK, "--controller", "mine.py:Mine")
    assert (result.code, result.err.count("\n"), result.out) == (2, 1, ""), result.err
    for part in wanted:
        assert part in result.err
    assert [path.name for path in tmp_path.iterdir()] == ["mine.py"]


@pytest.mark.parametrize("workers", [1, 2])
def test_an_exception_in_mid_run_names_line_and_tick_and_writes_nothing(nacs, tmp_path: Path, workers: int) -> None:
    text = GOOD.replace(STEP, f"self.ticks = getattr(self, 'ticks', 0) + 1\n        assert self.ticks < 30, 'enough'\n        {STEP}")
    (tmp_path / "mine.py").write_text(text)
    result = nacs("run", *QUICK, "--observer", "mine.py:Mine", "--workers", workers)
    assert (result.code, result.out) == (2, "")
    assert result.err.endswith("error: mine.py:13: Mine.step: AssertionError: enough (at tick 30)\n")
    assert [path.name for path in tmp_path.iterdir()] == ["mine.py"]


ARGUMENTS = [
    (["--observer", "mine.py"], ["--observer mine.py", "FILE.py:CLASS"]),
    (["--observer", "nowhere.py:Mine"], ["--observer nowhere.py:Mine", "No such file"]),
    (["--controller", "nowhere.py:Mine"], ["--controller nowhere.py:Mine", "No such file"]),
    (["--observer", "mine.py:Mine", "--observer", "mine.py:Mine"], ["'mine'", "taken"]),
    (["--observer", "mine.py:Mine", "--set", "control.feedback=nis"], ["control.feedback", "'nis'", "nis-fading, mine, truth"]),
    (["--export-log", "--record-trials", "0"], ["--export-log", "--record-trials 0"]),
]


@pytest.mark.parametrize(("arguments", "wanted"), ARGUMENTS, ids=[" ".join(a) for a, _ in ARGUMENTS])
def test_a_wrong_argument_is_one_line(nacs, tmp_path: Path, arguments: list[str], wanted: list[str]) -> None:
    (tmp_path / "mine.py").write_text(GOOD)
    result = nacs("run", *QUICK, *arguments)
    assert (result.code, result.err.count("\n"), result.out) == (2, 1, ""), result.err
    for part in wanted:
        assert part in result.err
    assert [path.name for path in tmp_path.iterdir()] == ["mine.py"]


def test_what_lies_beside_the_file_can_be_imported(nacs, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("from beside_the_filter import Mine\n")
    (tmp_path / "beside_the_filter.py").write_text(GOOD)
    assert UserCode((f"{tmp_path / 'mine.py'}:Mine",)).names == ("mine",)
