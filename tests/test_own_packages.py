"""A foreign `control`, `models`, `sim` or `estimation` is told in one line before anything breaks, whichever was installed first."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
COMMAND = "from nacs_twin.entry.command import main; main()"
FACE = "import nacs"
CAUGHT = """
try:
    import nacs
except ValueError as wrong:
    assert type(wrong).__name__ == "NacsError", type(wrong)
    raise SystemExit(f"{wrong.exit_code} {wrong}")
"""


def python(code: str, *path: Path, arguments: tuple[str, ...] = ("--version",)) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, path)), "PYTHONDONTWRITEBYTECODE": "1"}
    started = [sys.executable, "-c", code, *arguments]
    return subprocess.run(started, capture_output=True, text=True, env=environment, cwd=path[0], check=False)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder like `site-packages` with the packages that are looked at, and nothing of the others'."""
    folder = tmp_path_factory.mktemp("site")
    for name in ("nacs_twin", "nacs"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("models", "estimation", "control", "sim"):
        (folder / name).mkdir()
        (folder / name / "__init__.py").write_text('raise AssertionError("was imported")\n')
    return folder


def foreign(folder: Path, name: str, distribution: str | None = None) -> Path:
    """A package of that name that must not be imported; with what an installer notes of it."""
    (folder / name).mkdir(parents=True, exist_ok=True)
    (folder / name / "__init__.py").write_text('raise AssertionError("was imported")\n')
    if distribution is not None:
        noted = folder / f"{distribution}-1.0.dist-info"
        noted.mkdir()
        (noted / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {distribution}\nVersion: 1.0\n")
        (noted / "RECORD").write_text(f"{name}/statesp.py,sha256=x,1\n{name}/__init__.py,sha256=x,1\n")
    return folder


@pytest.mark.parametrize("name", ["models", "estimation", "control", "sim"])
def test_a_foreign_package_that_is_found_first_is_one_line_of_the_command(site: Path, tmp_path: Path, name: str) -> None:
    ended = python(COMMAND, foreign(tmp_path / "theirs", name), site)
    assert ended.returncode == 2
    assert ended.stdout == ""
    assert len(ended.stderr.splitlines()) == 1
    assert f"error: the package `{name}` that Python finds is not the twin's" in ended.stderr
    assert str(tmp_path / "theirs" / name / "__init__.py") in ended.stderr
    assert "pipx install nacs-twin" in ended.stderr


def test_it_is_a_nacserror_in_python(site: Path, tmp_path: Path) -> None:
    ended = python(CAUGHT, foreign(tmp_path / "theirs", "control"), site)
    assert len(ended.stderr.splitlines()) == 1
    assert ended.stderr.startswith("2 the package `control` that Python finds is not the twin's")


@pytest.mark.parametrize("last", ["theirs", "ours"])
def test_a_package_in_the_same_folder_is_told_of_in_both_orders_of_installing(site: Path, tmp_path: Path, last: str) -> None:
    """The one that comes last overwrites `control/__init__.py`; what an installer notes of the other stays."""
    both = tmp_path / "both"
    shutil.copytree(site, both)
    foreign(both, "control", "control")
    if last == "ours":
        shutil.copytree(site / "control", both / "control", dirs_exist_ok=True)
    (both / "sim" / "__init__.py").write_text("")  # the command answers signals before it looks at what is installed
    shutil.copytree(ROOT / "sim" / "cli", both / "sim" / "cli", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "sim" / "signals.py", both / "sim")
    ended = python(COMMAND, both)
    assert ended.returncode == 2
    assert len(ended.stderr.splitlines()) == 1
    assert "the distribution control has a package `control` too" in ended.stderr
    assert python(CAUGHT, both).stderr.startswith("2 the distribution control has a package `control` too")


def test_the_name_of_a_folder_without_modules_harms_nobody(tmp_path: Path) -> None:
    """A user's folder `models` beside his script is found after the twin's package."""
    (tmp_path / "models").mkdir()
    ended = python("from nacs_twin.own_packages import what_is_foreign; print(what_is_foreign())", tmp_path, ROOT)
    assert ended.stdout.strip() == "None"
