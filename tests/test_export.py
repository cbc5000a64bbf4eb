"""`nacs export`: signals in the formats of other tools, read back by their own readers."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import netCDF4
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from mcap.reader import make_reader
from scipy.io import loadmat

from sim.cli.bridges import export as command
from sim.export import matlab
from sim.export.matlab import valid_names
from sim.export.register import FORMATS
from sim.series.signals import long_table
from sim.series.signals.of_recordings import signals_of
from sim.series.signals.signal import Signals
from tests.test_signals import flown

CASES = {"nacs/disturbance": ("loop",), "consensus/fault-free": ("mupf-b", "none")}


@pytest.fixture(scope="module", params=CASES)
def run(request, tmp_path_factory) -> tuple[Path, Signals]:
    folder = tmp_path_factory.mktemp("run")
    signals = signals_of(*flown(request.param, CASES[request.param]))
    long_table.write(folder / "signals.parquet", signals, request.param)
    return folder, signals


def exported(nacs, run: tuple[Path, Signals], kind: str) -> tuple[Path, Signals]:
    folder, signals = run
    result = nacs("export", folder, "--to", kind, "--overwrite")
    assert (result.code, result.err) == (0, "")
    path = folder / f"signals{FORMATS[kind].suffix}"
    assert str(path) in result.out
    return path, signals


def test_csv_is_read_by_pandas(nacs, run) -> None:
    path, signals = exported(nacs, run, "csv")
    whole = pd.read_csv(path, engine="pyarrow")
    for name, loop in signals.loops.items():
        table = whole[whole["loop"] == name]
        for signal in loop:
            for column, values in signal.scalars():
                shape = (len(loop.trials), loop.agents or 1, len(loop.time))
                lead = values if "agent" in signal.dims or "trial" not in signal.dims else values[:, None]
                right = np.broadcast_to(lead, shape).ravel()
                np.testing.assert_array_equal(table[column].to_numpy().astype(right.dtype), right, err_msg=column)


def test_mat_is_read_by_scipy(nacs, run) -> None:
    path, signals = exported(nacs, run, "mat")
    whole = loadmat(path, simplify_cells=True)
    for name, loop in signals.loops.items():
        own = whole[name.replace("-", "_")]
        np.testing.assert_array_equal(own["time"], loop.time)
        for signal in loop:
            key = signal.variable.replace("-", "_")
            np.testing.assert_array_equal(own[key], np.squeeze(signal.values), err_msg=key)
            assert own["about"][key]["unit"] == signal.unit
            assert own["about"][key]["name"] == signal.name


def test_netcdf_is_read_by_xarray_and_by_netcdf(nacs, run) -> None:
    path, signals = exported(nacs, run, "netcdf")
    several = len(signals.loops) > 1
    for name, loop in signals.loops.items():
        with xr.open_dataset(path, engine="netcdf4", group=name if several else None) as whole:
            for signal in loop:
                one = whole[signal.variable]
                assert (one.dims, one.attrs["units"], one.attrs["frame"]) == (signal.dims, signal.unit, signal.frame)
                np.testing.assert_array_equal(one.values.astype(signal.values.dtype), signal.values)
            assert list(whole["truth_position" if several else "truth_rate"].coords["plane" if several else "axis"].values)[:2] == [
                "x",
                "y",
            ]
        with netCDF4.Dataset(path) as file:
            inside = file[name] if several else file
            np.testing.assert_array_equal(inside["time"][:], loop.time)


def test_mcap_is_read_by_its_own_reader(nacs, run) -> None:
    path, signals = exported(nacs, run, "mcap")
    found: dict[str, list[dict]] = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            said = json.loads(message.data)
            assert message.log_time == round(1e9 * said["time_s"])
            found.setdefault(channel.topic, []).append(said)
    for name, loop in signals.loops.items():
        agents = [f"/agent{number}" for number in loop.agent_numbers] or [""]
        topics = [f"/{name}/trial{trial}{agent}" for trial in loop.trials for agent in agents]
        assert {topic for topic in found if topic.startswith(f"/{name}/")} == set(topics)
        rows = np.array([[row["truth"]["position_x" if loop.agents else "rate_x"] for row in found[topic]] for topic in topics])
        np.testing.assert_array_equal(rows, loop["truth/position" if loop.agents else "truth/rate"].values[..., 0].reshape(rows.shape))
        observer = next(signal for signal in loop if signal.name.startswith("nis/"))
        nis = np.array([[row["nis"][observer.name.removeprefix("nis/")] for row in found[topic]] for topic in topics], dtype=float)
        np.testing.assert_array_equal(nis, observer.values.reshape(nis.shape))  # None is NaN


def test_names_are_valid_in_matlab() -> None:
    found = valid_names(["nis-windowed", "nis_windowed", "2nd", "a" * 70, "a" * 80])
    assert found == {
        "nis-windowed": "nis_windowed",
        "nis_windowed": "nis_windowed_2",
        "2nd": "x2nd",
        "a" * 70: "a" * 63,
        "a" * 80: "a" * 61 + "_2",
    }


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("run", "--to", "xlsx"), "--to xlsx: there is no such format; there are csv, mat, netcdf, mcap"),
        (("nowhere", "--to", "csv"), "nowhere: has no signals.parquet; name the folder of a run"),
        (("run", "--to", "csv", "--out", "run"), "--out run: is a folder; name a file"),
        (("run", "--to", "csv", "--out", "there.csv"), "--out there.csv: is there already; name another file or add --overwrite"),
        (("broken", "--to", "csv"), "signals.parquet: is no file of signals that `nacs run` wrote"),
    ],
)
def test_what_cannot_be_exported_is_one_line(nacs, run, tmp_path: Path, arguments, said: str) -> None:
    shutil.copytree(run[0], "run")
    Path("there.csv").touch()
    Path("broken").mkdir()
    Path("broken/signals.parquet").write_text("no table")
    before = set(tmp_path.rglob("*"))
    result = nacs("export", *arguments)
    assert (result.code, result.err.count("\n")) == (2, 1), result.err
    assert said in result.err
    assert set(tmp_path.rglob("*")) == before


def test_what_a_mat_file_cannot_hold_is_one_line(nacs, run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(matlab, "LARGEST", 100)
    result = nacs("export", run[0], "--to", "mat", "--out", "it.mat")
    assert (result.code, result.err.count("\n")) == (2, 1)
    assert "a MAT file of version 5 holds 2 GB; record fewer trials, or --to netcdf" in result.err
    assert not list(Path().iterdir())


@pytest.mark.parametrize(("kind", "package"), [("netcdf", "xarray"), ("netcdf", "netCDF4"), ("mcap", "mcap")])
def test_a_missing_extra_is_named(nacs, run, monkeypatch: pytest.MonkeyPatch, kind: str, package: str) -> None:
    monkeypatch.setattr(command, "find_spec", lambda name: None if name == package else True)
    result = nacs("export", run[0], "--to", kind, "--out", "it")
    assert (result.code, result.err) == (2, f"error: --to {kind} needs {package}: pip install 'nacs-twin[data]'\n")
    assert not Path("it").exists()
