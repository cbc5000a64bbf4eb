"""The command in a forked process of its own, limited in time and memory: imports are made once, and nothing it does can harm the next."""

from __future__ import annotations

import importlib
import io
import os
import pkgutil
import resource
import select
import signal
import sys
import time
import warnings
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from sim.cli import command, main, terminal
from sim.text.progress import PREFIX

HUNG = 124  # exit code of what was ended for taking too long
EXITS = (0, 1, 2, 3, 130)  # 1: a cross-check that fails
MEBI = 2**20
LOOK_AGAIN_S = 0.2
IDLE_S = 0.2  # of processor time, below which nothing was done


for room in ("outputs", "replay", "report", "rerun"):  # the command imports these when it needs them: once here, not in every child
    package = importlib.import_module(f"sim.{room}")
    for _, name, _ in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
        importlib.import_module(name)


class Ended(NamedTuple):
    """What became of a call."""

    code: int  # below zero: ended by that signal
    out: str
    err: str
    seconds: float
    written: tuple[str, ...]  # files that were not there before, or are not as they were


def call(arguments: Iterable[object], folder: Path, seconds: float = 30.0, mebibytes: int = 4000) -> Ended:
    """Call the command in `folder` as a terminal would; `out` and `err` lie beside the folder meanwhile."""
    before, started = _contents(folder), time.monotonic()
    paths = [folder.with_name(f"{folder.name}.{name}") for name in ("out", "err")]
    sys.stdout.flush()
    sys.stderr.flush()
    child = os.fork()
    if child == 0:
        _become([str(argument) for argument in arguments], folder, paths, seconds, mebibytes)
    code = _wait(child, seconds)
    out, err = (path.read_text(encoding="utf-8", errors="replace") for path in paths)
    for path in paths:
        path.unlink()
    after = _contents(folder)
    written = tuple(sorted(name for name in after if before.get(name) != after[name]))
    return Ended(code, out, err, time.monotonic() - started, written)


def complaints(ended: Ended) -> list[str]:
    """What a command must never do, whatever it is given; nothing if all is well."""
    lines = [line for line in ended.err.splitlines() if line.strip()]
    errors = [line for line in lines if not line.startswith(("warning: ", PREFIX))]
    steps = {line.partition(", about ")[0] for line in lines if line.startswith(PREFIX)}
    found = []
    if ended.code == HUNG and "take at least" not in ended.err and len(steps) < 2:  # who is told how long it takes can wait or not
        found.append("hangs")
    elif ended.code not in (*EXITS, HUNG):
        found.append(f"exit code {ended.code}")
    if "Traceback (most recent call last)" in ended.err:
        found.append("traceback")
    if "defect of the twin" in ended.err:
        found.append("unexpected: " + errors[-1].rpartition("(")[2][:60])
    if ended.code in (2, 3) and len(errors) != 1:
        found.append(f"{len(errors)} lines of error")
    if ended.code == 0 and errors:
        found.append("lines on stderr of a run that went well")
    if ended.code == 2 and ended.written:
        found.append("files written although the input is bad")
    return found


def _wait(child: int, seconds: float) -> int:
    """Exit code of the child, which is ended when it and its workers have computed that long, or done nothing for that long.

    So it does not matter how busy the machine is.
    """
    watched, spent, idle_since = os.pidfd_open(child), 0.0, time.monotonic()
    try:
        while not select.select([watched], [], [], LOOK_AGAIN_S)[0]:
            if (now := _computed(child)) > spent + IDLE_S:
                spent, idle_since = now, time.monotonic()
            if now > seconds or time.monotonic() - idle_since > seconds:
                os.killpg(child, signal.SIGKILL)
                os.waitpid(child, 0)
                return HUNG
        status = os.waitpid(child, 0)[1]
    finally:
        os.close(watched)
    return os.waitstatus_to_exitcode(status)


def _computed(session: int) -> float:
    """Seconds of processor time of all processes of a session."""
    ticks = 0
    for place in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            figures = place.read_text().rpartition(")")[2].split()
            if int(figures[3]) == session:
                ticks += sum(int(one) for one in figures[11:15])  # own and of children that ended
    return ticks / os.sysconf("SC_CLK_TCK")


def _become(arguments: list[str], folder: Path, paths: list[Path], seconds: float, mebibytes: int) -> None:
    """Be the command; does not return."""
    code = 70
    try:
        os.setsid()
        for number, path in enumerate(paths, 1):
            os.dup2(os.open(path, os.O_CREAT | os.O_TRUNC | os.O_WRONLY), number)
        sys.stdout, sys.stderr = (io.TextIOWrapper(io.FileIO(n, "w", closefd=False), encoding="utf-8", write_through=True) for n in (1, 2))
        held = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (held + mebibytes * MEBI,) * 2)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        warnings.resetwarnings()
        os.environ.pop(command.SHOW_TRACEBACK, None)
        os.chdir(folder)
        for console in (terminal.out, terminal.err):
            console.file = None  # whatever is sys.stdout and sys.stderr now
            console.width = 200
        sys.argv = ["nacs", *arguments]
        try:
            main.main()
        except SystemExit as stop:
            code = stop.code if isinstance(stop.code, int) else int(stop.code is not None)
    except BaseException:
        sys.excepthook(*sys.exc_info())
        code = 1
    finally:
        os._exit(code)


def _contents(folder: Path) -> dict[str, tuple[int, int]]:
    """Size and time of change of all files below a folder, by name."""
    found = {}
    for path in folder.rglob("*"):
        status = path.lstat()
        found[path.relative_to(folder).as_posix()] = (status.st_size, 0 if path.is_dir() else status.st_mtime_ns)
    return found
