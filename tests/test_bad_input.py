"""What a user can get wrong: one line that says what, where and what would be right; exit code 2; nothing written."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from sim.bad_input import BadInput
from sim.scenario.catalogue import SCENARIOS
from sim.scenario.files import load

SETTINGS = [
    ("plant.mas_kg=3", ["plant.mas_kg", "unknown key", "mass_kg"]),
    ("run.ticks=many", ["run.ticks", "must be a whole number", "'many'"]),
    ("run.trials=0", ["run.trials", "greater than or equal to 1", "0"]),
    ("run.tick_s=0.0125", ["run.tick_s", "0.0125", "whole number of physics steps", "0.01"]),
    ("run.tick_s=0.0025", ["(plant.step_s = 0.01 s); plant.step_s = 0.0025 would do"]),
    ("run.tick_s=0.033", ["(plant.step_s = 0.01 s); plant.step_s = 0.00825 would do"]),
    ("run.tick_s=2147483648", ["run.tick_s: 2.14748e+09 s is 2.15e+11 physics steps (plant.step_s = 0.01 s)", "at most 1e+09"]),
    ("plant.inertia_kg_m2=printed", ["plant.inertia_kg_m2", "triangle inequality", "0.173014"]),
    ("plant.inertia_kg_m2=[1,1,1,2,0,0]", ["plant.inertia_kg_m2", "not positive"]),
    ("plant.inertia_kg_m2=[1,1,1]", ["plant.inertia_kg_m2"]),
    ("plant.wheel_imbalance_um=1", ["step_s", "imbalance", "0.0005"]),
    ("plant.mass_kg=0.2", ["toml: plant: mass_kg = 0.2 must exceed"]),
    ("sensors.set=perfect", ["sensors", "'perfect'", "bench, paper, vn100, wmap, ideal"]),
    ("sensors.gyro_noise_deg=1", ["sensors.gyro_noise_deg", "unknown key", "gyro_noise_rad_s"]),
    ("sensors.dropout_probability=1.5", ["sensors.dropout_probability", "less than 1"]),
    ("observers.ekf.type=ukff", ["observers.ekf: no type is called 'ukff'; did you mean ukf?"]),
    ("observers.ekf.tuning=best", ["ekf.tuning", "'best'", "paper, consistent"]),
    ("observers.nis-fading.alpha=1.2", ["observers.nis-fading.alpha", "less than 1"]),
    ("observers.nis-fading.tail_on=0.2", ["observers.nis-fading", "on < off"]),
    ("control={type='unfalsified',feedback='truth',axis_limit_nm=1}", ["control.axis_limit_nm", "unknown key"]),
    ("control.feedback=nis", ["control.feedback", "'nis'", "nis-fading", "truth", "measurement"]),
    ("reference.amplitude_deg=[4,6]", ["reference.amplitude_deg"]),
    ("faults=[{kind='float',wheel=5,start_s=1,duration_s=1}]", ["faults.0", "no wheel 5", "1 to 4"]),
    ("faults=[{kind='flaot',wheel=1,start_s=1,duration_s=1}]", ["faults.0: no kind is called 'flaot'; did you mean float?"]),
    ("faults=[{kind='dropout',start_s=1}]", ["faults.0: no kind is called 'dropout'; did you mean drop-out?"]),
    ("faults=[{start_s=1}]", ["faults.0: needs a kind"]),
    ("faults=['float']", ["faults.0: must be a table (got 'float')"]),
    ("reference={type='sine'}", ["reference: no type is called 'sine'; there are sinusoid, hold"]),
    ("tuning.torque_correlation_s=-1", ["tuning.process_noise: is missing"]),
    ("observers.ekf=3", ["observers.ekf: must be a table (got 3)"]),
    ("plant.kind='nacs'", ["plant.kind: unknown key; kind belongs elsewhere"]),
    ("run.trials='ten'", ["run.trials: must be a whole number (got 'ten')"]),
    ("sensors.gyro='maybe'", ["sensors.gyro: must be true or false (got 'maybe')"]),
    ("plant.centre_of_mass_um=3", ["plant.centre_of_mass_um: must be a list (got 3)"]),
    ("faults=[{kind='float',wheel=1,duration_s=1}]", ["faults.0.start_s", "missing"]),
    ("faults=[{kind='float',wheel=1,start_s=99.5,duration_s=1}]", ["faults.0 (float)", "99.5 to 100.5 s", "0 to 100 s"]),
    ("faults=[{kind='effectiveness',wheel=1,remaining={uniform=[2,1]},start_s=1,duration_s=1}]", ["faults.0.remaining", "low < high"]),
    ("faults=[{kind='inertia',inertia_kg_m2=[1,1,3,0,0,0],start_s=1,duration_s=1}]", ["faults.0 (inertia)", "triangle inequality"]),
    ("faults=[{kind='inertia',inertia_kg_m2=[0.002,0.002,0.002,0,0,0],start_s=1,duration_s=1}]", ["faults.0 (inertia)", "not positive"]),
    ("faults=[{kind='delay',delay_s=-0.1,start_s=1,duration_s=1}]", ["faults.0.delay_s", "must not be negative"]),
    ("faults=[{kind='external-torque',torque_nm=1,direction=[0,0,0],start_s=1,duration_s=1}]", ["faults.0.direction", "zero"]),
    ("faults=[{kind='float',wheel=1,start_s={normal=[5,-1]},duration_s=1}]", ["faults.0.start_s", "standard deviation"]),
    ("plant.centre_of_mass_um=[nan,0,0]", ["plant.centre_of_mass_um.0", "finite"]),
    ("run.tick_s=inf", ["run.tick_s", "finite"]),
    ("reference.amplitude_deg=[170,170,0]", ["reference.amplitude_deg", "half a revolution"]),
    ("title.deep=1", ["--set title.deep", "'title' is a value"]),
    ("plant.mass_kg.deep=1", ["plant.mass_kg"]),
    ("run", ["--set run", "key.sub=value"]),
]


@pytest.mark.parametrize(("setting", "wanted"), SETTINGS, ids=[s for s, _ in SETTINGS])
def test_a_wrong_setting_is_one_line_naming_file_and_key(nacs, tmp_path: Path, setting: str, wanted: list[str]) -> None:
    result = nacs("run", "nacs/fault-free", "--set", setting)
    assert result.code == 2
    assert result.out == ""
    assert result.err.startswith("error: ")
    assert result.err.count("\n") == 1
    for part in wanted:
        assert part in result.err
    assert not list(tmp_path.iterdir())


ARGUMENTS = [
    (["nacs/fault-fre"], ["no scenario 'nacs/fault-fre'", "did you mean nacs/fault-free?"]),
    (["what/ever"], ["no scenario 'what/ever'", "nacs list"]),
    (["mine.toml"], ["no scenario file mine.toml"]),
    (["nacs/fault-free", "--trials", "0"], ["run.trials", "greater than or equal to 1"]),
    (["nacs/fault-free", "--seed", "-1"], ["run.seed", "greater than or equal to 0"]),
    (["nacs/fault-free", "--only-trial", "10"], ["--only-trial 10", "0 to 9"]),
    (["nacs/fault-free", "--out", "/proc/nowhere"], ["--out /proc/nowhere", "cannot be written"]),
    (["nacs/fault-free", "--live"], ["--live", "no Rerun viewer", "127.0.0.1"]),
    (["nacs/fault-free", "--live", "--workers", "2"], ["--live needs --workers 1"]),
]


@pytest.mark.parametrize(("arguments", "wanted"), ARGUMENTS, ids=[" ".join(a) for a, _ in ARGUMENTS])
def test_a_wrong_argument_is_one_line_and_writes_nothing(nacs, tmp_path: Path, arguments: list[str], wanted: list[str]) -> None:
    result = nacs("run", *arguments)
    assert result.code == 2
    assert result.err.count("\n") == 1
    for part in wanted:
        assert part in result.err
    assert not list(tmp_path.iterdir())


def test_a_broken_file_names_its_line(nacs, tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text("[run\nticks = 3\n")
    result = nacs("run", "mine.toml")
    assert (result.code, result.err.count("\n")) == (2, 1)
    assert "mine.toml" in result.err
    assert "line 1" in result.err


def test_a_folder_with_results_is_not_overwritten_silently(nacs, tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "summary.json").write_text("precious")
    result = nacs("run", "nacs/fault-free", "--set", "run.ticks=5", "--out", "mine")
    assert result.code == 2
    assert "--overwrite" in result.err
    assert (tmp_path / "mine" / "summary.json").read_text() == "precious"


def test_the_viewer_needs_a_display(nacs, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    result = nacs("view", "nacs/fault-free")
    assert result.code == 2
    assert "display" in result.err


def test_a_users_own_file_works_by_path(nacs, tmp_path: Path) -> None:
    text = (SCENARIOS / "nacs" / "fault-free.toml").read_text().replace("ticks = 1000", "ticks = 5").replace("trials = 10", "trials = 1")
    (tmp_path / "mine.toml").write_text(text)
    result = nacs("run", "mine.toml")
    assert result.code == 0, result.err
    assert (tmp_path / "runs" / "mine" / "summary.json").is_file()


def test_a_law_that_is_too_fast_for_the_tick_is_refused_at_its_place(nacs) -> None:
    result = nacs("run", "antenna-mapping/boeing702", "--set", "loops.adaptive.control.pace_rad_s=100")
    said = "loops.adaptive.control.pace_rad_s: 100 rad/s needs run.tick_s at most 0.005 s"
    assert (result.code, result.err) == (2, f"error: antenna-mapping/boeing702.toml: {said}\n")


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("plant.agents=0", "plant.agents: must be greater than or equal to 1 (got 0)"),
        ("plant.h1=[]", "plant.h1: needs 1 value or more (got [])"),
    ],
)
def test_a_key_that_is_called_as_its_section_s_type_is_named(nacs, setting: str, said: str) -> None:
    result = nacs("run", "consensus/fault-free", "--set", setting)
    assert (result.code, result.err) == (2, f"error: consensus/fault-free.toml: {said}\n")


@pytest.mark.parametrize(
    ("name", "tick_s"),
    [("nacs/fault-free", 0.0025), ("formation/fault-free", 0.0033), ("consensus/fault-free", 0.0033), ("wmap/compare", 0.07)],
)
def test_a_step_that_does_not_fit_a_period_is_told_with_one_that_does(name: str, tick_s: float) -> None:
    changes: dict[str, object] = {"run.ticks": 5, "run.tick_s": tick_s, "phases": {}, "faults": []}
    changes = {key: value for key, value in changes.items() if key != "phases" or not name.startswith("consensus")}
    for _ in range(3):  # the plant's step, and what some loops have of their own
        with pytest.raises(BadInput) as refused:
            load(name, changes)
        found = re.search(r"; ([\w.-]+) = (\S+) would do$", str(refused.value))
        assert found, refused.value
        changes[found[1]] = float(found[2])
        try:
            assert load(name, changes).run.tick_s == tick_s
        except BadInput:
            continue
        return
    pytest.fail(f"what is said never does: {changes}")
