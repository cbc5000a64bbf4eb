"""What others find around the code: how to cite it, that it is typed, and hooks that need nothing from elsewhere."""

from __future__ import annotations

import re
import tomllib
from fnmatch import fnmatchcase
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.house import FLOORS

ROOT = Path(__file__).resolve().parents[1]
TOML = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT = TOML["project"]
PACKAGES = [floor for floor in FLOORS if (ROOT / floor).is_dir()]


@pytest.fixture(scope="module")
def citation() -> dict[str, Any]:
    return yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))


def test_the_citation_names_the_distribution_its_version_and_its_licence(citation):
    assert citation["title"] == PROJECT["name"]
    assert citation["version"] == PROJECT["version"] == version("nacs-twin")
    assert citation["license"] == PROJECT["license"]
    assert citation["cff-version"] == "1.2.0"
    assert citation["message"]
    assert citation["authors"]


def test_the_citation_names_the_papers_whose_systems_the_twin_contains(citation):
    families = [reference["authors"][0]["family-names"] for reference in citation["references"]]
    assert families == ["McCafferty-Leroux", "Hill", "Tsao", "Rososhansky"]
    assert all(reference["type"] and reference["title"] for reference in citation["references"])
    errata = " ".join((ROOT / "docs" / "errata.md").read_text(encoding="utf-8").split()).lower()
    assert all(reference["title"].lower() in errata for reference in citation["references"][:3])


@pytest.fixture(scope="module")
def built() -> dict[str, set[str]]:
    """Files besides modules that a build takes along, by package: the tables of pyproject.toml, read as setuptools reads them."""
    table = TOML["tool"]["setuptools"]
    folders = {path.parent for floor in PACKAGES for path in (ROOT / floor).rglob("__init__.py")}
    names = {folder.relative_to(ROOT).as_posix().replace("/", "."): folder for folder in folders}
    taken = {name: folder for name, folder in names.items() if any(fnmatchcase(name, one) for one in table["packages"]["find"]["include"])}
    data = {name: [found for one in table["package-data"].get(name, ()) for found in folder.glob(one)] for name, folder in taken.items()}
    return {name: {path.relative_to(ROOT).as_posix() for path in found} for name, found in data.items()}


def test_type_checkers_are_told_that_every_package_is_typed(built):
    assert [package for package in PACKAGES if f"{package}/py.typed" not in built[package]] == []


def test_models_and_scenarios_are_installed_too(built):
    files = set().union(*built.values())
    wanted = {
        path.relative_to(ROOT).as_posix() for pattern in ("*.xml", "*.toml") for floor in PACKAGES for path in (ROOT / floor).rglob(pattern)
    }
    assert wanted
    assert wanted <= files


def test_every_folder_with_modules_is_installed(built):
    folders = {path.parent.relative_to(ROOT).as_posix().replace("/", ".") for floor in PACKAGES for path in (ROOT / floor).rglob("*.py")}
    assert folders == set(built)


def test_hooks_run_from_the_environment():
    hooks = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))
    assert [repository["repo"] for repository in hooks["repos"]] == ["local"]
    assert [hook["id"] for hook in hooks["repos"][0]["hooks"]] == ["ruff", "ruff-format", "mypy"]
    assert {hook["language"] for hook in hooks["repos"][0]["hooks"]} == {"system"}


def test_the_changelog_begins_with_what_is_not_released():
    headings = re.findall(r"^#+ (.+)$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert headings[:2] == ["Changelog", "Unreleased"]
    assert {"Added", "Changed", "Fixed"} <= set(headings)
