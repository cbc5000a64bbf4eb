"""Processes in which tests are run: under coverage, and on a mutant that lives in their memory alone; see tests/mutants.py.

The process that forks them has imported the libraries, but nothing of the project. Functions of a mutant get another code in a process that
has imported and collected everything, which takes no time; what is executed on import is imported anew. Other processes that tests start
see nothing of a mutant.
"""

from __future__ import annotations

import gc
import json
import os
import resource
import select
import signal
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from importlib import import_module
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import spec_from_file_location
from itertools import zip_longest
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any, NamedTuple

import pytest
from _pytest.runner import runtestprotocol

from tests.house import ROOT
from tests.mutation_kinds import Mutant

SCOPE = ("models", "estimation", "control", "sim")
QUIET = ("-q", "-p", "no:cacheprovider", "-p", "no:xdist", "--durations=0", "--tb=line", "--no-header")
QUIET += ("-W", "ignore::pytest.PytestAssertRewriteWarning")  # hypothesis is there already
LIBRARIES = (
    "numpy",
    "scipy.stats",
    "scipy.signal",
    "scipy.spatial.transform",
    "mujoco.batch",
    "pydantic",
    "typer",
    "rich",
    "pyarrow.parquet",
)
TOOLS = ("matplotlib.figure", "matplotlib.backends.backend_agg", "hypothesis", "filterpy.kalman", "coverage")
GRACE_S = 20.0  # beyond three times what the tests take, of the processor's time; five times that on the clock


class Verdict(NamedTuple):
    fate: str  # killed, survived or undecided
    by: str  # test


