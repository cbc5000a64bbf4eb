"""The rules of the house hold, and each of them would find what it is there for, in any folder."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.house import FLOORS, ORDER, ROOT, House, repository_files, storeys
from tests.house_rules import (
    LARGEST_GROUND,
    LARGEST_ROOM,
    MOST_STOREYS,
    RULES,
    bare_slices,
    in_room,
    ladders_on_plants,
    no_address_and_no_path_of_a_machine,
    plant_classes,
)

FILES = repository_files()
HOUSE = House(ROOT, FILES)
RULE = {rule.__name__: rule for rule in RULES}

# Rooms that have been cleared of these places; a room is added when it has been, and none is taken out. What is left elsewhere:
# `python -m tests.house_rules`.


def build(root: Path, **texts: str) -> House:
    """A made-up house of modules; every folder is a package. `sim__loop__x` is sim/loop/x.py."""
    for name, text in texts.items():
        path = root.joinpath(*name.split("__")).with_suffix(".py")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f'"""A module."""\n{text}\n', encoding="utf-8")
        for folder in path.relative_to(root).parents[:-1]:
            (root / folder / "__init__.py").write_text('"""A room."""\n', encoding="utf-8")
    return House.in_folder(root)


# ---- the house as it is


def test_every_python_file_of_the_floors_is_guarded_however_deep_it_lies():
    found = {path.relative_to(ROOT).as_posix() for floor in FLOORS for path in (ROOT / floor).rglob("*.py")}
    assert found == {module.place for module in HOUSE.modules}
    assert {module.floor for module in HOUSE.modules} >= {"models", "estimation", "control", "sim"}


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.__name__)
def test_the_house_keeps(rule):
    broken = rule(HOUSE)
    assert not broken, "\n".join([f"{len(broken)} places:", *broken])


def test_nothing_asks_of_which_class_a_plant_is():
    assert ladders_on_plants(HOUSE) == []


def test_nothing_cuts_a_state_by_numbers():
    assert bare_slices(HOUSE) == []


def test_no_file_names_a_registry_or_a_path_of_some_machine():
    assert no_address_and_no_path_of_a_machine(FILES) == []


# ---- the rules themselves, on made-up houses


def test_a_new_folder_is_guarded_by_every_rule(tmp_path):
    """Files in folders below a floor's own were once not looked at."""
    probe = tmp_path / "sim" / "show" / "utils.py"
    probe.parent.mkdir(parents=True)
    probe.write_text(
        "import random\nimport filterpy\nimport mujoco\nimport rerun\nfor trial in range(trials):\n    pass\n", encoding="utf-8"
    )
    house = House(tmp_path, [probe])
    found = {name for name, rule in RULE.items() if any("show" in line for line in rule(house))}
    assert found == {
        *("rooms_have_a_place", "nothing_depends_on_tests", "mujoco_stays_in_its_rooms", "rerun_stays_in_its_room"),
        *("names_say_something", "every_folder_is_a_package", "modules_say_what_they_are", "no_loop_by_number"),
        "random_numbers_come_from_generators",
    }


