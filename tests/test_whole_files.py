"""What is written is written whole, what was whole before is whole after, and a command that is asked to end ends in order."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pyarrow.parquet as pq
import pytest
from test_lost_trials import AT, VICTIM, break_a_filter

import sim.cli.commands.run
import sim.replay.replay
from sim.signals import Signals
from sim.whole_file import NotWritten, remove_abandoned, whole_file, write_whole

RUN = ("run", "nacs/fault-free", "--trials", 2, "--set", "run.ticks=20", "--out", "it")
LEAN = ("--without", "report", "--without", "recording", "--without", "signals")


def full(_: int) -> None:
    raise OSError(28, "No space left on device")


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def test_a_file_takes_its_place_at_the_end_and_not_before(tmp_path: Path) -> None:
    path = tmp_path / "new" / "a.txt"
    with whole_file(path) as temporary:
        assert (temporary.parent, temporary.suffix) == (path.parent, ".txt")
        temporary.write_text("one")
        assert not path.exists()
    assert contents(path.parent) == {"a.txt": b"one"}


@pytest.mark.parametrize("broken", [OSError(28, "No space left on device"), KeyboardInterrupt(), ValueError("no")], ids=repr)
def test_what_breaks_off_leaves_what_was_there(tmp_path: Path, broken: BaseException) -> None:
    path = tmp_path / "a.txt"
    write_whole(path, b"old")

    def write() -> None:
        with whole_file(path) as temporary:
            temporary.write_text("half")
            raise broken

    with pytest.raises(NotWritten if isinstance(broken, OSError) else type(broken)):
        write()
    assert contents(tmp_path) == {"a.txt": b"old"}


def test_what_a_killed_process_left_is_removed_and_what_a_live_one_writes_is_not(tmp_path: Path) -> None:
    script = "import os, sys, pathlib, signal\nfrom sim.whole_file import whole_file\n"
    script += "with whole_file(pathlib.Path(sys.argv[1])) as path: path.write_text('half'); os.kill(os.getpid(), signal.SIGKILL)"
    subprocess.run([sys.executable, "-c", script, str(tmp_path / "a.txt")], check=False)
    assert len(contents(tmp_path)) == 1
    with whole_file(tmp_path / "b.txt") as mine:
        mine.write_text("mine")
        remove_abandoned(tmp_path)
        assert set(contents(tmp_path)) == {mine.name}
    assert contents(tmp_path) == {"b.txt": b"mine"}


def test_why_a_file_is_not_written_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "folder").mkdir()
    write_whole(tmp_path / "file", b"")
    with pytest.raises(NotWritten, match=r"folder cannot be written: Is a directory$"):
        write_whole(tmp_path / "folder", b"")
    with pytest.raises(NotWritten, match=r"file/x cannot be written: (File exists|Not a directory)$"):
        write_whole(tmp_path / "file" / "x", b"")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(NotWritten, match=r"file cannot be written: No space left on device$"):
        write_whole(tmp_path / "file", b"new")
    assert contents(tmp_path) == {"file": b""}


def test_a_full_disk_leaves_an_older_run_as_it_was(nacs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert nacs(*RUN, *LEAN).code == 0
    before = contents(tmp_path / "it")
    monkeypatch.setattr(os, "fsync", full)
    result = nacs(*RUN, *LEAN, "--overwrite", "--seed", 5)
    assert (result.code, result.err.count("\n")) == (3, 1), result.err
    assert "summary.json cannot be written: No space left on device" in result.err
    assert contents(tmp_path / "it") == before


def test_a_folder_in_the_place_of_one_file_costs_no_other(nacs, tmp_path: Path) -> None:
    (tmp_path / "it" / "report.png").mkdir(parents=True)
    result = nacs(*RUN, "--overwrite", "--also", "log")
    assert (result.code, result.err.count("\n")) == (3, 1), result.err
    assert "report.png cannot be written: Is a directory" in result.err
    assert set(contents(tmp_path / "it")) == {"summary.json", "trials.parquet", "recording.rrd", "log.parquet", "signals.parquet"}
    assert "report.png" not in result.out


def test_a_new_run_takes_away_what_an_older_one_left_and_it_did_not_write(nacs, tmp_path: Path) -> None:
    assert nacs(*RUN, *LEAN, "--also", "log").code == 0
    (tmp_path / "it" / "notes.txt").write_text("mine")
    assert nacs(*RUN, *LEAN, "--overwrite").code == 0
    assert set(contents(tmp_path / "it")) == {"summary.json", "trials.parquet", "notes.txt"}


@pytest.mark.parametrize(
    ("scenario", "options"),
    [
        ("nacs/fault-free", ("--at", "1")),
        ("formation/fault-free", ("--at", "0.1", "--trials", 1, "--set", "phases={}")),
    ],
)
def test_a_cross_check_on_a_full_disk_is_one_line(nacs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, scenario, options) -> None:
    monkeypatch.setattr(os, "fsync", full)
    result = nacs("crosscheck", scenario, "--set", "run.ticks=20", "--out", "it", *options)
    assert (result.code, result.err.count("\n")) == (3, 1), result.err
    assert "No space left on device" in result.err
    assert not contents(tmp_path / "it")


# replay -----------------------------------------------------------------------------------------------------------------------


@pytest.fixture
def log(nacs, tmp_path: Path) -> Path:
    assert nacs(*RUN, "--trials", 3, "--record-trials", 3, *LEAN, "--also", "log").code == 0
    return tmp_path / "it" / "log.parquet"


def test_a_replay_keeps_the_trials_in_which_no_filter_broke_down(nacs, log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = nacs("replay", log, "--filter", "ekf", "--out", "whole")
    assert whole.code == 0, whole.err
    build_estimators = sim.replay.replay.build_estimators

    def breaking(*told: Any) -> Any:
        estimators = build_estimators(*told)
        break_a_filter(SimpleNamespace(estimators=estimators), monkeypatch)
        return estimators

    monkeypatch.setattr(sim.replay.replay, "build_estimators", breaking)
    result = nacs("replay", log, "--filter", "ekf", "--out", "broken")
    assert (result.code, result.err.count("\n")) == (3, 1), result.err
    assert f"trial {VICTIM} failed at t = {0.1 * AT:.3f} s" in result.err
    expected, found = (_by_trial(tmp_path / name) for name in ("whole", "broken"))
    assert {trial: len(rows) for trial, rows in found.items()} == {0: 20, VICTIM: AT, 2: 20}
    assert all(repr(found[trial]) == repr(expected[trial][: len(found[trial])]) for trial in range(3))  # NaN is as NaN here
    assert json.loads((tmp_path / "broken" / "summary.json").read_text())["trials"] == 2
    assert (tmp_path / "broken" / "replay.png").is_file()


def _by_trial(folder: Path) -> dict[int, list[dict[str, Any]]]:
    rows = pq.read_table(folder / "estimates.parquet").to_pylist()
    return {trial: [row for row in rows if row["trial"] == trial] for trial in range(3)}


def test_an_interrupted_replay_writes_nothing_half(nacs, log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("sim.replay.replay.run", interrupted)
    result = nacs("replay", log, "--out", "replayed")
    assert (result.code, result.err.count("\n")) == (130, 1), result.err
    assert "nothing was written" in result.err
    assert not (tmp_path / "replayed").exists()
    monkeypatch.undo()


def test_a_replay_on_a_full_disk_is_one_line(nacs, log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "fsync", full)
    result = nacs("replay", log, "--filter", "ekf", "--out", "replayed")
    assert (result.code, result.err.count("\n")) == (3, 1), result.err
    assert "estimates.parquet cannot be written: No space left on device, nor 2 more" in result.err
    assert not contents(tmp_path / "replayed")


# several agents ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("scenario", "fault", "options"),
    [
        ("formation/disturbance", "{kind='disturbance', start_s=0.1, end_s=0.2, size_nm=1e300}", ("--set", "phases={}")),
        ("consensus/disturbance", "{kind='disturbance', start_s=0.1, amplitude_n=1e300, rate_rad_s=2.0}", ()),
    ],
)
@pytest.mark.filterwarnings("ignore:overflow:RuntimeWarning", "ignore:invalid:RuntimeWarning")
def test_a_flight_of_agents_that_breaks_down_keeps_its_recording(nacs, tmp_path: Path, scenario: str, fault: str, options) -> None:
    result = nacs("run", scenario, "--trials", 1, "--set", "run.ticks=30", "--set", f"faults=[{fault}]", *options, "--out", "it")
    assert result.code == 3, result.err
    assert "trial 0 failed at t = 0.1" in result.err
    assert "what was recorded until then is in it" in result.err
    assert set(contents(tmp_path / "it")) >= {"recording.rrd", "report.png", "summary.json"}


# signals ----------------------------------------------------------------------------------------------------------------------


ASKING = ("SIGINT", "SIGTERM", "SIGHUP")


@pytest.fixture
def signals() -> Iterator[Signals]:
    """Signals of this process, that are heard; whatever the tests are run under is put back."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    for number in before:
        signal.signal(number, signal.default_int_handler)
    listening = Signals()
    listening.listen()
    yield listening
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("name", ASKING)
def test_a_signal_interrupts_once_and_from_the_third_on(name: str, signals: Signals) -> None:
    number = getattr(signal, name)
    with pytest.raises(KeyboardInterrupt):
        os.kill(os.getpid(), number)
    os.kill(os.getpid(), number)
    with pytest.raises(KeyboardInterrupt):
        os.kill(os.getpid(), number)
    signals.ignore()
    os.kill(os.getpid(), number)  # it is ending


