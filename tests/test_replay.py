"""Flight logs and their replay: the same numbers as in the loop, a laboratory's own files, and what can be wrong with them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from estimation.consistency import average_test
from models.dynamics.state_layout import StateLayout
from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.loop.recording import Recording
from sim.replay.estimates import estimates
from sim.replay.flight_log import FlightLog, export, read
from sim.replay.flight_log import about as said_by
from sim.replay.log_columns import columns_of
from sim.replay.metrics import evaluate
from sim.replay.replay import Consistency, Replayed, _seen, judge, replay
from sim.replay.setting import choose, setting
from sim.scenario.files import load
from sim.user_code.user_code import UserCode

TRIALS = np.array([2, 5, 6])
GAPS = {
    "run.ticks": 150,
    "faults.0.start_s": 3.0,
    "faults.1.start_s": 9.0,
    "sensors.dropout_probability": 0.1,
    "observers.nis-fading.tuning": "paper",
}
PARTS = ("mean", "sigma", "nees", "nis", "dof", "statistic", "declared")


class Flown(NamedTuple):
    path: Path
    recording: Recording


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Flown:
    scenario = load("nacs/disturbance", GAPS)
    recording = run(build(scenario, TRIALS))
    path = tmp_path_factory.mktemp("log") / "log.parquet"
    export(path, {"loop": recording}, scenario, "nacs/disturbance")
    return Flown(path, recording)


@pytest.fixture
def table(flown: Flown) -> pa.Table:
    """One trial as a laboratory would write it."""
    whole = pq.read_table(flown.path).slice(0, flown.recording.ticks)
    names = [n for n in whole.column_names if not n.startswith("truth_") and n not in ("trial", "tick", "dt")]
    return whole.select(names).replace_schema_metadata(None)


def replaced(table: pa.Table, name: str, values: object) -> pa.Table:
    return table.set_column(table.column_names.index(name), name, pa.array(values))


def run_over(log: FlightLog, scenario: Any, about: dict[str, Any], names: list[str]) -> Replayed:
    return replay(log, choose(scenario, about, "loop", names)[0], UserCode())


def test_replay_gives_every_built_in_observer_to_the_bit(flown: Flown) -> None:
    about = said_by(flown.path)
    scenario = setting(about, "log", None, {})
    (log,) = read(flown.path, columns_of(scenario))
    assert np.isnan(flown.recording.channels["reading"]).any()
    assert flown.recording.channels["nis-fading/declared"].any()
    for name in flown.recording.observers:  # alone, where the loop stepped them as one
        again = run_over(log, scenario, about, [name]).recording
        for part in PARTS:
            np.testing.assert_array_equal(again.channels[f"{name}/{part}"], flown.recording.channels[f"{name}/{part}"], f"{name}/{part}")


def test_a_log_holds_what_the_loop_saw(flown: Flown) -> None:
    about = said_by(flown.path)
    (log,) = read(flown.path, columns_of(setting(about, "log", None, {})))
    channels = flown.recording.channels
    assert list(log.trials) == list(TRIALS)
    assert log.dt == flown.recording.dt
    for name, array in (("reading", log.reading), ("command", log.known), ("truth/state", log.truth), ("fault", log.fault)):
        np.testing.assert_array_equal(array, channels[name])
    assert about["settings"]["observers"]["nis-fading"]["tuning"] == "paper"


def test_the_command_replays_what_another_wrote(nacs, tmp_path: Path) -> None:
    assert nacs("run", "nacs/wheel-failure", "--set", "run.ticks=450", "--set", "faults.0.start_s=20",
                "--set", "faults.0.duration_s=10", "--trials", 2, "--export-log", "--out", "it").code == 0  # fmt: skip
    result = nacs("replay", "it/log.parquet", "--filter", "nis-fading", "--filter", "ekf", "--out", "again")
    assert result.code == 0, result.err
    assert "nacs/wheel-failure" in result.out
    assert {path.name for path in (tmp_path / "again").iterdir()} == {"estimates.parquet", "summary.json", "replay.png"}
    found = pq.read_table(tmp_path / "again" / "estimates.parquet")
    assert found.column_names[:4] == ["trial", "tick", "filter", "loop"]
    assert found.num_rows == 2 * 450
    rows, flown = (json.loads((tmp_path / folder / "summary.json").read_text())["rows"] for folder in ("again", "it"))
    metrics = {"rmse_residual_rate", "rmse_truth_rate", "nees_mean", "nis_mean", "missed_fraction", "detection_delay_s"}
    for row in (r for r in rows if r["metric"] in metrics):
        (same,) = (r for r in pq.read_table(tmp_path / "it" / "trials.parquet").to_pylist()
                   if r["trial"] == 0 and all(r[key] == row[key] for key in ("subject", "metric", "phase")))  # fmt: skip
        assert row["mean"] == same["value"], row
    assert {r["metric"] for r in rows} > metrics | {"declared_fraction", "nis_inside_fraction", "white_fraction"}
    assert flown


def test_a_laboratorys_log_needs_neither_truth_nor_settings(nacs, tmp_path: Path, table: pa.Table, flown: Flown) -> None:
    pq.write_table(table, tmp_path / "lab.parquet")
    result = nacs("replay", "lab.parquet", "--tuning", "paper", "--set", "plant.mass_kg=3.5", "--out", "it")
    assert result.code == 0, result.err
    assert "the NACS as published" in result.out
    assert "truth" not in result.out
    rows = json.loads((tmp_path / "it" / "summary.json").read_text())["rows"]
    assert {row["subject"] for row in rows} == {"ekf", "mekf", "sif", "nis-windowed", "nis-fading"}
    assert not any(row["metric"].startswith(("rmse_truth", "nees")) for row in rows)


def test_trials_may_differ_in_length(tmp_path: Path, table: pa.Table, flown: Flown) -> None:
    short = table.slice(0, 90).append_column("trial", pa.array([7] * 90))
    whole = table.append_column("trial", pa.array([3] * table.num_rows))
    pq.write_table(pa.concat_tables([short, whole]), tmp_path / "both.parquet")
    about = said_by(tmp_path / "both.parquet")
    scenario = setting(about, "log", None, {"sensors.dropout_probability": 0.1})
    two = [run_over(block, scenario, about, ["mekf"]) for block in read(tmp_path / "both.parquet", columns_of(scenario))]
    first, second = sorted((one.recording for one in two), key=lambda r: r.ticks)
    np.testing.assert_array_equal(first.channels["mekf/mean"], second.channels["mekf/mean"][:90])
    found = pa.concat_tables([estimates(one) for one in two])
    assert sorted(set(found["trial"].to_pylist())) == [3, 7]
    assert found.num_rows == 90 + table.num_rows


def test_settings_mean_what_they_mean_in_a_run(flown: Flown) -> None:
    about = said_by(flown.path)
    named = setting(about, "log", "paper", {})
    assert {o.tuning for o in named.observers.values()} == {"paper"}
    common = setting(about, "log", None, {"tuning": "paper", "sensors.set": "paper", "observers.ekf.tuning": "consistent"})
    assert {name: o.tuning for name, o in common.observers.items() if o.tuning != "paper"} == {"ekf": "consistent"}
    assert common.sensors.attitude_noise_rad == pytest.approx(2 * 3e-6**0.5)
    own = setting(about, "log", None, {})
    assert own.observers["nis-fading"].tuning == "paper"
    assert own.observers["ekf"].tuning == "consistent"


def test_consistency_is_judged_with_the_components_that_were_read(tmp_path: Path) -> None:
    scenario = load("nacs/fault-free", {"run.ticks": 200, "sensors.dropout_probability": 0.3})
    export(tmp_path / "log.parquet", {"loop": run(build(scenario, np.arange(10)))}, scenario, "nacs/fault-free")
    (log,) = read(tmp_path / "log.parquet", columns_of(scenario))
    replayed = run_over(log, scenario, {}, ["mekf", "ekf"])
    for name in ("mekf", "ekf"):
        assert judge(replayed, name).nis_inside > 0.85
        nis = replayed.recording.channels[f"{name}/nis"]
        assert average_test(nis, 10, axis=1).fraction_inside < 0.6  # as if nothing had been missing
    gone = np.isnan(log.reading)
    assert np.isnan(replayed.innovation["mekf"][gone[..., 4]][:, 3:6]).all()
    assert np.isfinite(replayed.innovation["mekf"][1:][~gone[1:].any(axis=-1)]).all()


@pytest.mark.parametrize("read", [10, 7, 4])
def test_the_share_of_nis_inside_is_that_of_chi_square_numbers(read: int) -> None:
    """Numbers with so many degrees of freedom in 4000 ticks of five trials: 0.95 of their means are inside, and not of other ones."""
    drawn = np.random.default_rng(read).chisquare(read, (4000, 5))
    white = np.random.default_rng(2).standard_normal((4000, 5, 10))

    def judged(dof: float) -> Consistency:
        channels = {"f/nis": drawn, "f/dof": np.full_like(drawn, dof)}
        return judge(Replayed("loop", Recording(0.1, np.arange(5), channels, {"f": None}), {"f": white}, StateLayout.of_a_body(4)), "f")

    assert judged(read).nis_inside == pytest.approx(0.95, abs=0.014)  # four deviations
    assert judged(read + 1).nis_inside < 0.93
    assert judged(read).white == pytest.approx(0.95, abs=0.06)


def test_an_innovation_is_of_what_was_read_in_its_own_coordinates() -> None:
    """Nothing is predicted at the first tick; then a component of the attitude is missing, and then the speed of the second wheel."""
    body = np.zeros((3, 1, 11))
    body[1, 0, 1] = body[2, 0, 8] = np.nan
    cases = [  # reading, layout, error coordinates, those that are missing at the second tick and at the third
        (body, StateLayout.of_a_body(4), 11, [0, 1, 2, 3], [8]),
        (body, StateLayout.of_a_body(4), 10, [0, 1, 2], [7]),
        (body, StateLayout.of_a_body(4), 6, [0, 1, 2], []),  # wheel speeds are no states
        (body[..., :3], StateLayout.by_rodrigues(1), 6, [1, 3, 4, 5], [3, 4, 5]),  # rates are never read
        (body[..., 5:9], StateLayout.in_the_plane(1), 6, [4, 5], [3, 4, 5]),  # nor what is learned
    ]
    for reading, layout, size, second, third in cases:
        expected = np.ones((3, 1, size))
        expected[0], expected[1, 0, second], expected[2, 0, third] = np.nan, np.nan, np.nan
        np.testing.assert_array_equal(_seen(np.ones((3, 1, size)), reading, layout), expected, err_msg=f"{size} of {reading.shape[-1]}")


def test_the_degrees_of_freedom_of_a_reading_are_ten_and_seven_without_the_gyro() -> None:
    silent = {"kind": "drop-out", "sensor": "gyro", "start_s": 0.5, "duration_s": 0.5}
    blind = {"kind": "drop-out", "sensor": "attitude", "start_s": 1.5, "duration_s": 0.5}
    recording = run(build(load("nacs/fault-free", {"run.ticks": 25, "faults": [silent, blind]}), np.arange(2)))
    for name in recording.observers:  # a unit quaternion's four components count three
        np.testing.assert_array_equal(recording.channels[f"{name}/dof"][1:, 0], np.repeat([10, 7, 10, 7, 10], [4, 5, 5, 5, 5]))


def test_a_log_of_two_rows_is_a_log(tmp_path: Path, table: pa.Table) -> None:
    pq.write_table(table.slice(10, 2), tmp_path / "two.parquet")
    (log,) = read(tmp_path / "two.parquet", columns_of(load("nacs/disturbance")))
    assert (log.reading.shape, log.dt) == ((2, 1, 11), 0.1)


def test_an_attitude_that_is_read_in_part_is_not_read_and_its_sign_says_nothing(tmp_path: Path) -> None:
    """NEES against ten and NIS against the degrees of freedom of what was read, with half of the quaternions turned to -q."""
    scenario = load("nacs/fault-free", {"run.ticks": 200})
    recording = run(build(scenario, np.arange(20)))
    export(tmp_path / "log.parquet", {"loop": recording}, scenario, "nacs/fault-free")
    (log,) = read(tmp_path / "log.parquet", columns_of(scenario))
    random, torn = np.random.default_rng(5), log.reading.copy()
    gone = random.random(torn.shape[:2]) < 0.3
    torn[..., :4] *= random.choice([-1.0, 1.0], torn.shape[:2])[..., None]
    torn[gone, random.integers(0, 4, gone.sum())] = np.nan  # also at the first tick, where filters begin
    names, whole = ["ekf", "mekf"], torn.copy()
    whole[gone, :4] = np.nan
    found, same = (run_over(replace(log, reading=one), scenario, {}, names) for one in (torn, whole))
    for name in names:
        channels = found.recording.channels
        for part in PARTS:
            np.testing.assert_array_equal(channels[f"{name}/{part}"], same.recording.channels[f"{name}/{part}"], f"{name}/{part}")
        dof, nis = channels[f"{name}/dof"], channels[f"{name}/nis"]
        np.testing.assert_array_equal(dof, np.where(gone, 7.0, 10.0))
        assert np.mean(channels[f"{name}/nees"][50:]) == pytest.approx(10.0, rel=0.05)
        assert np.sum(nis[1:]) / np.sum(dof[1:]) == pytest.approx(1.0, abs=0.05)
        assert judge(found, name).nis_inside > 0.85
    apart = np.abs(channels["ekf/mean"][1:, :, 4:] - channels["mekf/mean"][1:, :, 4:]) / channels["mekf/sigma"][1:, :, 3:]
    assert apart.max() < 0.1  # a tenth of a deviation at most, where a wheel that nearly stands sticks in one filter and not in the other


def test_where_nothing_was_read_there_is_no_nis(tmp_path: Path, flown: Flown) -> None:
    about = said_by(flown.path)
    scenario = setting(about, "log", None, {})
    (log,) = read(flown.path, columns_of(scenario))
    silent = log.reading.copy()
    silent[20:40] = np.nan
    silent[60:80, :, :4], silent[60:80, :, 7:] = np.nan, np.nan  # a gyro alone
    names = ["ekf", "mekf", "nis-fading"]
    found = run_over(replace(log, reading=silent), scenario, about, names)
    rows = {(metric.subject, metric.metric): metric.values for metric in evaluate([found], scenario) if metric.phase == "all"}
    for name in names:
        nis, dof = (found.recording.channels[f"{name}/{part}"] for part in ("nis", "dof"))
        assert np.isnan(nis[20:40]).all()
        assert set(np.unique(dof[60:80])) <= {0.0, 3.0}
        there = np.isfinite(nis)
        np.testing.assert_allclose(rows[name, "nis_mean"], [nis[own, i].mean() for i, own in enumerate(there.T)], rtol=1e-12)
        np.testing.assert_allclose(rows[name, "nis_dof_mean"], [dof[own, i].mean() for i, own in enumerate(there.T)], rtol=1e-12)
    nothing = run_over(replace(log, reading=np.where(np.arange(len(silent))[:, None, None] > 0, np.nan, silent)), scenario, about, ["ekf"])
    (mean,) = (m.values for m in evaluate([nothing], scenario) if (m.metric, m.phase) == ("nis_mean", "all"))
    assert np.isnan(mean).all()  # not zero, which would be a filter far too sure of itself
    declared = estimates(found)
    by_filter = dict(zip(declared["filter"].to_pylist(), declared["declared"].to_pylist(), strict=True))
    assert by_filter["ekf"] is None  # it has no detector, so it does not say that all is well
    assert by_filter["nis-fading"] is not None


def wrong_logs(table: pa.Table) -> dict[str, tuple[pa.Table, list[str]]]:
    time = table["time_s"].to_numpy()
    back, away, text = time.copy(), time.copy(), ["a"] * len(time)
    back[[50, 51]] = back[[51, 50]]
    away[50:] += 2000.0
    infinite, scaled = table["omega1"].to_numpy().copy(), table["q4"].to_numpy() * 2.0
    infinite[3] = np.inf
    silent = [None, *table["command2"].to_pylist()[1:]]
    return {
        "columns": (table.drop_columns(["omega2", "command4"]), ["lacks columns omega2, command4", "docs/replay.md"]),
        "empty": (table.slice(0, 0), ["is empty"]),
        "one row": (table.slice(0, 1), ["trial 0", "single row"]),
        "back": (replaced(table, "time_s", back), ["trial 0", "time_s runs backwards", "5.1 s is followed by 5 s", "sort the rows"]),
        "gap": (replaced(table, "time_s", away), ["trial 0", "nothing was read for 2000.1 s after 4.9 s", "`trial` number of its own"]),
        "other dt": (table.append_column("dt", pa.array([0.2] * len(time))), ["dt says 0.2 s, but time_s grows by 0.1 s"]),
        "trial": (table.append_column("trial", pa.array([0.2] * 20 + [0.7] * (len(time) - 20))), ["trial 0.2 in row 0", "0, 1, 2"]),
        "negative trial": (table.append_column("trial", pa.array([-1] * len(time))), ["trial -1 in row 0"]),
        "other plant": (
            table.append_column("wheel5", table["wheel4"]).append_column("command5", table["command4"]),
            ["wheel5, command5", "nacs"],
        ),
        "twice": (table.append_column("omega2", table["omega2"]), ["two columns omega2"]),
        "loop": (replaced(table, "loop", [3] * len(time)), ["column loop", "names of loops"]),
        "no such loop": (replaced(table, "loop", ["x"] * len(time)), ["column loop says x", "has loop"]),
        "time of day": (replaced(table, "time_s", pa.array(np.arange(len(time)), pa.timestamp("ms"))), ["time_s holds timestamp[ms]"]),
        "truth": (table.append_column("truth_q1", pa.array([np.inf] * len(time))), ["truth_q1, row 0", "finite"]),
        "text": (replaced(table, "omega1", text), ["omega1", "string", "not numbers"]),
        "infinite": (replaced(table, "omega1", infinite), ["omega1, row 3", "finite"]),
        "quaternion": (replaced(table, "q4", scaled), ["unit quaternion", "scalar last"]),
        "command": (replaced(table, "command2", silent), ["command2 is missing at 0 s"]),
        "period": (table.append_column("dt", pa.array([0.1] * 20 + [0.2] * (len(time) - 20))), ["dt changes from 0.1 s to 0.2 s"]),
    }


WRONG = (
    "columns", "empty", "one row", "back", "gap", "other dt", "trial", "negative trial", "other plant", "twice", "loop", "no such loop",
    "time of day", "truth", "text", "infinite", "quaternion", "command", "period",
)  # fmt: skip


@pytest.mark.parametrize("what", WRONG)
def test_a_wrong_log_is_one_line_and_writes_nothing(nacs, tmp_path: Path, table: pa.Table, what: str) -> None:
    wrong, wanted = wrong_logs(table)[what]
    pq.write_table(wrong, tmp_path / "lab.parquet")
    result = nacs("replay", "lab.parquet", "--filter", "ekf")
    assert (result.code, result.err.count("\n"), result.out) == (2, 1, "")
    for part in ["lab.parquet", *wanted]:
        assert part in result.err
    assert [path.name for path in tmp_path.iterdir()] == ["lab.parquet"]


ARGUMENTS = [
    (["nowhere.parquet"], ["nowhere.parquet: does not exist"]),
    (["."], [".: is a folder", "log.parquet"]),
    (["text.parquet"], ["text.parquet", "no Parquet file"]),
    (["lab.parquet/log.parquet"], ["lab.parquet/log.parquet", "cannot be read"]),
    (["x" * 300], ["cannot be read", "too long"]),
    (["lab.parquet", "--filter", "ukff"], ["--filter ukff", "no such filter", "ekf, mekf, sif"]),
    (["lab.parquet", "--tuning", "best"], ["--tuning best", "paper, consistent"]),
    (["lab.parquet", "--set", "plant.mas_kg=3"], ["lab.parquet", "plant.mas_kg", "mass_kg"]),
    (["lab.parquet", "--observer", "mine.py:Mine"], ["mine.py", "No such file"]),
]


@pytest.mark.parametrize(("arguments", "wanted"), ARGUMENTS, ids=[" ".join(a)[:40] for a, _ in ARGUMENTS])
def test_a_wrong_argument_is_one_line(nacs, tmp_path: Path, table: pa.Table, arguments: list[str], wanted: list[str]) -> None:
    pq.write_table(table, tmp_path / "lab.parquet")
    (tmp_path / "text.parquet").write_text("q1,q2\n")
    result = nacs("replay", *arguments)
    assert (result.code, result.err.count("\n"), result.out) == (2, 1, ""), result.err
    for part in wanted:
        assert part in result.err
    assert len(list(tmp_path.iterdir())) == 2


def test_metadata_of_another_program_are_one_line(nacs, tmp_path: Path, table: pa.Table) -> None:
    deep = "[" * 100_000 + "]" * 100_000
    free = '{"settings": {"plant": {"type": "rigid"}}}'
    for number, metadata in enumerate(('{"settings": {"plant": 1}}', '{"settings": 3}', "[1]", "{", deep, '{"scenario": 1}', free)):
        pq.write_table(table.replace_schema_metadata({"nacs": metadata}), tmp_path / f"{number}.parquet")
        result = nacs("replay", f"{number}.parquet")
        assert (result.code, result.err.count("\n")) == (2, 1), result.err
        assert f"{number}.parquet" in result.err
        assert len(list(tmp_path.iterdir())) == number + 1


def test_what_a_log_says_of_itself_is_text_and_need_not_be_all(nacs, tmp_path: Path, flown: Flown) -> None:
    """Square brackets are no markup, and a scenario without a name is one all the same."""
    whole = pq.read_table(flown.path)
    about = said_by(flown.path)
    for number, (named, seen) in enumerate((({"scenario": "[/] mine"}, "[/] mine"), ({}, "without a name"))):
        metadata = {"nacs": json.dumps({"settings": about["settings"]} | named)}
        pq.write_table(whole.replace_schema_metadata(metadata), tmp_path / f"[b]{number}.parquet")
        result = nacs("replay", f"[b]{number}.parquet", "--filter", "mekf", "--out", f"[new]{number}")
        assert (result.code, result.err) == (0, ""), result.err
        assert seen in result.out
        assert f"[new]{number}/estimates.parquet" in result.out
        assert f"Replay of [b]{number}.parquet" in result.out


def test_a_particle_filter_replays_to_the_bit_and_runs_over_any_log(nacs, tmp_path: Path, table: pa.Table) -> None:
    """Its random numbers are those of the run: of the log's seed, its name and the trials that the log has."""
    filters = (
        "--set",
        "observers={nis-fading={type='nis-switched', smoothing='fading'}, pf={type='pf', particles=50}}",
        "--set",
        "run.ticks=60",
        "--set",
        "run.seed=17",
    )
    undrawn = ("--without", "report", "--without", "recording")
    assert nacs("run", "nacs/fault-free", *filters, *undrawn, "--trials", 3, "--export-log", "--record-trials", 3, "--out", "it").code == 0
    whole = pq.read_table("it/log.parquet")
    some = whole.filter(pa.array(np.array(whole["trial"]) != 1))
    pq.write_table(some, "some.parquet")
    result = nacs("replay", "some.parquet", "--filter", "pf", "--out", "again")
    assert result.code == 0, result.err
    flown = {(r["trial"], r["metric"]): r["value"] for r in pq.read_table("it/trials.parquet").to_pylist() if r["subject"] == "pf"}
    rows = {r["metric"]: r for r in json.loads(Path("again/summary.json").read_text())["rows"] if r["subject"] == "pf"}
    for metric in ("rmse_truth_rate", "nees_mean", "attitude_error_deg"):
        assert {rows[metric]["min"], rows[metric]["max"]} == {flown[0, metric], flown[2, metric]}
    pq.write_table(table, "lab.parquet")
    result = nacs("replay", "lab.parquet", "--filter", "pf", "--out", "lab")
    assert result.code == 0, result.err
    assert set(pq.read_table("lab/estimates.parquet")["filter"].to_pylist()) == {"pf"}


def test_the_columns_are_those_of_the_page() -> None:
    page = (Path(__file__).parents[1] / "docs" / "replay.md").read_text()
    for name in ("trial", "time_s", "dt", "q1", "omega1", "wheel1", "command1", "truth_", "sigma_rotation1", "nis_inside_fraction"):
        assert f"`{name}" in page
    assert columns_of(load("nacs/fault-free")).reading[:4] == ("q1", "q2", "q3", "q4")
