"""How strong are the tests? Wrong changes of the source, drawn by a seed, and whether a test fails of each.

    python -m tests.mutants --n 150 --seed 7
    python -m tests.mutants --n 40 --seed 7 --only models,control
    python -m tests.mutants --n 150 --seed 7 --list               # what would be drawn; nothing is run

The kinds of change (tests/mutation_kinds.py) take turns. Nothing is changed in the working tree: changes are made one at a time in a copy
of it, in FOLDER. There each test file is run once under coverage (kept until the source or the file changes), which says what lines a test
executes and how long that takes. A mutant is then given to the tests that execute its line, cheapest first, one of each function before the
next, until one fails or the sum of their times is at the budget; then to the other tests of files whose fixtures execute it. So what
survives would at most be killed by tests that take longer, or that see the line only in another process: the rate is a lower bound.
A line that is executed on import is covered by the tests that execute a line that names what it defines.

A mutant with which the tests take three times as long as they should, and 30 s, is killed as well. Results are appended to
FOLDER/mutants-SEED.jsonl; a run that is interrupted goes on from there. What survives is either the same program, which one argues, or
wants a test: of the kind, not of that mutant. Needs `coverage` (pip install '.[test]').
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from tests.house import ROOT, repository_files
from tests.mutants_coverage import REPORT, SCOPE, SECONDS
from tests.mutation_kinds import KINDS, Mutant, mutants

PARTS = {
    "models": ("models/*",),
    "estimation": ("estimation/*",),
    "control": ("control/*",),
    "sim": (
        *(f"sim/{room}/*" for room in ("faults", "plant", "sensors", "network", "estimators", "controllers", "loop", "metrics", "replay")),
        *("sim/campaign/summary.py", "sim/campaign/draws.py", "sim/campaign/shard.py", "sim/draws.py", "sim/randomness.py"),
    ),
}
PICTURES = ("models/plants/flexible_picture.py",)  # colours and sizes that are only looked at
# these read the source as text, or its history
LEFT_OUT = ("tests/test_architecture.py", "tests/test_regression.py", "tests/test_packaging.py")
ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL")}
QUIET = ("-x", "-q", "-p", "no:cacheprovider", "-n", "0", "--durations=0", "--tb=line", "--no-header")
GRACE_S = 30.0


def part_of(place: str) -> str | None:
    """The part that a file belongs to; None: it is not changed."""
    if place in PICTURES:
        return None
    return next((part for part, globs in PARTS.items() if any(fnmatchcase(place, glob) for glob in globs)), None)


def drawn(sources: dict[str, str], count: int, seed: int) -> list[Mutant]:
    """So many mutants of some files by place; the kinds take turns."""
    of_kind: dict[str, list[Mutant]] = {kind: [] for kind in KINDS}
    for place, source in sorted(sources.items()):
        for one in mutants(place, source):
            of_kind[one.kind].append(one)
    rng, found = random.Random(seed), []
    for some in of_kind.values():
        rng.shuffle(some)
    while len(found) < count and any(of_kind.values()):
        found += [some.pop() for some in of_kind.values() if some]
    return found[:count]


class Test(NamedTuple):
    """What is known of a test from its run under coverage."""

    name: str
    seconds: float
    lines: dict[str, frozenset[int]]


class Copy:
    """A copy of the working tree in which sources are changed and tests are run."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.tree = folder, folder / "tree"
        for path in repository_files():
            copied = self.tree / path.relative_to(ROOT)
            if not copied.is_file() or copied.read_bytes() != path.read_bytes():
                copied.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(path, copied)
        others = [entry for entry in os.environ.get("PYTHONPATH", "").split(os.pathsep) if entry and Path(entry).resolve() != ROOT]
        self._environment = os.environ | ONE_THREAD | {"PYTHONPATH": os.pathsep.join([str(self.tree), *others])}

    def sources(self, parts: Iterable[str]) -> dict[str, str]:
        """The files of some parts, by place."""
        paths = (path for top in SCOPE for path in sorted((self.tree / top).rglob("*.py")))
        return {place: path.read_text() for path in paths if part_of(place := path.relative_to(self.tree).as_posix()) in parts}

    def pytest(self, arguments: Iterable[str], seconds: float | None = None, **environment: str) -> tuple[int | None, str]:
        """Exit code, None if it took too long, and what was printed."""
        command = [sys.executable, "-m", "pytest", *QUIET, *arguments]
        with subprocess.Popen(
            command, cwd=self.tree, env=self._environment | environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            text=True, errors="replace", start_new_session=True,
        ) as running:  # fmt: skip
            try:
                said = running.communicate(timeout=seconds)[0]
                return running.returncode, said
            except subprocess.TimeoutExpired:
                return None, ""
            finally:
                if running.poll() is None:
                    os.killpg(running.pid, signal.SIGKILL)

    def tests(self, longest: float, without: Iterable[str] = ()) -> list[Test]:
        """Every test that passes, or is cut at `longest` seconds; files are run of which that is not known yet."""
        state = hashlib.sha256(b"".join(path.read_bytes() for top in SCOPE for path in sorted((self.tree / top).rglob("*.py"))))
        found = []
        for path in sorted(self.tree.glob("tests/test_*.py")):
            place = path.relative_to(self.tree).as_posix()
            if place in LEFT_OUT or path.stem in without:
                continue
            known = hashlib.sha256(state.digest() + path.read_bytes() + str(longest).encode()).hexdigest()[:16]
            report = self.folder / "coverage" / f"{path.stem}-{known}.json"
            if not report.is_file():
                report.parent.mkdir(exist_ok=True)
                begun = time.perf_counter()
                self.pytest(["-p", "tests.mutants_coverage", "--maxfail=1000", place], **{REPORT: str(report), SECONDS: str(longest)})
                if not report.is_file():
                    raise SystemExit(f"{place} cannot be run under coverage: pytest -p tests.mutants_coverage {place}")
                print(f"{place}: {time.perf_counter() - begun:.0f} s", file=sys.stderr, flush=True)
            for name, one in json.loads(report.read_text()).items():
                if one["outcome"] in {"failed", "skipped"}:
                    print(f"{name} {one['outcome']}: it is not asked", file=sys.stderr)
                    continue
                lines = {at: frozenset(numbers) for at, numbers in one["lines"].items()}
                found.append(Test(name or f"{place}::", one["seconds"], lines))
        return found


