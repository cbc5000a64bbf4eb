"""The register of outputs: what a run leaves, what it says of it, and an output that nobody knew."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

MADE_UP = Path(__file__).parent / "made_up" / "outputs"
QUICK = ("run", "nacs/fault-free", "--trials", 2, "--set", "run.ticks=20", "--out", "it")
SCRIPT = """
import sys
import sim.outputs

sim.outputs.__path__.append({folder!r})  # as if its file lay there
from sim.cli import main

sys.argv = ["nacs", *{arguments!r}]
main.main()
"""


@pytest.mark.parametrize(("options", "more"), [((), set()), (("--export-log",), {"log.parquet"}), (("--also", "log"), {"log.parquet"})])
def test_a_run_leaves_what_is_unasked_and_what_was_asked_for(nacs, tmp_path: Path, options, more) -> None:
    result = nacs(*QUICK, *options)
    assert result.code == 0, result.err
    files = {path.name for path in (tmp_path / "it").iterdir()}
    assert files == {"summary.json", "trials.parquet", "report.png", "recording.rrd", "signals.parquet"} | more
    for name in files - {"summary.json", "trials.parquet"}:
        assert f"it/{name}" in result.out
    assert ("nacs replay it/log.parquet" in result.out) == bool(more)


def test_a_run_leaves_out_what_is_not_wanted(nacs, tmp_path: Path) -> None:
    result = nacs(*QUICK, "--without", "report", "--without", "recording", "--without", "signals")
    assert result.code == 0, result.err
    assert {path.name for path in (tmp_path / "it").iterdir()} == {"summary.json", "trials.parquet"}
    assert "report.png" not in result.out


@pytest.mark.parametrize("option", ["--also", "--without"])
def test_an_output_that_does_not_exist_is_one_line(nacs, tmp_path: Path, option: str) -> None:
    result = nacs(*QUICK, option, "movie")
    assert (result.code, result.err.count("\n")) == (2, 1)
    assert f"{option} movie: there is no such output; there are detection, learners, log, recording, report, signals, weights" in result.err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("output", ["learners", "weights"])
def test_an_output_of_agents_is_not_to_be_had_of_one_body(nacs, tmp_path: Path, output: str) -> None:
    result = nacs(*QUICK, "--also", output)
    assert (result.code, result.err) == (2, f"error: --also {output}: is of agents in the plane, and this scenario is of one body\n")
    assert not list(tmp_path.iterdir())


def test_an_output_needs_a_recorded_trial(nacs) -> None:
    result = nacs(*QUICK, "--also", "log", "--record-trials", 0)
    assert result.code == 2
    assert "--also log writes the recorded trials and --record-trials 0 records none" in result.err


def test_an_output_of_one_file_is_offered_written_and_replaced(tmp_path: Path) -> None:
    def run(*more: str) -> str:
        arguments = [*map(str, QUICK), "--also", "attitude", "--record-trials", "2", *more]
        (tmp_path / "nacs.py").write_text(SCRIPT.format(folder=str(MADE_UP), arguments=arguments))
        done = subprocess.run([sys.executable, "nacs.py"], cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout

    shown = run()
    assert "Attitude   it/attitude.csv" in shown
    assert "Plot it    python plot.py it/attitude.csv" in shown
    table = np.loadtxt(tmp_path / "it" / "attitude.csv", delimiter=",", skiprows=1)
    assert table.shape == (40, 6)
    np.testing.assert_allclose(np.linalg.norm(table[:, 2:], axis=1), 1.0)
    run("--overwrite", "--set", "run.ticks=10")
    assert len(np.loadtxt(tmp_path / "it" / "attitude.csv", delimiter=",", skiprows=1)) == 20


def test_an_output_is_wanted_or_not(nacs, tmp_path: Path) -> None:
    for options in (("--also", "report", "--without", "report"), ("--export-log", "--without", "log")):
        result = nacs(*QUICK, *options)
        name = options[-1]
        assert (result.code, result.err.count("\n")) == (2, 1), result.err
        assert f"--also {name} and --without {name}: " in result.err
        assert not (tmp_path / "it").exists()
