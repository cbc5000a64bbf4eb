"""What can be done with the testbed can be done with every body: each kind of plant by each feature."""

from __future__ import annotations

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow.parquet as pq
import pytest
import rerun as rr
from rerun.chunk import RrdReader

from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.loop.motion import motion
from sim.replay.flight_log import about, export, read
from sim.replay.log_columns import columns_of
from sim.replay.replay import replay
from sim.replay.setting import choose, setting, why_not
from sim.scenario.files import load
from sim.user_code.user_code import UserCode

EXAMPLES = Path(__file__).parents[1] / "docs" / "examples"
FILTER = f"{EXAMPLES / 'complementary_filter.py'}:ComplementaryFilter"
TRIALS = np.arange(2)
PARTS = ("mean", "sigma", "nis", "dof", "statistic", "declared", "modes", "ess", "fading", "learned")


class Body(NamedTuple):
    """A scenario of each kind of plant, made short."""

    scenario: str
    changes: dict[str, object]
    law: str  # of the user's own, that fits its laws


NONE: dict[str, object] = {"faults": []}
BODIES = {
    "nacs": Body("nacs/disturbance", NONE | {"run.ticks": 60}, "TORQUE"),
    "nacs, several loops": Body("nacs/imm-wheel-failure", NONE | {"run.ticks": 40}, "TORQUE"),
    "nacs, learning": Body("nacs/learned-dynamics", NONE | {"run.ticks": 30, "phases": {}}, "TORQUE"),
    "freeflyer": Body("wmap/smc-imm", NONE | {"run.ticks": 40}, "TORQUE"),
    "monolithic": Body("monolithic/compare", NONE | {"run.ticks": 40, "phases": {}}, "TORQUE"),
    "flexible": Body(
        "antenna-mapping/panelsat",
        {"run.ticks": 60, "identification.period": 20.0, "observers.ekf.type": "ekf", "loops.nominal.watching": ["ekf"]},
        "TORQUE",
    ),
    "formation": Body("formation/fault-free", {"run.ticks": 40, "phases": {}}, "NETWORKED"),
    "formation-nacs": Body("formation/nacs", {"run.ticks": 30, "phases": {}}, "NETWORKED"),
    "agents": Body("consensus/command-fault", NONE | {"run.ticks": 30}, "PLANAR"),
}
LAWS = {
    "TORQUE": "def step(self, estimate, target): return -0.1 * estimate.omega_BN_B",
    "NETWORKED": "def step(self, own, heard): return -0.01 * own.state[..., 3:]",
    "PLANAR": "def step(self, own, heard): return -own.learned - own.state[..., 2:]",
}
UNDRAWN = ("--without", "report", "--without", "recording")  # what takes longest and is looked at elsewhere

every_body = pytest.mark.parametrize("body", BODIES.values(), ids=list(BODIES))


def settings(body: Body) -> list[str]:
    return [part for key, value in body.changes.items() for part in ("--set", f"{key}={json.dumps(value)}")]


@every_body
def test_a_log_replays_every_filter_of_every_loop_to_the_bit(body: Body, tmp_path: Path) -> None:
    scenario = load(body.scenario, body.changes)
    recordings = {loop: run(build(scenario, TRIALS, loop=loop)) for loop in scenario.loop_names}
    path = tmp_path / "log.parquet"
    export(path, recordings, scenario, body.scenario)
    said = about(path)
    again = setting(said, "log", None, {})
    compared = 0
    for block in read(path, columns_of(again)):
        if why_not(again, block.loop):
            assert scenario.loops[block.loop].tick_s < scenario.run.tick_s
            continue
        chosen, names = choose(again, said, block.loop, [])
        if not names:
            continue
        replayed = replay(block, chosen, UserCode()).recording
        flown = recordings[block.loop]
        assert set(replayed.observers) == set(flown.observers)
        for name in flown.observers:
            for part in PARTS:
                if (expected := flown.channels.get(f"{name}/{part}")) is not None:
                    np.testing.assert_array_equal(replayed.channels[f"{name}/{part}"], expected, err_msg=f"{block.loop} {name}/{part}")
                    compared += 1
    assert compared >= 6