def test_a_signal_waits_for_the_end_of_what_must_not_be_lost(signals: Signals) -> None:
    done = []

    def work() -> None:
        with signals.held():
            os.kill(os.getpid(), signal.SIGTERM)
            done.append("kept")
        done.append("after")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert done == ["kept"]


def test_a_signal_interrupts_the_long_part_of_it(signals: Signals) -> None:
    done = []

    def work() -> None:
        with signals.heeded():
            os.kill(os.getpid(), signal.SIGTERM)
            done.append("not")

    with signals.held():
        with pytest.raises(KeyboardInterrupt):
            work()
        done.append("kept")
    assert done == ["kept"]


def test_what_the_caller_ignores_stays_ignored(signals: Signals) -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    signals.listen()
    os.kill(os.getpid(), signal.SIGHUP)
    assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN


def _hear_everything() -> None:
    """As a process that a terminal starts: what the tests' own parent told them to ignore is inherited otherwise."""
    for name in (signal.SIGHUP, signal.SIGINT, signal.SIGTERM):
        signal.signal(name, signal.SIG_DFL if name != signal.SIGINT else signal.default_int_handler)


@pytest.mark.parametrize("name", ASKING)
@pytest.mark.parametrize("module", ["numpy", "typer"])
def test_a_signal_while_modules_are_imported_is_one_line(name: str, module: str, tmp_path: Path) -> None:
    """A module that asks its own process to end, and swallows whatever is raised in answer."""
    asks = f"import os, signal, time\ntry:\n    os.kill(os.getpid(), signal.{name})\n    time.sleep(5)\nexcept BaseException:\n    pass\n"
    (tmp_path / f"{module}.py").write_text(asks)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    command = [sys.executable, "-m", "sim.cli.main", "run", "nacs/fault-free", "--out", "it"]
    ended = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False, preexec_fn=_hear_everything)
    assert (ended.returncode, ended.stderr) == (130, "interrupted: nothing was begun; the same command begins anew\n")
    assert not (tmp_path / "it").exists()