class Selection:
    """Which tests to ask of a mutant."""

    def __init__(self, tests: list[Test], sources: dict[str, str]) -> None:
        self._sources = sources
        self._of_line: dict[tuple[str, int], set[int]] = defaultdict(set)
        self._made_in: dict[tuple[str, int], set[str]] = defaultdict(set)  # test files whose fixtures and imports execute a line
        self._of_file: dict[str, set[int]] = defaultdict(set)
        self.tests = tests
        for i, test in enumerate(tests):
            file, _, function = test.name.partition("::")
            if function:
                self._of_file[file].add(i)
            for place, numbers in test.lines.items():
                for line in numbers:
                    if function:
                        self._of_line[place, line].add(i)
                    else:
                        self._made_in[place, line].add(file)

    @cached_property
    def _words(self) -> dict[str, set[tuple[str, int]]]:
        """Lines in which a name stands."""
        found: dict[str, set[tuple[str, int]]] = defaultdict(set)
        for place, source in self._sources.items():
            for line, text in enumerate(source.splitlines(), start=1):
                for word in re.findall(r"[A-Za-z_]\w*", text):
                    found[word].add((place, line))
        return found

    def of(self, mutant: Mutant, budget: float) -> list[Test]:
        """In the order in which they are asked; the sum of their times is at most the budget, or there is one."""
        at = [(mutant.place, line) for line in range(mutant.lines[0], mutant.lines[1] + 1)]
        if mutant.names:
            at += [line for name in mutant.names for line in self._words.get(name, ())]
        covering = {i for line in at for i in self._of_line.get(line, ())}
        beside = (
            set() if mutant.names and covering else {i for line in at for file in self._made_in.get(line, ()) for i in self._of_file[file]}
        )
        found: list[Test] = []
        for test in (*self._ordered(covering), *self._ordered(beside - covering)):
            budget -= test.seconds
            if budget < 0 and found:
                break
            found.append(test)
        return found

    def _ordered(self, which: Iterable[int]) -> Iterator[Test]:
        """Cheapest first; the n-th case of a function counts n-fold."""
        cases: Counter[str] = Counter()
        ranked = []
        for test in sorted((self.tests[i] for i in which), key=lambda test: (test.seconds, test.name)):
            function = test.name.partition("[")[0]
            cases[function] += 1
            ranked.append((cases[function] * (test.seconds + 0.01), test.name, test))
        return (test for *_, test in sorted(ranked, key=lambda one: one[:2]))


