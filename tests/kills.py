"""Kill commands of the twin, their workers and their cluster at random moments, go on as they say, and see whether anything was lost.

    python -m tests.kills --n 30 --seed 7

The moment is drawn evenly over the work of the command, from the start of the interpreter to the last file, in the processor time that it
and its workers have spent. After each kill the command
that the printed line names is called (after SIGKILL, which leaves no time for words, what docs/campaigns.md says), and what is there then
must be equal to the bit to what an undisturbed command leaves. The same seed draws the same kinds and moments. Needs /proc.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from sim.text.progress import PREFIX
from tests.fuzz_process import call
from tests.kill_cases import (
    CAMPAIGN,
    COMMANDS,
    DASK_THERE,
    Cluster,
    Kind,
    Work,
    answers,
    drawn,
    end_marked,
    marked,
    products,
    start,
    workers,
)

PATIENCE_S = 400.0  # that a command may take to end
POLL_S = 0.01
GRACE_S = 15.0  # in which its workers must have noticed that it is gone
ANEW, REPLACED = "the same command begins anew", "the same command with --overwrite"


class Verdict(NamedTuple):
    """What a kill did."""

    kind: Kind
    share: float
    met: str  # how far the command was: early (before the twin's first line), late (it was over), or in time
    code: int
    said: str
    lost: int  # trials that were finished and had to be flown again
    complaints: list[str]

    def __str__(self) -> str:
        told = f"{self.kind} at {100 * self.share:3.0f} % ({self.met}): exit {self.code}, {self.said[:150] or '-'}"
        return told + "".join(f"\n    {complaint}" for complaint in self.complaints)


class Series:
    """Kills of a seed, in a folder."""

    def __init__(self, seed: int, folder: Path) -> None:
        self._rng, self._folder = random.Random(seed), folder
        self._mark = f"{os.getpid()}-{seed}"
        self._cluster = Cluster(folder, f"{self._mark}-cluster")
        self._work_s: dict[str, float] = {}
        self._undisturbed: dict[str, tuple[int, dict[str, object]]] = {}
        self.verdicts: list[Verdict] = []

    def run(self, count: int, kinds: tuple[str, ...] = ()) -> None:
        """So many kills; only of some commands, if they are named."""
        self.run_these([(kind, share) for kind, share in drawn(count, self._rng) if not kinds or kind.command in kinds])

    def run_these(self, cases: list[tuple[Kind, float]]) -> None:
        """Kills of these kinds, after these shares of the work; whatever happens, no process is left."""
        try:
            for kind, share in cases:
                self.verdicts.append(self._kill(kind, share, self._folder / f"case-{len(self.verdicts)}"))
                print(f"{len(self.verdicts):3}  {self.verdicts[-1]}", flush=True)
        finally:
            self._cluster.stop()
            end_marked(self._mark)

    def _arguments(self, command: str) -> tuple[str, ...]:
        if command == DASK_THERE:
            self._cluster.start()
        return tuple(self._cluster.address if part == "ADDRESS" else part for part in COMMANDS[command])

    def _prepare(self, folder: Path) -> Path:
        """A folder with what commands read."""
        folder.mkdir()
        (folder / "campaign.toml").write_text(CAMPAIGN)
        log = self._folder / "log.parquet"
        if not log.exists():
            short = ("--trials", 2, "--record-trials", 2, "--set", "run.ticks=60", "--without", "report", "--without", "recording")
            assert call(("run", "nacs/fault-free", *short, "--also", "log", "--out", "made"), folder, PATIENCE_S).code == 0
            shutil.move(folder / "made" / "log.parquet", log)
        shutil.copy(log, folder)
        return folder

    def _whole(self, command: str) -> tuple[int, dict[str, object]]:
        """Exit code and products of the undisturbed command, once timed as a process of its own."""
        family = COMMANDS[command][0] if command != "run in processes" else command
        if command not in self._work_s:
            folder = self._prepare(self._folder / f"whole-{len(self._work_s)}")
            arguments, work = self._arguments(command), self._work(command)
            running = start(("-m", "sim.cli.main", *arguments), folder, self._mark, folder / "said")
            while (code := running.poll()) is None:
                self._work_s[command] = work.done()
                time.sleep(POLL_S)
            found = code, products(folder / "it")
            assert found == self._undisturbed.setdefault(family, found), f"{command} differs from another engine's"
        return self._undisturbed[family]

    def _work(self, command: str) -> Work:
        """That of a command which is about to start; of a running cluster that of its workers."""
        return Work(self._cluster.mark if command == DASK_THERE else self._mark)

    def _kill(self, kind: Kind, share: float, folder: Path) -> Verdict:
        code_when_done, wanted = self._whole(kind.command)
        self._prepare(folder)
        arguments = self._arguments(kind.command)
        code, met = self._disturb(kind, share, arguments, folder)
        said = (folder / "said").read_text(errors="replace").splitlines()
        lines = [line for line in said if not line.startswith(("warning: ", PREFIX))]
        complaints = _complaints(kind, code, met, lines, code_when_done)
        complaints += self._leftovers()
        sealed = {path.name: path.stat().st_mtime_ns for path in folder.glob("it/shards/*.seal")}
        if code != code_when_done:
            again = _way_on(arguments, lines[-1] if lines else "", folder)
            if kind.command == DASK_THERE:
                self._cluster.start()
            options = ("--workers", "1") if again[0] == "campaign" and kind.command != DASK_THERE else ()
            ended = call((*again, *options), folder, PATIENCE_S)
            if ended.code != code_when_done:
                complaints.append(f"going on by `{shlex.join(again)}` ends with {ended.code}: {ended.err.strip()[-300:]}")
        found = products(folder / "it")
        complaints += [f"{name} is not as undisturbed" for name in sorted({*wanted, *found}) if wanted.get(name) != found.get(name)]
        now = {path.name: path.stat().st_mtime_ns for path in folder.glob("it/shards/*.seal")}
        lost = 2 * sum(now.get(name) != stamp for name, stamp in sealed.items())
        return Verdict(kind, share, met, code, " ".join(lines), lost, complaints + ([f"{lost} finished trials lost"] if lost else []))

    def _disturb(self, kind: Kind, share: float, arguments: tuple[str, ...], folder: Path) -> tuple[int, str]:
        """Run and kill; exit code, and how far the command was."""
        work = self._work(kind.command)
        running = start(("-m", "sim.cli.main", *arguments), folder, self._mark, folder / "said")
        while running.poll() is None and work.done() < share * self._work_s[kind.command]:
            time.sleep(POLL_S)
        mark = self._cluster.mark if kind.command == DASK_THERE else self._mark
        if kind.victim == "worker":
            while running.poll() is None and not workers(mark):
                time.sleep(POLL_S)
            victim = self._rng.choice(sorted(workers(mark)) or [0])
        else:
            victim = self._cluster.scheduler if kind.victim == "scheduler" else running.pid
        met = "late"
        if running.poll() is None and victim:
            met = "early" if kind.victim == "main" and not answers(running.pid) else "in time"
            with suppress(ProcessLookupError):
                os.kill(victim, kind.by)
        try:
            return running.wait(PATIENCE_S), met
        except subprocess.TimeoutExpired:
            running.kill()
            running.wait()
            return 124, met

    def _leftovers(self) -> list[str]:
        """Processes that outlive the command; they are ended."""
        end = time.monotonic() + GRACE_S
        while marked(self._mark) and time.monotonic() < end:
            time.sleep(0.1)
        lines = [Path(f"/proc/{process}/cmdline").read_text().replace("\0", " ")[:100] for process in marked(self._mark)]
        end_marked(self._mark)
        return [f"left over: {line}" for line in lines]


def _complaints(kind: Kind, code: int, met: str, lines: list[str], done: int) -> list[str]:
    """What is wrong with how a command ended that was disturbed."""
    polite = kind.victim == "main" and kind.by != signal.SIGKILL
    allowed = {done}
    if kind.victim == "main":
        allowed.add(130 if polite and met != "early" else -kind.by)
    elif kind.victim == "scheduler":
        allowed.add(3)
    found = [] if code in allowed else [f"exit code {code}"]
    if met == "early":  # nothing of the twin's was there to answer
        return found
    if any("Traceback" in line for line in lines):
        found.append("traceback")
    if len(lines) != (code in {3, 130}):
        found.append(f"{len(lines)} lines: {' / '.join(lines)[:300]}")
    if code in {3, 130} and not re.search(rf"(go on|sum them up) with: nacs|{ANEW}|{REPLACED}", " ".join(lines)):
        found.append("no line says how to go on")
    return found


def _way_on(arguments: tuple[str, ...], line: str, folder: Path) -> tuple[str, ...]:
    """The command that goes on, as the line says; after SIGKILL, as the docs do."""
    if command := re.search(r"(?:go on|sum them up) with: nacs (.*)", line):
        return tuple(shlex.split(command[1]))
    if ANEW in line or not (folder / "it").exists():
        return arguments
    return (*arguments, "--resume" if arguments[0] == "campaign" else "--overwrite")


def kills(seed: int, count: int, kinds: tuple[str, ...] = ()) -> list[Verdict]:
    """A series."""
    with tempfile.TemporaryDirectory(prefix="nacs-kills-") as folder:
        series = Series(seed, Path(folder))
        series.run(count, kinds)
    return series.verdicts


def main() -> None:
    """Run a series and report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=int, default=30, help="how many kills")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", action="append", choices=list(COMMANDS), default=[], help="kills of this command alone, of those drawn")
    chosen = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(130))  # its own processes are ended even so
    verdicts = kills(chosen.seed, chosen.n, tuple(chosen.only))
    by_kind: dict[str, list[Verdict]] = defaultdict(list)
    for verdict in verdicts:
        by_kind[str(verdict.kind)].append(verdict)
    print(f"\n{'kind':52} kills  in time  lost trials  complaints")
    for kind, found in [*sorted(by_kind.items()), ("all", verdicts)]:
        in_time, lost, complaints = (
            sum(of(v) for v in found) for of in (lambda v: v.met == "in time", lambda v: v.lost, lambda v: len(v.complaints))
        )
        print(f"{kind:52} {len(found):5} {in_time:8} {lost:12} {complaints:11}")
    sys.exit(any(verdict.complaints for verdict in verdicts))


if __name__ == "__main__":
    main()
