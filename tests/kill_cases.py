"""What is killed, when, and which commands of the twin are at it."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
MARK = "NACS_KILLED_BY"  # in the environment of all processes that a series starts, with its own number
LOOK_AGAIN_S = 0.3  # for processes that are new
COMES_AND_GOES = {"wall_s", "peak_memory_mib"}
CAMPAIGN = """title = "short"
scenario = "nacs/fault-free"
seed = 11
trials = 12
shard = 2
[override]
run.ticks = 60
[dispersion]
"plant.inertia_kg_m2.1" = { uniform = [0.0150, 0.0196] }
"""
ALONE = "campaign in one process"
PROCESSES = "campaign in processes"
DASK_HERE = "campaign on a dask of its own"
DASK_THERE = "campaign on a running dask"
COMMANDS = {
    ALONE: ("campaign", "campaign.toml", "--workers", "1", "--out", "it"),
    PROCESSES: ("campaign", "campaign.toml", "--workers", "2", "--out", "it"),
    DASK_HERE: ("campaign", "campaign.toml", "--workers", "2", "--engine", "dask", "--out", "it"),
    DASK_THERE: ("campaign", "campaign.toml", "--engine", "dask", "--scheduler", "ADDRESS", "--out", "it"),
    "run": ("run", "nacs/fault-free", "--trials", "66", "--set", "run.ticks=20", "--out", "it"),
    "run in processes": ("run", "nacs/fault-free", "--trials", "8", "--set", "run.ticks=30", "--workers", "2", "--out", "it"),
    "replay": ("replay", "log.parquet", "--out", "it"),
    "crosscheck": ("crosscheck", "nacs/fault-free", "--set", "run.ticks=30", "--trials", "2", "--at", "1", "--out", "it"),
}


class Kind(NamedTuple):
    """Who is killed by what while which command runs."""

    command: str
    victim: str  # main, worker or scheduler
    by: signal.Signals

    def __str__(self) -> str:
        return f"{self.command}: {self.victim}, {self.by.name}"


KILL, TERM, HUP, INT = signal.SIGKILL, signal.SIGTERM, signal.SIGHUP, signal.SIGINT
KINDS = (
    *(Kind(ALONE, "main", by) for by in (KILL, KILL, KILL, TERM, HUP, INT)),
    *(Kind(PROCESSES, "main", by) for by in (KILL, TERM, INT)),
    *(Kind(PROCESSES, "worker", by) for by in (KILL, KILL, KILL, TERM)),
    *(Kind(DASK_HERE, victim, by) for victim, by in (("main", KILL), ("main", INT), ("main", TERM), ("worker", KILL))),
    *(Kind(DASK_THERE, victim, by) for victim, by in (("worker", KILL), ("worker", KILL), ("scheduler", KILL), ("scheduler", KILL))),
    *(Kind("run", "main", by) for by in (KILL, TERM, INT)),
    *(Kind("run in processes", victim, by) for victim, by in (("main", INT), ("worker", KILL))),
    *(Kind("replay", "main", by) for by in (KILL, INT)),
    *(Kind("crosscheck", "main", by) for by in (KILL, HUP)),
)  # thirty


def drawn(count: int, rng: random.Random) -> Iterator[tuple[Kind, float]]:
    """Kinds, all before one comes again, and which share of the command's life has passed."""
    left = list[Kind]()
    for _ in range(count):
        left = left or rng.sample(KINDS, len(KINDS))
        yield left.pop(), rng.random()


def start(arguments: tuple[str, ...], folder: Path, mark: str, said: Path) -> subprocess.Popen[bytes]:
    """A process of the series; what it says on stderr goes to a file."""
    environment = os.environ | {MARK: mark, "PYTHONPATH": str(ROOT)}
    environment.pop("NACS_TRACEBACK", None)
    with said.open("wb") as err:
        return subprocess.Popen(
            [sys.executable, *arguments],
            cwd=folder,
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=err,
            start_new_session=True,
            preexec_fn=_hear,  # noqa: PLW1509  # nothing has threads here
        )


def _hear() -> None:
    """Heed all signals, also if the series runs in the background or under `nohup`: what is ignored is inherited."""
    for number in (INT, HUP, TERM):
        signal.signal(number, signal.SIG_DFL)


