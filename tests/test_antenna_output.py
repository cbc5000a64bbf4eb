"""Recording, report and tables of antenna mapping under unfalsified control."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib.image
import numpy as np
import pytest
import rerun as rr
from matplotlib.figure import Figure
from rerun.chunk import RrdReader
from rich.console import Console

from control.falsification import energy, values
from models.attitude import quaternion
from models.plants.flexible_parameters import FlexibleParameters
from sim.campaign.blocks import simulate
from sim.loop.recording import Recording
from sim.metric import Metric
from sim.metrics.fixed_gain_loop import FixedGainLoop
from sim.metrics.results import rows
from sim.report.register import write_report
from sim.rerun.loops.antenna import outlook
from sim.rerun.loops.recording import write_loops
from sim.rerun.loops.scene import stage
from sim.scenario.files import load
from sim.scenario.one_body import Scenario
from sim.series.antenna import FAILED, PASSED, SHUT, AntennaFlight, antenna_events, antenna_flights, antenna_lanes, is_antenna
from sim.tables import antenna as antenna_tables

AXES = [2, 0]  # azimuth, elevation


class Flown(NamedTuple):
    scenario: Scenario
    recordings: dict[str, Recording]
    metrics: list[Metric]

    def several(self, position: int = 0) -> tuple[AntennaFlight, ...]:
        return antenna_flights(self.scenario, self.recordings, position)


def fly(name: str, ticks: int, trials: int = 1, **overrides: Any) -> Flown:
    scenario = load(f"antenna-mapping/{name}", {"run.ticks": ticks, **overrides})
    numbers = np.arange(5, 5 + trials)
    shard = simulate(scenario, numbers, numbers)
    assert shard.failure is None
    return Flown(scenario, shard.recordings, shard.metrics)


@pytest.fixture(autouse=True, scope="module")
def strict() -> Any:
    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(False)


@pytest.fixture(scope="module")
def delayed() -> Flown:
    """Ten ticks of delay, a first controller that is unstable; it has switched in both channels."""
    return fly("panelsat-destabilising", 420, trials=2)


@pytest.fixture(scope="module")
def mapped() -> Flown:
    """With identified responses; azimuth has switched."""
    short = {"identification.period": 60.0, "identification.periods": 1, "identification.settling_periods": 1}
    return fly("boeing702", 740, **short)


@pytest.fixture(scope="module")
def recorded(delayed: Flown, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("antenna") / "recording.rrd"
    write_loops(path, "antenna-mapping/panelsat-destabilising", delayed.scenario, delayed.recordings, {})
    return path


def column(path: Path, entity: str, component: str) -> tuple[np.ndarray, np.ndarray]:
    """Instants (ns) and values of one component of one entity."""
    found: list[tuple[int, Any]] = []
    for chunk in RrdReader(path).stream().filter(content=entity).to_chunks():
        batch = chunk.to_record_batch()
        if component in batch.schema.names and "sim_time" in batch.schema.names:
            found += zip(batch.column("sim_time").cast("int64").to_pylist(), batch.column(component).to_pylist(), strict=True)
    found.sort(key=lambda row: row[0])
    return np.array([t for t, _ in found]), np.array([v for _, v in found])


def scalars(path: Path, entity: str) -> np.ndarray:
    return column(path, entity, "Scalars:scalars")[1]


def entities(path: Path) -> set[str]:
    return {chunk.entity_path for chunk in RrdReader(path).stream().to_chunks()}


@pytest.mark.parametrize("name", ["mapped", "delayed"])
def test_the_tests_that_are_drawn_are_those_of_the_controller(name: str, request: pytest.FixtureRequest) -> None:
    flown: Flown = request.getfixturevalue(name)
    for flight in flown.several():
        by_energy = np.where(flight.is_open, energy(flight.tests), np.inf)[..., None]
        score = values(flight.tests, flight.theta * flight.unit) / by_energy
        assert flight.is_open.any(axis=0).all()
        np.testing.assert_allclose(score, flight.channel("control/score"), rtol=1e-9, atol=1e-11)


def test_a_controller_that_was_falsified_is_outside_the_region_and_the_last_one_inside(delayed: Flown) -> None:
    flight = delayed.several()[0]
    for channel, ticks in enumerate(flight.switches):
        assert len(ticks) > 0
        first, last = flight.theta[0, channel], flight.theta[-1, channel]
        assert not flight.unfalsified(channel, first)
        assert flight.unfalsified(channel, 1.0001 * last if flight.verdict(channel, last, -1).max() < 0.0 else last)
        barely_damped = last * [1.0, 0.5]
        assert not flight.unfalsified(channel, barely_damped)
        np.testing.assert_array_equal(flight.path(channel)[0], first)
        np.testing.assert_array_equal(flight.path(channel)[-1], last)


def test_missing_readings_are_held_as_the_loop_holds_them() -> None:
    drop = {"kind": "drop-out", "sensor": "attitude", "start_s": 3.5, "duration_s": 0.6}
    flight = fly("panelsat-destabilising", 260, faults=[drop]).several()[0]
    assert np.isnan(flight.channel("reading")).any()
    heard = flight.is_open[:, 1]
    assert heard[-20:].all()
    score = values(flight.tests, flight.theta * flight.unit)[heard, 1] / energy(flight.tests)[heard, 1, None]
    np.testing.assert_allclose(score, flight.channel("control/score")[heard, 1], rtol=1e-9, atol=1e-11)


def test_a_channel_s_plots_hold_what_was_recorded(delayed: Flown, recorded: Path) -> None:
    several = delayed.several(1)
    for i, channel in enumerate(("azimuth", "elevation")):
        wanted = np.degrees(quaternion.to_rotation_vector(several[0].recording.channels["reference/q"]))[:, AXES[i]]
        angles, errors = (scalars(recorded, f"/trial_6/pointing/{key}{channel}") for key in ("", "error_"))
        np.testing.assert_array_equal(angles[:, 0], wanted)
        score = scalars(recorded, f"/trial_6/controllers/score_{channel}")
        noted = several[0].channel("control/score")[:, i]
        np.testing.assert_array_equal(score, np.column_stack([np.zeros(len(noted)), np.where(noted == 0.0, np.nan, noted)]))
        for loop, flight in enumerate(several):
            truth = np.degrees(quaternion.to_rotation_vector(flight.channel("truth/state")[:, :4]))[:, AXES[i]]
            np.testing.assert_array_equal(angles[:, 1 + loop], truth)
            np.testing.assert_allclose(errors[:, loop], truth - wanted, rtol=1e-12)
            proportional, rate = 1.0 / flight.theta[:, i, 0], flight.theta[:, i, 1]
            inertia = flight.assembly.inertia[AXES[i], AXES[i]]
            frequency = scalars(recorded, f"/trial_6/controllers/frequency_{channel}")[:, loop]
            np.testing.assert_allclose(frequency * 5.0, np.sqrt(proportional / inertia), rtol=1e-12)
            damping = scalars(recorded, f"/trial_6/controllers/damping_{channel}")[:, loop]
            np.testing.assert_allclose(damping, proportional * rate / (2.0 * np.sqrt(proportional * inertia)), rtol=1e-12)
    for loop, flight in enumerate(several):
        np.testing.assert_array_equal(scalars(recorded, f"/trial_6/wheels/torque/{flight.name}"), 1e3 * flight.channel("command"))
        for number, panel in enumerate(("panel_1", "panel_2")):
            angle = np.degrees(flight.channel("truth/qpos")[:, 11 + number])
            np.testing.assert_array_equal(scalars(recorded, f"/trial_6/panels/{panel}")[:, loop], angle)


def test_switches_are_told_and_shown_where_they_happen(delayed: Flown, recorded: Path) -> None:
    several = delayed.several()
    adaptive, frozen = several
    assert (adaptive.name, frozen.name) == ("adaptive", "frozen")
    told = antenna_events(several)
    assert [k for k, _, _ in told] == sorted(int(k) for ticks in adaptive.switches for k in ticks)
    instants, texts = column(recorded, "/trial_5/events", "TextLog:text")
    assert {text for _, _, text in told} <= set(texts[:, 0])
    assert (np.diff(instants) >= 0).all()
    state_timelines = antenna_lanes(several)
    worst = frozen.channel("control/score")[:, 1].max(axis=-1)
    expected = np.where(worst == 0.0, SHUT, np.where(worst >= 0.0, FAILED, PASSED))
    assert state_timelines["frozen/elevation"] == [(k, str(s)) for k, s in enumerate(expected) if k == 0 or s != expected[k - 1]]
    times, places = column(recorded, "/trial_5/pictures/plane/elevation/now", "Points2D:positions")
    assert times.tolist() == [0, *(20_000_000 * (adaptive.switches[1] + 1)).tolist()]
    log = np.log(adaptive.path(1))  # where the picture has logarithmic axes, pixels are proportional; its rows count downwards
    moved = np.diff(places[:, 0], axis=0)
    np.testing.assert_allclose(moved / moved[0] * [1.0, 1.0], np.diff(log, axis=0) / np.diff(log, axis=0)[0], rtol=1e-3, atol=1e-4)
    assert moved[0, 0] > 0.0 > moved[0, 1]  # softer: to the right; more derivative time: up


def test_the_scene_magnifies_attitude_and_panels_by_what_its_title_says(mapped: Flown, tmp_path: Path) -> None:
    path = tmp_path / "recording.rrd"
    write_loops(path, "antenna-mapping/boeing702", mapped.scenario, mapped.recordings, {})
    verify = [Path(sys.executable).with_name("rerun"), "rrd", "verify", path]
    checked = subprocess.run(verify, capture_output=True, text=True, check=False)
    assert checked.returncode == 0, checked.stdout + checked.stderr
    flight = mapped.several()[0]
    every = 739 // max(1, len(column(path, "/world/adaptive/hub", "Transform3D:quaternion")[0]) - 1)
    hub, panel, desired = (
        column(path, f"/world/adaptive/{part}", "Transform3D:quaternion")[1][:, 0] for part in ("hub", "panel_1", "reference")
    )
    qpos = flight.channel("truth/qpos")[::every]
    turn = quaternion.to_rotation_vector(flight.channel("truth/state")[::every, :4])
    far = np.argmax(np.linalg.norm(turn, axis=-1))
    turns = np.linalg.norm(quaternion.to_rotation_vector(hub)[far]) / np.linalg.norm(turn[far])
    assert turns == pytest.approx(round(turns), rel=1e-4)
    assert turns > 1.0
    np.testing.assert_allclose(quaternion.to_rotation_vector(hub), turns * turn, atol=2e-6)
    wanted = quaternion.to_rotation_vector(flight.recording.channels["reference/q"][::every])
    np.testing.assert_allclose(quaternion.to_rotation_vector(desired), round(turns) * wanted, atol=2e-6)
    bent = quaternion.error(panel, hub)[:, 0]
    most = np.argmax(np.abs(qpos[:, 11]))
    bends = bent[most] / qpos[most, 11]
    assert bends == pytest.approx(round(bends), rel=1e-3)
    assert bends > 1.0
    said = str(stage(mapped.several(), flight.assembly, outlook(mapped.several())))
    assert said.startswith(f"attitude x {round(turns)}; panels x {round(bends)}; ")
    np.testing.assert_allclose(bent, bends * qpos[:, 11], atol=1e-5)
    assert {"/pictures/plane/azimuth", "/pictures/response_error/elevation", "/pictures/response_effort/azimuth"} <= entities(path)


def test_the_linear_loop_responds_as_what_was_identified(mapped: Flown) -> None:
    flight = mapped.several()[0]
    for i, channel in enumerate(("azimuth", "elevation")):
        loop = flight.linear(i, flight.theta[-1, i])
        assert loop is not None
        assert loop.is_stable
        found = {part: flight.recording.findings[f"{channel}/final/{part}"][0] for part in ("frequency", "error", "effort")}
        error, effort = (np.abs(response) for response in loop.responses(found["frequency"]))
        np.testing.assert_allclose(error, found["error"], atol=0.05)
        assert np.median(np.abs(effort / found["effort"] - 1.0)) < 0.02


def test_a_delay_that_the_linear_loop_does_not_survive(delayed: Flown) -> None:
    adaptive, _ = delayed.several()
    unstable, calm = adaptive.linear(1, adaptive.theta[0, 1]), adaptive.linear(1, adaptive.theta[-1, 1])
    assert unstable is not None
    assert calm is not None
    assert (unstable.is_stable, calm.is_stable) == (False, True)
    prompt = FixedGainLoop(unstable.channel, unstable.proportional, unstable.derivative, unstable.dt)
    assert prompt.is_stable
    slow = np.array([1e-3])
    error, effort = unstable.responses(slow)
    assert abs(error[0]) < 1e-2  # a free body has two integrators
    assert abs(effort[0]) < 1e-5


def test_the_delay_in_a_response_is_that_many_ticks() -> None:
    channel = FlexibleParameters().linear_channel(0)
    frequency = np.array([0.2, 1.0, 2.0])
    late, prompt = (FixedGainLoop(channel, 1e-3, 1e-2, 0.1, ticks).responses(frequency) for ticks in (7, 0))
    np.testing.assert_allclose(
        (1.0 - late[0]) / (1.0 - prompt[0]), np.exp(-0.7j * frequency), rtol=1e-3
    )  # gains so low that the loop is open


def test_the_report_shows_what_was_flown(mapped: Flown, tmp_path: Path, figures: list[Figure]) -> None:
    write_report(tmp_path / "report.png", "antenna-mapping/boeing702", mapped.scenario, mapped.recordings)
    assert matplotlib.image.imread(tmp_path / "report.png").shape[:2] == (2010, 2100)
    titled = {axes.get_title(loc="left"): axes for axes in figures[0].axes if axes.get_title(loc="left")}
    assert [title[:3] for title in sorted(titled)] == [f"({letter})" for letter in "abcdefghijkl"]
    adaptive, nominal = mapped.several()
    errors = [line.get_ydata() for line in titled["(a) Pointing error of azimuth, dotted: switches"].lines]
    for flight in (adaptive, nominal):
        assert any(np.array_equal(error, flight.pointed[:, 0] - flight.wanted[:, 0]) for error in errors)
    count = len(adaptive.switches[0])
    assert count > 0
    plane = titled[f"(d) Controllers of azimuth: {count} switch{'' if count == 1 else 'es'}"]
    assert any(np.array_equal(np.transpose(line.get_data()), adaptive.path(0)) for line in plane.lines)
    responses = [line.get_ydata() for line in titled["(g) Pointing error per reference, azimuth"].lines]
    heard = adaptive.recording.findings["azimuth/final/error"][0]
    assert any(set(map(float, drawn)) <= set(heard.tolist()) for drawn in responses)


@pytest.mark.parametrize(("name", "ticks"), [("boeing702-frozen", 1), ("panelsat-destabilising", 2)])
def test_runs_of_a_few_ticks_can_be_drawn(name: str, ticks: int, tmp_path: Path) -> None:
    flown = fly(name, ticks)
    write_report(tmp_path / "report.png", name, flown.scenario, flown.recordings)
    write_loops(tmp_path / "recording.rrd", name, flown.scenario, flown.recordings, {})
    assert len(scalars(tmp_path / "recording.rrd", "/pointing/azimuth")) == ticks


def test_what_a_failed_run_leaves_can_be_drawn(delayed: Flown, tmp_path: Path) -> None:
    whole = delayed.recordings["frozen"].select(np.array([0]))
    left = {"frozen": Recording(whole.dt, whole.trials, {key: array[:7] for key, array in whole.channels.items()}, whole.thresholds)}
    write_report(tmp_path / "report.png", "x", delayed.scenario, left)
    write_loops(tmp_path / "recording.rrd", "x", delayed.scenario, left, {})
    assert scalars(tmp_path / "recording.rrd", "/pointing/error_azimuth").shape == (7, 1)


def test_other_loops_are_not_taken_for_antenna_mapping(delayed: Flown) -> None:
    assert is_antenna(delayed.scenario, delayed.recordings)
    whole = delayed.recordings["frozen"]
    guest = Recording(whole.dt, whole.trials, {k: a for k, a in whole.channels.items() if not k.startswith("control/")}, whole.thresholds)
    assert not is_antenna(delayed.scenario, {"frozen": guest})
    assert not is_antenna(load("wmap/compare"), {})


@pytest.mark.parametrize("name", ["mapped", "delayed"])
def test_the_tables_fit_and_hold_the_metrics(name: str, request: pytest.FixtureRequest) -> None:
    flown: Flown = request.getfixturevalue(name)
    console = Console(width=80, record=True)
    printed = antenna_tables.antenna(rows(flown.metrics), flown.scenario, len(next(iter(flown.recordings.values())).trials))
    for table in printed:
        console.print(table)
    text = console.export_text()
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= 80
    found = {(m.subject, m.metric, m.phase): m.values for m in flown.metrics}
    loops = list(flown.scenario.loops)
    pointing = [float(np.mean(found["elevation", "rms_pointing_deg", loop])) for loop in loops]
    row = next(line.split() for line in text.splitlines() if line.split()[:1] == ["elevation"])
    assert row[1:4] == [f"{pointing[0]:.3g}", f"{pointing[1]:.3g}", f"{pointing[0] / pointing[1]:.3g}"]
    assert len(printed) == (3 if name == "mapped" else 2)
    if name == "mapped":
        last = [line.split() for line in text.splitlines() if line.split()[:1] == ["azimuth"]][-1]
        expected = [
            found["azimuth", metric, phase].max() for metric in ("sup_w1_ter", "sup_w2_tur") for phase in ("initial", "nominal", "final")
        ]
        assert last[1:] == [f"{value:.3g}" for value in expected]


def test_the_command_prints_and_writes_all(nacs: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    outcome = nacs("run", "antenna-mapping/boeing702-frozen", "--trials", 1, "--set", "run.ticks=20", "--out", "results")
    assert outcome.code == 0, outcome.err
    assert "Pointing error and torque" in outcome.out
    assert {"report.png", "recording.rrd", "summary.json"} <= {path.name for path in Path("results").iterdir()}
