"""Fill the disk under the twin's commands, at many sizes of it, and see whether anything is told or kept by halves.

    python -m tests.full_disk --sizes 20 --seed 7

Each case has a file system of its own (a tmpfs, for which one must be root), with what an earlier run left there in every other one, and
so many bytes more: sizes from nothing to just enough, evenly in their logarithms. A command on it ends well or says in one line what it
could not write; each file is then the whole old one or the whole new one, and nothing else is there. A campaign goes on, once there is
room, as its line says. The same seed gives the same cases.
"""

from __future__ import annotations

import argparse
import random
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from tests.fuzz_process import Ended, call
from tests.kill_cases import CAMPAIGN, products

PAGE = 4096
ROOMY = 256 * 2**20
SHORT = ("--set", "run.ticks=30")
COMMANDS = {
    "run": ("run", "nacs/fault-free", *SHORT, "--trials", "3", "--also", "log"),
    "campaign": ("campaign", "campaign.toml", "--workers", "1"),
    "replay": ("replay", "log.parquet"),
    "crosscheck": ("crosscheck", "nacs/fault-free", *SHORT, "--trials", "2", "--at", "1"),
}
OTHERWISE = {"run": ("--seed", "5"), "replay": ("--tuning", "paper"), "crosscheck": ("--seed", "5")}  # the earlier run's


class NoMount(RuntimeError):
    """File systems cannot be mounted here; the message is one line."""


class Disk:
    """A mounted file system of a size that can change."""

    def __init__(self, place: Path) -> None:
        self.place = place

    def resize(self, size: int) -> None:
        """Make it so many bytes large."""
        subprocess.run(["mount", "-o", f"remount,size={max(size, PAGE)}", str(self.place)], check=True, capture_output=True)

    @property
    def used(self) -> int:
        """Bytes that are in use."""
        return shutil.disk_usage(self.place).used


@contextmanager
def disk(place: Path) -> Iterator[Disk]:
    """A roomy file system, unmounted afterwards whatever happens; raises NoMount."""
    place.mkdir(exist_ok=True)
    try:
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={ROOMY}", "tmpfs", str(place)], check=True, capture_output=True, text=True)
    except (OSError, subprocess.CalledProcessError) as refused:
        reason = getattr(refused, "stderr", "") or str(refused)
        raise NoMount(f"no file system can be mounted here: {' '.join(reason.split())}") from None
    try:
        yield Disk(place)
    finally:
        subprocess.run(["umount", str(place)], check=True, capture_output=True)


class Case(NamedTuple):
    """A command that met the end of its disk.

    Attributes:
      command: its name.
      room: bytes that it had.
      earlier: whether something was there before.
      ended: how.
      complaints: what is wrong with it.
    """

    command: str
    room: int
    earlier: bool
    ended: Ended
    complaints: list[str]

    def __str__(self) -> str:
        before = "over an earlier one" if self.earlier else "in an empty place"
        said = f"{self.command:10} {self.room / 1024:8.0f} KiB {before}: exit {self.ended.code}, {self.ended.err.strip()[:200] or '-'}"
        return said + "".join(f"\n    {complaint}" for complaint in self.complaints)


