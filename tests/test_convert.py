"""`nacs convert`: logs in others' conventions become the twin's own log again, wrong maps are refused, and maps are proposed."""

from __future__ import annotations

import json
import re
import shutil
import tomllib
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from mcap.writer import Writer
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from models.attitude.quaternion import attitude_matrix
from sim.convert import comma_separated, evidence
from sim.convert.axes import BODY, WORLD, as_quaternion, axes
from sim.convert.column_names import Found, Named, named
from sim.convert.map_file import FileMap, TimeMap
from sim.convert.mapped import seconds
from sim.convert.units import factor
from sim.loop.build import assembly_of, build
from sim.loop.closed_loop import run
from sim.replay.flight_log import export, read
from sim.replay.log_columns import columns_of
from sim.replay.log_file import LogFile
from sim.replay.setting import setting
from sim.scenario.files import load

LEAN: dict[str, object] = {"observers": {"ekf": {"type": "ekf"}}, "control.feedback": "truth", "run.ticks": 120, "run.seed": 5}
Q, OMEGA = ["q1", "q2", "q3", "q4"], ["omega1", "omega2", "omega3"]
WHEEL, COMMAND = ([f"{name}{i}" for i in (1, 2, 3, 4)] for name in ("wheel", "command"))
OWN = ["time_s", *Q, *OMEGA, *WHEEL, *COMMAND]
ROOT = Path(__file__).resolve().parents[1]
SHARED = ROOT.parent / "shared" / "data"  # logs of others, where they stand beside the checkout


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> pd.DataFrame:
    """The twin's own log of a flight with large turns, one trial, with some readings that did not come."""
    scenario = load("nacs/fault-free", LEAN | {"reference.amplitude_deg": [20.0, 15.0, 25.0], "sensors.dropout_probability": 0.05})
    path = tmp_path_factory.mktemp("own") / "log.parquet"
    export(path, {"loop": run(build(scenario, np.array([0])))}, scenario, "nacs/fault-free")
    return pq.read_table(path).to_pandas()


def in_rpm(log: pd.DataFrame) -> pd.DataFrame:
    """Scalar first, deg/s, rpm, mN m."""
    return pd.DataFrame(
        {"t": log["time_s"]}
        | dict(zip(["q_w", "q_x", "q_y", "q_z"], log[["q4", "q1", "q2", "q3"]].to_numpy().T, strict=True))
        | dict(zip(["gx", "gy", "gz"], np.degrees(log[OMEGA].to_numpy()).T, strict=True))
        | dict(zip(["rw1", "rw2", "rw3", "rw4"], log[WHEEL].to_numpy().T * 30.0 / np.pi, strict=True))
        | dict(zip(["u1", "u2", "u3", "u4"], 1e3 * log[COMMAND].to_numpy().T, strict=True))
    )


RPM_MAP = """
[time]
column = "t"
[attitude]
columns = ["q_w", "q_x", "q_y", "q_z"]
order = "scalar-first"
[rate]
columns = ["gx", "gy", "gz"]
unit = "deg/s"
[wheels]
columns = ["rw1", "rw2", "rw3", "rw4"]
unit = "rpm"
[command]
columns = ["u1", "u2", "u3", "u4"]
unit = "mN m"
"""


def in_enu(log: pd.DataFrame) -> pd.DataFrame:
    """SciPy's rotation from a body forward, left, up into east, north, up, inverted; and rates about those axes of the body."""
    flip, enu = np.diag([1.0, -1.0, -1.0]), np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    q = np.full((len(log), 4), np.nan)
    there = log[Q].notna().all(axis=1).to_numpy()
    to_ned = Rotation.from_quat(log[Q].to_numpy()[there]).as_matrix()  # v_N = R v_B, by the same four numbers
    q[there] = Rotation.from_matrix(enu.T @ to_ned @ flip).inv().as_quat()
    rates = log[OMEGA].to_numpy() @ flip
    return log.assign(**dict(zip(Q, q.T, strict=True)), **dict(zip(OMEGA, rates.T, strict=True)))[OWN]


ENU_MAP = f"""
[time]
column = "time_s"
[attitude]
columns = {Q}
direction = "q_NB"
world = "ENU"
body = "FLU"
[rate]
columns = {OMEGA}
body = "FLU"
[wheels]
columns = {WHEEL}
[command]
columns = {COMMAND}
"""


def in_ms(log: pd.DataFrame) -> pd.DataFrame:
    """Whole milliseconds since 1970, wheels and commands of the opposite sign."""
    ms = 1_790_000_000_000 + np.rint(1e3 * log["time_s"]).astype(np.int64)
    return log.assign(stamp=ms, **{name: -log[name] for name in (*WHEEL, *COMMAND)})[["stamp", *OWN[1:]]]