BAD: list[tuple[str, dict[str, str]]] = [
    ("floors_import_down", {"models__plants__x": "import sim.loop.x", "sim__loop__x": ""}),
    ("floors_import_down", {"estimation__x": "from control.x import Law", "control__x": ""}),
    ("floors_import_down", {"control__deep__x": "from estimation import x", "estimation__x": ""}),
    ("floors_import_down", {"sim__cli__x": "def f():\n    import nacs", "nacs__x": ""}),
    ("rooms_have_a_place", {"sim__utilities__x": ""}),
    ("rooms_have_a_place", {"models__orbits__x": ""}),
    ("rooms_import_down", {"sim__loop__x": "from sim.report.page import Page", "sim__report__page": ""}),
    ("rooms_import_down", {"sim__x": "from sim import faults", "sim__faults__x": ""}),
    ("rooms_import_down", {"sim__loop__deep__x": "from sim.cli import x", "sim__cli__x": ""}),
    ("rooms_import_down", {"models__dynamics__x": "from models.plants.x import X", "models__plants__x": ""}),
    ("rooms_import_down", {"models__x": "import models.attitude.x", "models__attitude__x": ""}),
    ("rooms_import_down", {"sim__plant__x": "if TYPE_CHECKING:\n    from sim.loop.y import Y", "sim__loop__y": ""}),
    ("rooms_import_down", {"sim__plant__x": "y = import_module('sim.loop.y')", "sim__loop__y": ""}),
    ("no_circle_among_rooms", {"sim__plant__x": "import sim.loop.y", "sim__loop__y": "", "sim__loop__z": "import sim.plant.x"}),
    ("no_circle_among_modules", {"sim__loop__x": "import sim.loop.y", "sim__loop__y": "def f():\n    from sim.loop import x"}),
    ("imports_are_absolute_and_literal", {"sim__loop__x": "from . import y", "sim__loop__y": ""}),
    ("imports_are_absolute_and_literal", {"sim__loop__x": "y = importlib.import_module(name)"}),
    ("nothing_depends_on_tests", {"models__plants__x": "from tests import house"}),
    ("mujoco_stays_in_its_rooms", {"sim__cli__x": "import mujoco.viewer"}),
    ("mujoco_stays_in_its_rooms", {"estimation__x": "from mujoco import MjModel"}),
    ("rerun_stays_in_its_room", {"sim__report__x": "import rerun as rr"}),
    ("rooms_are_small", {f"sim__x{i}": "" for i in range(LARGEST_GROUND + 1)}),
    ("rooms_are_small", {f"sim__cli__deep__x{i}": "" for i in range(LARGEST_ROOM + 1)}),
    *(
        ("names_say_something", {name: ""})
        for name in ("sim__loop__utils", "sim__loop__wheel_helpers", "sim__cli__common__x", "control__base")
    ),
    ("no_loop_by_number", {"sim__loop__x": "for i in range(len(trials)):\n    pass"}),
    ("no_loop_by_number", {"estimation__deep__x": "a = [i for i in range(self.particles)]"}),
    ("there_is_one_closed_loop", {"sim__loop__x": ""}),
    ("there_is_one_closed_loop", {"sim__loop__x": "for k in range(run.ticks):\n    pass"}),
    ("there_is_one_closed_loop", {"sim__replay__x": "while tick < last:\n    tick += 1"}),
    ("there_is_one_closed_loop", {"sim__metrics__x": "for t in times:\n    law.decide(t)\n    plant.advance(t)"}),
    ("random_numbers_come_from_generators", {"control__x": "import random"}),
    ("random_numbers_come_from_generators", {"control__x": "from numpy.random import default_rng"}),
    ("random_numbers_come_from_generators", {"control__x": "a = np.random.normal()"}),
]


@pytest.mark.parametrize(("rule", "texts"), BAD, ids=[f"{rule}-{next(iter(texts.values()))[:30]!r}" for rule, texts in BAD])
def test_a_rule_finds(rule, texts, tmp_path):
    assert RULE[rule](build(tmp_path, **texts))


GOOD_LOOP = "for k in range(s.ticks):\n    d = s.law.decide(k)\n    s.plant.advance(d)"


def test_a_good_house_breaks_no_rule(tmp_path):
    house = build(
        tmp_path,
        models__sections="",
        models__attitude__quaternion="",
        models__dynamics__body="from models.attitude import quaternion",
        models__plants__nacs="import mujoco\nfrom models.dynamics.body import Body\nfrom models.sections import Section",
        estimation__kalman="from models.dynamics.body import Body",
        control__law="import models.attitude.quaternion",
        sim__units="import numpy as np\nrandom = np.random.Generator(np.random.PCG64(np.random.SeedSequence(1)))",
        sim__plant__batch="import mujoco\nfrom models.plants.nacs import compile_nacs",
        sim__loop__closed_loop=f"from sim.plant.batch import Plant\n{GOOD_LOOP}",
        sim__rerun__sink="import rerun\nimport sim.loop.closed_loop",
        sim__cli__commands__viewer="import mujoco\nfrom sim.rerun import sink\nfor i in range(3):\n    pass",
        nacs__face="from sim.loop.closed_loop import run",
    )
    assert {name: broken for name, rule in RULE.items() if (broken := rule(house))} == {}
    assert max(storeys(house.graph_of_rooms()).values()) == 7


def test_a_high_house_is_found(tmp_path):
    rooms = [room for room in ORDER if room.startswith("sim.") and room != "sim.ground"][: MOST_STOREYS + 1]
    names = [room.replace(".", "__") + "__x" for room in rooms]
    texts = {name: f"import {below.replace('__', '.')}" if below else "" for name, below in zip(names, [None, *names], strict=False)}
    (line,) = RULE["few_storeys"](build(tmp_path, **texts))
    assert line == f"{MOST_STOREYS + 1} storeys: " + " -> ".join(reversed(rooms))