class Filling:
    """All that is needed to fill disks, in a folder."""

    def __init__(self, seed: int, folder: Path) -> None:
        self._rng, self._folder, self._place = random.Random(seed), folder / "work", folder / "disk"
        self._out = self._place / "it"
        self._folder.mkdir()
        (self._folder / "campaign.toml").write_text(CAMPAIGN.replace("trials = 16", "trials = 6").replace("ticks = 100", "ticks = 20"))
        self._call(*COMMANDS["run"], "--record-trials", "3", "--out", "made")
        shutil.move(self._folder / "made" / "log.parquet", self._folder)

    def _call(self, *arguments: str) -> Ended:
        return call(arguments, self._folder, 120.0)

    def cases(self, command: str, sizes: int) -> Iterator[Case]:
        """The cases of a command; raises NoMount."""
        whole, earlier, needed = self._undisturbed(command)
        for number in range(sizes):
            share = (number - self._rng.random()) / (sizes - 1 or 1)
            room = int(PAGE * (1.2 * needed / PAGE) ** share) if number else 0
            with disk(self._place) as place:
                yield self._case(command, room, earlier if number % 2 else None, place, whole)

    def _undisturbed(self, command: str) -> tuple[Path, Path, int]:
        """Folders of what it leaves and of what was there earlier, and the bytes that it takes."""
        whole, earlier = (self._folder / f"{command}-{name}" for name in ("whole", "earlier"))
        with disk(self._place) as place:
            before = place.used
            assert self._call(*COMMANDS[command], "--out", str(self._out)).code == 0
            needed = place.used - before
            shutil.copytree(self._out, whole)
        if command == "campaign":  # one that was interrupted
            shutil.copytree(whole, earlier, ignore=lambda _, names: [name for name in names if re.search(r"0000000[24]|^[rst].*\.", name)])
        else:
            assert self._call(*COMMANDS[command], *OTHERWISE[command], "--out", str(earlier)).code == 0
        return whole, earlier, needed

    def _case(self, command: str, room: int, earlier: Path | None, place: Disk, whole: Path) -> Case:
        arguments = (*COMMANDS[command], "--out", str(self._out))
        if earlier is not None:
            shutil.copytree(earlier, self._out)
            arguments = (*arguments, "--resume" if command == "campaign" else "--overwrite")
        before = _contents(self._out)
        place.resize(place.used + room)
        ended = self._call(*arguments)
        complaints = _complaints(ended)
        after, old, new = products(self._out), products(earlier) if earlier else {}, products(whole)
        for name, content in after.items():
            if content not in (new.get(name), old.get(name)):
                complaints.append(f"{name} is neither the old nor the new one")
            if name.endswith(".rrd") and _contents(self._out)[name] != before.get(name) and not _is_recording(self._out / name):
                complaints.append(f"{name} is not whole")
        complaints += [f"{name} is gone" for name in before if name not in after]
        if ended.code == 0 and after != new:
            complaints.append("what was said to be done is not all there")
        if ended.code == 3 and command == "campaign":
            place.resize(ROOMY)
            complaints += self._goes_on(ended, arguments, new)
        return Case(command, room, earlier is not None, ended, complaints)

    def _goes_on(self, ended: Ended, arguments: tuple[str, ...], new: dict[str, object]) -> list[str]:
        """What is wrong with a campaign that goes on with more room."""
        again = re.search(r"(?:go on|sum them up) with: nacs (.*)", ended.err)
        following = self._call(*(shlex.split(again[1]) if again else arguments), "--workers", "1")
        if following.code:
            return [f"it does not go on: {following.err.strip()[:200]}"]
        return [] if products(self._out) == new else ["going on leaves something else"]


def _contents(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def _is_recording(path: Path) -> bool:
    """Whether Rerun can read a recording to its end."""
    verified = subprocess.run([sys.executable, "-m", "rerun", "rrd", "verify", str(path)], capture_output=True, check=False)
    return verified.returncode == 0


def _complaints(ended: Ended) -> list[str]:
    lines = [line for line in ended.err.splitlines() if not line.startswith("warning: ")]
    if ended.code == 0:
        return ["lines of a command that went well"] if lines else []
    if ended.code != 3:
        return [f"exit code {ended.code}: {ended.err.strip()[-300:]}"]
    found = [] if len(lines) == 1 else [f"{len(lines)} lines"]
    return found if "No space left on device" in ended.err else [*found, "it does not say why"]


def fill(seed: int, sizes: int, commands: tuple[str, ...] = tuple(COMMANDS)) -> Iterator[Case]:
    """All cases of a seed; raises NoMount."""
    with tempfile.TemporaryDirectory(prefix="nacs-full-") as folder:
        filling = Filling(seed, Path(folder))
        for command in commands:
            yield from filling.cases(command, sizes)


def main() -> None:
    """Fill disks and report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", type=int, default=20, help="of the disk, for each command")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", action="append", choices=list(COMMANDS), help="this command alone (may be repeated)")
    chosen = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(130))  # the disk is unmounted even so
    cases = list[Case]()
    try:
        for case in fill(chosen.seed, chosen.sizes, tuple(chosen.only or COMMANDS)):
            cases.append(case)
            print(case, flush=True)
    except NoMount as refused:
        print(refused)
        sys.exit(2)
    print(f"\n{'command':10} sizes  went well  ended with 3  complaints")
    for command in dict.fromkeys(case.command for case in cases):
        own = [case for case in cases if case.command == command]
        codes = [case.ended.code for case in own]
        print(f"{command:10} {len(own):5} {codes.count(0):10} {codes.count(3):13} {sum(len(case.complaints) for case in own):11}")
    sys.exit(any(case.complaints for case in cases))


if __name__ == "__main__":
    main()
