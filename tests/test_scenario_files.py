"""Scenario files: those that extend others, those that `nacs new` writes, and what is said of their keys."""

from __future__ import annotations

import json
import re
import runpy
import tomllib
from pathlib import Path

import pytest

from nacs.errors import NacsError
from nacs.scenarios import load as load_in_python
from sim.scenario import catalogue, files
from sim.scenario.described.meanings import MEANINGS, meaning, unit
from sim.scenario.described.schema import Schema
from sim.scenario.extension import DEEPEST, laid_over

ROOT = Path(__file__).resolve().parents[1]
SOME = ("nacs/disturbance", "wmap/compare", "antenna-mapping/panelsat", "formation/nacs-faults", "consensus/disturbance")


@pytest.fixture(scope="module")
def schema() -> Schema:
    return Schema()


# ---- files that extend others


def test_tables_are_merged_and_all_else_is_replaced() -> None:
    base = {"a": 1, "list": [1, 2], "run": {"ticks": 9, "seed": 3}, "law": {"type": "pd", "gain": 2}, "faults": [{"kind": "x"}]}
    own = {"list": [3], "run": {"ticks": 5}, "law": {"type": "smc"}, "faults": [], "new": {"b": 1}}
    assert laid_over(base, own) == {
        "a": 1,
        "list": [3],
        "run": {"ticks": 5, "seed": 3},
        "law": {"type": "smc"},
        "faults": [],
        "new": {"b": 1},
    }
    assert laid_over({"law": {"type": "pd", "gain": 2}}, {"law": {"gain": 3}}) == {"law": {"type": "pd", "gain": 3}}
    assert laid_over({"a": {"b": 1}}, {"a": 2}) == {"a": 2}
    assert base["run"] == {"ticks": 9, "seed": 3}


def test_a_file_extends_a_scenario_and_a_file_that_does(tmp_path) -> None:
    (tmp_path / "short.toml").write_text('extends = "nacs/disturbance"\n[run]\nticks = 900\n[sensors]\nlatency_s = 0.0\n')
    (tmp_path / "below").mkdir()
    (tmp_path / "below" / "mine.toml").write_text(
        'extends = "../short.toml"\ntitle = "Mine"\nfaults = []\n[control]\nproportional_nm = 0.2\n'
    )
    found = files.dumped(files.load(str(tmp_path / "below" / "mine.toml")))
    right = files.dumped(files.load("nacs/disturbance", {"run.ticks": 900, "title": "Mine", "faults": [], "control.proportional_nm": 0.2}))
    assert found == right
    assert files.load(str(tmp_path / "short.toml"), {"run.ticks": 950}).run.ticks == 950


def test_a_dictionary_extends_too() -> None:
    assert load_in_python({"extends": "nacs/disturbance", "run": {"ticks": 900}}).run.ticks == 900
    with pytest.raises(NacsError, match="dictionary: extends: no scenario 'nacs/disturbanc'; did you mean nacs/disturbance"):
        load_in_python({"extends": "nacs/disturbanc"})


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('extends = "mine.toml"', "mine.toml: extends: goes in a circle: mine.toml -> mine.toml"),
        ('extends = "other.toml"', "extends: goes in a circle: mine.toml -> other.toml -> mine.toml"),
        ('extends = "none.toml"', "mine.toml: extends: no scenario file none.toml"),
        ('extends = "nacs/fault-fre"', "mine.toml: extends: no scenario 'nacs/fault-fre'; did you mean nacs/fault-free?"),
        ("extends = 3", "mine.toml: extends: must be the name of a scenario, or the path of a file"),
        ('extends = ""', "mine.toml: extends: must be the name of a scenario, or the path of a file"),
        ('extends = "broken.toml"', "mine.toml: extends: broken.toml: cannot be read as TOML"),
        ('extends = "nacs/fault-free"\n[run]\ntick = 3', "mine.toml: run.tick: unknown key; did you mean"),
        ('extends = "nacs/fault-free"\n[run]\nextends = "x"', "mine.toml: run.extends: unknown key"),
        ('extends = "0.toml"', f"more than {DEEPEST} files extend each other"),
    ],
)
def test_what_cannot_be_extended_is_said_in_one_line(nacs, tmp_path, text, said) -> None:
    (tmp_path / "mine.toml").write_text(text)
    (tmp_path / "other.toml").write_text('extends = "mine.toml"')
    (tmp_path / "broken.toml").write_text("[run")
    for number in range(DEEPEST + 2):
        (tmp_path / f"{number}.toml").write_text(f'extends = "{number + 1}.toml"')
    result = nacs("run", "mine.toml", "--out", "it")
    assert (result.code, result.out, result.err.count("\n")) == (2, "", 1)
    assert said in result.err
    assert not (tmp_path / "it").exists()


# ---- files to begin with


@pytest.mark.parametrize("name", SOME)
def test_a_new_file_is_its_base_and_says_what_is_not_set(nacs, tmp_path, name) -> None:
    """With every remark that has a value taken in, it is the same scenario still."""
    result = nacs("new", "mine", "--from", name)
    assert (result.code, result.err) == (0, "")
    assert "nacs run mine.toml" in result.out
    text = (tmp_path / "mine.toml").read_text()
    right = files.dumped(files.load(name))
    assert tomllib.loads(text) == tomllib.loads((catalogue.SCENARIOS / f"{name}.toml").read_text())
    assert files.dumped(files.load("mine.toml")) == right
    taken_in, count = re.subn(r"^# ([\w-]+ = .*)$", r"\1", text, flags=re.M)
    assert count > 20
    (tmp_path / "whole.toml").write_text(taken_in)
    assert files.dumped(files.load("whole.toml")) == right


