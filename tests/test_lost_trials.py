"""A trial in which a filter or the physics breaks down leaves the batch with a reason; the others run on, the same to the bit."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from estimation.gaussian import LostDefiniteness
from sim.campaign.blocks import simulate
from sim.loop.build import build
from sim.loop.closed_loop import run, run_whole
from sim.loop.recording import RecordedRunFailed
from sim.plant.batch import Plant, SimulationFailed
from sim.scenario.files import load

KINDS = {
    "nacs": ("nacs/disturbance", {"faults": [], "run.ticks": 30}, "loop"),
    "freeflyer": ("wmap/smc-imm", {"faults": [], "run.ticks": 30}, "smc-imm"),
    "monolithic": ("monolithic/fault-free", {"faults": [], "run.ticks": 30, "phases": {}}, "pf-matched"),
    "formation": ("formation/fault-free", {"run.ticks": 30, "phases": {}}, "pf"),
    "formation-nacs": ("formation/nacs", {"run.ticks": 30, "phases": {}}, "aukf"),
    "agents": ("consensus/fault-free", {"run.ticks": 30}, "mupf-b"),
}
every_kind = pytest.mark.parametrize("kind", KINDS)
TRIALS, VICTIM, AT = np.array([3, 5, 8]), 1, 12


def break_a_filter(system, monkeypatch) -> None:
    """The last filter of the loop loses definiteness in one trial, once."""
    estimator = system.estimators[-1]
    step, calls = type(estimator).step, iter(range(10_000))

    def breaks(self, belief, known, reading, dt):
        drawn = step(self, belief, known, reading, dt)  # random numbers are drawn before the breakdown
        if self is estimator and next(calls) == AT - 1:
            raise LostDefiniteness((0, VICTIM) if estimator.blame(LostDefiniteness((0, VICTIM)))[0] == VICTIM else (VICTIM, 0))
        return drawn

    monkeypatch.setattr(type(estimator), "step", breaks)


def break_lapack(system, monkeypatch) -> None:
    """LAPACK refuses the whole stack of the last filter from a tick on, as long as one trial is in it, and does not say which."""
    estimator = system.estimators[-1]
    step, first, calls = type(estimator).step, type(estimator).initial, iter(range(10_000))
    begun, refusing = [], []

    def initial(self, reading):
        if self is estimator:
            begun.append(np.array(reading[VICTIM]))
        return first(self, reading)

    def refuses(self, belief, known, reading, dt):
        drawn = step(self, belief, known, reading, dt)
        if self is estimator:
            if next(calls) == AT - 1:
                refusing.append(True)
            if refusing and not np.array_equal(reading[VICTIM], begun[0], equal_nan=True):
                matrices = np.tile(np.eye(3), (len(TRIALS), 1, 1))
                matrices[VICTIM] = np.nan
                np.linalg.eigvals(matrices)
        return drawn

    monkeypatch.setattr(type(estimator), "initial", initial)
    monkeypatch.setattr(type(estimator), "step", refuses)


def break_the_physics(system, monkeypatch) -> None:
    """MuJoCo is given a torque that is no number, in one trial at one tick."""
    give, victim = type(system.effectors).give, VICTIM

    def sick(self, tick, *told):
        given = give(self, tick, *told)
        if tick != AT:
            return given
        if callable(given.push):
            push = given.push

            def wild(motion, time):
                force = push(motion, time).copy()
                force[victim] = np.nan
                return force

            return given._replace(push=wild)
        torque = np.array(np.broadcast_to(given.push, (len(TRIALS), *given.push.shape[1:])))
        torque[victim] = np.nan
        return given._replace(push=torque)

    monkeypatch.setattr(type(system.effectors), "give", sick)


@every_kind
@pytest.mark.parametrize("how", [break_a_filter, break_lapack, break_the_physics])
def test_the_others_run_on_to_the_bit(kind: str, how, monkeypatch: pytest.MonkeyPatch) -> None:
    name, changes, loop = KINDS[kind]
    scenario = load(name, changes)
    sound = run(build(scenario, TRIALS, loop=loop))
    system = build(scenario, TRIALS, loop=loop)
    with monkeypatch.context() as patched:
        how(system, patched)
        broken = run(system)
    [lost] = broken.lost
    assert lost.trial == TRIALS[VICTIM]
    assert abs(lost.tick - AT) <= 1
    assert not sound.lost
    others = [place for place, _ in enumerate(TRIALS) if place != VICTIM]
    for channel, values in broken.channels.items():
        if not channel.startswith("reference/"):
            np.testing.assert_array_equal(values[:, others], sound.channels[channel][:, others], err_msg=channel)
            own = values[lost.tick :, VICTIM]
            assert not own.any() if own.dtype == bool else np.isnan(own).all(), channel
            np.testing.assert_array_equal(values[: lost.tick, VICTIM], sound.channels[channel][: lost.tick, VICTIM], err_msg=channel)
    for figure, values in broken.figures.items():
        np.testing.assert_array_equal(values[:, others], sound.figures[figure][:, others], err_msg=figure)


@every_kind
def test_metrics_are_of_the_sound_trials_alone(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    name, changes, loop = KINDS[kind]
    scenario = load(name, changes)
    if scenario.loops:
        scenario = scenario.model_copy(update={"loops": {loop: scenario.loops[loop]}})
    nobody = np.zeros(0, dtype=np.int64)
    whole = simulate(scenario, TRIALS, nobody)
    advance, calls = Plant._step, iter(range(10_000))

    def breaks(self, steps):
        causes = advance(self, steps)
        return causes | ({VICTIM: "on purpose"} if next(calls) == AT else {})

    monkeypatch.setattr(Plant, "_step", breaks)
    block = simulate(scenario, TRIALS, nobody)
    assert block.trials.tolist() == [3, 8]
    assert [(lost.trial, "on purpose" in lost.cause) for lost in block.lost] == [(5, True)]
    assert [metric[:4] for metric in block.metrics] == [metric[:4] for metric in whole.metrics]
    for one, other in zip(block.metrics, whole.metrics, strict=True):
        np.testing.assert_array_equal(one.values, other.values[[0, 2]], err_msg=f"{one.subject} {one.metric}")


def test_a_run_keeps_the_others_and_says_who_failed(nacs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    advance, calls = Plant._step, iter(range(10_000))
    monkeypatch.setattr(Plant, "_step", lambda self, steps: advance(self, steps) | ({0: "it broke"} if next(calls) == 20 else {}))
    result = nacs("run", "nacs/disturbance", "--set", "faults=[]", "--set", "run.ticks=40", "--trials", 3, "--out", "it")
    assert result.code == 3
    assert "error: trial 0 failed at t = 2.000 s: it broke; what was recorded until then is in it" in result.err
    assert set(pq.read_table(tmp_path / "it" / "trials.parquet")["trial"].to_pylist()) == {1, 2}
    assert json.loads((tmp_path / "it" / "summary.json").read_text())["trials"] == 2
    assert {path.name for path in (tmp_path / "it").iterdir()} >= {"report.png", "recording.rrd"}


@pytest.mark.parametrize("name", ["nacs/disturbance", "formation/fault-free", "consensus/fault-free"])
def test_what_was_recorded_of_a_single_trial_is_kept(name: str, nacs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    advance, calls = Plant._step, iter(range(1_000_000))
    monkeypatch.setattr(Plant, "_step", lambda self, steps: advance(self, steps) | ({0: "it broke"} if next(calls) > 100 else {}))
    short = ("--set", "run.ticks=120", "--set", "phases={}") if name.startswith("formation") else ("--set", "run.ticks=120")
    more = ("--set", "faults=[]") if name.startswith("nacs") else ()
    result = nacs("run", name, *short, *more, "--trials", 1, "--out", "it")
    assert result.code == 3, result.err
    assert "it broke" in result.err
    assert (tmp_path / "it" / "recording.rrd").stat().st_size > 10_000


EVERYBODY = {
    "wmap/compare": (("pd-ukf", "smc-imm"), {"phases": {}}),
    "monolithic/fault-free": (("mekf", "aukf-printed"), {"phases": {}}),
    "antenna-mapping/panelsat": (("adaptive", "nominal"), {"phases": {}}),
    "formation/disturbance": (("truth", "aukf"), {"phases": {}}),
    "consensus/disturbance": (("adtl", "aukf"), {}),
}


@pytest.mark.parametrize("name", EVERYBODY)
def test_where_all_trials_of_all_loops_break_down_what_was_recorded_of_one_is_kept(name: str) -> None:
    """A push that no physics takes, at the tenth tick of every trial: loops break down together, in trials of one number."""
    loops, changes = EVERYBODY[name]
    scenario = load(name, {"faults": [], "run.ticks": 20, **changes})
    tick = scenario.run.tick_s
    force = {"kind": "external-force", "force_n": [1e300, 0.0]}
    torque = {"kind": "external-torque", "torque_nm": {"uniform": [1e300, 1.1e300]}}
    push = {**(force if name.startswith("consensus") else torque), "start_s": 10 * tick, "duration_s": tick}
    scenario = load(name, {"faults": [push], "run.ticks": 20, **changes})
    scenario = scenario.model_copy(update={"loops": {loop: scenario.loops[loop] for loop in loops}})
    block = simulate(scenario, TRIALS, TRIALS[:1])
    assert not len(block.trials)
    assert [(one.trial, one.time_s) for one in block.lost] == [(trial, pytest.approx(10 * tick)) for trial in TRIALS.tolist()]
    assert set(block.recordings) == set(loops)
    for recording in block.recordings.values():
        assert recording.trials.tolist() == [3]
        assert recording.counted in (
            10,
            11,
        )  # agents in the plane are pushed at the end of the tick before already, by the last stage of RK4


def test_of_several_loops_the_first_breakdown_is_told_and_what_all_of_them_recorded_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """Trial 8 breaks down in the first loop and trial 3 in both, later in the second; nobody wanted trial 8 to be recorded."""
    scenario = load("wmap/compare", {"faults": [], "phases": {}, "run.ticks": 20})
    scenario = scenario.model_copy(update={"loops": {loop: scenario.loops[loop] for loop in ("pd-ukf", "pd-imm")}})
    advance, calls = Plant._step, iter(range(10_000))
    causes = {4: {2: "first"}, 6: {0: "second"}, 20 + 9: {0: "third"}}
    monkeypatch.setattr(Plant, "_step", lambda self, steps: advance(self, steps) | causes.get(next(calls), {}))
    block = simulate(scenario, TRIALS, TRIALS[:1])
    assert block.trials.tolist() == [5]
    assert [(one.trial, one.cause) for one in block.lost] == [(3, "loop pd-ukf: second"), (8, "loop pd-ukf: first")]
    assert {name: recording.trials.tolist() for name, recording in block.recordings.items()} == {"pd-ukf": [3], "pd-imm": [3]}


def test_a_batch_that_cannot_be_saved_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    system = build(load("nacs/fault-free", {"run.ticks": 5}), TRIALS)
    bank = type(system.estimators[0])

    def always(*_: object) -> None:
        raise LostDefiniteness((0, 2))

    monkeypatch.setattr(bank, "step", always)
    recording = run(system)
    assert [lost.trial for lost in recording.lost] == TRIALS.tolist()
    assert "ekf: its innovation covariance lost definiteness" in recording.lost[0].cause
    with pytest.raises(RecordedRunFailed, match=r"failed at t = 0\.100 s"):
        run_whole(build(load("nacs/fault-free", {"run.ticks": 5}), TRIALS))


@pytest.mark.parametrize(("part", "at"), [("decide", 5), ("start", 0)])
def test_a_law_that_breaks_down_leaves_what_was_recorded(part: str, at: int, monkeypatch: pytest.MonkeyPatch) -> None:
    system = build(load("nacs/fault-free", {"run.ticks": 9}), TRIALS)
    work, calls = getattr(type(system.law), part), iter(range(100))

    def refuses(self, *told):
        if next(calls) == at:
            raise np.linalg.LinAlgError("Singular matrix")
        return work(self, *told)

    monkeypatch.setattr(type(system.law), part, refuses)
    recording = run(system)
    assert [(lost.trial, lost.tick, lost.cause) for lost in recording.lost] == [(trial, at, "Singular matrix") for trial in TRIALS]
    assert recording.counted == at
    if at:
        truth = recording.channels["truth/state"]
        assert np.isfinite(truth[:at]).all()
        assert np.isnan(recording.channels["ekf/mean"][at:]).all()


def test_a_run_whose_law_breaks_down_at_once_is_one_line(nacs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuses(*_: object) -> None:
        raise np.linalg.LinAlgError("SVD did not converge")

    law = type(build(load("nacs/fault-free", {"run.ticks": 9}), TRIALS).law)
    monkeypatch.setattr(law, "decide", refuses)
    result = nacs("run", "nacs/fault-free", "--set", "run.ticks=9", "--trials", 2, "--out", "it")
    assert (result.code, result.err.count("\n")) == (3, 1), result.err
    assert "trial 0 failed at t = 0.000 s: SVD did not converge" in result.err


def test_a_failure_names_every_trial() -> None:
    plant = build(load("nacs/fault-free", {"run.ticks": 5}), np.arange(4)).plant
    push = np.zeros((4, 3))
    push[[1, 3], 0] = np.nan
    with pytest.raises(SimulationFailed, match="trial 1 failed") as failure:
        plant.advance(np.zeros((4, 4)), push, 10)
    assert set(failure.value.causes) == {1, 3}
