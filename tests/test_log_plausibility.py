"""Logs that cannot be true: each wrong unit, order and sign is named, and no log of the twin is suspected, whatever failed in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.replay.flight_log import FlightLog, export
from sim.replay.log_columns import columns_of
from sim.replay.plausibility import COMMANDS, RATES, SPEEDS, TIMES, _read_between, complaints
from sim.scenario.files import load

LEAN: dict[str, object] = {"observers": {"ekf": {"type": "ekf"}}, "control.feedback": "truth"}
FLIGHTS: dict[str, tuple[str, dict[str, object]]] = {
    "as published": ("nacs/fault-free", {"run.ticks": 200}),
    "a tenth of a degree": ("nacs/fault-free", {"run.ticks": 300, "run.seed": 6, "reference.amplitude_deg": [0.1, 0.1, 0.1]}),
    "about one axis": ("nacs/fault-free", {"run.ticks": 200, "run.seed": 7, "reference.amplitude_deg": [0, 0, 20]}),
    "at 100 Hz": ("nacs/fault-free", {"run.ticks": 600, "run.seed": 8, "run.tick_s": 0.01}),
    "at 2 Hz": ("nacs/fault-free", {"run.ticks": 100, "run.seed": 9, "run.tick_s": 0.5}),
    "with drop-outs": ("nacs/fault-free", {"run.ticks": 200, "run.seed": 10, "sensors.dropout_probability": 0.3}),
    "a wheel fails": (
        "nacs/wheel-failure",
        {"run.ticks": 300, "run.seed": 11, "faults.0.start_s": 6.0, "faults.0.duration_s": 20.0},
    ),
    "pushed": ("nacs/disturbance", {"run.ticks": 300, "run.seed": 12, "faults.0.start_s": 5.0, "faults.1.start_s": 15.0}),
}


@cache
def flight(name: str) -> tuple[Any, FlightLog]:
    scenario = load(FLIGHTS[name][0], FLIGHTS[name][1] | LEAN)
    return scenario, log_of(scenario)


def log_of(scenario: Any, trials: int = 2) -> FlightLog:
    loop = scenario.loop_names[0]
    flown = run(build(scenario, np.arange(trials), loop=loop))
    time = np.repeat(flown.time[:, None], trials, axis=1)
    channels = flown.channels
    return FlightLog(
        loop, flown.dt, flown.trials, time, channels["reading"], columns_of(scenario).recorded(flown), channels["truth/state"], None
    )


def scaled(log: FlightLog, part: slice, factor: float) -> FlightLog:
    reading = log.reading.copy()
    reading[..., part] *= factor
    return replace(log, reading=reading)


def scalar_first(log: FlightLog) -> FlightLog:
    reading = log.reading.copy()
    reading[..., :4] = np.roll(reading[..., :4], 1, axis=-1)
    return replace(log, reading=reading)


def test_a_span_is_read_if_either_end_or_anything_between_is():
    known = np.array([False, True, False, False, False, True, False])
    np.testing.assert_array_equal(_read_between(known, np.array([0, 2, 4, 5])), [True, False, True])
    np.testing.assert_array_equal(_read_between(known, np.array([1, 3, 6])), [True, True])


RATE, WHEELS = slice(4, 7), slice(7, None)
TO_RPM = 30.0 / np.pi
WRONG: dict[str, tuple[Callable[[FlightLog], FlightLog], list[str]]] = {
    "deg/s": (lambda log: scaled(log, RATE, 180.0 / np.pi), ["rates look like deg/s"]),
    "scalar first": (scalar_first, ["quaternions look scalar first"]),
    "rpm": (lambda log: scaled(log, WHEELS, TO_RPM), ["wheel speeds look like rpm"]),
    "ms": (lambda log: replace(log, time=1e3 * log.time, dt=1e3 * log.dt), ["times look like ms"]),
    "commands": (lambda log: replace(log, known=-log.known), ["commands have the opposite sign"]),
    "mN m": (lambda log: replace(log, known=1e3 * log.known), ["commands look like mN m"]),
    "all": (
        lambda log: scalar_first(scaled(scaled(log, RATE, 180.0 / np.pi), WHEELS, TO_RPM)),
        ["quaternions look scalar first", "rates look like deg/s", "wheel speeds look like rpm"],
    ),
}


@pytest.mark.parametrize("name", FLIGHTS)
def test_a_true_log_is_not_suspected_and_a_wrong_one_is_named(name: str) -> None:
    scenario, log = flight(name)
    assert complaints(log, scenario) == []
    for change, sentences in WRONG.values():
        assert complaints(change(log), scenario) == [(trial, sentence) for trial in (0, 1) for sentence in sentences]
    for change in (lambda log: scaled(log, RATE, -1.0), lambda log: scaled(log, slice(0, 3), -1.0)):  # nearly the same at small angles
        found = complaints(change(log), scenario)
        assert [trial for trial, _ in found] == [0, 1]
        assert all("rates have the opposite sign" in said or "from B to N" in said for _, said in found)


@pytest.mark.parametrize(
    "failed",
    [
        [{"kind": "lock", "wheel": 1, "start_s": 2.0}],
        [{"kind": "float", "wheel": 2, "start_s": 2.0}, {"kind": "float", "wheel": 3, "start_s": 2.0}],
        [{"kind": "effectiveness", "wheel": wheel, "start_s": 0.0, "remaining": 0.1} for wheel in (1, 2, 3, 4)],
        [{"kind": "constant-output", "wheel": 4, "start_s": 2.0, "torque_nm": -1e-3}],
        [{"kind": "noise", "sensor": "gyro", "start_s": 2.0, "factor": 30.0}],
        [{"kind": "bias", "sensor": "gyro", "start_s": 2.0, "size": 0.2}],
        [{"kind": "drop-out", "sensor": "attitude", "start_s": 2.0}],
        [{"kind": "drop-out", "sensor": "gyro", "start_s": 0.0}],
    ],
    ids=lambda failed: f"{len(failed)} {failed[0]['kind']} {failed[0].get('sensor', '')}",
)
def test_what_fails_makes_no_log_suspicious(failed: list[dict[str, object]]) -> None:
    faults = [{"duration_s": 10.0, **one} for one in failed]
    scenario = load("nacs/fault-free", LEAN | {"run.ticks": 150, "run.seed": 3, "faults": faults})
    assert complaints(log_of(scenario), scenario) == []


@pytest.mark.parametrize("friction", [5e-4, 5e-3])
def test_dry_friction_that_the_log_does_not_know_makes_it_not_suspicious(friction: float) -> None:
    scenario = load("nacs/fault-free", LEAN | {"run.ticks": 150, "plant.wheel_coulomb_nm": friction})
    assert complaints(log_of(scenario), scenario) == []


def test_a_log_without_a_reading_is_said_so() -> None:
    scenario, log = flight("as published")
    silent = log.reading * np.nan
    assert complaints(replace(log, reading=silent), scenario) == [(0, "no row has a reading"), (1, "no row has a reading")]
    silent[7, 1, 4] = 0.0
    assert complaints(replace(log, reading=silent), scenario) == []


def test_noise_alone_tells_nothing() -> None:
    """Readings that have nothing to do with each other, and a body that rests: neither fits any reading of it."""
    scenario, log = flight("as published")
    for seed in range(20):
        random = np.random.default_rng(seed)
        q = random.standard_normal(log.reading[..., :4].shape) * 1e-3 + [0.0, 0.0, 0.0, 1.0]
        q /= np.linalg.norm(q, axis=-1, keepdims=True)
        rest = 1e-3 * random.standard_normal(log.reading[..., 4:].shape)
        noise = replace(log, reading=np.concatenate([q, rest], axis=-1), known=1e-6 * random.standard_normal(log.known.shape))
        assert complaints(noise, scenario) == []


@pytest.mark.parametrize("missing", [slice(0, 4), slice(4, 7), slice(0, 7)], ids=["attitudes", "rates", "both"])
def test_without_attitudes_or_rates_nothing_tells_of_them(missing: slice) -> None:
    scenario, log = flight("as published")
    reading = log.reading.copy()
    reading[1:, :, missing] = np.nan  # one is left
    assert complaints(replace(log, reading=reading), scenario) == []


def test_agents_in_the_plane_are_held_against_their_velocities() -> None:
    scenario = load("consensus/fault-free", {"run.ticks": 300})
    log = log_of(scenario)
    assert complaints(log, scenario) == []
    assert complaints(replace(log, time=1e3 * log.time, dt=1e3 * log.dt), scenario)[0][1].startswith("times look like ms")
    place = log.reading.copy()
    place[..., :2] *= 1e3
    assert complaints(replace(log, reading=place), scenario)[0][1].startswith("positions look like mm")


def test_the_command_says_it_in_one_line_and_goes_on_when_it_is_trusted(nacs, tmp_path: Path) -> None:
    scenario = load("nacs/fault-free", LEAN | {"run.ticks": 80})
    export(tmp_path / "true.parquet", {"loop": run(build(scenario, np.arange(2)))}, scenario, "nacs/fault-free")
    table = pq.read_table(tmp_path / "true.parquet")
    for name in ("omega1", "omega2", "omega3"):
        degrees = np.where(np.array(table["trial"]) == 1, np.degrees(table[name]), table[name])
        table = table.set_column(table.column_names.index(name), name, pa.array(degrees))
    pq.write_table(table, tmp_path / "lab.parquet")
    result = nacs("replay", "lab.parquet", "--filter", "mekf")
    assert (result.code, result.err.count("\n"), result.out) == (2, 1, "")
    for part in ("lab.parquet: rates look like deg/s in trial 1", "docs/replay.md", "--trust"):
        assert part in result.err
    assert {path.name for path in tmp_path.iterdir()} == {"true.parquet", "lab.parquet"}
    result = nacs("replay", "lab.parquet", "--filter", "mekf", "--trust", "--out", "it")
    assert (result.code, result.err.count("\n")) == (0, 1)
    assert "warning: lab.parquet: rates look like deg/s in trial 1; taken as it is" in result.err
    assert (tmp_path / "it" / "estimates.parquet").is_file()


def test_the_page_names_what_is_known() -> None:
    page = (Path(__file__).parents[1] / "docs" / "replay.md").read_text(encoding="utf-8")
    (known,) = (part for part in page.split("\n\n") if part.startswith("Known are"))
    for unit in (*TIMES, *RATES, *SPEEDS, *COMMANDS):
        if " look like " in unit.said and " of the opposite" not in unit.said:
            assert unit.said.split(" look like ")[1] in known
    assert "scalar first" in known
    assert "from B to N" in known