MS_MAP = f"""
[time]
column = "stamp"
unit = "ms"
offset = "first"
[attitude]
columns = {Q}
[rate]
columns = {OMEGA}
[wheels]
columns = {WHEEL}
sign = [-1, -1, -1, -1]
[command]
columns = {COMMAND}
sign = [-1, -1, -1, -1]
"""
CONVENTIONS = {"rpm": (in_rpm, RPM_MAP), "enu": (in_enu, ENU_MAP), "ms": (in_ms, MS_MAP)}


def written(folder: Path, table: pd.DataFrame, said: str) -> tuple[Path, Path]:
    """A laboratory's CSV, with nine digits, and its map."""
    table.to_csv(folder / "lab.csv", index=False, float_format="%.9g")
    (folder / "map.toml").write_text(said)
    return folder / "lab.csv", folder / "map.toml"


def the_same(found: pd.DataFrame, own: pd.DataFrame, tolerance: float = 1e-8) -> None:
    """All readings, commands and instants within the rounding of nine digits, relative to the largest of each column; q and -q are one."""
    q = found[Q].to_numpy() * np.sign(np.sum(found[Q].to_numpy() * own[Q].to_numpy(), axis=1))[:, None]
    for name in OWN:
        one = q[:, Q.index(name)] if name in Q else found[name].to_numpy()
        np.testing.assert_allclose(one, own[name], rtol=0.0, atol=tolerance * np.nanmax(np.abs(own[name])) + 1e-12, err_msg=name)


@pytest.mark.parametrize("name", CONVENTIONS)
def test_a_foreign_convention_gives_the_twins_own_log(nacs, own, tmp_path, name) -> None:
    lab, said = written(tmp_path, CONVENTIONS[name][0](own), CONVENTIONS[name][1])
    result = nacs("convert", lab, "--map", said, "--out", "log.parquet")
    assert (result.code, result.err) == (0, "")
    assert "120 rows of 1 trial of nacs" in result.out
    the_same(pq.read_table("log.parquet").to_pandas(), own)


def test_the_log_can_be_read_and_says_where_it_comes_from(nacs, own, tmp_path) -> None:
    lab, said = written(tmp_path, in_rpm(own), 'scenario = "nacs/disturbance"\n' + RPM_MAP)
    assert nacs("convert", lab, "--map", said).code == 0
    file = LogFile.opened(tmp_path / "lab.parquet")
    assert file.about["converted"]["from"] == "lab.csv"
    assert file.about["converted"]["map"]["wheels"]["unit"] == "rpm"
    scenario = setting(file.about, "log", None, {})
    assert scenario.title == load("nacs/disturbance").title
    (block,) = read(file, columns_of(scenario))
    assert (block.loop, len(block.time), block.dt) == ("loop", 120, 0.1)


@pytest.mark.parametrize("name", CONVENTIONS)
def test_a_map_is_proposed_that_gives_the_twins_own_log(nacs, own, tmp_path, name) -> None:
    """But for what no log can tell: about which axes, and on which side of both, wheels and commands are."""
    lab, _ = written(tmp_path, CONVENTIONS[name][0](own), "")
    result = nacs("convert", lab, "--inspect")
    assert (result.code, result.err) == (0, "")
    proposed = tomllib.loads(result.out)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["lab.csv", "map.toml"]
    if name == "enu":
        assert "world, .body" in result.out
        assert proposed["attitude"]["direction"] == "q_NB"
        proposed["attitude"] |= {"world": "ENU", "body": "FLU"}
        proposed["rate"] |= {"body": "FLU"}
    if name == "ms":
        assert "their sign about the axes of W" in result.out
        assert proposed["time"] == {"column": "stamp", "unit": "ms", "offset": "first"}
        for part in ("wheels", "command"):
            proposed[part] |= {"sign": [-1, -1, -1, -1]}
    (tmp_path / "map.toml").write_text(toml(proposed))
    assert nacs("convert", lab, "--map", "map.toml", "--out", "log.parquet").code == 0
    the_same(pq.read_table("log.parquet").to_pandas(), own)


def toml(said: dict[str, Any]) -> str:
    """Words, and tables of texts, numbers and lists of them, as TOML; JSON spells those alike."""
    words = "".join(f"{key} = {json.dumps(value)}\n" for key, value in said.items() if not isinstance(value, dict))
    tables = {key: value for key, value in said.items() if isinstance(value, dict)}
    return words + "\n".join(f"[{key}]\n" + "\n".join(f"{k} = {json.dumps(v)}" for k, v in table.items()) for key, table in tables.items())


def test_the_example_of_the_documentation_is_what_happens(nacs, tmp_path) -> None:
    """Its map is the file's, its output the command's."""
    page = (ROOT / "docs" / "convert.md").read_text(encoding="utf-8")
    shutil.copytree(ROOT / "docs" / "examples", tmp_path / "docs" / "examples")
    commands = re.findall(r"^\$ nacs (convert .*)$", page, re.M)
    assert len(commands) == 3
    for command in commands:
        result = nacs(*command.split())
        lines = [line.rstrip() for line in (result.out + result.err).strip().splitlines()]
        told = page.split(f"$ nacs {command}\n", 1)[1].split("```", 1)[0].strip().splitlines()
        assert lines == told, command