def test_a_new_file_of_one_that_extends_is_whole(nacs, tmp_path) -> None:
    (tmp_path / "short.toml").write_text('extends = "nacs/disturbance"\n[run]\nticks = 800\n')
    assert nacs("new", "mine.toml", "--from", "short.toml").code == 0
    assert tomllib.loads((tmp_path / "mine.toml").read_text())["run"] == {"ticks": 800, "tick_s": 0.1, "trials": 10, "seed": 2024}
    assert "extends" not in (tmp_path / "mine.toml").read_text().replace("short.toml", "")
    assert "# gyro_noise_rad_s = 0.0017320508  # rad/s; standard deviation" in (tmp_path / "mine.toml").read_text()


def test_what_is_not_set_is_what_a_named_set_makes_it(nacs, tmp_path) -> None:
    assert nacs("new", "mine", "--from", "antenna-mapping/panelsat").code == 0
    mass = files.load("antenna-mapping/panelsat").plant.mass_kg
    assert mass != files.load("antenna-mapping/boeing702").plant.mass_kg
    assert f"# mass_kg = {mass}  # kg; whole" in (tmp_path / "mine.toml").read_text()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["mine"], "mine.toml: is there already; take another name or add --overwrite"),
        ([" "], "cannot be a scenario's name: it must have 1 to 60 printable characters"),
        (["two\nlines"], "cannot be a scenario's name"),
        (["x" * 300], "cannot be a scenario's name"),
        (["folder.toml"], "folder.toml: is a folder"),
        (["it", "--from", "nacs/faultfree"], "no scenario 'nacs/faultfree'; did you mean nacs/fault-free?"),
    ],
)
def test_a_new_file_that_cannot_be_is_said_in_one_line(nacs, tmp_path, arguments, said) -> None:
    (tmp_path / "mine.toml").write_text("mine")
    (tmp_path / "folder.toml").mkdir()
    result = nacs("new", *arguments)
    assert (result.code, result.err.count("\n")) == (2, 1)
    assert said in result.err
    assert (tmp_path / "mine.toml").read_text() == "mine"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["folder.toml", "mine.toml"]


# ---- what editors and people are told


def test_the_schema_takes_every_scenario_and_no_wrong_one(nacs) -> None:
    jsonschema = pytest.importorskip("jsonschema")
    told = json.loads(nacs("schema").out)
    jsonschema.Draft202012Validator.check_schema(told)
    check = jsonschema.Draft202012Validator(told)
    for name in catalogue.scenario_names():
        assert [error.message for error in check.iter_errors(tomllib.loads((catalogue.SCENARIOS / f"{name}.toml").read_text()))] == []
    data = tomllib.loads((catalogue.SCENARIOS / "nacs" / "disturbance.toml").read_text())
    for wrong in (
        data | {"titel": "x"},
        data | {"run": data["run"] | {"ticks": "many"}},
        data | {"plant": {"type": "nasc"}},
        data | {"control": data["control"] | {"typ": 1}},
        data | {"faults": [{"kind": "external-torque", "start_s": 1.0, "torque_nm": "x"}]},
        {key: value for key, value in data.items() if key != "run"},
        {"extends": 3},
        {"extends": "nacs/disturbance", "runs": {}},
    ):
        assert list(check.iter_errors(wrong)), wrong
    assert not list(check.iter_errors({"extends": "nacs/disturbance", "run": {"ticks": 3}}))


def test_every_key_says_what_it_means(schema) -> None:
    silent = [f"{name}.{one.name}" for name in schema.definitions for one in schema.keys(name) if not one.meaning]
    assert silent == []


def test_no_meaning_is_of_a_key_that_is_not_there(schema) -> None:
    there = {one.name for name in schema.definitions for one in schema.keys(name)} | {"extends"}
    there |= {f"{schema.title(name)}.{one.name}" for name in schema.definitions for one in schema.keys(name)}
    assert sorted(set(MEANINGS) - there) == []


@pytest.mark.parametrize(
    ("key", "said"),
    [
        ("gyro_noise_rad_s", "rad/s"),
        ("gyro_bias_walk_rad_s_sqrt_s", "rad/s/sqrt(s)"),
        ("inertia_kg_m2", "kg m2"),
        ("derivative_nms", "N m s"),
        ("torque_nm", "N m"),
        ("duration_s", "s"),
        ("feedback", ""),
        ("alpha", ""),
    ],
)
def test_the_name_of_a_key_ends_with_its_unit(key, said) -> None:
    assert unit(key) == said


def test_a_class_may_mean_something_of_its_own() -> None:
    assert meaning("NisSwitched", "alpha") != meaning("Ukf", "alpha")
    assert meaning("Ukf", "no such key") is None


def test_the_page_is_what_the_settings_say() -> None:
    page = runpy.run_path(str(ROOT / "docs" / "scenario_files.py"))["PAGE"]
    stale = "python docs/scenario_files.py > docs/scenario-files.md"
    assert page == (ROOT / "docs" / "scenario-files.md").read_text(encoding="utf-8"), stale
