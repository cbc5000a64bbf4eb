"""Every example and notebook runs as it stands; notebooks are kept without output."""

from __future__ import annotations

import json
import re
import runpy
from pathlib import Path

import matplotlib as mpl
import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"
SCRIPTS = sorted(EXAMPLES.glob("*.py"))
NOTEBOOKS = sorted(EXAMPLES.glob("notebooks/*.ipynb"))
SAID = {  # of each script, in its output
    "01_first_flight": "greatest rate: 0.",
    "02_change_something": "10 um off the pivot: wheels reach",
    "03_own_filter": "luenberger",
    "04_own_law": "mine            tracking error 0.",
    "05_step_by_hand": "rad/s over 64 testbeds",
    "06_consistency": "ekf: NEES ",
    "07_fault_of_your_own": "declared at",
    "08_formation": "'agent': 6",
    "09_campaign": "count    8.0",
    "10_cross_check": "Cross-check of eq9-10",
    "11_replay_a_log": "mekf",
    "12_bad_input": "run.tiks: unknown key; did you mean ticks?",
}


@pytest.fixture(autouse=True)
def _elsewhere(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pytest.importorskip("xarray")
    pytest.importorskip("pandas")
    monkeypatch.chdir(tmp_path)
    mpl.use("agg")


@pytest.mark.parametrize("script", SCRIPTS, ids=[script.stem for script in SCRIPTS])
def test_a_script_says_what_it_should(script: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runpy.run_path(str(script), run_name="__main__")
    assert SAID[script.stem] in capsys.readouterr().out


def test_every_script_is_known() -> None:
    assert [script.stem for script in SCRIPTS] == sorted(SAID)


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=[notebook.stem for notebook in NOTEBOOKS])
def test_a_notebook_runs_and_is_kept_without_output(notebook: Path) -> None:
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    place: dict[str, object] = {"__name__": "__main__"}
    for cell in cells:
        if cell["cell_type"] == "code":
            assert cell["outputs"] == []
            assert cell["execution_count"] is None
            exec("".join(cell["source"]), place)  # as a notebook does


def test_the_page_runs(capsys: pytest.CaptureFixture[str]) -> None:
    text = (EXAMPLES.parent / "docs" / "python.md").read_text(encoding="utf-8")
    for block in re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL):
        exec(compile(block, "docs/python.md", "exec"), {"__name__": "__main__"})
    assert "Estimators:" in capsys.readouterr().out
