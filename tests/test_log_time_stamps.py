"""Time stamps of real logs: each step over its own interval, gaps predicted, what comes twice taken once."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from numpy.typing import NDArray

from models.attitude import quaternion
from sim.loop.build import build_estimators
from sim.replay.flight_log import FlightLog, read
from sim.replay.log_columns import columns_of
from sim.replay.replay import replay
from sim.replay.setting import choose, setting
from sim.scenario.files import load
from sim.user_code.user_code import UserCode

Array = NDArray[np.floating]

SPIN = np.array([0.0, 0.0, 0.4])  # rad/s about a principal axis: without torques it stays
SCENARIO = load("nacs/fault-free", {"plant.inertia_kg_m2": [0.02, 0.02, 0.03, 0.0, 0.0, 0.0]})


def spinning(time: Array, path: Path, **more: object) -> Path:
    """A log without noise of a body that spins evenly, wheels at rest."""
    q = quaternion.from_rotation_vector(SPIN * (time - time[0])[:, None])
    columns = {"time_s": time} | dict(zip(("q1", "q2", "q3", "q4"), q.T, strict=True))
    columns |= {f"omega{i + 1}": np.full(len(time), SPIN[i]) for i in (0, 1, 2)}
    columns |= {f"{name}{i}": np.zeros(len(time)) for name in ("wheel", "command") for i in (1, 2, 3, 4)}
    pq.write_table(pa.table({name: pa.array(values) for name, values in (columns | more).items()}), path)
    return path


def jitter(rows: int, seed: int = 0) -> Array:
    """Stamps about 10 ms apart, as a real IMU's file has them: 7.6 to 13 ms, and one interval of 30 ms."""
    each = 0.01 * np.random.default_rng(seed).uniform(0.76, 1.3, rows - 1)
    each[rows // 2] = 0.0302
    return 1.7e9 + np.concatenate([[0.0], np.cumsum(each)])


def estimate(path: Path, names: tuple[str, ...] = ("mekf",)) -> tuple[FlightLog, dict[str, Array]]:
    (log,) = read(path, columns_of(SCENARIO))
    return log, replay(log, choose(SCENARIO, {}, log.loop, list(names))[0], UserCode()).recording.channels


def test_each_step_is_over_its_own_interval(tmp_path: Path) -> None:
    """The very numbers that the filter gives when it is stepped by hand; and a spin that is followed to rounding."""
    time = jitter(200)
    log, channels = estimate(spinning(time, tmp_path / "log.parquet"))
    ticking = SCENARIO.model_copy(update={"run": SCENARIO.run.model_copy(update={"tick_s": log.dt})})
    (filter_,) = build_estimators(choose(ticking, {}, "loop", ["mekf"])[0], np.zeros(1, np.int64), UserCode(), "loop")
    belief = filter_.initial(log.reading[0])
    known = np.zeros((1, 8))
    for row in np.arange(1, 200):
        cuts = 3 if row == 101 else 1  # three periods without a reading
        for cut in np.arange(cuts):
            reading = log.reading[row] if cut == cuts - 1 else np.full_like(log.reading[row], np.nan)
            belief = filter_.step(belief, known, reading, float(np.diff(time)[row - 1] / cuts))
        np.testing.assert_allclose(channels["mekf/mean"][row], belief.mean[0], rtol=0, atol=1e-15)
        np.testing.assert_allclose(channels["mekf/nis"][row], belief.nis[0], rtol=1e-9, atol=1e-20)
    turned = quaternion.angle(channels["mekf/mean"][:, 0, :4], log.reading[:, 0, :4])
    assert turned.max() < 1e-6  # 2e-7 rad: stamps of an epoch clock are rounded to 2e-7 s
    step = 0.4 * np.abs(np.diff(time) - log.dt).max()
    assert step > 4e-3  # what a step over the period would be off by at the gap


def test_a_gap_is_prediction(tmp_path: Path) -> None:
    """Nothing is read for 0.7 s: just before the next reading the body has turned by 0.7 s of its rate, and the filter is as unsure."""
    time = np.concatenate([np.arange(50) * 0.1, 4.9 + 0.7 + np.arange(20) * 0.1])
    silent = {"wheel1": np.where(np.arange(70) == 50, np.nan, 0.0)}
    path = spinning(time, tmp_path / "log.parquet", **silent)
    table = pq.read_table(path)
    for name in ("q1", "q2", "q3", "q4", "omega1", "omega2", "omega3", "wheel2", "wheel3", "wheel4"):
        values = np.where(np.arange(70) == 50, np.nan, np.array(table[name]))
        table = table.set_column(table.column_names.index(name), name, pa.array(values))
    pq.write_table(table, path)
    log, channels = estimate(path)
    whole, same = estimate(spinning(np.arange(76) * 0.1, tmp_path / "whole.parquet"))
    assert len(channels["mekf/mean"]) == 70
    expected = quaternion.from_rotation_vector(SPIN * time[50])
    assert quaternion.angle(channels["mekf/mean"][50, 0, :4], expected) < 1e-9
    silence = np.where((np.arange(76) > 49) & (np.arange(76) < 57), np.nan, 1.0)[:, None, None]
    flown = replay(FlightLog("loop", 0.1, log.trials, whole.time, whole.reading * silence, whole.known, whole.truth, None),
                   choose(SCENARIO, {}, "loop", ["mekf"])[0], UserCode()).recording.channels  # fmt: skip
    np.testing.assert_allclose(channels["mekf/sigma"][50], flown["mekf/sigma"][56], rtol=1e-12)
    np.testing.assert_allclose(channels["mekf/sigma"][51:], flown["mekf/sigma"][57:], rtol=1e-12)
    grown = channels["mekf/sigma"][50] / same["mekf/sigma"][56]
    assert (grown[:, :6] > 1.2).all()
    assert (grown[:, 6:] > 1.0).all()  # wheels that stand still stick, so that nothing adds up


def test_a_row_that_comes_twice_is_taken_once_and_said(nacs, tmp_path: Path) -> None:
    """Of two sensors' rows of one instant each gives what it has."""
    time = np.arange(60) * 0.1
    spinning(time, tmp_path / "once.parquet")
    once = pq.read_table(tmp_path / "once.parquet")
    row = {name: once[name].to_numpy()[[20]] for name in once.column_names}
    imu = row | {name: np.array([np.nan]) for name in once.column_names if name.startswith("wheel")}
    wheels = row | {name: np.array([np.nan]) for name in once.column_names if name[0] in "qo"}
    parts = [once.slice(0, 20), pa.table(imu), pa.table(wheels), once.slice(21, 20), once.slice(40, 1), once.slice(40)]
    pq.write_table(pa.concat_tables(parts), tmp_path / "twice.parquet")
    (log,) = read(tmp_path / "twice.parquet", columns_of(SCENARIO))
    (same,) = read(tmp_path / "once.parquet", columns_of(SCENARIO))
    for part in ("time", "reading", "known"):
        np.testing.assert_array_equal(getattr(log, part), getattr(same, part))
    result = nacs("replay", "twice.parquet", "--filter", "mekf", "--out", "it")
    assert (result.code, result.err.count("\n")) == (0, 1)
    assert "trial 0: 3 rows with the time stamp of the row before, first at 2 s" in result.err
    assert pq.read_table(tmp_path / "it" / "estimates.parquet")["time_s"].to_pylist() == time.tolist()


def test_rounded_stamps_of_an_even_log_are_even(tmp_path: Path) -> None:
    """A clock that counts from 1970 has steps of 2e-7 s in double precision; that is no jitter."""
    for start in (0.0, 1.7e9):
        (log,) = read(spinning(start + np.arange(100) * 0.01, tmp_path / "log.parquet"), columns_of(SCENARIO))
        assert log.intervals is None
        assert log.dt == 0.01


def test_flights_of_other_clocks_are_trials_of_one_file(nacs, tmp_path: Path) -> None:
    """Each with its own stamps, rows of them in any order among each other."""
    first, second = (pq.read_table(spinning(jitter(rows, rows), tmp_path / "one.parquet")) for rows in (80, 120))
    parts = [table.append_column("trial", pa.array([number] * len(table))) for number, table in ((3, first), (12, second))]
    mixed = pa.concat_tables([parts[1].slice(0, 60), parts[0], parts[1].slice(60)])
    pq.write_table(mixed, tmp_path / "both.parquet")
    result = nacs("replay", "both.parquet", "--filter", "mekf", "--filter", "nis-fading", "--out", "it")
    assert (result.code, result.err) == (0, ""), result.err
    found = pq.read_table(tmp_path / "it" / "estimates.parquet").filter(pa.compute.field("filter") == "mekf")
    for table, number in ((first, 3), (second, 12)):
        own = found.filter(pa.compute.field("trial") == number)
        assert own["time_s"].to_pylist() == table["time_s"].to_pylist()
        assert np.abs(np.array(own["q3"]) - np.array(table["q3"])).max() < 1e-6
    assert json.loads((tmp_path / "it" / "summary.json").read_text())["trials"] == 2


def test_what_is_wrong_with_stamps_and_cannot_be_helped_is_one_line(nacs, tmp_path: Path) -> None:
    time = np.arange(60) * 0.1
    restart = np.concatenate([time, time])
    for number, (stamps, said) in enumerate(((restart, "time_s runs backwards: 5.9 s is followed by 0 s"), (time * 0 + 3.0, "single row"))):
        spinning(stamps, tmp_path / f"{number}.parquet")
        result = nacs("replay", f"{number}.parquet", "--filter", "mekf")
        assert (result.code, result.err.count("\n"), result.out) == (2, 1, "")
        assert f"{number}.parquet: trial 0" in result.err
        assert said in result.err


@pytest.mark.parametrize("names", [("pf",), ("aukf",)])
def test_other_filters_take_the_interval_too(tmp_path: Path, names: tuple[str, ...]) -> None:
    scenario = setting({}, "log", None, {"observers.pf": {"type": "pf", "particles": 100}, "observers.aukf": {"type": "aukf"}})  # fmt: skip
    (log,) = read(spinning(jitter(100), tmp_path / "log.parquet"), columns_of(scenario))
    mean = replay(log, choose(scenario, {}, "loop", list(names))[0], UserCode()).recording.channels[f"{names[0]}/mean"]
    assert quaternion.angle(mean[..., :4], log.reading[..., :4]).max() < 2e-3