def judged(copy: Copy, mutant: Mutant, asked: list[Test]) -> dict[str, object]:
    """What becomes of a mutant: killed, survived or undecided, by which test, after how many seconds."""
    path, begun = copy.tree / mutant.place, time.perf_counter()
    whole, times = path.read_bytes(), path.stat()
    listing = copy.folder / "asked.txt"
    listing.write_text("\n".join(test.name for test in asked))
    limit = GRACE_S + 3.0 * sum(test.seconds for test in asked)
    path.write_bytes(mutant.applied(whole))
    try:  # without bytecode, so that what lies there stays the sound source's
        code, said = copy.pytest([f"@{listing}"], limit, PYTHONDONTWRITEBYTECODE="1") if asked else (0, "no test executes it")
    finally:
        path.write_bytes(whole)
        os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
    by = next((line for line in said.splitlines() if line.startswith(("FAILED", "ERROR"))), said.strip()[-200:] if code else "")
    fate = {0: "survived", 1: "killed", 2: "killed", None: "killed"}.get(code, "undecided")
    seconds = round(time.perf_counter() - begun, 1)
    return {"fate": fate, "by": "too slow" if code is None else by[:300], "asked": len(asked), "seconds": seconds}


def report(results: list[dict[str, object]]) -> str:
    """The table of parts and kinds, and all that survived."""
    lines = []
    for heading in ("part", "kind"):
        lines.append(f"{heading:20} {'drawn':>6} {'killed':>7} {'survived':>9} {'rate':>7}")
        fates: dict[str, Counter[object]] = defaultdict(Counter)
        for one in results:
            fates[str(one[heading])][one["fate"]] += 1
        for name, count in (*fates.items(), ("all", sum(fates.values(), Counter()))):
            killed, total = count["killed"], count.total()
            lines.append(f"{name:20} {total:6} {killed:7} {total - killed:9} {killed / total:7.1%}")
        lines.append("")
    for one in results:
        if one["fate"] != "killed":
            lines += [f"{one['mutant']}", f"  {one['fate']} {one['asked']} tests: {', '.join(map(str, one['tests']))}"]
    return "\n".join(lines)


def _parsed(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--n", type=int, default=150, help="mutants to draw (default: 150)")
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--only", default=",".join(PARTS), help="parts, with commas between (default: all)")
    parser.add_argument("--list", action="store_true", help="say what is drawn, and run nothing")
    parser.add_argument(
        "--folder", type=Path, default=ROOT / "runs" / "mutants", help="of the copy and the results (default: runs/mutants)"
    )
    parser.add_argument("--without", default="", help="test files that are not asked, such as test_wmap,test_antenna")
    parser.add_argument("--budget", type=float, default=60.0, help="seconds of tests per mutant (default: 60)")
    parser.add_argument("--longest", type=float, default=20.0, help="seconds after which a test is cut under coverage (default: 20)")
    asked = parser.parse_args(arguments)
    asked.only = asked.only.split(",")
    if unknown := [part for part in asked.only if part not in PARTS]:
        parser.error(f"--only {','.join(unknown)}: the parts are {', '.join(PARTS)}")
    return asked


def main(arguments: list[str] | None = None) -> None:
    asked = _parsed(arguments)
    copy = Copy(asked.folder.resolve())
    sources = copy.sources(asked.only)
    chosen = drawn(sources, asked.n, asked.seed)
    if asked.list:
        print("\n".join(map(str, chosen)))
        return
    selection = Selection(copy.tests(asked.longest, asked.without.split(",")), copy.sources(PARTS))
    file = copy.folder / f"mutants-{asked.seed}.jsonl"
    known = {one["mutant"]: one for one in map(json.loads, file.read_text().splitlines())} if file.is_file() else {}
    results = []
    for number, mutant in enumerate(chosen, start=1):
        if (found := known.get(str(mutant))) is None:
            tests = selection.of(mutant, asked.budget)
            found = {"mutant": str(mutant), "part": part_of(mutant.place), "kind": mutant.kind, **judged(copy, mutant, tests)}
            found["tests"] = [test.name for test in tests] if found["fate"] != "killed" else []
            with file.open("a") as lines:
                lines.write(json.dumps(found) + "\n")
            print(f"{number}/{len(chosen)} {found['fate']} in {found['seconds']} s  {mutant}", file=sys.stderr, flush=True)
        results.append(found)
    print(report(results))


if __name__ == "__main__":
    main()
