"""A pytest plugin that says which test executes which line, how long it takes and whether it passes; see tests/mutants.py.

What a test finds made, by a fixture or on import, it does not execute itself: those lines stand under the name "". What runs in another
process is not seen.
"""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import coverage
import pytest

REPORT, SECONDS, SCOPE = "MUTANTS_COVERAGE", "MUTANTS_SECONDS", ("models", "estimation", "control", "sim")


class CutShortError(BaseException):
    """A test takes too long; nothing that it calls catches this."""


class LinesOfTests:
    def __init__(self) -> None:
        self.coverage = coverage.Coverage(data_file=None, source=list(SCOPE), config_file=False, messages=False)
        self.tests: dict[str, dict[str, Any]] = {"": {"seconds": 0.0, "outcome": "", "lines": {}}}
        self.coverage.start()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Iterator[None]:
        def cut(*_: object) -> None:
            raise CutShortError

        signal.signal(signal.SIGALRM, cut)
        self.coverage.switch_context(item.nodeid)
        signal.setitimer(signal.ITIMER_REAL, float(os.environ[SECONDS]))
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
            self.coverage.switch_context("")
            self.tests[item.nodeid] = {"seconds": round(time.perf_counter() - begun, 3), "outcome": outcome, "lines": {}}

    def pytest_sessionfinish(self) -> None:
        self.coverage.stop()
        data = self.coverage.get_data()
        for file in data.measured_files():
            place = Path(file).relative_to(Path.cwd()).as_posix()
            for line, contexts in data.contexts_by_lineno(file).items():
                for name in contexts:
                    self.tests[name]["lines"].setdefault(place, []).append(line)
        Path(os.environ[REPORT]).write_text(json.dumps(self.tests))


def pytest_configure(config: pytest.Config) -> None:
    config.pluginmanager.register(LinesOfTests())