# ---- what can be wrong with a map


WRONG: dict[str, tuple[str, str, str]] = {  # what is replaced by what, and what is said
    "deg/s": ('unit = "deg/s"', "", "rates look like deg/s; put it right"),
    "order": ('order = "scalar-first"', "", "quaternions look scalar first; put it right"),
    "rpm": ('unit = "rpm"', "", "wheel speeds look like rpm; put it right"),
    "torque": ('unit = "mN m"', "", "commands look like mN m; put it right"),
    "clock": ('column = "t"', 'column = "t"\nunit = "ms"', "times look like s taken for ms; put it right"),
    "a column": ('"gx"', '"g_x"', "rate.columns: lab.csv: has no column 'g_x'; did you mean 'gx'?"),
    "the clock's column": ('column = "t"', 'column = "clock"', "time.column: lab.csv: has no column 'clock'; there are t, q_w"),
    "a column twice": ('"gy"', '"gx"', "rate.columns: names 'gx' twice"),
    "a key": ("[rate]", "[rates]", "rates: unknown key; did you mean rate?"),
    "a unit": ('"deg/s"', '"m/s"', "rate: unit 'm/s' is none of rate; there are rad/s, deg/s, rpm"),
    "axes": ('order = "scalar-first"', 'world = "NEU"', "axes 'NEU': are left-handed"),
    "letters": ('order = "scalar-first"', 'world = "NEX"', "axes 'NEX': needs three letters of N/S, E/W, D/U"),
    "twice an axis": ('order = "scalar-first"', 'body = "FFD"', "axes 'FFD': are not three axes at right angles"),
    "rows": ('order = "scalar-first"', "body = [[1, 0, 0], [0, 1, 0], [0, 0, 0.5]]", "are not three axes at right angles"),
    "a part": ("[wheels]", "[truth_wheels]", 'wheels: is missing; name its columns, or say wheels = "none"'),
    "three wheels": (', "rw4"', "", "wheels: has 3 columns, nacs has 4: wheel1, wheel2, wheel3, wheel4"),
    "two clocks": ('column = "t"', 'column = "t"\nrate_hz = 10', "time: needs either a column or rate_hz"),
    "signs": ('unit = "rpm"', 'unit = "rpm"\nsign = [1, -1]', "sign: has 2 of 4 columns"),
    "a sign": ('unit = "rpm"', 'unit = "rpm"\nsign = [1, 1, 1, 2]', "must be 1 or -1"),
    "axes of motors": ('unit = "mN m"', 'unit = "mN m"\nbody = "FLU"', "motor torques are about the wheels' own axes"),
    "a loop": ("[time]", 'scenario = "nacs/fault-free"\nloop = "pd"\n[time]', "loop = 'pd': nacs/fault-free has loop"),
    "a scenario": ("[time]", 'scenario = "nacs/faultfree"\n[time]', "did you mean nacs/fault-free?"),
    "a column of the log": ("[time]", '[columns]\nq5 = { column = "t" }\n[time]', "columns.q5: is no such column of the log"),
    "several": ("[time]", 'scenario = "formation/nacs"\nloop = "truth"\n[time]', "attitude: is of one body"),
    "syntax": ("[time]", "[time", "cannot be read as TOML"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_map_is_refused_with_the_reason(nacs, own, tmp_path, name) -> None:
    old, new, reason = WRONG[name]
    assert old in RPM_MAP
    written(tmp_path, in_rpm(own), RPM_MAP.replace(old, new, 1))
    result = nacs("convert", "lab.csv", "--map", "map.toml", "--out", "log.parquet")
    assert (result.code, result.out) == (2, "")
    assert reason in result.err
    assert result.err.count("\n") == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["lab.csv", "map.toml"]


def test_a_log_that_looks_wrong_can_be_trusted(nacs, own, tmp_path) -> None:
    lab, said = written(tmp_path, in_rpm(own), RPM_MAP.replace('unit = "deg/s"', ""))
    result = nacs("convert", lab, "--map", said, "--trust")
    assert result.code == 0
    assert "rates look like deg/s; taken as it is" in result.err


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["lab.csv"], "--map: is missing; `nacs convert lab.csv --inspect > map.toml` proposes one"),
        (["lab.csv", "--map", "none.toml"], "--map none.toml: there is no such file"),
        (["lab.csv", "--map", "map.toml", "--out", "map.toml"], "--out map.toml: is there already"),
        (["lab.csv", "--map", "map.toml", "--out", "."], "--out .: is a folder; name a file"),
        (["lab.csv", "--map", "map.toml", "--scenario", "nacs/fault-free"], "--scenario: belongs to --inspect"),
        (["lab.csv", "--inspect", "--out", "log.parquet"], "--inspect: proposes a map and writes nothing"),
        (["lab.csv", "--inspect", "--scenario", "formation/nacs"], "--inspect: knows logs of one body, not of"),
        (["none.csv", "--map", "map.toml"], "none.csv: there is no such file"),
        ([".", "--inspect"], ".: is a folder"),
        (["lab.xls", "--inspect"], "lab.xls: files .xls are not known; there are .csv"),
        (["words.csv", "--inspect"], "words.csv: has no column of numbers"),
        (["twice.csv", "--inspect"], "twice.csv: has two columns a"),
        (["ragged.csv", "--inspect"], "ragged.csv: cannot be read as CSV"),
        (["longer.csv", "--inspect"], "longer.csv: cannot be read as CSV"),
        (["heading.csv", "--inspect"], "heading.csv: has fewer than two rows of numbers"),
        (["bad.mat", "--inspect"], "bad.mat: cannot be read"),
        (["bad.mcap", "--inspect"], "bad.mcap: cannot be read as MCAP"),
        (["bad.h5", "--inspect"], "bad.h5: cannot be read"),
    ],
)
def test_what_cannot_be_read_is_said_in_one_line(nacs, tmp_path, arguments, reason) -> None:
    for name, text in {
        "lab.csv": "t,a\n0,1\n1,2\n",
        "lab.xls": "x",
        "words.csv": "a,b\nx,y\nz,w\n",
        "twice.csv": "a,a\n1,2\n3,4\n",
        "ragged.csv": "a,b\n1,2\n3\n4,5\n",
        "longer.csv": "a,b\n1,2\n3,4\n5,6,7\n",
        "heading.csv": "a,b\n",
        "map.toml": RPM_MAP,
        **dict.fromkeys(("bad.mat", "bad.mcap", "bad.h5"), "no such thing, but long enough to look at " * 9),
    }.items():
        (tmp_path / name).write_text(text)
    result = nacs("convert", *arguments)
    assert (result.code, result.out) == (2, "")
    assert reason in result.err
    assert result.err.count("\n") == 1