def marked(mark: str) -> list[int]:
    """Processes that carry a mark and are no zombies."""
    found = []
    for place in Path("/proc").iterdir():
        try:
            if place.name.isdigit() and f"{MARK}={mark}\0".encode() in (place / "environ").read_bytes():  # empty of a zombie
                found.append(int(place.name))
        except OSError:  # it has ended meanwhile, or is another user's
            continue
    return found


def workers(mark: str) -> list[int]:
    """Those of them that compute: what multiprocessing spawned for the twin or for a nanny of dask."""
    found = []
    for process in marked(mark):
        try:
            line = Path(f"/proc/{process}/cmdline").read_bytes()
        except OSError:
            continue
        if b"spawn_main" in line:
            found.append(process)
    return found


class Work:
    """Seconds of processor time that all processes with a mark have spent: what a command has done, however busy the machine is."""

    def __init__(self, mark: str) -> None:
        self._mark, self._known, self._looked = mark, list[int](), 0.0
        self._before, self._most = self._sum(), 0.0

    def done(self) -> float:
        """Since the beginning; the time of those that have ended is not forgotten as long as less is spent after them."""
        self._most = max(self._most, self._sum() - self._before)
        return self._most

    def _sum(self) -> float:
        if time.monotonic() - self._looked > LOOK_AGAIN_S:
            self._known, self._looked = marked(self._mark), time.monotonic()
        return sum(map(_spent, self._known))


def _spent(process: int) -> float:
    try:
        figures = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return sum(map(int, figures[11:13])) / os.sysconf("SC_CLK_TCK")


def answers(process: int) -> bool:
    """Whether a process has got so far that it has a word to say about SIGTERM: before, it is the interpreter that starts."""
    try:
        status = Path(f"/proc/{process}/status").read_text()
    except OSError:
        return False
    caught = next((line.split()[1] for line in status.splitlines() if line.startswith("SigCgt")), "0")
    return bool(int(caught, 16) >> (signal.SIGTERM - 1) & 1)


def products(folder: Path) -> dict[str, object]:
    """What a command left in a folder, but the time that it took; of a recording, which holds the time of day, that it is there."""
    found: dict[str, object] = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.suffix == ".json":
            content = json.loads(path.read_bytes())
            found[name] = {key: value for key, value in content.items() if key not in COMES_AND_GOES}
        elif path.is_file():
            found[name] = b"" if path.suffix == ".rrd" else path.read_bytes()
    return found


class Cluster:
    """A scheduler of dask and two workers, at one address as often as they are started."""

    def __init__(self, folder: Path, mark: str) -> None:
        self._folder, self.mark, self._running = folder, mark, list[subprocess.Popen[bytes]]()
        self.address = ""

    def start(self) -> None:
        """Start what does not run; with a new scheduler all is new."""
        if self._running and all(one.poll() is None for one in self._running):
            return
        self.stop()
        file, port = self._folder / "scheduler.json", self.address.rpartition(":")[2] or "0"
        file.unlink(missing_ok=True)
        here = ("--host", "127.0.0.1", "--no-dashboard")
        options = ("--scheduler-file", str(file))
        self._run("scheduler", *here, "--port", port, *options)
        end = time.monotonic() + 60
        while not (file.exists() and file.read_text().strip().endswith("}")) and time.monotonic() < end:
            time.sleep(0.1)
        self.address = json.loads(file.read_text())["address"]
        self._run("worker", *here, "--nworkers", "2", "--nthreads", "1", *options)
        while len(workers(self.mark)) < 2 and time.monotonic() < end:
            time.sleep(0.1)

    def _run(self, *arguments: str) -> None:
        self._running.append(start(("-m", "dask", *arguments), self._folder, self.mark, self._folder / f"{arguments[0]}.err"))

    @property
    def scheduler(self) -> int:
        """Number of its process."""
        return self._running[0].pid

    def stop(self) -> None:
        """End all processes."""
        for one in self._running[::-1]:
            one.terminate()
        for one in self._running:
            try:
                one.wait(15)
            except subprocess.TimeoutExpired:
                one.kill()
                one.wait()
        self._running = []
        end_marked(self.mark)


def end_marked(mark: str) -> int:
    """End what is left of the processes with a mark; how many they were."""
    left = marked(mark)
    for process in left:
        try:
            os.kill(process, signal.SIGKILL)
        except ProcessLookupError:
            continue
    return len(left)
