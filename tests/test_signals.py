"""Signals: every number of a recording under its name, in memory and in `signals.parquet`, for every family."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from sim.bad_input import BadInput
from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.loop.recording import Recording
from sim.scenario.files import load
from sim.series.signals import long_table
from sim.series.signals.of_recordings import signals_of
from sim.series.signals.signal import Signals

ROOT = Path(__file__).parents[1]
TICKS, TRIALS = 3, 2
# columns of each channel by hand, in the order of its components; of an observer's under `*/`
QUATERNION, XYZ, WHEELS = ["q1", "q2", "q3", "q4"], ["x", "y", "z"], ["1", "2", "3", "4"]
STATE = [*QUATERNION, *(f"rate_{i}" for i in XYZ), *(f"wheel_speed{i}" for i in WHEELS)]
RODRIGUES = [f"{of}{i}" for of in ("sigma", "sigma_rate", "sigma_acceleration") for i in "123"]
MOTION = ["position_x", "position_y", "velocity_x", "velocity_y"]
ONE_NUMBER = {"*/nees": "nees/*", "*/nis": "nis/*", "*/dof": "dof/*", "*/statistic": "statistic/*", "*/declared": "declared/*"}
BODY = {
    "truth/state": [f"truth/{c}" for c in STATE],
    "reading": [f"reading/{c}" for c in STATE],
    "torque_B": [f"torque_demanded/{i}" for i in XYZ],
    "command": [f"command/wheel{i}" for i in WHEELS],
    "applied": [f"torque_applied/wheel{i}" for i in WHEELS],
    "reference/q": [f"reference/{c}" for c in QUATERNION],
    "reference/omega": [f"reference/rate_{i}" for i in XYZ],
    "reference/alpha": [f"reference/acceleration_{i}" for i in XYZ],
    "*/mean": [f"estimate/*/{c}" for c in STATE],
    "*/sigma": [f"sigma/*/{c}" for c in [f"rotation_{i}" for i in XYZ] + STATE[4:]],
}
FORMATION = {
    "truth/state": [f"truth/{c}" for c in RODRIGUES[:6]],
    "truth/q_BN": [f"truth/{c}" for c in QUATERNION],
    "truth/wheel_speed": [f"truth/wheel_speed{i}" for i in WHEELS],
    "reading": [f"reading/{c}" for c in RODRIGUES[:3]],
    "torque_B": [f"torque_demanded/{i}" for i in XYZ],
    "applied": [f"torque_applied/{i}" for i in XYZ],
    "wheel_torque": [f"torque_applied/wheel{i}" for i in WHEELS],
    "known": [f"told/{of}_{i}" for of in ("torque", "momentum") for i in XYZ],
    "control/acceleration": [f"control/{c}" for c in RODRIGUES[6:]],
    "reference/leader": [f"leader/{c}" for c in RODRIGUES],
    "*/mean": [f"estimate/*/{c}" for c in RODRIGUES[:6]],
    "*/sigma": [f"sigma/*/{c}" for c in RODRIGUES[:6]],
}
CONSENSUS = {
    "truth/state": [f"truth/{c}" for c in MOTION],
    "reading": [f"reading/{c}" for c in MOTION],
    "estimate": [f"feedback/{c}" for c in MOTION],
    "force": ["force_applied/x", "force_applied/y"],
    "unknown": ["force_unknown/x", "force_unknown/y"],
    "learned": ["force_learned/x", "force_learned/y"],
    "known": ["told/force_x", "told/force_y", "told/surface_x", "told/surface_y"],
    "reference/leader": ["leader/position_x", "leader/position_y"],
    "reference/leader_rate": ["leader/velocity_x", "leader/velocity_y"],
    "weights": [f"weights/{i}" for i in range(1, 27)],
    "*/mean": [f"estimate/*/{c}" for c in MOTION],
    "*/sigma": [f"sigma/*/{c}" for c in MOTION],
}
# scenario, loops, columns by hand, and what else it has: columns that are checked apart, channels that are no signals
CASES: dict[str, tuple[tuple[str, ...], dict[str, list[str]], str, set[str]]] = {
    "nacs/disturbance": (("loop",), BODY, ("truth/angle", "truth/mass_"), {"truth/qpos", "truth/qvel", "fault"}),
    "formation/nacs": (("aukf", "pf"), FORMATION, "received/", {"truth/qpos", "messages/received"}),
    "consensus/fault-free": (("mupf-b", "none"), CONSENSUS, "-", {"truth/qpos"}),
}


def flown(name: str, loops: tuple[str, ...], ticks: int = TICKS, trials: int = TRIALS) -> tuple[Any, dict[str, Recording]]:
    phases = {} if name.startswith("consensus/") else {"phases": {}}
    scenario = load(name, {"run.ticks": ticks, "run.trials": trials, "faults": [], **phases})
    return scenario, {loop: run(build(scenario, np.arange(trials), None, None, loop)) for loop in loops}


@pytest.fixture(scope="module", params=CASES)
def case(request, tmp_path_factory) -> tuple[str, Any, dict[str, Recording], Signals, Path]:
    scenario, recordings = flown(request.param, CASES[request.param][0])
    signals, path = signals_of(scenario, recordings), tmp_path_factory.mktemp("it") / "signals.parquet"
    long_table.write(path, signals, request.param)
    return request.param, scenario, recordings, signals, path


def expected(recording: Recording, by_hand: dict[str, list[str]], agents: int) -> dict[str, tuple[str, np.ndarray]]:
    """Column -> channel and values (trials, agents, ticks)."""
    shape, found = (TRIALS, agents, TICKS), {}
    for channel, array in recording.channels.items():
        observer = next((o for o in recording.observers if channel.startswith(f"{o}/")), "")
        key = f"*/{channel.removeprefix(f'{observer}/')}" if observer else channel
        scalar = {"fault": "fault", "*/ess": "effective_particles/*", "*/lost": "repairs/*"} | ONE_NUMBER
        names = [scalar[key]] if key in scalar else by_hand.get(key, [])
        for i, name in enumerate(names):
            values = array if key in scalar else array[..., i]
            if channel.startswith("reference/"):
                values = np.broadcast_to(values, shape)
            elif agents > 1:
                values = np.moveaxis(values, 0, -1)
            else:
                values = values.T[:, None]
            found[name.replace("*", observer)] = (channel, values)
    return found


def test_every_number_of_the_table_is_the_recordings(case) -> None:
    name, _, recordings, _, path = case
    _, by_hand, apart, others = CASES[name]
    whole = pq.read_table(path)
    for loop, recording in recordings.items():
        table = whole.filter(pa.compute.equal(whole["loop"], loop))
        agents = len(recording.channels["truth/state"][0, 0]) if "agent" in whole.column_names else 1
        right = expected(recording, by_hand, agents)
        assert {channel for channel, _ in right.values()} == set(recording.channels) - (others - {"fault"})
        filled = {c for c in whole.column_names if table[c].null_count < table.num_rows}
        keys = {"loop", "trial", "time_s"} | ({"agent"} if agents > 1 else set())
        assert {c for c in filled - keys if not c.startswith(apart)} == set(right)
        trial, agent, tick = (i.ravel() for i in np.indices((TRIALS, agents, TICKS)))
        np.testing.assert_array_equal(table["trial"], recording.trials[trial])
        np.testing.assert_array_equal(table["time_s"], recording.time[tick])
        if agents > 1:
            np.testing.assert_array_equal(table["agent"], 1 + agent)
        for column, (_, values) in right.items():
            np.testing.assert_array_equal(table[column].to_numpy(), np.ascontiguousarray(values).ravel(), err_msg=column)


def test_a_table_read_back_is_the_same_signals(case) -> None:
    _, _, _, signals, path = case
    again = long_table.read(path)
    assert (again.family, list(again.loops)) == (signals.family, list(signals.loops))
    for loop, own in signals.loops.items():
        assert list(again.loops[loop].signals) == list(own.signals)
        np.testing.assert_array_equal(again.loops[loop].time, own.time)
        for one, other in zip(own, again.loops[loop], strict=True):
            assert (one.dims, one.axes, one.columns, one.values.dtype) == (other.dims, other.axes, other.columns, other.values.dtype)
            np.testing.assert_array_equal(one.values, other.values)


def test_columns_say_unit_frame_and_meaning(case) -> None:
    *_, path = case
    for field in pq.read_schema(path):
        said = {key.decode(): value.decode() for key, value in field.metadata.items()}
        assert said["meaning"], field.name
        assert field.name in ("loop", "trial", "agent", "time_s") or said["unit"], field.name


def test_messages_stand_in_the_rows_of_who_hears() -> None:
    scenario, recordings = flown("formation/nacs", ("truth",))
    recording, received = recordings["truth"], signals_of(scenario, recordings).loops["truth"]["received"].values
    ways = scenario.communication().ways
    assert np.isnan(received).sum() == TRIALS * TICKS * (6 * 7 - len(ways))
    for way, (receiver, sender) in enumerate(ways):
        np.testing.assert_array_equal(received[:, receiver, :, sender], recording.channels["messages/received"][..., way].T)


def test_hinges_are_mujocos() -> None:
    scenario, recordings = flown("antenna-mapping/panelsat", ("adaptive",))
    recording, loop = recordings["adaptive"], signals_of(scenario, recordings).loops["adaptive"]
    qpos = recording.channels["truth/qpos"]  # a free joint first, of three components of position and a quaternion, scalar first
    np.testing.assert_array_equal(loop["truth/position"].values, np.swapaxes(qpos[..., :3], 0, 1))
    np.testing.assert_array_equal(loop["truth/attitude"].values[..., 3], qpos[..., 3].T)
    np.testing.assert_array_equal(loop["truth/angle"].values, np.swapaxes(qpos[..., 7:], 0, 1))
    np.testing.assert_array_equal(loop["truth/angle_rate"].values, np.swapaxes(recording.channels["truth/qvel"][..., 6:], 0, 1))
    assert loop["control/compliance"].columns == ("control/compliance_azimuth", "control/compliance_elevation")
    np.testing.assert_array_equal(loop["control/lead"].values, np.swapaxes(recording.channels["control/theta"][..., 1], 0, 1))


def test_balance_masses_slide_and_wheels_turn() -> None:
    """Of the testbed's model: a ball joint, four wheels, three masses along rails."""
    scenario, recordings = flown("nacs/disturbance", ("loop",))
    recording, loop = recordings["loop"], signals_of(scenario, recordings).loops["loop"]
    qpos, qvel = (np.swapaxes(recording.channels[f"truth/{name}"], 0, 1) for name in ("qpos", "qvel"))
    masses, wheels = loop["truth/mass_position"], loop["truth/angle"]
    assert (masses.unit, masses.axes[0].labels) == ("m", ("balance_x", "balance_y", "balance_z"))
    assert (wheels.unit, wheels.axes[0].labels) == ("rad", ("wheel_1", "wheel_2", "wheel_3", "wheel_4"))
    np.testing.assert_array_equal(masses.values, qpos[..., 8:])
    np.testing.assert_array_equal(wheels.values, qpos[..., 4:8])
    np.testing.assert_array_equal(loop["truth/mass_speed"].values, qvel[..., 7:])


