"""`import nacs`: what the command does from Python, and the twin that is stepped from outside."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import nacs
from tests.test_feature_matrix import LAWS, Body, every_body

SHORT = {"run.ticks": 12, "phases": {}}


class Still:
    """A law that asks for nothing."""

    def step(self, estimate, target):
        return np.zeros_like(estimate.omega_BN_B)


class Reader:
    """A filter that believes what it reads."""

    def __init__(self, setting):
        self.rest = setting.layout.rest

    def initial(self, measurement):
        return self.step(None, None, measurement, 0.0)

    def step(self, belief, command, measurement, dt):
        class Belief:
            mean = np.where(np.isnan(measurement), self.rest, measurement)

        return Belief()


@every_body
def test_stepped_from_outside_by_its_own_law_it_is_the_run_to_the_bit(body: Body) -> None:
    changes = body.changes | {"run.trials": 2}
    for loop in nacs.load(body.scenario, set=changes).loop_names[:2]:
        twin = nacs.Twin(body.scenario, set=changes, loop=loop)
        readings = [twin.read()]
        while not twin.over:
            readings.append(twin.step(twin.torque))
        stepped = twin.recording
        flown = nacs.run(body.scenario, set=changes).recordings[loop]
        for name, channel in flown.channels.items():
            np.testing.assert_array_equal(stepped.channels[name], channel, err_msg=f"{loop}: {name}")
        assert np.isnan(readings[-1]).all()


@every_body
def test_signals_and_a_picture_of_every_family(body: Body) -> None:
    pytest.importorskip("xarray")
    flown = nacs.run(body.scenario, set=body.changes | {"run.trials": 1})
    for loop in flown.loops:
        signals = flown.signals_of(loop)
        assert signals.sizes["trial"] == 1
        assert signals.attrs["loop"] == loop
        np.testing.assert_array_equal(signals["time"], flown.recordings[loop].time)
    assert flown.report().axes
    assert body.scenario.partition("/")[0] in repr(flown)


def test_a_torque_from_outside_turns_the_body_as_euler_says() -> None:
    """Nothing else acts on a rigid spacecraft: in a control period the rate gains J^-1 of the torque times the time."""
    still = SHORT | {"faults": [], "run.trials": 2}
    twin = nacs.Twin("monolithic/fault-free", set=still, controller=Still)
    start, inertia, torque = twin.truth[:, 4:7], twin.scenario.plant.inertia, np.array([[0.02, 0.0, 0.0], [0.0, 0.0, 0.01]])
    twin.step(torque)
    gained = twin.truth[:, 4:7] - start
    midway = start + gained / 2.0
    wanted = twin.dt * np.linalg.solve(inertia, (torque - np.cross(midway, midway @ inertia)).T).T
    np.testing.assert_allclose(gained, wanted, rtol=1e-3)


def test_reset_begins_anew_and_a_seed_changes_what_happens() -> None:
    twin = nacs.Twin("nacs/fault-free", trials=2, seed=5, set=SHORT)
    first = np.stack([twin.step() for _ in range(5)])
    twin.reset()
    np.testing.assert_array_equal(np.stack([twin.step() for _ in range(5)]), first)
    twin.reset(seed=6)
    assert not np.array_equal(np.stack([twin.step() for _ in range(5)]), first)
    assert twin.time == pytest.approx(5 * twin.dt)
    assert twin.reading_names[:4] == ("q1", "q2", "q3", "q4")
    assert set(twin.reference) == {"q", "omega", "alpha"}


def test_a_filter_and_a_law_of_a_notebook_are_those_of_a_file(tmp_path: Path) -> None:
    (tmp_path / "law.py").write_text(f"class Damp:\n    {LAWS['TORQUE']}\n")

    class Damp:
        def step(self, estimate, target):
            return -0.1 * estimate.omega_BN_B

    asked = {"trials": 1, "set": SHORT}
    from_file = nacs.run("nacs/fault-free", controller=f"{tmp_path / 'law.py'}:Damp", **asked)

    def damp(setting):
        return Damp()

    for given in (Damp, Damp(), damp):
        flown = nacs.run("nacs/fault-free", controller=given, **asked).recordings["loop"]
        np.testing.assert_array_equal(flown.channels["truth/state"], from_file.recordings["loop"].channels["truth/state"])
    watched = nacs.run("nacs/fault-free", observers=[Reader], **asked).recordings["loop"]
    np.testing.assert_array_equal(watched.channels["reader/mean"], watched.channels["reading"])


def test_what_is_saved_is_what_the_command_writes(nacs_command, tmp_path: Path) -> None:
    flown = nacs.run("nacs/fault-free", trials=2, seed=3, set=SHORT)
    flown.save(tmp_path / "saved")
    code = nacs_command(
        "run",
        "nacs/fault-free",
        "--trials",
        2,
        "--seed",
        3,
        "--set",
        "run.ticks=12",
        "--set",
        "phases={}",
        "--out",
        "o",
        "--record-trials",
        2,
    ).code
    assert code == 0
    names = sorted(path.name for path in (tmp_path / "saved").iterdir())
    assert names == sorted(path.name for path in Path("o").iterdir())
    for name in names:
        if name.endswith(".parquet"):
            one, other = (pq.read_table(folder / name) for folder in (tmp_path / "saved", Path("o")))
            assert one.schema.equals(other.schema, check_metadata=True)
            for column in one.column_names:
                np.testing.assert_array_equal(one[column].to_numpy(), other[column].to_numpy())
    kept = [json.loads((folder / "summary.json").read_text()) for folder in (tmp_path / "saved", Path("o"))]
    assert kept[0]["rows"] == kept[1]["rows"]
    assert flown.arrow.equals(pq.read_table(tmp_path / "saved" / "trials.parquet"))
    with pytest.raises(nacs.NacsError, match="is not empty"):
        flown.save(tmp_path / "saved")


def test_campaign_cross_check_and_replay_hand_over_what_they_leave(nacs_command, tmp_path: Path) -> None:
    (tmp_path / "c.toml").write_text('title = "T"\nscenario = "nacs/fault-free"\ntrials = 2\nseed = 5\n[override]\n"run.ticks" = 4\n')
    done = nacs.campaign(tmp_path / "c.toml", out=tmp_path / "c", workers=1)
    assert done.summary["trials"] == 2
    assert set(done.table("trials.parquet")["trial"].to_pylist()) == {0, 1}
    with pytest.raises(nacs.NacsError, match="is not empty; name another folder"):
        nacs.campaign(tmp_path / "c.toml", out=tmp_path / "c")
    checked = nacs.crosscheck("monolithic/fault-free", out=tmp_path / "x", trials=1, at=[0.1], set={"run.ticks": 12, "phases": {}})
    assert "Cross-check of" in checked.text
    assert checked.arrow.num_rows
    assert (
        nacs_command(
            "run", "nacs/fault-free", "--set", "run.ticks=8", "--set", "phases={}", "--trials", 1, "--export-log", "--out", "o"
        ).code
        == 0
    )
    replayed = nacs.replay("o/log.parquet", out=tmp_path / "r", filters=["ekf"])
    assert replayed.table("estimates.parquet").num_rows == 8
    with pytest.raises(nacs.NacsError, match="no-such"):
        replayed.table("no-such.parquet")


WRONG = [
    (lambda: nacs.run(None), "scenario=None: must be a name"),
    (lambda: nacs.run("nacs/fault-free", set=["run.ticks"]), "must be a dictionary"),
    (lambda: nacs.run("nacs/fault-free", set={5: 5}), "5 is no text"),
    (lambda: nacs.run("nacs/fault-free", observers=5), "must be a list"),
    (lambda: nacs.Twin("nacs/fault-free", trials=2, set=SHORT).step([1j, 0.0, 0.0]), "not complex128"),
    (lambda: nacs.Twin("nacs/fault-free", trials=2, set=SHORT).step(["1", "2", "3"]), "must be numbers"),
    (lambda: nacs.run("nacs/fault-free", trials=1, set=SHORT, record_trials=0).signals, "no trial was recorded"),
    (lambda: nacs.run("nacs/disturbanse"), "did you mean nacs/disturbance"),
    (lambda: nacs.run("nacs/fault-free", set={"run.tiks": 3}), "run.tiks"),
    (lambda: nacs.run({"title": "t"}), "dictionary: "),
    (lambda: nacs.run("nacs/fault-free", workers=0), "workers=0: must be a whole number of at least 1"),
    (lambda: nacs.run("nacs/fault-free", workers="3"), "workers='3': must be a whole number"),
    (lambda: nacs.run("nacs/fault-free", trials=2.5), "trials=2.5: must be a whole number"),
    (lambda: nacs.run("nacs/fault-free", trials=np.array([1, 2])), "must be a whole number"),
    (lambda: nacs.Twin("nacs/fault-free", trials=True), "trials=True"),
    (lambda: nacs.crosscheck(None), "scenario=None: must be a name or a path"),
    (lambda: nacs.crosscheck(thresholds=5), "thresholds=5: must be a dictionary"),
    (lambda: nacs.crosscheck(at=["x"]), "at='x': must be a number"),
    (lambda: nacs.campaign(None), "file=None: must be a name or a path"),
    (lambda: nacs.campaign("nacs-wheel-failure", trials="x"), "trials='x'"),
    (lambda: nacs.replay("a.parquet", filters=5), "filters=5: must be a list"),
    (lambda: nacs.linearize(at="x"), "at='x': must be a number"),
    (lambda: nacs.margins(at=10**400), "must be a number"),
    (lambda: nacs.export_fmu("nacs/fault-free", None), "file=None: must be a name or a path"),
    (lambda: nacs.export_fmu("nacs/fault-free", "a.fmu", version=4), "there are 3, 2"),
    (lambda: nacs.scenarios(None), "beginning=None"),
    (lambda: nacs.run("nacs/fault-free", workers=2, controller=Still), "workers=1"),
    (lambda: nacs.run("nacs/fault-free", controller=object()), "has no method step"),
    (lambda: nacs.run("nacs/fault-free", observers=[Still]), "has no method initial"),
    (lambda: nacs.Twin("nacs/fault-free", loop="x"), "no such loop; there are loop"),
    (lambda: nacs.Twin("nacs/fault-free", trials=2, set=SHORT).step([1.0, 2.0]), r"does not fit the shape \(2, 3\)"),
    (lambda: nacs.Twin("nacs/fault-free", trials=2, set=SHORT).step([0.0, np.nan, 0.0]), "not finite: nan"),
    (lambda: nacs.crosscheck("nacs/fault-free", set={"run.ticks": {1, 2}}), "cannot be written as TOML"),
    (lambda: nacs.replay("nothing.parquet"), "nothing.parquet"),
    (lambda: nacs.campaign("nothing"), "no campaign 'nothing'"),
    (lambda: nacs.campaign("wheel-failure", resume=True), "needs out"),
    (lambda: nacs.run("nacs/fault-free", trials=1, set=SHORT).signals_of("x"), "no such loop"),
]


@pytest.mark.parametrize(("call", "said"), WRONG, ids=[said for _, said in WRONG])
def test_bad_input_is_one_line(call, said: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(nacs.NacsError, match=said) as raised:
        call()
    assert "\n" not in str(raised.value)
    assert raised.value.exit_code == 2
    assert not list(tmp_path.iterdir())


def test_after_the_last_tick_there_is_none() -> None:
    twin = nacs.Twin("nacs/fault-free", trials=1, set=SHORT | {"run.ticks": 2})
    twin.step()
    twin.step()
    assert twin.over
    for call in (twin.read, twin.step, lambda: twin.truth):
        with pytest.raises(nacs.NacsError, match="of 2 ticks is over; reset"):
            call()
    assert twin.reset().shape == (1, 11)


def test_a_law_that_says_nan_is_told_with_its_line() -> None:
    class Broken:
        def step(self, estimate, target):
            return np.full_like(estimate.omega_BN_B, np.nan)

    with pytest.raises(nacs.NacsError, match=r"test_python_face.py:\d+: Broken.step: torque is not finite"):
        nacs.run("nacs/fault-free", trials=1, set=SHORT, controller=Broken())


def test_a_law_that_writes_into_what_it_is_told_harms_nobody() -> None:
    class Scribble:
        def step(self, estimate, target):
            target.q_DN[...] = 0.5
            estimate.omega_BN_B[...] = 7.0
            return np.zeros_like(estimate.omega_BN_B)

    one, other = (nacs.run("nacs/fault-free", trials=2, set=SHORT, controller=law).recordings["loop"].channels for law in (Scribble, Still))
    for name, channel in other.items():
        np.testing.assert_array_equal(one[name], channel, err_msg=name)


def test_what_is_handed_out_is_a_copy() -> None:
    pytest.importorskip("xarray")
    flown = nacs.run("nacs/fault-free", trials=1, set=SHORT)
    before = flown.recordings["loop"].channels["truth/state"].copy()
    flown.signals.truth_rate.values[...] = 9.0
    np.testing.assert_array_equal(flown.recordings["loop"].channels["truth/state"], before)
    twin = nacs.Twin("nacs/fault-free", trials=1, set=SHORT)
    twin.reference["q"][...] = 0.5
    twin.estimate.omega_BN_B[...] = 7.0
    while not twin.over:
        twin.step()
    np.testing.assert_array_equal(twin.recording.channels["truth/state"], before)


def test_trials_and_seed_have_the_last_word() -> None:
    table = {"ticks": 5, "tick_s": 0.1, "trials": 10, "seed": 2024}
    run = nacs.load("nacs/fault-free", trials=1, seed=77, set={"run.seed": 1, "run.trials": 3, "run": table, "phases": {}}).run
    assert (run.trials, run.seed, run.ticks) == (1, 77, 5)


def test_a_step_that_failed_is_not_the_end() -> None:
    class Fails(Reader):
        ticks = 0

        def step(self, belief, command, measurement, dt):
            self.ticks += 1
            if self.ticks > 4:
                raise RuntimeError("it is broken")
            return Reader.step(self, belief, command, measurement, dt)

    twin = nacs.Twin("nacs/fault-free", trials=1, set=SHORT, observers=[Fails])

    def fly() -> None:
        while True:
            twin.step()

    with pytest.raises(nacs.NacsError, match="it is broken"):
        fly()
    assert not twin.over
    with pytest.raises(nacs.NacsError, match=r"an earlier step failed: .*it is broken"):
        twin.step()


def test_without_recorded_trials_metrics_are_there_and_older_files_go(tmp_path: Path) -> None:
    nacs.run("nacs/fault-free", trials=1, set=SHORT).save(tmp_path / "it")
    flown = nacs.run("nacs/fault-free", trials=2, set=SHORT, record_trials=0)
    flown.save(tmp_path / "it", overwrite=True)
    assert {path.name for path in (tmp_path / "it").iterdir()} == {"summary.json", "trials.parquet"}
    assert json.loads((tmp_path / "it" / "summary.json").read_text())["sim_s"] == pytest.approx(2 * 12 * 0.1)


def test_scenarios_are_found_by_their_beginning() -> None:
    assert set(nacs.scenarios("nacs/wheel")) == {"nacs/wheel-failure"}
    assert len(nacs.scenarios()) > 50


def test_numpys_numbers_are_numbers() -> None:
    twin = nacs.Twin("nacs/fault-free", trials=np.int64(2), seed=np.int32(4), set={"run.ticks": np.int64(3), "phases": {}})
    assert twin.truth.shape == (2, 11)
    assert twin.scenario.run.seed == 4


def test_workers_in_a_script_without_a_guard_are_told_before_any_is_started(tmp_path: Path) -> None:
    script = tmp_path / "mine.py"
    script.write_text(
        'import nacs\ntry:\n    nacs.run("nacs/fault-free", trials=2, workers=2)\nexcept nacs.NacsError as wrong:\n    print(wrong)\n'
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, cwd=tmp_path, check=True)
    assert done.stdout == (
        'workers=2: every worker would run mine.py again; put what it does under `if __name__ == "__main__":`, or say workers=1\n'
    )