# ---- kinds of files


RATE = np.array([[0.3, 1.1, 0.7], [0.2, 0.9, 1.3], [0.25, 0.7, 0.4]])  # of each axis: amplitude rad/s, pulsation rad/s, phase


def tumbling(rows: int, dt: float) -> tuple[Any, Any]:
    """SciPy's rotations from body to world (rows, 4), scalar last, of a body that turns at rates (rows, 3), rad/s, about its own axes."""
    time = dt * np.arange(rows)[:, None]
    rates = RATE[:, 0] * np.sin(RATE[:, 1] * time + RATE[:, 2])
    whole = [Rotation.from_rotvec([0.4, -0.2, 1.0])]
    for step in 0.5 * dt * (rates[1:] + rates[:-1]):
        whole.append(whole[-1] * Rotation.from_rotvec(step))
    return Rotation.concatenate(whole).as_quat(), rates


def test_files_of_a_benchmark_with_a_rate_of_rows_and_matrices(nacs, tmp_path) -> None:
    """HDF5, scalar first, rad/s, no clock; of a body without wheels."""
    q, rates = tumbling(600, 1.0 / 285.7)
    with netCDF4.Dataset(tmp_path / "lab.hdf5", "w") as file:
        for name, size in (("row", 600), ("three", 3), ("four", 4)):
            file.createDimension(name, size)
        file.createVariable("opt_quat", "f8", ("row", "four"))[:] = np.roll(q, 1, axis=1)
        file.createVariable("imu_gyr", "f8", ("row", "three"))[:] = rates
        file.createVariable("imu_acc", "f8", ("row", "three"))[:] = 9.81
        file.createVariable("movement", "i1", ("row",))[:] = 1
    result = nacs("convert", "lab.hdf5", "--inspect", "--scenario", "monolithic/fault-free")
    proposed = tomllib.loads(result.out)
    assert proposed["attitude"]["order"] == "scalar-first"
    assert proposed["attitude"]["direction"] == "q_BN"
    assert proposed["rate"]["unit"] == "rad/s"
    assert proposed["rate"]["sign"] == [1, 1, 1]
    assert proposed["time"]["rate_hz"] == pytest.approx(285.7, rel=0.01)
    assert f"{np.pi / 180.0 * proposed['time']['rate_hz']:.4g} with deg/s" in result.out
    (tmp_path / "map.toml").write_text(result.out)
    result = nacs("convert", "lab.hdf5", "--map", "map.toml", "--out", "log.parquet")
    assert (result.code, result.err) == (0, "")
    assert "Left out   imu_acc(1), imu_acc(2), imu_acc(3), movement" in result.out
    log = pq.read_table("log.parquet").to_pandas()
    np.testing.assert_array_equal(log[Q], q)
    np.testing.assert_array_equal(log[OMEGA], rates)
    assert (log[["torque1", "torque2", "torque3"]] == 0.0).all(axis=None)


