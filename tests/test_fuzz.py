"""The fuzzer's short run, and what it and its elder kin have found: each with the line that is right."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from models.plants.nacs import NacsParameters
from tests.fuzz import CAMPAIGN, fuzz
from tests.fuzz_process import HUNG, Ended, _wait, call, complaints

QUICK = ("--set", "run.ticks=4", "--trials", "1", "--without", "report", "--without", "recording")


def test_spoiled_inputs_of_all_kinds_are_answered_in_a_line() -> None:
    fuzzer = fuzz(seed=20, seconds=120.0, most=24)
    assert not fuzzer.failures, "\n".join(map(str, fuzzer.failures))
    assert len({kind for kind, _ in fuzzer.codes}) >= 5
    assert sum(n for (_, code), n in fuzzer.codes.items() if code == 2) >= 8  # it spoils what it is given


def test_the_fuzzer_sees_a_traceback_a_second_line_and_a_file_too_many() -> None:
    shown = "Traceback (most recent call last):\n  File ...\nKeyError: 1\n"
    assert "traceback" in complaints(Ended(1, "", shown, 0.1, ()))
    assert "2 lines of error" in complaints(Ended(2, "", "error: a\nerror: b\n", 0.1, ()))
    assert complaints(Ended(2, "", "warning: w\nerror: a\n", 0.1, ("o", "o/x"))) == ["files written although the input is bad"]
    assert "exit code -11" in complaints(Ended(-11, "", "", 0.1, ()))
    assert complaints(Ended(0, "table", "warning: w\n", 0.1, ("o",))) == []


GOOD: list[tuple[list[str], int, str]] = [  # arguments, exit code, what is said: on stdout if all is well, else on stderr
    (["run", "nacs/fault-free", *QUICK, "--set", "sensors.gyro=false", "--out", "o"], 0, "Residual RMSE"),
    (["run", "nacs/fault-free", *QUICK, "--set", "control.proportional_nm=1e200", "--out", "o"], 0, "control effort -"),
    (["run", "nacs/fault-free", *QUICK, "--set", 'title="[/red] $\\\\frac{ x"', "--out", "res[new]"], 0, "[/red] $\\frac{ x"),
    (["run", "nacs/fault-free", *QUICK, "--set", 'source="[/]"', "--out", "o"], 0, "[/]"),
    (["run", "nacs/fault-free", "--set", "run.ticks=4", "--set", 'title="$\\\\frac{ x"', "--trials", "1", "--out", "o"], 0, "report.png"),
    (
        ["run", "consensus/command-fault", *QUICK, "--set", "faults=[]", "--set", "loops.mupf-a.first_weight_std=1e9", "--out", "o"],
        3,
        "lost definiteness",
    ),
    (["--version"], 0, "nacs 0."),
]


@pytest.mark.parametrize(("arguments", "code", "said"), GOOD, ids=[" ".join(arguments)[:70] for arguments, _, _ in GOOD])
def test_odd_but_possible_inputs_are_flown(tmp_path: Path, arguments: list[str], code: int, said: str) -> None:
    (tmp_path / "here").mkdir()
    ended = call(arguments, tmp_path / "here", 120.0)
    assert complaints(ended) == [], ended.err
    assert ended.code == code, ended.err
    assert said in (ended.err if code else ended.out)


def _refused(tmp_path: Path, arguments: list[str], files: dict[str, bytes], wanted: list[str]) -> None:
    here = tmp_path / "here"
    here.mkdir()
    for name, content in files.items():
        (here / name).write_bytes(content)
    ended = call(arguments, here, 60.0)
    assert ended.code == 2, ended.err
    assert complaints(ended) == [], ended.err
    assert ended.err.startswith("error: ")
    for part in wanted:
        assert part in ended.err


ARGUMENTS: list[tuple[list[str], list[str]]] = [
    (["run"], ["Missing argument", "SCENARIO"]),
    (["run", "nacs/fault-free", "--trials", "ten"], ["--trials", "integer"]),
    (["run", "nacs/fault-free", "--nothing"], ["--nothing"]),
    (["rum"], ["rum"]),
    (["run", "nacs/fault-free", "--seed", str(2**63)], ["run.seed", "less than 9223372036854775808"]),
    (["campaign", "antenna-mapping", "--seed", str(2**70)], ["seed", "less than 9223372036854775808"]),
    (["run", "nacs/fault-free", "--point", "7"], ["--point 7", "no campaign"]),
    (["run", "antenna-mapping", "--only-trial", "1", "--point", "7"], ["--point 7", "0 to 0"]),
    (["run", "antenna-mapping"], ["--only-trial", "nacs campaign antenna-mapping"]),
    (["run", "x" * 5000], ["no scenario"]),
    (["run", "x" * 5000 + ".toml"], ["no scenario file"]),
    (["run", "nacs/fault-free", "--out", "x" * 300], ["--out", "File name too long"]),
    (["run", "nacs/fault-free", "--set", "a=" + "[" * 4000], ["nested too deeply"]),
    (["run", "nacs/fault-free", "--set", "run.ticks=" + "9" * 5000], ["cannot be read"]),
    (["run", "nacs/fault-free", "--set", "run..ticks=3"], ["a name is empty"]),
    (["run", "nacs/fault-free", "--set", "sensors.set=[1]"], ["sensors", "no sensor set [1]"]),
    (["run", "nacs/fault-free", "--set", "sensors.set={a=1}"], ["sensors", "no sensor set"]),
    (["run", "nacs/fault-free", "--set", 'observers.ekf.type="a\\nb"'], ["observers.ekf", "no type is called"]),
    (["run", "nacs/fault-free", "--set", 'observers."ekf".alpha=2'], ["are not quoted here"]),
    (["run", "nacs/fault-free", "--set", 'observers={" "={type="ekf"}}'], ["empty name"]),
    (["run", "nacs/fault-free", "--set", 'observers={"$x"={type="ekf"}}'], ["cannot be an observer's name"]),
    (["run", "nacs/fault-free", "--set", f'title="{"x" * 1000}"'], ["title", "300 characters"]),
    (["run", "nacs/fault-free", "--set", "run.ticks=true"], ["run.ticks: must be a whole number (got True)"]),
    (["run", "nacs/fault-free", "--set", "sensors.gyro='yes'"], ["sensors.gyro: must be true or false (got 'yes')"]),
    (["run", "nacs/fault-free", "--set", "plant.mass_kg='3.2'"], ["plant.mass_kg: must be a number (got '3.2')"]),
    (["run", "nacs/fault-free", "--set", "title=3"], ["title: must be text (got 3)"]),
    (["run", "nacs/fault-free", "--set", "sensors.mass_kg=3"], ["sensors.mass_kg: unknown key; mass_kg belongs elsewhere"]),
    (["run", "nacs/fault-free", "--set", "phases.a=[0.01,0.02]"], ["phases.a", "no tick of 0.1 s"]),
    (["run", "formation/fault-free", "--set", "phases.settled=[60,60.002]"], ["phases.settled", "no tick"]),
    (["run", "nacs/fault-free", "--trials", "1000000000"], ["1000000000 trials of 1000 ticks", "days", "GiB"]),
    (["run", "nacs/fault-free", "--set", "run.ticks=1000000000000"], ["1000000000000 ticks", "years", "GiB"]),
    (["run", "nacs/fault-free", "--set", "run.tick_s=1e9"], ["run.tick_s", "1e+11 physics steps", "at most 1e+09"]),
    (["run", "nacs/fault-free", "--set", "run.tick_s=9e6"], ["days"]),
    (["run", "consensus/fault-free", "--set", "loops.adtl.tick_s=1e-15"], ["loops.adtl.tick_s", "at most 1e+09"]),
    (["campaign", "antenna-mapping", "--trials", "1000000000"], ["years", "GiB"]),
    (["run", "nacs/fault-free", "--set", "start.quaternion=[0.5,0,0,0.8660254]"], ["start", "60 deg", "30 deg"]),
    (["run", "nacs/fault-free", "--set", "reference.amplitude_deg=[45,0,0]"], ["reference", "45 deg", "30 deg"]),
    (["run", "nacs/fault-free", "--set", "start.wheel_speed_rad_s=[900,0,0,0]"], ["start.wheel_speed_rad_s", "900", "837.6"]),
    (["run", "nacs/fault-free", "--set", "plant.balance_position_mm=[1000,0,0]"], ["plant.balance_position_mm.0", "equal to 40"]),
    (["run", "nacs/fault-free", "--set", "plant.wheel_inertia_kg_m2=1e-4"], ["wheel_inertia_kg_m2", "twice"]),
    (["run", "nacs/fault-free", "--observer", "no.py:A"], ["No such file"]),
]


@pytest.mark.parametrize(("arguments", "wanted"), ARGUMENTS, ids=[" ".join(arguments)[-60:] for arguments, _ in ARGUMENTS])
def test_a_bad_argument_is_one_line_and_writes_nothing(tmp_path: Path, arguments: list[str], wanted: list[str]) -> None:
    _refused(tmp_path, arguments, {}, wanted)


CAMPAIGNS: list[tuple[str, list[str]]] = [
    ('[grid]\n"run.seed" = [1, 2]\n', ["grid.run.seed", "campaign's own"]),
    ('[grid]\n"sensors.gyro_noise_rad_s" = [1e-3]\n', ["grid.sensors.gyro_noise_rad_s", "[dispersion]"]),
    ('[grid]\n"plant.mass_kg" = []\n', ["grid.plant.mass_kg", "is empty"]),
    ('[grid]\n"plant." = [1]\n', ["a name is empty"]),
    ("[grid]\n" + "".join(f'"phases.p{i}" = [[0, 1], [0, 2], [0, 3]]\n' for i in range(16)), ["43046721 points", "at most 10000"]),
]


@pytest.mark.parametrize(("more", "wanted"), CAMPAIGNS, ids=[wanted[-1] for _, wanted in CAMPAIGNS])
def test_a_campaign_that_contradicts_itself_is_refused(tmp_path: Path, more: str, wanted: list[str]) -> None:
    _refused(tmp_path, ["campaign", "mine.toml", "--out", "o"], {"mine.toml": (CAMPAIGN + more).encode()}, wanted)


BREAKS = '{kind = "external-torque", torque_nm = 1e300, direction = [1, 0, 0], start_s = 0.5, duration_s = 0.5}'


@pytest.mark.parametrize("section", ["[dispersion]", "[grid]"])
def test_a_campaign_in_which_all_trials_fail_is_summed_up(tmp_path: Path, section: str) -> None:
    here = tmp_path / "here"
    here.mkdir()
    values = "{uniform = [1e-3, 2e-3]}" if section == "[dispersion]" else "[1e-3, 2e-3]"
    head = CAMPAIGN.partition("[dispersion]")[0].replace('"run.ticks" = 4', '"run.ticks" = 12')
    (here / "mine.toml").write_text(f'{head}faults = [{BREAKS}]\n{section}\n"sensors.gyro_noise_rad_s" = {values}\n')
    ended = call(["campaign", "mine.toml", "--out", "o", "--workers", "1"], here, 120.0)
    assert (ended.code, complaints(ended)) == (0, []), ended.err
    told = "failed: " if section == "[dispersion]" else "failed at {'sensors.gyro_noise_rad_s': 0.002}: "
    assert f"{told}trials 0, 1, 2, 3" in ended.out
    assert {"o/summary.json", "o/report.png", "o/recording.rrd"} <= set(ended.written)


USERS = {
    "raise GeneratorExit": "GeneratorExit",
    "raise BaseException('no')": "BaseException: no",
    "raise SystemExit(0)": "SystemExit: 0",
    "class E(Exception):\n    def __str__(self): raise ValueError\nraise E": "mine.py:3: Mine: E",
    "raise KeyError('[/red]')": "KeyError: '[/red]'",
}


@pytest.mark.parametrize("text", USERS)
def test_whatever_a_users_file_raises_is_blamed_on_its_line(tmp_path: Path, text: str) -> None:
    arguments = ["run", "nacs/fault-free", "--observer", "mine.py:Mine"]
    _refused(tmp_path, arguments, {"mine.py": text.encode()}, ["mine.py:", USERS[text]])


def test_a_byte_order_mark_is_read_over(tmp_path: Path) -> None:
    here = tmp_path / "here"
    here.mkdir()
    (here / "mine.toml").write_bytes(b"\xef\xbb\xbf" + CAMPAIGN.encode())
    assert call(["run", "mine.toml", "--only-trial", "1", *QUICK[4:], "--out", "o"], here, 60.0).code == 0
    (here / "filter.py").write_bytes(b"\xef\xbb\xbfclass Mine:\n    pass\n")
    ended = call(["run", "nacs/fault-free", "--observer", "filter.py:Mine"], here)
    assert "has no method initial" in ended.err


FOLDERS = {
    "nowhere": "leads nowhere",
    "nowhere/in": "leads nowhere",
    "round": "leads nowhere",
    "file": "is a file",
    "file/in": "cannot be written",
}


def test_folders_that_cannot_be(tmp_path: Path) -> None:
    here = tmp_path / "here"
    here.mkdir()
    (here / "nowhere").symlink_to("not-there")
    (here / "round").symlink_to("round")
    (here / "file").write_text("mine")
    for folder, why in FOLDERS.items():
        ended = call(["run", "nacs/fault-free", *QUICK, "--out", folder], here)
        assert (ended.code, complaints(ended)) == (2, []), ended.err
        assert why in ended.err


def test_a_shipped_campaigns_trial_is_flown_by_its_name(tmp_path: Path) -> None:
    here = tmp_path / "here"
    here.mkdir()
    ended = call(["run", "antenna-mapping", "--only-trial", "19", "--without", "report", "--without", "recording", "--out", "o"], here, 5.0)
    assert "no scenario" not in ended.err  # it flies, for longer than this waits
    assert "--only-trial" not in ended.err


def test_a_run_that_fills_the_wheels_is_said_so_with_the_time() -> None:
    # weight 3.2 kg x 9.80665 m/s2 at [0.5, -0.4] um; a wheel takes half the sum of both torques, to 837.6 rad/s
    sum_nm = 3.2 * 9.80665 * (0.5e-6 + 0.4e-6) / 2.0
    assert NacsParameters().filled_s == pytest.approx(1.740138e-5 * 11.76 / 0.01404 / sum_nm)


def _child(does: Callable[[], object]) -> int:
    child = os.fork()
    if child == 0:
        os.setsid()
        does()
        os._exit(7)
    return child


def _for_ever() -> None:
    while True:
        pass


def test_what_computes_too_long_or_does_nothing_hangs() -> None:
    """The limit is of processor time, and of waiting; a child that ends before is neither."""
    assert _wait(_child(_for_ever), 1.0) == HUNG
    assert _wait(_child(lambda: time.sleep(60.0)), 1.0) == HUNG
    assert _wait(_child(lambda: time.sleep(0.5)), 5.0) == 7
