"""Progress of long work where there is no terminal: lines with what is left, told in seconds that pass."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from sim.campaign import cost
from sim.scenario import files
from sim.text import progress


class _Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> _Clock:
    chosen = _Clock()
    monkeypatch.setattr(progress, "time", chosen)
    return chosen


def test_a_line_every_ten_seconds_says_what_is_left(clock: _Clock) -> None:
    said = io.StringIO()
    with progress.Work(Console(file=said, width=200), "ticks") as work:
        for second in range(31):
            clock.now = 100.0 + second
            work.report("flight", 2 * second, 80)
    assert said.getvalue().splitlines() == [
        "progress: flight, 20 of 80 ticks, about 30 s left",
        "progress: flight, 40 of 80 ticks, about 20 s left",
        "progress: flight, 60 of 80 ticks, about 10 s left",
    ]


def test_work_of_several_kinds_is_judged_each_by_itself(clock: _Clock) -> None:
    said = io.StringIO()
    with progress.Work(Console(file=said, width=200), "steps") as work:
        work.report("flight", 0, 1)
        clock.now += 100.0
        work.report("replays", 0, 4)
        clock.now += 600.0
        work.advance("replays", 1, 4)
    assert said.getvalue().splitlines() == ["progress: replays, 0 of 4 steps", "progress: replays, 1 of 4 steps, about 30 min left"]


def test_a_terminal_gets_a_bar_instead() -> None:
    said = io.StringIO()
    with progress.Work(Console(file=said, force_terminal=True, width=100), "trials") as work:
        work.report("campaign", 3, 7)
    assert "3/7" in said.getvalue()
    assert progress.PREFIX not in said.getvalue()


def test_what_takes_long_is_said_before_it_begins() -> None:
    """6 spacecraft, 4 ticks of 10 000 s at 10 ms: 24 million steps of a body in each of two loops, at least 1 us each."""
    formation = files.load("formation/link-cut", {"run.tick_s": 1e4, "run.ticks": 4, "run.trials": 1, "phases": {}})
    steps = 2 * 4 * 1e4 / 0.01 * 6  # two loops
    (line,) = cost.check(formation, 1)
    assert line == f"1 trial of 4 ticks take at least {cost.cost(formation, 1).seconds:.3g} s"
    assert cost.cost(formation, 1).seconds == pytest.approx(1e-6 * steps, rel=1e-3)
    testbed = files.load("nacs/fault-free", {"run.ticks": 12})
    assert cost.check(testbed, 4000) == []
    assert len(cost.check(testbed, 4000, flights=20)) == 1