def test_a_log_of_an_imu_alone_with_jittering_stamps(nacs, tmp_path) -> None:
    """Headings with units, an accelerometer and a magnetometer beside the gyro: the rates are kept, and every stamp."""
    jitter = np.random.default_rng(3).uniform(-1e-3, 1e-3, 200)
    time, (_, rates) = 0.01 * np.arange(200) + jitter, tumbling(200, 0.01)
    axes = [f"{sensor} {axis} ({unit})" for sensor, unit in (("Gyroscope", "deg/s"), ("Accelerometer", "g")) for axis in "XYZ"]
    rest = np.tile([0.0, 0.0, 1.0], (200, 1))
    table = pd.DataFrame(np.column_stack([time, np.degrees(rates), rest]), columns=["Time (s)", *axes])
    lab, said = written(tmp_path, table, "")
    result = nacs("convert", lab, "--inspect")
    said.write_text(result.out)
    assert 'unit = "deg/s"' in result.out
    assert nacs("convert", lab, "--map", said, "--out", "log.parquet").code == 0
    log = pq.read_table("log.parquet").to_pandas()
    np.testing.assert_allclose(log["time_s"], time, atol=1e-8)
    np.testing.assert_allclose(log[OMEGA], rates, atol=1e-8)
    assert log[[*Q, *WHEEL]].isna().all(axis=None)
    assert (log[COMMAND] == 0.0).all(axis=None)


@pytest.mark.skipif(not SHARED.is_dir(), reason="no logs of others beside the checkout")
def test_logs_that_others_measured(nacs) -> None:
    """BROAD, as its authors describe it: scalar first, IMU to room, rad/s, 285.7 rows a second."""
    result = nacs("convert", next(SHARED.glob("broad/16*.hdf5")), "--inspect", "--scenario", "monolithic/fault-free")
    proposed = tomllib.loads(result.out)
    assert (proposed["attitude"]["order"], proposed["attitude"]["direction"]) == ("scalar-first", "q_BN")
    assert (proposed["rate"]["unit"], proposed["rate"]["sign"]) == ("rad/s", [1, 1, 1])
    assert proposed["time"]["rate_hz"] == pytest.approx(285.7, rel=0.02)
    proposed = tomllib.loads(nacs("convert", SHARED / "fusion" / "sensor_data.csv", "--inspect").out)
    assert (proposed["rate"]["unit"], proposed["time"]["unit"], proposed["attitude"]) == ("deg/s", "s", "none")


def test_mat_files_with_structs_and_matrices(nacs, own, tmp_path) -> None:
    """Quaternions as (4, rows), wheels as (rows, 4), time as a row; of two lengths of rows the map's."""
    log = {"t": own["time_s"].to_numpy(), "q": own[Q].to_numpy().T, "w": own[OMEGA].to_numpy(), "rw": own[WHEEL].to_numpy()}
    savemat(tmp_path / "lab.mat", {"log": log | {"u": own[COMMAND].to_numpy()}, "slow": np.arange(10.0), "name": "x"})
    listed = {key: json.dumps([f"log.{key}({i + 1})" for i in range(n)]) for key, n in (("q", 4), ("w", 3), ("rw", 4), ("u", 4))}
    parts = zip(("attitude", "rate", "wheels", "command"), listed.values(), strict=True)
    said = '[time]\ncolumn = "log.t"\n' + "".join(f"[{key}]\ncolumns = {columns}\n" for key, columns in parts)
    (tmp_path / "map.toml").write_text(said)
    result = nacs("convert", "lab.mat", "--map", "map.toml", "--out", "log.parquet")
    assert (result.code, result.err) == (0, "")
    the_same(pq.read_table("log.parquet").to_pandas(), own)
    (tmp_path / "map.toml").write_text(said.replace("log.t", "slow"))
    result = nacs("convert", "lab.mat", "--map", "map.toml", "--overwrite", "--out", "log.parquet")
    assert result.code == 2
    assert "time has 10 rows, q1 has 120" in result.err


