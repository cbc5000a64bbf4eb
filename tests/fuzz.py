"""Feed the command what nobody meant, and say what it does that it must never do.

    python -m tests.fuzz --seconds 300 --seed 7

Each case runs in a forked process that is limited in time and memory. A case that fails is made smaller, as long as it fails alike, and
written down with its input. The same seed gives the same cases.
"""

from __future__ import annotations

import argparse
import random
import shutil
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import NamedTuple

from tests.fuzz_mutants import Case, draw
from tests.fuzz_process import Ended, call, complaints

SECONDS_A_CASE = 40.0
CAMPAIGN = """title = "T"
scenario = "nacs/fault-free"
trials = 4
shard = 2
seed = 5
[override]
"run.ticks" = 4
[dispersion]
"sensors.gyro_noise_rad_s" = {uniform = [1e-3, 2e-3]}
"""


class Failure(NamedTuple):
    """A case that fails, as small as it can be."""

    case: Case
    arguments: list[str]
    found: list[str]
    ended: Ended

    def __str__(self) -> str:
        said = self.ended.err.strip().splitlines()
        return f"{', '.join(self.found)}\n  {self.case}\n  nacs {' '.join(self.arguments)[:300]}\n  {said[-1][:300] if said else ''}"


class Fuzzer:
    """Cases of a seed, one after another."""

    def __init__(self, seed: int, folder: Path) -> None:
        self._rng, self._folder = random.Random(seed), folder
        self._sound = _sound(folder)
        self.codes: Counter[tuple[str, int]] = Counter()
        self.failures: list[Failure] = []

    def one(self) -> None:
        """The next case."""
        case = draw(self._rng)
        arguments, ended = self._fly(case)
        self.codes[case.kind, ended.code] += 1
        if found := complaints(ended):
            self.failures.append(self._smallest(Failure(case, arguments, found, ended)))
            print(f"\n{self.failures[-1]}", flush=True)

    def _fly(self, case: Case) -> tuple[list[str], Ended]:
        place = self._folder / "case"
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir()
        arguments = case.build(place, self._sound)
        return arguments, call(arguments, place, SECONDS_A_CASE)

    def _smallest(self, failure: Failure) -> Failure:
        for case in failure.case.smaller():
            if case.edits:
                arguments, ended = self._fly(case)
                if set(failure.found) & set(complaints(ended)):
                    return self._smallest(Failure(case, arguments, complaints(ended), ended))
        return failure


def _sound(folder: Path) -> Path:
    """A log and a campaign's folder that nobody has spoiled."""
    sound = folder / "sound"
    sound.mkdir()
    short = ["--set", "run.ticks=6", "--trials", "1", "--without", "report", "--without", "recording"]
    whole = call(["run", "nacs/fault-free", *short, "--export-log", "--out", "."], sound, 120.0)
    (sound / "campaign.toml").write_text(CAMPAIGN)
    flown = call(["campaign", "campaign.toml", "--out", "campaign", "--workers", "1"], sound, 120.0)
    assert whole.code == flown.code == 0, whole.err + flown.err
    return sound


def fuzz(seed: int, seconds: float, most: int | None = None) -> Fuzzer:
    """Cases of a seed for so many seconds, or so many cases."""
    with tempfile.TemporaryDirectory(prefix="nacs-fuzz-") as folder:
        fuzzer, end = Fuzzer(seed, Path(folder)), time.monotonic() + seconds
        while time.monotonic() < end and (most is None or sum(fuzzer.codes.values()) < most):
            fuzzer.one()
    return fuzzer


def main() -> None:
    """Run for a while and report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cases", type=int, default=None, help="no more than so many")
    chosen = parser.parse_args()
    fuzzer = fuzz(chosen.seed, chosen.seconds, chosen.cases)
    kinds = sorted({kind for kind, _ in fuzzer.codes})
    print(f"\n{sum(fuzzer.codes.values())} cases, {len(fuzzer.failures)} failures; exit codes:")
    for kind in kinds:
        print(f"  {kind:10}", ", ".join(f"{code}: {n}" for (k, code), n in sorted(fuzzer.codes.items()) if k == kind))
    sys.exit(bool(fuzzer.failures))


if __name__ == "__main__":
    main()
