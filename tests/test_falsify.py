"""`nacs falsify`: candidates against a log of another controller, the candidates then flown; its laws and tests against other means."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from numpy.typing import NDArray
from scipy import signal

from control.falsification import Specification, values
from control.integral_control import IntegralControl
from control.verdict import NEVER, judge
from models.attitude import quaternion
from sim.loop.build import assembly_of, build
from sim.loop.closed_loop import run
from sim.replay.axis_record import axis_records
from sim.replay.flight_log import export, read
from sim.replay.log_columns import columns_of
from sim.scenario.files import load

Array = NDArray[np.floating]
EXAMPLES = Path(__file__).parents[1] / "docs" / "examples"
AXES = {"azimuth": 2, "elevation": 0}


def pid(gains: list[tuple[float, float, float, bool]], tick_s: float) -> IntegralControl:
    columns = [np.array(part)[:, None] for part in zip(*gains, strict=True)]
    return IntegralControl(columns[0], columns[1], columns[2], columns[3].astype(bool), tick_s)


# ---- the laws and the tests, by other means


def test_the_fictitious_reference_of_a_law_that_flew_is_the_reference_it_flew() -> None:
    tick, inertia = 0.05, 2.0
    law = pid([(1.5, 0.0, 2.0, False), (1.5, 0.3, 2.0, False), (1.5, 0.3, 2.0, True), (1.5, 0.2, 0.0, True)], tick)
    wanted = np.cumsum(np.random.default_rng(3).normal(size=(400, 1)), axis=0) * 0.01
    shape = (4, 1)
    angle, rate, memory, inverse = np.zeros(shape), np.zeros(shape), law.start(shape), law.start(shape)
    for r in wanted:
        torque, memory = law.torque(memory, r - angle, rate)
        error, inverse = law.error(inverse, torque, rate)
        np.testing.assert_allclose(angle + error, np.broadcast_to(r, shape), rtol=0, atol=1e-9)
        acceleration = (torque + 0.3 * np.sin(angle)) / inertia  # whatever the plant is
        angle, rate = angle + tick * rate, rate + tick * acceleration


def test_the_inverse_of_pid_is_eq_7() -> None:
    tick, (p, i, d) = 1e-3, (2.0, 0.5, 3.0)
    law = pid([(p, i, d, True)], tick)
    time = tick * np.arange(8000)
    torque, memory, found = np.sin(1.3 * time), law.start((1, 1)), []
    for u in torque:
        error, memory = law.error(memory, np.array([u]), np.zeros(1))
        found.append(error[0, 0])
    _, expected, _ = signal.lsim(([1.0, 0.0], [d, p, i]), torque, time)
    np.testing.assert_allclose(found, expected, atol=2e-3)  # of 0.3; the sampling is of first order


def test_the_verdict_is_that_of_whole_signals_and_of_the_conics() -> None:
    random, ticks, trials, tick = np.random.default_rng(8), 300, 2, 0.1
    effort, position = (np.cumsum(random.normal(size=(ticks, trials)), axis=0) * s for s in (0.02, 0.05))
    rate = np.gradient(position, tick, axis=0)
    theta = np.array([[3.0, 1.0], [20.0, 5.0], [0.5, 0.2]])  # (1/C_p, C_d/C_p)
    asked = Specification(zero=0.3, error_bound=1.2, effort_bound=0.2, tick=tick)
    errors = theta[:, 0, None, None] * effort + theta[:, 1, None, None] * rate
    found = judge(asked, np.moveaxis(errors, 1, 0), effort, position, gate=0.05)
    for c, one in enumerate(theta):
        for t in range(trials):
            b, a = signal.bilinear([1.0, 0.3], [1.0, 0.003], fs=1.0 / tick)
            reference = np.cumsum((errors[c, :, t] + position[:, t]) ** 2)
            weighted = [np.cumsum(signal.lfilter(b, a, x / bound) ** 2) for x, bound in ((errors[c, :, t], 1.2), (effort[:, t], 0.2))]
            told = tick * np.cumsum(position[:, t] ** 2) > 0.05
            evidence = asked.start(())
            conic = np.full((ticks, 2), -np.inf)
            for k in range(ticks):
                evidence = asked.record(evidence, effort[k, t], rate[k, t], position[k, t])
                conic[k] = values(asked.tests(evidence), one)
            for test in (0, 1):
                ratio = np.where(told, np.sqrt(weighted[test] / reference), -1.0)
                np.testing.assert_allclose(found.ratio[c, t, test], ratio.max(), rtol=1e-9)
                for failed in (ratio >= 1.0, told & (conic[:, test] >= 0.0)):
                    assert found.first[c, t, test] == (np.argmax(failed) if failed.any() else NEVER)
    assert {True, False} == set((found.first == NEVER).ravel().tolist())  # some tests fail, some do not


def test_a_record_at_rest_tells_nothing() -> None:
    noise = 1e-5 * np.random.default_rng(4).normal(size=(200, 1))
    found = judge(Specification(0.3, 2.25, 0.09, 0.1), 3.0 * noise[:, None], noise, noise, gate=1e-4)
    assert np.isnan(found.ratio).all()
    assert not found.falsified.any()


# ---- another controller's data, and the candidates in flight

LOOPS = {  # of panelsat: lambda 5 rad/s; the log is of the nominal loop, the candidates are flown with its noise
    "nominal": (0.1, 1.0),
    "good": (0.21, 0.7),
    "slow": (0.05, 1.0),
}
FILE = """
axes = ["azimuth", "elevation"]
[specification]
pace_rad_s = 5.0
[candidates.good]
type = "pd"
frequency_rad_s = {good[0]}
damping = {good[1]}
[candidates.slow]
type = "pd"
frequency_rad_s = {slow[0]}
damping = {slow[1]}
"""


def fixed(frequency: float, damping: float, quantum_deg: float) -> dict[str, Any]:
    """A PD law that is never replaced, its gains by the true inertia."""
    law = {"type": "unfalsified", "pace_rad_s": 5.0, "quantum_deg": quantum_deg, "feedback": "measurement", "frozen": True}
    return {"control": law | {"inertia_error": 0.0, "frequency": frequency, "damping": damping}}


def weighted_error(recording: Any, axis: int, pace: float = 5.0, bound: float = 2.25) -> float:
    """||w1 * (r - y)|| / ||r|| of a flight by reference and truth alone, the greatest of all instants after the first 15 s."""
    turn = quaternion.to_rotation_vector
    wanted, angle = turn(recording.channels["reference/q"])[:, axis], turn(recording.channels["truth/state"][..., :4])[:, 0, axis]
    wanted, angle = wanted - angle[0], angle - angle[0]
    zero = 0.3 * pace
    b, a = signal.bilinear([1.0, zero], [1.0, 0.01 * zero], fs=1.0 / recording.dt)
    ratio = np.sqrt(np.cumsum(signal.lfilter(b, a, (wanted - angle) / bound) ** 2) / np.maximum(np.cumsum(wanted**2), 1e-12))
    return float(ratio[round(15.0 / recording.dt) :].max())


@pytest.fixture(scope="module")
def panelsat(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    loops = {name: fixed(*pair, quantum_deg=0.02) for name, pair in LOOPS.items()}
    scenario = load("antenna-mapping/panelsat", {"loops": loops, "identification": None, "run.ticks": 2500, "run.seed": 90101})
    flown = {name: run(build(scenario, np.array([0]), loop=name)) for name in LOOPS}
    path = tmp_path_factory.mktemp("panelsat") / "log.parquet"
    export(path, {"nominal": flown["nominal"]}, scenario, "antenna-mapping/panelsat")
    return path, flown


def test_a_logs_own_law_would_have_been_asked_what_it_was_asked(panelsat) -> None:
    path, flown = panelsat
    scenario = load("antenna-mapping/panelsat", {})
    (log,) = read(path, columns_of(scenario))
    records, notes = axis_records("log", log, assembly_of(scenario))
    assert not notes
    for axis in AXES.values():
        inertia = assembly_of(scenario).inertia[axis, axis]
        law = pid([(inertia * 0.25, 0.0, 2.0 * inertia * 0.5, False)], log.dt)
        record, memory, asked = records[axis], law.start((1, 1)), []
        for torque, rate in zip(record.torque, record.rate, strict=True):
            error, memory = law.error(memory, torque, rate)
            asked.append(error[0, 0])
        wanted = quaternion.to_rotation_vector(flown["nominal"].channels["reference/q"])[:, axis]
        np.testing.assert_allclose(asked + record.angle[:, 0], wanted, atol=1e-8)


def test_panelsat_falsifies_the_bad_candidate_and_the_flight_agrees(nacs, tmp_path: Path, panelsat) -> None:
    path, flown = panelsat
    gains = {name: (5.0 * pair[0], pair[1]) for name, pair in LOOPS.items()}
    (tmp_path / "c.toml").write_text(FILE.format(**gains))
    result = nacs("falsify", path, "--candidates", "c.toml", "--out", "it")
    assert result.code == 0, result.err
    assert {p.name for p in (tmp_path / "it").iterdir()} == {"falsification.json", "falsification.parquet", "falsification.png"}
    rows = json.loads((tmp_path / "it" / "falsification.json").read_text())["rows"]
    assert rows == pq.read_table(tmp_path / "it" / "falsification.parquet").to_pylist()
    assert {(row["candidate"], row["axis"], row["falsified"]) for row in rows} == {
        ("good", "z", False), ("good", "x", False), ("slow", "z", True), ("slow", "x", True)
    }  # fmt: skip
    for row in rows:
        miss = weighted_error(flown[row["candidate"]], "xyz".index(row["axis"]))
        assert (miss >= 1.0) == row["falsified"], (row, miss)
        if row["falsified"]:
            assert row["error_falsified_s"] > {"z": 4.0, "x": 10.0}[row["axis"]]  # when the first slew begins
            assert row["effort_falsified_s"] is None
    assert all(name in result.out for name in ("1 of 2 candidates falsified", "not falsified", "axis z (azimuth), data of nominal"))


@pytest.fixture(scope="module")
def testbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The testbed flown by quaternion feedback on a filter."""
    scenario = load("nacs/fault-free", {"run.ticks": 600, "run.seed": 90102})
    path = tmp_path_factory.mktemp("testbed") / "log.parquet"
    export(path, {"loop": run(build(scenario, np.arange(2)))}, scenario, "nacs/fault-free")
    return path


