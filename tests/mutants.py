"""How strong are the tests? Wrong changes of the source, drawn by a seed, and whether a test fails of each.

    python -m tests.mutants --n 150 --seed 7
    python -m tests.mutants --n 40 --seed 7 --only models,control
    python -m tests.mutants --n 150 --seed 7 --list               # what would be drawn; nothing is run

The kinds of change (tests/mutation_kinds.py) take turns. No file is changed: a mutant lives in the memory of a forked process alone. Each
test file is run once under coverage (tests/mutants_process.py; kept in FOLDER until the source or that file changes), which says what lines
a test executes and how long it takes. A mutant is then given to the tests that execute its line, the cheap and narrow first and one case of
each function before the next, until one fails or the sum of their times is at the budget; then to those whose fixtures execute it. A line
that is executed on import is covered by the tests that execute a line that names what it defines, and its mutant is imported afresh.

So what survives would at most be killed by tests that take longer, or that see it in another process only: the rate is a lower bound. A
mutant is also killed when the tests need far more time than they should. Results are appended to FOLDER/mutants-SEED.jsonl; a run that is
interrupted goes on from there. What survives is either the same program, which one argues, or wants a test: of the kind, not of that
mutant. Needs `coverage` (pip install '.[test]').
"""

from __future__ import annotations

import argparse
import hashlib
import json
import random
import re
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from tests.house import ROOT
from tests.mutants_process import SCOPE, Verdict, ask, ask_afresh, preload, run_under_coverage
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
LEFT_OUT = ("test_architecture", "test_regression", "test_packaging")  # they read the source as text, or its history
CUT = 1.5  # how many times as long as it was given a test is taken to last that was cut
TOGETHER = 8  # test files that are run in one process under coverage
QUICK_S = 1.0  # below that, tests of a file are asked together, so that its fixtures are made once


def part_of(place: str) -> str | None:
    """The part that a file belongs to; None: it is not changed."""
    return None if place in PICTURES else next((part for part, globs in PARTS.items() if any(fnmatchcase(place, g) for g in globs)), None)


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


def sources(parts: Iterable[str]) -> dict[str, str]:
    """The files of some parts, by place."""
    paths = (path for top in SCOPE for path in sorted((ROOT / top).rglob("*.py")))
    return {place: path.read_text() for path in paths if part_of(place := path.relative_to(ROOT).as_posix()) in parts}


class Test(NamedTuple):
    """What is known of a test from its run under coverage; without a function's name of a file's fixtures and imports."""

    name: str
    seconds: float
    lines: dict[str, list[int]]

    @property
    def file(self) -> str:
        return self.name.partition("::")[0]


def known_tests(folder: Path, longest: float, without: Iterable[str]) -> list[Test]:
    """Every test that passes, or is cut at `longest` seconds; files are run of which that is not known yet."""
    state = hashlib.sha256(b"".join(path.read_bytes() for top in SCOPE for path in sorted((ROOT / top).rglob("*.py"))))
    reports = {}
    for path in sorted((ROOT / "tests").glob("test_*.py")):
        if path.stem not in {*LEFT_OUT, *without}:
            known = hashlib.sha256(state.digest() + path.read_bytes() + str(longest).encode()).hexdigest()[:16]
            reports[path.relative_to(ROOT).as_posix()] = folder / "coverage" / f"{path.stem}-{known}.json"
    unknown = [place for place, report in reports.items() if not report.is_file()]
    for first in range(0, len(unknown), TOGETHER):
        some = unknown[first : first + TOGETHER]
        begun = time.perf_counter()
        run_under_coverage({place: reports[place] for place in some}, longest)
        print(f"{', '.join(some)}: {time.perf_counter() - begun:.0f} s", file=sys.stderr, flush=True)
    found = []
    for place, report in reports.items():
        for name, one in json.loads(report.read_text()).items():
            if one["outcome"] in {"failed", "skipped"}:
                print(f"{name} {one['outcome']}: it is not asked", file=sys.stderr)
                continue
            seconds = CUT * longest if one["outcome"] == "cut" else one["seconds"]
            found.append(Test(name or f"{place}::", seconds, one["lines"]))
    return found


class Selection:
    """Which tests to ask of a mutant."""

    def __init__(self, tests: list[Test], sources: dict[str, str]) -> None:
        self._sources, self.tests = sources, tests
        self._of_line: dict[tuple[str, int], set[int]] = defaultdict(set)
        self._made_in: dict[tuple[str, int], set[str]] = defaultdict(set)  # test files whose fixtures and imports execute a line
        self._of_file: dict[str, set[int]] = defaultdict(set)
        for i, test in enumerate(tests):
            is_test = not test.name.endswith("::")
            if is_test:
                self._of_file[test.file].add(i)
            for at in ((place, line) for place, numbers in test.lines.items() for line in numbers):
                if is_test:
                    self._of_line[at].add(i)
                else:
                    self._made_in[at].add(test.file)

    @cached_property
    def _words(self) -> dict[str, set[tuple[str, int]]]:
        """Lines in which a name stands."""
        found: dict[str, set[tuple[str, int]]] = defaultdict(set)
        for place, source in self._sources.items():
            for line, text in enumerate(source.splitlines(), start=1):
                for word in re.findall(r"[A-Za-z_]\w*", text):
                    found[word].add((place, line))
        return found

    def asked(self, mutant: Mutant, budget: float) -> list[Test]:
        """The tests that execute its line, and then the others of files whose fixtures do, as far as the budget goes."""
        own = self._executing(mutant)
        files = set() if mutant.names and own else {file for line in self._lines(mutant) for file in self._made_in.get(line, ())}
        beside = {i for file in files for i in self._of_file[file]}
        return self._within(budget, [*self._ordered(own), *self._ordered(beside - own)])

    def _lines(self, mutant: Mutant) -> list[tuple[str, int]]:
        at = [(mutant.place, line) for line in range(mutant.lines[0], mutant.lines[1] + 1)]
        return at + [line for name in mutant.names for line in self._words.get(name, ())]

    def _executing(self, mutant: Mutant) -> set[int]:
        return {i for line in self._lines(mutant) for i in self._of_line.get(line, ())}

    def _ordered(self, which: Iterable[int]) -> list[Test]:
        """Cheap ones that look at little first: seconds times files that are executed; the n-th case of a function counts n-fold."""
        cases: Counter[str] = Counter()
        ranked = []
        for test in sorted((self.tests[i] for i in which), key=lambda test: (test.seconds, test.name)):
            function = test.name.partition("[")[0]
            cases[function] += 1
            ranked.append((cases[function] * (test.seconds + 0.01) * len(test.lines), test.name, test))
        return [test for *_, test in sorted(ranked, key=lambda one: one[:2])]

    def _within(self, budget: float, tests: Iterable[Test]) -> list[Test]:
        found: list[Test] = []
        for test in tests:
            if found and test.seconds > budget:
                break
            budget -= test.seconds
            found.append(test)
        rank = {file: number for number, file in enumerate(dict.fromkeys(test.file for test in found))}
        return sorted(found, key=lambda test: (test.seconds > QUICK_S, rank[test.file]))