def test_a_signal_after_the_command_is_done_changes_nothing(tmp_path: Path) -> None:
    script = "import atexit, os, signal, sys\nfrom sim.cli.main import main\nassert 'numpy' not in sys.modules\n"
    script += "atexit.register(os.kill, os.getpid(), signal.SIGTERM)\nsys.argv = ['nacs', '--version']\nmain()"
    ended = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert ended.stdout.startswith("nacs ")


def test_trials_that_are_finished_are_written_before_a_signal_is_heeded(
    nacs, signals: Signals, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sim.cli.commands.run.SIGNALS", signals)
    joined = sim.cli.commands.run.join

    def asked(blocks: Any) -> Any:
        os.kill(os.getpid(), signal.SIGTERM)
        return joined(blocks)

    monkeypatch.setattr("sim.cli.commands.run.join", asked)
    result = nacs(*RUN)
    assert (result.code, result.err.count("\n")) == (130, 1), result.err
    assert "what was written until then is whole, in it; the same command with --overwrite writes all" in result.err
    assert set(contents(tmp_path / "it")) == {"summary.json", "trials.parquet"}
    assert json.loads((tmp_path / "it" / "summary.json").read_text())["trials"] == 2


def test_an_interruption_where_nothing_is_to_be_kept_is_one_line(nacs, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("sim.cli.commands.run.load", interrupted)
    result = nacs(*RUN)
    assert (result.code, result.err) == (130, "interrupted: nothing was begun; the same command begins anew\n")


def test_what_a_killed_run_left_half_written_is_gone_after_the_next(nacs, tmp_path: Path) -> None:
    (tmp_path / "it").mkdir()
    for name in (f".report-{os.getpid()}-01234567.part.png", ".summary-999999999-01234567.part.json"):  # once of our own number
        (tmp_path / "it" / name).write_text("half")
    assert nacs(*RUN, *LEAN, "--overwrite").code == 0
    assert set(contents(tmp_path / "it")) == {"summary.json", "trials.parquet"}
