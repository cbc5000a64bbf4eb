from __future__ import annotations

import os
import sys
from collections.abc import Callable
from typing import Any, NamedTuple

import pytest
from matplotlib.figure import Figure

from sim.cli import command, terminal
from sim.series import raster


class Outcome(NamedTuple):
    code: int
    out: str
    err: str


@pytest.fixture
def nacs(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path) -> Callable[..., Outcome]:
    """The command, run in an empty folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setenv(command.SHOW_TRACEBACK, "1")  # what nobody expected fails a test with all that is known of it

    def call(*arguments: object) -> Outcome:
        for console in (terminal.out, terminal.err):  # they may have been made where COLUMNS was another
            monkeypatch.setattr(console, "width", int(os.environ["COLUMNS"]))
        monkeypatch.setattr(sys, "argv", ["nacs", *map(str, arguments)])
        code = command.command()
        captured = capsys.readouterr()
        return Outcome(code, captured.out, captured.err)

    return call


LONGEST = (
    "test_wmap.py",
    "test_antenna.py",
    "test_scenarios.py",
    "test_feature_matrix.py",
)  # begun first


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Long files first; the order within a file stays."""
    items.sort(key=lambda item: LONGEST.index(item.path.name) if item.path.name in LONGEST else len(LONGEST))


@pytest.fixture
def figures(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Pictures that are written while the test runs."""
    seen: list[Figure] = []
    draw = raster.pixels

    def pixels(figure: Figure) -> Any:
        seen.append(figure)
        return draw(figure)

    monkeypatch.setattr(raster, "pixels", pixels)
    return seen


@pytest.fixture
def nacs_command(nacs: Callable[..., Outcome]) -> Callable[..., Outcome]:
    """The command, where the name `nacs` is the package's."""
    return nacs