def test_the_testbed_falsifies_the_bad_candidate_and_the_flight_agrees(nacs, tmp_path: Path, testbed: Path) -> None:
    gains = {"good": (1.4, 0.7), "slow": (0.25, 1.0)}
    (tmp_path / "c.toml").write_text(FILE.format(**gains))
    result = nacs("falsify", testbed, "--candidates", "c.toml", "--out", "it")
    assert result.code == 0, result.err
    rows = pq.read_table(tmp_path / "it" / "falsification.parquet").to_pylist()
    assert {(row["candidate"], row["falsified"]) for row in rows} == {("good", False), ("slow", True)}
    loops = {name: fixed(frequency / 5.0, damping, quantum_deg=0.046) for name, (frequency, damping) in gains.items()}
    scenario = load("nacs/unfalsified", {"loops": loops, "identification": None, "run.ticks": 600, "run.seed": 90103})
    for name in gains:
        flown = run(build(scenario, np.array([0]), loop=name))
        for axis in AXES.values():
            assert (weighted_error(flown, axis) >= 1.0) == (name == "slow")


# ---- candidates of one's own, and what can be wrong

OWN = """
import numpy as np
class Mine:
    def __init__(self, setting):
        self.p, self.d = setting.inertia * 1.05**2, 1.4 * setting.inertia * 1.05
    def torque(self, reference, angle, rate):
        return self.p * (reference - angle) - self.d * rate
    def reference(self, torque, angle, rate):
        return {returned}
"""
ASKED = '[candidates.own]\ntype = "class"\nlaw = "mine.py:Mine"\n'