def test_a_docstring_has_to_say_something_also_of_a_folder(tmp_path):
    build(tmp_path, sim__loop__x="")
    (tmp_path / "sim" / "loop" / "__init__.py").write_text('"""no end"""\n', encoding="utf-8")
    (tmp_path / "sim" / "__init__.py").write_text("", encoding="utf-8")
    assert RULE["modules_say_what_they_are"](House.in_folder(tmp_path)) == ["sim/__init__.py", "sim/loop/__init__.py"]


PLANTS = {
    "models__sections": "class Section: ...\nclass Positive(Section): ...",
    "models__plants__nacs": "class NacsParameters(Section): ...\nclass Wheel: ...\nisinstance(p, NacsParameters)",
    "sim__plant__kinds": "class NacsPlant(NacsParameters): ...\nPlants = Annotated[NacsPlant | Other, 1]\nAny = Wheel | None",
}


def test_ladders_on_plants_are_found_by_class_subclass_union_and_match(tmp_path):
    asks = [
        "isinstance(p, NacsParameters)",
        "isinstance(p, nacs.NacsPlant | int)",
        "issubclass(p, (int, Plants))",
        "match p:\n    case NacsPlant():\n        pass",
        "isinstance(p, Wheel)",
        "isinstance(p, Positive)",
        "NacsPlant(p)",
    ]
    house = build(tmp_path, **PLANTS, sim__loop__x="\n".join(asks))
    assert plant_classes(house) == {"NacsParameters", "NacsPlant", "Plants"}
    assert [line.split(": ")[1] for line in ladders_on_plants(house)] == ["NacsParameters", "NacsPlant", "Plants", "NacsPlant"]
    assert len(in_room(house, "sim.loop", ladders_on_plants(house))) == 4
    assert in_room(house, "sim.plant", ladders_on_plants(house)) == []


@pytest.mark.parametrize("cut", ["[:4]", "[0:4]", "[4:7]", "[7:]", "[..., :4]", "[..., 4:7]", "[..., 7:]", "[..., :7]", "[:, 0, 4:7]"])
def test_bare_slices_are_found(cut, tmp_path):
    assert len(bare_slices(build(tmp_path, sim__series__deep__x=f"a = state{cut}"))) == 1


@pytest.mark.parametrize("cut", ["[4]", "[:n]", "[:-1]", "[:3]", "[..., layout.rate]", "[:4, 0]", "[7:, :]", "[::4]", "[0:4:2]"])
def test_other_slices_are_not(cut, tmp_path):
    assert bare_slices(build(tmp_path, sim__series__x=f"a = state{cut}")) == []


def test_the_layout_of_the_state_may_name_its_slices(tmp_path):
    cuts = "cuts = slice(4), slice(4, 7), slice(7, None), slice(None)"
    house = build(tmp_path, models__plants__layout=f"class StateLayout: ...\n{cuts}", sim__loop__x=cuts)
    assert [line.split(": ")[1] for line in bare_slices(house)] == ["slice(4)", "slice(4, 7)", "slice(7, None)"]


def test_addresses_and_paths_are_found_in_every_kind_of_text(tmp_path):
    wrong = ["pip install from pypi" + ".org", "see /ho" + "me/someone/file"]
    files = [tmp_path / name for name in ("a.py", "b.yaml", "c.cff", "Makefile", "d.md")]
    for file in files:
        file.write_text("\n".join(["good", *wrong]), encoding="utf-8")
    assert len(no_address_and_no_path_of_a_machine(files, tmp_path)) == 2 * len(files)


# ---- files that the guides name


@pytest.mark.parametrize("guide", ["README.md", "CONTRIBUTING.md", "CHANGELOG.md"])
def test_a_guide_names_files_that_are_there(guide):
    known = {path.relative_to(ROOT).as_posix() for path in FILES}
    known |= {folder.as_posix() for path in known for folder in Path(path).parents}
    text = (ROOT / guide).read_text(encoding="utf-8")
    named = re.findall(r"\b(?:models|sim|estimation|control|tests|docs|benchmarks)/(?:[\w-]+/)*[\w.-]*\w", text)
    assert sorted({name for name in named if name not in known and Path(name).stem != "x"}) == []