def test_a_robots_log_whose_topics_come_at_their_own_instants(nacs, own, tmp_path) -> None:
    """Commands are written when they change, here each 30 ms before the reading; they are held, readings are not."""
    nanoseconds = np.rint(1e9 * own["time_s"]).astype(np.int64).tolist()
    with (tmp_path / "lab.mcap").open("wb") as file:
        log = Writer(file)
        log.start()
        topics = {name: log.register_channel(name, "json", 0) for name in ("/imu", "/motors")}
        for stamp, row in zip(nanoseconds, own.to_dict("records"), strict=True):
            imu = {"q": [row[name] for name in Q], "rate": [row[name] for name in OMEGA], "wheel": [row[name] for name in WHEEL]}
            plain = {key: value for key, value in imu.items() if not np.isnan(value).any()}
            log.add_message(topics["/motors"], stamp + 70_000_000, json.dumps([row[name] for name in COMMAND]).encode(), 0)
            log.add_message(topics["/imu"], stamp + 100_000_000, json.dumps(plain).encode(), 0)
        log.finish()
    names = {"attitude": ("/imu.q", 4), "rate": ("/imu.rate", 3), "wheels": ("/imu.wheel", 4), "command": ("/motors", 4)}
    parts = {key: {"columns": [f"{name}({i + 1})" for i in range(n)]} for key, (name, n) in names.items()}
    parts["command"]["hold"] = True
    said = {"time": {"column": "log_time", "unit": "ns", "offset": 1e8}, **parts}
    (tmp_path / "map.toml").write_text(toml(said))
    result = nacs("convert", "lab.mcap", "--map", "map.toml", "--out", "log.parquet")
    assert (result.code, result.err) == (0, "")
    found = pq.read_table("log.parquet").to_pandas()
    np.testing.assert_allclose(found["time_s"][:4], [-0.03, 0.0, 0.07, 0.1], atol=1e-12)
    late = found[1::2].reset_index(drop=True)
    for name in (*OMEGA, *WHEEL):
        there = own[[*OMEGA, *WHEEL]].notna().all(axis=1) if name in OMEGA else own[WHEEL].notna().all(axis=1)
        np.testing.assert_array_equal(late[name][there], own[name][there])
    np.testing.assert_array_equal(late[COMMAND], own[COMMAND])
    assert found[OMEGA][::2].isna().all(axis=None)


def test_a_robots_log_with_a_number_that_is_none_is_refused(nacs, tmp_path) -> None:
    with (tmp_path / "lab.mcap").open("wb") as file:
        log = Writer(file)
        log.start()
        log.add_message(log.register_channel("/imu", "json", 0), 0, b'{"a": 1' + b"0" * 400 + b"}", 0)
        log.finish()
    result = nacs("convert", "lab.mcap", "--inspect")
    assert (result.code, result.err.count("\n")) == (2, 1)
    assert "lab.mcap: cannot be read as MCAP" in result.err


# ---- what CSV files are like


@pytest.mark.parametrize(
    "text",
    [
        "t,a\n0,1.5\n1,2.5\n",
        "t;a\n0;1,5\n1;2,5\n",
        "t\ta\r\n0\t1.5\r\n1\t2.5\r\n",
        "# a remark, with a comma\n# another\nt,a\n0,1.5\n1,2.5\n",
        "Logger 7\nSerial 12\n\nt,a\n0,1.5\n1,2.5\n",
        '\ufeff"t","a"\n0,1.5\n1,2.5\n',
        "t a\n0 1,5\n1 2,5\n",
    ],
    ids=["commas", "semicolons and decimal commas", "tabs", "remarks", "a preamble", "quotes and a mark", "spaces"],
)
def test_columns_of_text(tmp_path, text) -> None:
    (tmp_path / "lab.csv").write_bytes(text.encode())
    found = comma_separated.columns(tmp_path / "lab.csv", FileMap())
    assert {name: values.tolist() for name, values in found.items()} == {"t": [0, 1], "a": [1.5, 2.5]}


def test_columns_without_a_heading_and_with_gaps(tmp_path) -> None:
    (tmp_path / "lab.csv").write_text("0,1.5,x\n1,NaN,y\n2,,z\n")
    found = comma_separated.columns(tmp_path / "lab.csv", FileMap())
    assert list(found) == ["column1", "column2"]
    np.testing.assert_array_equal(found["column2"], [1.5, np.nan, np.nan])
    (tmp_path / "lab.csv").write_text('"a, in V",b\n1,2\n3,4\n')
    assert list(comma_separated.columns(tmp_path / "lab.csv", FileMap())) == ["a, in V", "b"]
    (tmp_path / "lab.csv").write_text("when,a\n2026-01-01T00:00:00.000,1\n2026-01-01T00:00:00.250,2\n")
    assert np.diff(comma_separated.columns(tmp_path / "lab.csv", FileMap())["when"]).tolist() == [250_000_000]


# ---- parts of a map


def test_axes_by_letters_and_by_rows() -> None:
    np.testing.assert_array_equal(axes("ENU", WORLD) @ [1.0, 2.0, 3.0], [2.0, 1.0, -3.0])
    np.testing.assert_array_equal(axes("NWU", WORLD) @ [1.0, 2.0, 3.0], [1.0, -2.0, -3.0])
    np.testing.assert_array_equal(axes("flu", BODY) @ [1.0, 2.0, 3.0], [1.0, -2.0, -3.0])
    turn = Rotation.from_euler("ZYX", [0.3, -0.7, 1.1]).as_matrix()
    rows = tuple(tuple(row) for row in turn.tolist())
    np.testing.assert_allclose(attitude_matrix(as_quaternion(axes(rows, BODY))), turn, atol=1e-15)