def test_no_name_stands_for_two(case) -> None:
    for loop in case[3].loops.values():
        columns = [column for signal in loop for column in signal.columns]
        assert len(set(columns)) == len(columns)
        assert len({signal.variable for signal in loop}) == len(loop.signals)


@pytest.mark.parametrize(
    ("name", "loop"),
    [
        ("nacs/three-rates", "loop"),
        ("nacs/learned-dynamics", "learned"),
        ("nacs/imm-wheel-failure", "pd-imm-realloc"),
        ("nacs/unfalsified", "adaptive"),
        ("monolithic/fault-free", "aukf-printed"),
    ],
)
def test_the_register_knows_every_channel(name: str, loop: str) -> None:
    scenario, recordings = flown(name, (loop,), ticks=1, trials=1)
    found = signals_of(scenario, recordings).loops[loop]
    known = {signal.channel for signal in found if "not in the register" not in signal.meaning}
    assert known == set(recordings[loop].channels)


def test_what_the_register_does_not_know_is_kept_as_it_is() -> None:
    scenario, recordings = flown("nacs/disturbance", ("loop",))
    noted = np.arange(TICKS * TRIALS * 2.0).reshape(TICKS, TRIALS, 2)
    recordings["loop"].channels["control/own"] = noted
    signal = signals_of(scenario, recordings).loops["loop"]["control/own"]
    assert signal.columns == ("control/own/1", "control/own/2")
    np.testing.assert_array_equal(signal.values, np.swapaxes(noted, 0, 1))


