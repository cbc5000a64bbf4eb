"""The rules of the house, read off the source itself."""

import ast
import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FLOORS = ("models", "estimation", "control", "sim")
MAY_IMPORT = {
    "models": {"models"},
    "estimation": {"estimation", "models"},
    "control": {"control", "models"},
    "sim": {"sim", "estimation", "control", "models"},
}


def files() -> list[Path]:
    """Everything that is, or would be, in the repository; without git, whatever lies in the house's folders."""
    listing = ["git", "-C", str(ROOT), "ls-files", "--cached", "--others", "--exclude-standard", "-z"]
    try:
        names = subprocess.run(listing, capture_output=True, check=True).stdout.decode().split("\0")
        return [ROOT / name for name in names if name and (ROOT / name).is_file()]
    except (OSError, subprocess.CalledProcessError):
        folders = (*FLOORS, "tests", "docs", "benchmarks")
        return [path for folder in folders for path in (ROOT / folder).rglob("*") if path.is_file() and "__pycache__" not in path.parts]


FILES = files()
MODULES = [path for path in FILES if path.suffix == ".py" and path.parent.name in FLOORS and path.parent.parent == ROOT]
every_module = pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))


def imported(path: Path) -> set[str]:
    """Names of all modules that a file imports, wherever in it, type checking included."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name}: a relative import"
            names.add(node.module or "")
    return names


def roots(path: Path) -> set[str]:
    return {name.split(".")[0] for name in imported(path)}


def loops(tree: ast.AST) -> list[ast.For | ast.comprehension]:
    return [node for node in ast.walk(tree) if isinstance(node, ast.For | ast.comprehension)]


def test_the_house_has_its_four_floors():
    assert {path.parent.name for path in MODULES} == set(FLOORS)


@every_module
def test_imports_only_go_down(path):
    assert roots(path) & set(FLOORS) <= MAY_IMPORT[path.parent.name]


@every_module
def test_nothing_of_the_house_depends_on_its_tests(path):
    assert not roots(path) & {"tests", "benchmarks", "pytest", "hypothesis", "filterpy", "stonesoup"}


@every_module
def test_mujoco_is_imported_only_where_models_are_compiled_stepped_and_seen(path):
    allowed = path.parent.name == "models" or (path.parent.name, path.name) in {("sim", "plant.py"), ("sim", "viewer.py")}
    assert allowed or "mujoco" not in roots(path)


@every_module
def test_rerun_is_imported_only_in_its_sink(path):
    allowed = path.parent.name == "sim" and path.name.startswith("rerun_")
    assert allowed or "rerun" not in roots(path)


@every_module
def test_a_file_is_named_for_its_concept(path):
    vague = {"util", "utils", "helper", "helpers", "common", "misc", "base", "core"}
    assert not vague & set(path.stem.split("_"))


@every_module
def test_no_loop_goes_through_trials_particles_or_agents_by_number(path):
    """`for _ in range(...)` over what should be a leading axis; streams of random numbers are drawn trial by trial, by name."""
    many = re.compile(r"\b(n_?)?(trials?|particles?|agents?|nsim)\b|sigma_points", re.IGNORECASE)
    for loop in loops(ast.parse(path.read_text(encoding="utf-8"))):
        over = loop.iter
        if isinstance(over, ast.Call) and isinstance(over.func, ast.Name) and over.func.id == "range":
            assert not many.search(ast.unparse(over)), f"line {over.lineno}: {ast.unparse(over)}"


@every_module
def test_no_random_number_comes_from_a_global_generator(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    used = {ast.unparse(node) for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    legal = {"np.random.Generator", "np.random.PCG64", "np.random.SeedSequence"}
    assert {name for name in used if re.fullmatch(r"np\.random\.\w+", name)} <= legal
    assert "random" not in roots(path)


@every_module
def test_every_module_says_in_its_first_line_what_it_is(path):
    said = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
    assert said
    assert said.splitlines()[0].endswith((".", "?", ":"))


@pytest.mark.parametrize(
    "path", [p for p in FILES if p.suffix in {".py", ".toml", ".md", ".xml", ".txt", ".yml", ""}], ids=lambda p: p.name
)
def test_no_file_names_a_registry_or_a_path_of_some_machine(path):
    hosts = ("pypi" + ".org", "python" + "hosted", "registry." + "npmjs", "conda" + ".anaconda", "crates" + ".io")
    folders = re.compile("(?<![\\w.])/(" + "|".join(("wor" + "k", "tm" + "p", "ro" + "ot", "hom" + "e", "Use" + "rs")) + ")/")
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        assert not any(host in line for host in hosts), f"{path.name}:{number}"
        assert not folders.search(line), f"{path.name}:{number}"