def test_a_law_of_ones_own_is_judged_as_the_same_law_by_its_gains(nacs, tmp_path: Path, panelsat) -> None:
    (tmp_path / "mine.py").write_text(OWN.format(returned="angle + (torque + self.d * rate) / self.p"))
    twin = '[candidates.same]\ntype = "pd"\nfrequency_rad_s = 1.05\ndamping = 0.7\n'
    (tmp_path / "c.toml").write_text(ASKED + twin)
    result = nacs("falsify", panelsat[0], "--candidates", "c.toml", "--axis", "azimuth", "--out", "it")
    assert result.code == 0, result.err
    one, other = pq.read_table(tmp_path / "it" / "falsification.parquet").to_pylist()
    assert {one["candidate"], other["candidate"]} == {"own", "same"}
    for test in ("error_ratio", "effort_ratio"):
        assert one[test] == pytest.approx(other[test], rel=1e-9)


@pytest.mark.parametrize(
    ("returned", "said"),
    [
        ("angle + (torque - self.d * rate) / self.p", "is not the inverse of torque"),
        ("angle[::-1] * 1.0", "looks ahead"),
        ("angle - angle.mean(axis=1, keepdims=True)", "a trial comes out differently among others than alone"),
        ("angle[:, 0]", "gives shape (40,), needs (ticks, trials) = (40, 3)"),
        ("np.full_like(angle, np.nan)", "is not finite at tick 0"),
        ("nothing", "NameError: name 'nothing' is not defined"),
    ],
)
def test_what_is_wrong_with_a_class_is_said_with_its_line(nacs, tmp_path: Path, panelsat, returned: str, said: str) -> None:
    (tmp_path / "mine.py").write_text(OWN.format(returned=returned))
    (tmp_path / "c.toml").write_text(ASKED)
    result = nacs("falsify", panelsat[0], "--candidates", "c.toml", "--out", "it")
    assert result.code == 2
    assert result.err.startswith("error: mine.py:")
    assert said in result.err
    assert result.err.count("\n") == 1
    assert not (tmp_path / "it").exists()