@every_body
def test_a_user_s_filter_flies_and_is_judged(body: Body, nacs, tmp_path: Path) -> None:
    result = nacs("run", body.scenario, "--trials", 2, *settings(body), "--observer", FILTER, "--out", "it")
    assert result.code == 0, result.err
    subjects = set(pq.read_table(tmp_path / "it" / "trials.parquet")["subject"].to_pylist())
    loops = load(body.scenario, body.changes).loops
    expected = {f"{loop}/complementary-filter" for loop in loops} or {"complementary-filter"}
    assert expected <= subjects
    assert any(column.startswith("estimate/complementary-filter/") for column in pq.read_schema(tmp_path / "it" / "signals.parquet").names)


@every_body
def test_a_user_s_law_flies_in_place_of_the_scenario_s(body: Body, nacs, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(f"class Mine:\n    def __init__(self, setting): pass\n    {LAWS[body.law]}\n")
    result = nacs("run", body.scenario, "--trials", 1, *settings(body), "--controller", "mine.py:Mine", "--out", "it", *UNDRAWN)
    assert result.code == 0, result.err
    assert json.loads((tmp_path / "it" / "summary.json").read_text())["guests"] == {"mine": "mine.py:Mine"}


@every_body
def test_one_trial_alone_is_the_same_trial(body: Body, nacs, tmp_path: Path) -> None:
    common = ["run", body.scenario, "--trials", 3, *settings(body), *UNDRAWN]
    assert nacs(*common, "--out", "all").code == 0
    result = nacs(*common, "--only-trial", 2, "--out", "one")
    assert result.code == 0, result.err
    everyone, alone = (pq.read_table(tmp_path / folder / "trials.parquet").to_pylist() for folder in ("all", "one"))

    def comparable(rows: list[dict]) -> list[dict]:
        return [row | {"value": repr(row["value"])} for row in rows if row["trial"] == 2]

    assert comparable(everyone) == comparable(alone)


@every_body
def test_filters_with_covariances_have_nees(body: Body) -> None:
    scenario = load(body.scenario, body.changes)
    found = {}
    for loop in scenario.loop_names:
        recording = run(build(scenario, TRIALS, loop=loop))
        found |= {
            (loop, name): np.nanmean(recording.channels[f"{name}/nees"])
            for name in recording.observers
            if np.isfinite(recording.channels[f"{name}/nees"]).any()
        }
    assert found
    assert all(value > 0.0 for value in found.values())


@every_body
def test_a_viewer_has_a_model_and_poses(body: Body) -> None:
    scenario = load(body.scenario, body.changes)
    moved = motion(scenario, scenario.loop_names[0])
    assert moved.qpos.shape == (scenario.run.ticks, moved.scene.nq)
    assert np.isfinite(moved.qpos).all()


@every_body
def test_a_run_is_shown_live(body: Body, nacs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Accepting:
        def close(self) -> None:
            pass

    path = tmp_path / "live.rrd"
    monkeypatch.setattr("sim.rerun.live.socket.create_connection", lambda *_, **__: Accepting())
    monkeypatch.setattr(rr.RecordingStream, "connect_grpc", lambda stream, _, default_blueprint: stream.save(path, default_blueprint))
    result = nacs("run", body.scenario, "--trials", 1, *settings(body), "--live", "--out", "it", *UNDRAWN)
    assert result.code == 0, result.err
    entities = {str(chunk.entity_path) for chunk in RrdReader(path).stream().to_chunks()}
    loops = load(body.scenario, body.changes).loops
    shown = [f"/{loop}/truth/" for loop in loops] or ["/estimation"]
    assert all(any(entity.startswith(start) or not loops for entity in entities) for start in shown)
