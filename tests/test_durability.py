"""Short runs of the two series that show what is kept: commands that are killed, and disks that fill."""

from __future__ import annotations

import random
import signal
from pathlib import Path

import pytest

from tests.full_disk import NoMount, fill
from tests.kill_cases import ALONE, DASK_THERE, KINDS, Kind, answers, drawn
from tests.kills import Series, _complaints, _way_on

TERM, KILL = signal.SIGTERM, signal.SIGKILL
LINE = "interrupted: 4 of 12 trials are left; go on with: nacs campaign 'a b.toml' --resume --out it"


@pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="no /proc")
def test_commands_that_are_killed_lose_nothing(tmp_path: Path) -> None:
    series = Series(1, tmp_path)
    series.run_these([(Kind("replay", "main", TERM), 0.5), (Kind("replay", "main", KILL), 0.8)])
    assert [verdict.complaints for verdict in series.verdicts] == [[], []], "\n".join(map(str, series.verdicts))
    assert "in time" in {verdict.met for verdict in series.verdicts}


def test_disks_that_fill_leave_nothing_half() -> None:
    try:
        cases = list(fill(seed=3, sizes=3, commands=("replay",)))
    except NoMount as refused:
        pytest.skip(str(refused))
    assert not [case for case in cases if case.complaints], "\n".join(map(str, cases))
    assert {case.ended.code for case in cases} >= {3}


def test_the_series_of_kills_sees_what_is_wrong() -> None:
    campaign, scheduler = Kind(ALONE, "main", TERM), Kind(DASK_THERE, "scheduler", KILL)
    assert _complaints(campaign, 130, "in time", [LINE], 0) == []
    assert _complaints(campaign, 0, "late", [], 0) == []
    assert _complaints(campaign, -15, "early", [], 0) == []
    assert _complaints(campaign, -15, "in time", [], 0) == ["exit code -15"]
    assert _complaints(campaign, 130, "in time", ["interrupted"], 0) == ["no line says how to go on"]
    assert _complaints(campaign, 130, "in time", [LINE, "x"], 0)[0].startswith("2 lines")
    assert "traceback" in _complaints(campaign, 1, "in time", ["Traceback (most recent call last):", "KeyboardInterrupt"], 0)
    assert _complaints(campaign._replace(by=KILL), -9, "in time", [], 0) == []
    assert _complaints(scheduler, 3, "in time", ["error: lost: 4 of 12 trials are left; go on with: nacs campaign x"], 0) == []
    assert _complaints(scheduler._replace(victim="worker"), 3, "in time", [LINE], 0) == ["exit code 3"]


def test_the_series_goes_on_as_it_is_told(tmp_path: Path) -> None:
    typed = ("campaign", "a b.toml", "--out", "it")
    assert _way_on(typed, LINE, tmp_path) == ("campaign", "a b.toml", "--resume", "--out", "it")
    assert _way_on(typed, "", tmp_path) == typed
    assert _way_on(typed, "interrupted: nothing was begun; the same command begins anew", tmp_path) == typed
    (tmp_path / "it").mkdir()
    assert _way_on(typed, "", tmp_path) == (*typed, "--resume")
    assert _way_on(("run", "x", "--out", "it"), "", tmp_path)[-1] == "--overwrite"


def test_thirty_kills_are_of_thirty_kinds_and_the_same_for_a_seed() -> None:
    one, again = (list(drawn(30, random.Random(4))) for _ in range(2))
    assert one == again
    assert sorted(kind for kind, _ in one) == sorted(KINDS)
    assert not answers(1 << 30)