@pytest.mark.parametrize(
    ("quantity", "unit", "size"),
    [
        ("rate", "dps", np.pi / 180.0),
        ("rate", "°/s", np.pi / 180.0),
        ("rate", "RPM", 2.0 * np.pi / 60.0),
        ("rate", "rad_s", 1.0),
        ("torque", "mNm", 1e-3),
        ("torque", "N*m", 1.0),
        ("torque", "gf cm", 9.80665e-5),
        ("time", "µs", 1e-6),
        ("length", "mm", 1e-3),
        ("rate", 0.5, 0.5),
    ],
)
def test_units(quantity, unit, size) -> None:
    assert factor(quantity, unit) == size


def test_each_flight_has_its_own_first_stamp() -> None:
    stamps, trial = np.array([5_000_000_000_000_000_001, 5_000_000_000_000_000_003, 7, 8]), np.array([1.0, 1.0, 0.0, 0.0])
    found = seconds(stamps, TimeMap(column="t", unit="ns", offset="first"), trial)
    np.testing.assert_array_equal(found, 1e-9 * np.array([0.0, 2.0, 0.0, 1.0]))
    found = seconds(stamps[:2], TimeMap(column="t", unit="ns", offset=5e18))
    np.testing.assert_array_equal(found, 1e-9 * np.array([1.0, 3.0]))


def test_flights_sentinels_and_what_was_true(nacs, own, tmp_path) -> None:
    """Two flights in one file, a number that stands for nothing, the truth, and a period."""
    lab = own.fillna(-999.0).assign(flight=np.repeat([3, 4], 60))
    lab["t"] = np.concatenate([own["time_s"][:60], own["time_s"][:60]])
    truth = "".join(
        f"[truth_{key}]\ncolumns = {json.dumps([f'truth_{name}' for name in names])}\n"
        for key, names in (("attitude", Q), ("rate", OMEGA), ("wheels", WHEEL))
    )
    head = 'trial = "flight"\nmissing = [-999]\ntruth_fault = "truth_fault"\n[time]\ncolumn = "t"\nperiod_s = 0.1\n'
    said = head + ENU_MAP.split("\n", 3)[3].replace('direction = "q_NB"\nworld = "ENU"\nbody = "FLU"\n', "").replace('body = "FLU"\n', "")
    lab, path = written(tmp_path, lab, said + truth)
    result = nacs("convert", lab, "--map", path, "--out", "log.parquet")
    assert (result.code, result.err) == (0, "")
    assert "120 rows of 2 trials" in result.out
    found = pq.read_table("log.parquet").to_pandas()
    assert found["trial"].tolist() == [3] * 60 + [4] * 60
    assert (found["dt"] == 0.1).all()
    for name in (*Q, *OMEGA, *WHEEL, *[f"truth_{name}" for name in (*Q, *OMEGA, *WHEEL)]):
        np.testing.assert_allclose(found[name], own[name], rtol=1e-8, atol=1e-8)
    assert not found["truth_fault"].any()


def test_agents_are_named_column_by_column(nacs, tmp_path) -> None:
    """Of agents in the plane each column of the log is said, with its unit and sign."""
    scenario = load("consensus/fault-free")
    columns = columns_of(scenario)
    needed = [*columns.all(columns.reading), *columns.all(columns.known)]
    time = 0.01 * np.arange(80)
    lab = pd.DataFrame({"t": time} | dict.fromkeys(needed, 0.0))
    lab["agent1_x1"], lab["agent1_v1"] = -1e3 * np.sin(3.0 * time), 3.0 * np.cos(3.0 * time)
    said = f'scenario = "consensus/fault-free"\nloop = "{scenario.loop_names[0]}"\n[time]\ncolumn = "t"\n[columns]\n'
    said += "".join(f'{name} = {{ column = "{name}" }}\n' for name in needed if name != "agent1_x1")
    lab, path = written(tmp_path, lab, said + 'agent1_x1 = { column = "agent1_x1", unit = "mm", sign = -1 }\n')
    result = nacs("convert", lab, "--map", path, "--out", "log.parquet")
    assert (result.code, result.err) == (0, "")
    np.testing.assert_allclose(pq.read_table("log.parquet")["agent1_x1"].to_numpy(), np.sin(3.0 * time), atol=1e-8)
    path.write_text(said)
    assert "columns: lacks agent1_x1" in nacs("convert", lab, "--map", path, "--out", "other.parquet").err


# ---- what names say


