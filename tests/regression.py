"""Whether a refactoring moved a bit: `python -m tests.regression PARENT [HEAD]` flies every scenario shortly in both trees and compares.

PARENT and HEAD are revisions or folders with a checkout; HEAD is the working tree of this file if it is not given. Exit code 0: every bit
of every channel, metric and occurrence is the same. 1: something differs or could not be flown. 2: the arguments make no sense.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import re
import subprocess
import sys
import tarfile
import tempfile
from concurrent.futures import ThreadPoolExecutor
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, NoReturn

from tests.regression_comparison import SIDES, BadArguments, Rename, Side, Tally, compare
from tests.regression_probe import scenario_files

ROOT = Path(__file__).resolve().parents[1]
PROBE = Path("tests", "regression_probe.py")
ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "BLIS", "NUMEXPR", "VECLIB_MAXIMUM")}

# ticks at most of what takes long: three particle filters of six agents and a loop at a tenth of the tick; 200 end their first window
FEWER_TICKS = {"consensus/*": 200}


class ProbeFailed(RuntimeError):
    """A tree could not be flown at all; one line."""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise BadArguments(message)


def parsed(arguments: list[str]) -> argparse.Namespace:
    """The command line; raises BadArguments."""
    parser = _Parser(prog="python -m tests.regression", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("parent", metavar="PARENT", help="revision or folder")
    parser.add_argument("head", metavar="HEAD", nargs="?", default=str(ROOT), help="revision or folder; default: this working tree")
    parser.add_argument("--only", metavar="GLOB", default="*", help="scenarios by family/name")
    parser.add_argument("--ticks", type=_positive, default=300, help="control ticks of a flight, at most (default: 300)")
    parser.add_argument("--jobs", type=_positive, default=1, help="processes at a time (default: 1)")
    parser.add_argument(
        "--rename", metavar="OLD=NEW", type=_rename, action="append", default=[], help="regex and replacement for the parent's names"
    )
    return parser.parse_args(arguments)


def _positive(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text} is not a whole number of 1 or more")
    return int(text)


def _rename(text: str) -> Rename:
    old, equals, new = text.partition("=")
    if not equals or not old:
        raise argparse.ArgumentTypeError(f"{text!r} needs the form OLD=NEW")
    try:
        pattern = re.compile(old)
        pattern.sub(new, "")  # complains of groups that OLD does not have
    except (re.error, IndexError) as broken:
        raise argparse.ArgumentTypeError(f"{text!r} is no regular expression with its replacement: {broken}") from None
    return Rename(pattern, new)


def unpacked(said: str, folder: Path) -> Path:
    """The tree that an argument names: a folder as it is, a revision unpacked into `folder`; raises BadArguments."""
    tree = Path(said).resolve()
    if not tree.is_dir():
        git = ["git", "-C", str(ROOT)]
        known = subprocess.run([*git, "rev-parse", "--quiet", "--verify", f"{said}^{{commit}}"], capture_output=True, check=False)
        if known.returncode or said.startswith("-"):
            raise BadArguments(f"{said} is neither a folder nor a revision of {ROOT}")
        archive = subprocess.run([*git, "archive", "--format=tar", f"{said}^{{commit}}"], capture_output=True, check=True).stdout
        with tarfile.open(fileobj=io.BytesIO(archive)) as packed:
            packed.extractall(folder, filter="data")
        tree = folder
    if not scenario_files(tree):
        raise BadArguments(f"{said} has no scenarios below sim/")
    return tree


def fly(probe: Path, tree: Path, side: str, ticks: dict[str, int], folder: Path) -> dict[str, Any]:
    """Fly scenarios of a tree in a process of its own and give back what its probe put down; raises ProbeFailed."""
    folder.mkdir()
    environment = os.environ | ONE_THREAD | {"PYTHONPATH": str(tree), "PYTHONHASHSEED": "0"}
    command = [sys.executable, "-P", str(probe), str(tree), str(folder), side, json.dumps(ticks)]
    done = subprocess.run(command, cwd=tree, env=environment, stdout=sys.stderr, stderr=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        raise ProbeFailed(f"{side}: the probe ended with {done.returncode}: {(done.stderr.strip().splitlines() or ['nothing said'])[-1]}")
    flown: dict[str, Any] = json.loads((folder / "flown.json").read_text(encoding="utf-8"))
    return flown


def fly_both(trees: tuple[Path, Path], asked: argparse.Namespace, folder: Path) -> tuple[Side, Side]:
    """Both trees' flights of all scenarios that are asked for, each tree's in as many processes as there are jobs."""
    probe = next(path for path in (trees[1] / PROBE, ROOT / PROBE) if path.is_file())
    sides, waiting = (Side({}, {}), Side({}, {})), []
    pool = ThreadPoolExecutor(asked.jobs)
    try:
        for side, tree in enumerate(trees):
            ticks = {name: _ticks(name, asked.ticks) for name in scenario_files(tree) if fnmatchcase(name, asked.only)}
            for share in range(asked.jobs):
                if part := dict(list(ticks.items())[share :: asked.jobs]):
                    place = folder / f"{SIDES[side]}-flown-{share}"
                    waiting.append((side, place, pool.submit(fly, probe, tree, SIDES[side], part, place)))
        for side, place, found in waiting:
            sides[side].flown.update(found.result())
            sides[side].folders.update(dict.fromkeys(found.result(), place))
    finally:
        pool.shutdown(cancel_futures=True)
    if not any(side.flown for side in sides):
        raise BadArguments(f"--only {asked.only}: no scenario has such a name")
    return sides


def _ticks(name: str, most: int) -> int:
    return min([most, *(fewer for pattern, fewer in FEWER_TICKS.items() if fnmatchcase(name, pattern))])


def main(arguments: list[str]) -> int:
    """Compare, report, and give the exit code."""
    try:
        asked = parsed(arguments)
        with tempfile.TemporaryDirectory(prefix="regression-") as name:
            folder, tally = Path(name), Tally()
            trees = [unpacked(said, folder / side) for said, side in zip((asked.parent, asked.head), SIDES, strict=True)]
            for line in compare(fly_both((trees[0], trees[1]), asked, folder), asked.rename, tally):
                print(line, flush=True)
    except BadArguments as wrong:
        print(f"error: {wrong}", file=sys.stderr)
        return 2
    except ProbeFailed as failed:
        print(f"error: {failed}", file=sys.stderr)
        return 1
    for line in tally.errors:
        print(f"not flown: {line}")
    print(f"compared: {tally.files} files, {tally.loops} loops, {', '.join(f'{n} {kind}' for kind, n in tally.compared.items())}")
    print(f"{len(tally.errors)} could not be flown, {f'{tally.differences} differ' if tally.differences else 'no bit differs'}")
    return 1 if tally.differences or tally.errors else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