def test_long_runs_are_in_row_groups(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(long_table, "ROWS", 2)
    signals = signals_of(*flown("nacs/disturbance", ("loop",)))
    long_table.write(tmp_path / "signals.parquet", signals, "nacs/disturbance")
    file = pq.ParquetFile(tmp_path / "signals.parquet")
    assert [file.metadata.row_group(i).num_rows for i in range(file.num_row_groups)] == [2, 1, 2, 1]
    again = long_table.read(tmp_path / "signals.parquet").loops["loop"]
    np.testing.assert_array_equal(again["truth/rate"].values, signals.loops["loop"]["truth/rate"].values)


def test_another_table_is_no_file_of_signals(tmp_path: Path) -> None:
    pq.write_table(pa.table({"loop": ["loop"]}), tmp_path / "signals.parquet")
    with pytest.raises(BadInput, match=r"signals.parquet: is no file of signals that `nacs run` wrote \(it lacks the description"):
        long_table.read(tmp_path / "signals.parquet")


def test_a_table_that_was_cut_is_refused(case) -> None:
    path = case[-1].with_name("cut.parquet")
    pq.write_table(pq.read_table(case[-1]).slice(0, 5), path)
    with pytest.raises(BadInput, match=r"cut.parquet: has 5 rows"):
        long_table.read(path)


def test_the_page_of_signals_is_what_the_register_says() -> None:
    page = runpy.run_path(str(ROOT / "docs" / "signals.py"))["PAGE"]
    assert page == (ROOT / "docs" / "signals.md").read_text(encoding="utf-8"), "python docs/signals.py > docs/signals.md"