def test_names_of_columns() -> None:
    found = named(
        ["Time (ms)", "Q.w", "Q.x", "Q.y", "Q.z", "gyro_x_deg_s", "gyro_y_deg_s", "gyro_z_deg_s", "RW1 [rpm]", "RW2 [rpm]", "flight"]
    )
    assert found.clock == ("Time (ms)", "ms")
    assert found.trial == "flight"
    assert found.groups["attitude"][0].columns == ("Q.x", "Q.y", "Q.z", "Q.w")
    assert found.groups["rate"][0].unit == "deg/s"
    assert found.groups["wheels"] == [Found(("RW1 [rpm]", "RW2 [rpm]"), ("1", "2"), "rpm")]
    assert named(["rw1", "rw2"]).groups["wheels"] == [Found(("rw1", "rw2"), ("1", "2"), None)]
    assert named([f"/wheels.speed_rpm({i})" for i in (1, 2)]).groups["wheels"][0].unit == "rpm"
    assert named(["a", "b"]) == Named(None, None, {})


def test_physics_finds_what_names_do_not_say(nacs, tmp_path) -> None:
    """Columns A to H: the squares of four add up to one, three fit their turns, swapped and with a sign."""
    q, rates = tumbling(300, 0.02)
    swapped = np.degrees(rates)[:, [1, 0, 2]] * [1.0, -1.0, 1.0]
    noise = np.random.default_rng(0).standard_normal((300, 1))
    table = pd.DataFrame(np.column_stack([20.0 * np.arange(300), noise, q, swapped]), columns=list("ABCDEFGHI"))
    lab, _ = written(tmp_path, table, "")
    proposed = tomllib.loads(nacs("convert", lab, "--inspect").out)
    assert proposed["time"] == {"column": "A", "unit": "ms", "offset": 0.0}
    assert proposed["attitude"]["columns"] == list("CDEF")
    assert (proposed["attitude"]["order"], proposed["attitude"]["direction"]) == ("scalar-last", "q_BN")
    assert proposed["rate"] == {"columns": ["H", "G", "I"], "unit": "deg/s", "sign": [-1, 1, 1], "body": "FRD"}


def test_what_nothing_tells_is_said(nacs, tmp_path) -> None:
    """A body at rest."""
    rest = np.tile([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (50, 1))
    table = pd.DataFrame(np.column_stack([0.1 * np.arange(50), rest]), columns=["t", *Q, *OMEGA])
    lab, _ = written(tmp_path, table, "")
    result = nacs("convert", lab, "--inspect")
    assert "# - attitude: order and direction; no turn is seen beside the rates" in result.out
    assert "# - rate.unit: no name says it" in result.out
    assert "# - time.unit: s would make a likely period" in result.out
    assert "# - wheels: no columns are named as wheel speeds are" in result.out


def test_commands_are_given_to_the_wheels_that_follow_them(own) -> None:
    """Two exchanged, one of the opposite sign, in mN m beside rpm."""
    scenario = load("nacs/fault-free")
    commands = own[COMMAND].to_numpy()[:, [1, 0, 2, 3]] * np.array([1e3, 1e3, 1e3, -1e3])
    inertia = assembly_of(scenario).wheel_inertia
    verdict = evidence.driving(own["time_s"].to_numpy(), own[WHEEL].to_numpy() * 30.0 / np.pi, commands, inertia)
    assert verdict is not None
    assert verdict.best == evidence.Driving("rpm", "mN m", (1, 0, 2, 3), (1, 1, 1, -1))


def test_nothing_is_held_from_one_flight_into_the_next(nacs, tmp_path: Path) -> None:
    """A command that is missing where a flight begins was never given there."""
    rows = ["trial,t,q1,q2,q3,q4,w1,w2,w3,s1,s2,s3,s4,c1,c2,c3,c4"]
    for trial in (0, 1):
        for k in range(4):
            command = "" if k == 0 and trial else f"0.00{trial + 1}{k}"
            rows.append(",".join([str(trial), f"{0.1 * k:.1f}", "0,0,0,1", "0,0,0", "0,0,0,0", *[command] * 4]))
    (tmp_path / "lab.csv").write_text("\n".join(rows) + "\n")
    said = {"trial": "trial", "time": {"column": "t"}} | {
        key: {"columns": [f"{letter}{i + 1}" for i in range(n)]}
        for key, letter, n in (("attitude", "q", 4), ("rate", "w", 3), ("wheels", "s", 4), ("command", "c", 4))
    }
    said["command"]["hold"] = True
    (tmp_path / "map.toml").write_text(toml(said))
    result = nacs("convert", "lab.csv", "--map", "map.toml", "--out", "log.parquet")
    assert (result.code, result.err.count("\n")) == (2, 1)
    assert "trial 1: command1 is missing at 0 s" in result.err


def test_a_whole_offset_loses_no_digit() -> None:
    stamps = np.array([1790000000000000000, 1790000000100000001])
    np.testing.assert_allclose(seconds(stamps, TimeMap(column="t", unit="ns", offset=1790000000000000001)), [-1e-9, 0.1], atol=1e-15)
    assert np.isfinite(seconds(stamps, TimeMap(column="t", unit="ns", offset=1e30))).all()