def judged(chosen: list[Mutant], selection: Selection, budget: float) -> Iterator[tuple[Mutant, list[Test], Verdict]]:
    """What becomes of mutants, and the tests that were asked; those that live in functions first."""
    asked = {mutant: selection.asked(mutant, budget) for mutant in chosen}
    names = {mutant: [test.name for test in tests] for mutant, tests in asked.items()}
    seconds = {mutant: sum(test.seconds for test in tests) for mutant, tests in asked.items()}
    inside = [mutant for mutant in chosen if asked[mutant] and not mutant.names]
    afresh = [mutant for mutant in chosen if asked[mutant] and mutant.names]
    for mutant, verdict in zip(inside, ask([(mutant, names[mutant], seconds[mutant]) for mutant in inside]), strict=True):
        if verdict.fate == "undecided":
            afresh.append(mutant)
        else:
            yield mutant, asked[mutant], verdict
    for mutant in afresh:
        yield mutant, asked[mutant], ask_afresh(mutant, names[mutant], seconds[mutant])
    yield from ((mutant, [], Verdict("survived", "no test executes it")) for mutant in chosen if not asked[mutant])


def report(results: list[dict[str, Any]]) -> str:
    """The table of parts and kinds, and all that survived."""
    lines = []
    for heading in ("part", "kind"):
        lines.append(f"{heading:20} {'drawn':>6} {'killed':>7} {'survived':>9} {'rate':>7}")
        fates: dict[str, Counter[str]] = defaultdict(Counter)
        for one in results:
            fates[one[heading]][one["fate"]] += 1
        for name, count in (*fates.items(), ("all", sum(fates.values(), Counter()))):
            killed, total = count["killed"], count.total()
            lines.append(f"{name:20} {total:6} {killed:7} {total - killed:9} {killed / total:7.1%}")
        lines.append("")
    for one in results:
        if one["fate"] != "killed":
            lines += [one["mutant"], f"  {one['fate']}; {len(one['tests'])} tests: {', '.join(one['tests'])}"]
    return "\n".join(lines)


def _parsed(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--n", type=int, default=150, help="mutants to draw (default: 150)")
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--only", default=",".join(PARTS), help="parts, with commas between (default: all)")
    parser.add_argument("--list", action="store_true", help="say what is drawn, and run nothing")
    parser.add_argument("--folder", type=Path, default=ROOT / "runs" / "mutants", help="of coverage and results (default: runs/mutants)")
    parser.add_argument("--without", default="", help="test files that are not asked, such as test_wmap,test_antenna")
    parser.add_argument("--budget", type=float, default=60.0, help="seconds of tests per mutant (default: 60)")
    parser.add_argument("--longest", type=float, default=20.0, help="seconds after which a test is cut under coverage (default: 20)")
    asked = parser.parse_args(arguments)
    asked.only, asked.folder = asked.only.split(","), asked.folder.resolve()
    if unknown := [part for part in asked.only if part not in PARTS]:
        parser.error(f"--only {','.join(unknown)}: the parts are {', '.join(PARTS)}")
    return asked


def main(arguments: list[str] | None = None) -> None:
    asked = _parsed(arguments)
    chosen = drawn(sources(asked.only), asked.n, asked.seed)
    if asked.list:
        print("\n".join(map(str, chosen)))
        return
    preload()
    selection = Selection(known_tests(asked.folder, asked.longest, asked.without.split(",")), sources(PARTS))
    file = asked.folder / f"mutants-{asked.seed}.jsonl"
    known = {one["mutant"]: one for one in map(json.loads, file.read_text().splitlines())} if file.is_file() else {}
    left = [mutant for mutant in chosen if str(mutant) not in known]
    for number, (mutant, tests, verdict) in enumerate(judged(left, selection, asked.budget), start=1):
        found = {"mutant": str(mutant), "part": part_of(mutant.place), "kind": mutant.kind, **verdict._asdict()}
        found["tests"] = [] if verdict.fate == "killed" else [test.name for test in tests]
        known[str(mutant)] = found
        with file.open("a") as lines:
            lines.write(json.dumps(found) + "\n")
        print(f"{number}/{len(left)} {verdict.fate} {mutant}", file=sys.stderr, flush=True)
    print(report([known[str(mutant)] for mutant in chosen]))


if __name__ == "__main__":
    main()