def preload() -> None:
    """Import the libraries, with one thread each, since threads do not survive a fork."""
    os.environ |= {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL")}
    for name in (*LIBRARIES, *TOOLS):
        import_module(name)


def _forked(work: Callable[[], object], seconds: float | None = None) -> object:
    """What `work` gives in a forked process, as JSON can say it; None if that takes too long or dies."""
    out, into = os.pipe()
    if (pid := os.fork()) == 0:
        os.close(out)
        silent = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1, 2):
            os.dup2(silent, stream)
        os.setsid()  # what it starts is ended with it
        if seconds is not None:
            resource.setrlimit(resource.RLIMIT_CPU, (int(seconds) + 1, int(seconds) + 2))
        with suppress(BaseException):
            os.write(into, json.dumps(work()).encode())
        os._exit(0)
    os.close(into)
    said, until = b"", None if seconds is None else time.monotonic() + 5.0 * seconds
    while select.select([out], [], [], None if until is None else max(0.0, until - time.monotonic()))[0]:
        if not (more := os.read(out, 65536)):
            break
        said += more
    os.close(out)
    with suppress(ProcessLookupError):
        os.killpg(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
    return json.loads(said) if said else None


# under coverage -------------------------------------------------------------------------------------------------------------------


class CutShortError(BaseException):
    """A test takes too long; nothing that it calls catches this."""


class LinesOfTests:
    """A plugin that says which test executes which line, how long it takes and whether it passes.

    What a test finds made by a fixture it need not execute itself: those lines stand under the name of its file.
    """

    def __init__(self, reports: dict[str, Path], longest: float) -> None:
        self._coverage = import_module("coverage").Coverage(data_file=None, source=list(SCOPE), config_file=False, messages=False)
        self._reports, self._longest = reports, longest
        self._tests: dict[str, dict[str, Any]] = {f"{file}::": {"seconds": 0.0, "outcome": "", "lines": {}} for file in reports}
        self._coverage.start()

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self._coverage.switch_context(f"{nodeid.partition('::')[0]}::")

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Iterator[None]:
        def cut(*_: object) -> None:
            raise CutShortError

        signal.signal(signal.SIGALRM, cut)
        self._coverage.switch_context(item.nodeid)
        signal.setitimer(signal.ITIMER_REAL, self._longest)
        begun, outcome = time.perf_counter(), "passed"
        try:
            return (yield)
        except CutShortError:
            outcome = "cut"
            pytest.skip("cut short")
        except BaseException as error:
            outcome = "skipped" if isinstance(error, pytest.skip.Exception) else "failed"
            raise
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            self._coverage.switch_context("")
            self._tests[item.nodeid] = {"seconds": round(time.perf_counter() - begun, 3), "outcome": outcome, "lines": {}}

    def pytest_sessionfinish(self) -> None:
        self._coverage.stop()
        data = self._coverage.get_data()
        for file in data.measured_files():
            place = Path(file).relative_to(ROOT).as_posix()
            for line, contexts in data.contexts_by_lineno(file).items():
                for name in filter(None, contexts):
                    self._tests[name]["lines"].setdefault(place, []).append(line)
        for file, report in self._reports.items():
            report.parent.mkdir(parents=True, exist_ok=True)
            report.write_text(json.dumps({name: one for name, one in self._tests.items() if name.startswith(f"{file}::")}))


def run_under_coverage(reports: dict[str, Path], longest: float) -> None:
    """Run test files and write what their tests execute."""
    files = [str(ROOT / place) for place in reports]
    _forked(lambda: int(pytest.main([*QUIET, *files], plugins=[LinesOfTests(reports, longest)])))
    if lost := [place for place, report in reports.items() if not report.is_file()]:
        raise SystemExit(f"{', '.join(lost)} cannot be run under coverage; do they pass?")


# on a mutant ----------------------------------------------------------------------------------------------------------------------


def revised(mutant: Mutant) -> bool:
    """Give the functions of a mutant's file, which is imported, their code in the mutant; False if one cannot be told or take it."""
    path = ROOT / mutant.place
    codes: dict[tuple[str, int], list[CodeType]] = {}
    several = [compile(mutant.applied(path.read_bytes()), str(path), "exec")]
    while several:
        code = several.pop()
        codes.setdefault((code.co_qualname, code.co_firstlineno), []).append(code)
        several += [part for part in code.co_consts if isinstance(part, CodeType)]
    changed = False
    for function in gc.get_objects():
        if isinstance(function, FunctionType) and (now := function.__code__).co_filename == str(path):
            found = codes.get((now.co_qualname, now.co_firstlineno), [])
            if len(found) != 1 or found[0].co_freevars != now.co_freevars:
                return False
            changed |= found[0] != now
            function.__code__ = found[0]
    return changed


class Asking:
    """A plugin that, in the place of running what was collected, runs some of it on every mutant, until one fails."""

    def __init__(self, asked: Iterable[tuple[Mutant, list[str], float]], told: int) -> None:
        self._asked, self._told = asked, told

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        items = {item.nodeid: item for item in session.items}
        for mutant, names, seconds in self._asked:
            tests = [items[name] for name in names if name in items]
            verdict = _forked(lambda mutant=mutant, tests=tests: _first_failure(tests) if revised(mutant) else "?", _limit(seconds))
            os.write(self._told, (json.dumps(verdict) + "\n").encode())
        return True


def _limit(seconds: float) -> float:
    return GRACE_S + 3.0 * seconds


def _first_failure(items: list[pytest.Item]) -> str:
    """The name of the first test that fails, "" if none does."""
    for item, following in zip_longest(items, items[1:]):
        if any(report.failed for report in runtestprotocol(item, log=False, nextitem=following)):
            return item.nodeid
    return ""


def _verdict(by: Any) -> Verdict:
    """Of the first failure: a name, "" for none, "?" if there was no mutant, None for too long or dead."""
    known = {None: Verdict("killed", "time or crash"), "": Verdict("survived", ""), "?": Verdict("undecided", "")}
    return known.get(by, Verdict("killed", str(by)))


def ask(asked: list[tuple[Mutant, list[str], float]]) -> Iterator[Verdict]:
    """Verdicts on mutants in functions, each with names of tests and the seconds that they take, one after another."""
    files = sorted({name.partition("::")[0] for _, names, _ in asked for name in names})
    out, into = os.pipe()
    if (pid := os.fork()) == 0:
        os.close(out)
        with suppress(BaseException):
            pytest.main([*QUIET, *(str(ROOT / file) for file in files)], plugins=[Asking(asked, into)])
        os._exit(0)
    os.close(into)
    with os.fdopen(out) as verdicts:
        yield from (_verdict(json.loads(line)) for line in verdicts)
    os.waitpid(pid, 0)


class _MutatedSource(SourceFileLoader):
    """Loads one file as a mutant has it."""

    def __init__(self, name: str, path: str, mutant: Mutant) -> None:
        super().__init__(name, path)
        self._mutant = mutant

    def get_code(self, fullname: str) -> CodeType:
        return compile(self._mutant.applied(Path(self.path).read_bytes()), self.path, "exec")


class _Finder:
    """Finds that file before anybody else does."""

    def __init__(self, mutant: Mutant) -> None:
        self._mutant, self._name = mutant, mutant.place.removesuffix(".py").removesuffix("/__init__").replace("/", ".")

    def find_spec(self, name: str, *_: object) -> ModuleSpec | None:
        if name != self._name:
            return None
        file = str(ROOT / self._mutant.place)
        return spec_from_file_location(name, file, loader=_MutatedSource(name, file, self._mutant))


class _FirstFailure:
    """A plugin that notes which test fails."""

    by = ""

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed and not self.by:
            self.by = report.nodeid


def ask_afresh(mutant: Mutant, names: list[str], seconds: float) -> Verdict:
    """The verdict on a mutant that is imported anew."""

    def work() -> str:
        sys.meta_path.insert(0, _Finder(mutant))
        noted = _FirstFailure()
        code = pytest.main([*QUIET, "-x", *(str(ROOT / name) for name in names)], plugins=[noted])
        return noted.by or ("" if code == pytest.ExitCode.OK else f"exit code {int(code)}")

    return _verdict(_forked(work, _limit(seconds)))