GOOD = '[candidates.a]\ntype = "pd"\nfrequency_rad_s = 1.0\ndamping = 0.7\n'


@pytest.mark.parametrize(
    ("text", "arguments", "said"),
    [
        (GOOD, ("--axis", "w"), "--axis w: no such axis; there are x, y, z, azimuth, elevation"),
        (GOOD, ("--loop", "adaptive"), "--loop adaptive; there are nominal"),
        (GOOD, ("--set", "nonsense.key=1"), "nonsense: unknown key"),
        ("", (), "candidates: is missing"),
        ("[candidates]\n", (), "candidates: there is none"),
        (GOOD + "proportional_nm = 1.0\n", (), "candidates.a: proportional_nm: give it or frequency_rad_s, one of the two"),
        (GOOD.replace("1.0", "-1.0"), (), "candidates.a.frequency_rad_s"),
        (GOOD.replace('"pd"', '"pie"'), (), "no type is called 'pie'; did you mean pid?"),
        (GOOD.replace('"pd"', '"pid"'), (), "candidates.a.integral_per_s: is missing"),
        (GOOD.replace("1.0", str([float(k + 1) for k in range(5001)])), (), "5001 candidates; at most 5000"),
        ("[specification]\npace_rad_s = 50\n" + GOOD, (), "ask for at most 25 rad/s"),
        (ASKED, (), "mine.py"),
        ("axes = [1]\n" + GOOD, (), "axes.0"),
        ("=", (), "cannot be read as TOML"),
    ],
)
def test_bad_input_is_one_line(nacs, tmp_path: Path, panelsat, text: str, arguments: tuple[str, ...], said: str) -> None:
    (tmp_path / "c.toml").write_text(text)
    result = nacs("falsify", panelsat[0], "--candidates", "c.toml", "--out", "it", *arguments)
    assert result.code == 2, result.out
    assert said in result.err
    assert result.err.count("\n") == 1
    assert not (tmp_path / "it").exists()


def test_an_identification_without_a_sine_for_each_channel_is_refused(nacs) -> None:
    result = nacs("run", "nacs/unfalsified", "--set", "identification.period=20.0")
    assert result.code == 2
    assert "identification: period = 20: has no sine for each channel up to highest = 0.6; needs 20.94" in result.err


def test_a_body_that_turns_about_has_no_axes(nacs, tmp_path: Path, panelsat) -> None:
    table = pq.read_table(panelsat[0])
    turn = np.linspace(0.0, 3.0, table.num_rows)
    q = quaternion.from_rotation_vector(np.stack([0 * turn, 0 * turn, turn], axis=-1))
    names = table.column_names
    for i, name in enumerate(("q1", "q2", "q3", "q4")):
        table = table.set_column(names.index(name), name, pa.array(q[:, i]))
    pq.write_table(table, tmp_path / "log.parquet")
    (tmp_path / "c.toml").write_text(GOOD)
    result = nacs("falsify", "log.parquet", "--candidates", "c.toml", "--trust")
    assert result.code == 2
    assert "the body turns by up to 172 deg" in result.err


def test_missing_readings_and_a_missing_last_command_do_no_harm(panelsat) -> None:
    scenario = load("antenna-mapping/panelsat", {})
    (log,) = read(panelsat[0], columns_of(scenario))
    whole, _ = axis_records("log", log, assembly_of(scenario))
    log.reading[100:103, 0, 2] = np.nan  # one component: no attitude
    log.known[-1] = np.nan
    records, _ = axis_records("log", log, assembly_of(scenario))
    for one, other in zip(records, whole, strict=True):
        assert len(one.angle) == len(other.angle) - 1
        np.testing.assert_array_equal(one.angle[100:103], np.broadcast_to(other.angle[99], (3, 1)))
        np.testing.assert_array_equal(one.angle[103:], other.angle[103:-1])


def test_the_example_runs_and_writes_nothing_unasked(nacs, tmp_path: Path, testbed: Path) -> None:
    result = nacs("falsify", testbed, "--candidates", EXAMPLES / "candidates.toml", "--axis", "y")
    assert result.code == 0, result.err
    assert "of 13 candidates falsified" in result.out
    assert list(tmp_path.iterdir()) == []
