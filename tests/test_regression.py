"""The bit-for-bit comparison of two trees: silent where nothing moved, loud where one number did."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]
NOISE = re.compile(r"\battitude_noise_rad: \w+ = Field\(")
TINY = ("--only", "nacs/fault-free", "--ticks", "12")


def compared(*arguments: object) -> subprocess.CompletedProcess[str]:
    """The command, run as a person would."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "tests.regression", *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)


def test_a_tree_is_equal_to_itself() -> None:
    done = compared(ROOT, *TINY)
    assert done.returncode == 0, done.stdout + done.stderr
    first, *_, last = done.stdout.splitlines()
    assert re.fullmatch(r"nacs/fault-free loop: equal are [1-9]\d+ channels, [1-9]\d+ metrics, 0 occurrences", first)
    assert last == "0 could not be flown, no bit differs"


def test_another_noise_of_one_sensor_and_a_name_that_only_one_tree_has_are_told(tmp_path: Path) -> None:
    for folder in ("models", "sim", "estimation", "control", "tests"):
        shutil.copytree(ROOT / folder, tmp_path / folder)
    changed = next(path for path in (tmp_path / "sim").rglob("sensors.py") if NOISE.search(path.read_text(encoding="utf-8")))
    text, times = NOISE.subn(r"\g<0>1.0000001 * ", changed.read_text(encoding="utf-8"))
    assert times == 1
    changed.write_text(text, encoding="utf-8")
    done = compared(tmp_path, ROOT, *TINY, "--rename", "^applied$=given")
    assert done.returncode == 1, done.stderr
    lines = done.stdout.splitlines()
    assert re.search(r"channels, \d+ metrics, 0 occurrences; \d+ differ$", lines[0])
    assert any(re.match(r"  channel reading: \d+ of \d+ numbers differ, by \S+ at most, relatively by \S+$", line) for line in lines)
    assert any(re.match(r"  metric ekf rmse_truth_quaternion@all \[1\]: 2 of 2 numbers differ", line) for line in lines)
    assert {"  channel given: only in parent", "  channel applied: only in head"} <= set(lines)
    assert not any(line.startswith("  channel reference/q:") for line in lines)
    assert re.fullmatch(r"0 could not be flown, \d+ differ", lines[-1])


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ((), "required: PARENT"),
        (("no-such-revision",), "no-such-revision is neither a folder nor a revision"),
        ((ROOT / "docs",), "has no scenarios below sim/"),
        ((ROOT, "--ticks", "0"), "argument --ticks: 0 is not a whole number of 1 or more"),
        ((ROOT, "--rename", "old"), "argument --rename: 'old' needs the form OLD=NEW"),
        ((ROOT, "--rename", "(=new"), "no regular expression"),
        ((ROOT, "--only", "nacs/no-such"), "--only nacs/no-such: no scenario has such a name"),
    ],
)
def test_arguments_that_make_no_sense_are_told_in_one_line(
    arguments: tuple[object, ...], complaint: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.syspath_prepend(ROOT)
    assert import_module("tests.regression").main([*map(str, arguments)]) == 2
    captured = capsys.readouterr()
    assert not captured.out
    (line,) = captured.err.splitlines()
    assert line.startswith("error: ")
    assert complaint in line


@pytest.mark.parametrize(
    ("parent", "head", "said"),
    [
        ([1.0, 2.0], [1.0, 2.5], "1 of 2 numbers differ, by 0.5 at most, relatively by 0.2"),
        ([0.0, 2.0], [-0.0, 2.0], "1 of 2 numbers differ, by 0 at most, relatively by 0"),
        ([np.nan, 2.0], [3.0, 2.0], "1 of 2 numbers differ, by 0 at most, relatively by 0; 1 NaN in one tree only"),
        ([1.0], [1.0, 1.0], "float64 (1,) in parent, float64 (2,) in head"),
        ([True], [1.0], "bool (1,) in parent, float64 (1,) in head"),
    ],
)
def test_how_far_two_arrays_are_apart(parent: list[float], head: list[float], said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ROOT)
    assert import_module("tests.regression_comparison").apart(np.array(parent), np.array(head)) == said


def test_a_shortened_scenario_has_its_faults_and_windows_inside(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ROOT)
    data = {
        "run": {"ticks": 1000, "tick_s": 0.1, "trials": 10, "seed": 7},
        "faults": [{"kind": "delay", "start_s": {"uniform": [20.0, 40.0]}, "duration_s": 10.0, "delay_s": 0.5}],
        "phases": {"late": [50.0, 100.0], "brief": [99.0, 99.5]},
    }
    short = import_module("tests.regression_probe").shorten(data, 100)
    assert short["run"] == {"ticks": 100, "tick_s": 0.1, "trials": 2, "seed": 7}
    (fault,) = short["faults"]
    assert fault["start_s"]["uniform"] == pytest.approx([2.0, 4.0])
    assert (fault["duration_s"], fault["delay_s"]) == (pytest.approx(1.0), 0.5)
    assert short["phases"] == {"late": pytest.approx([5.0, 10.0]), "brief": pytest.approx([9.9, 10.0])}
    assert data["run"]["ticks"] == 1000
