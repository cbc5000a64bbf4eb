from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader

from models.attitude import quaternion
from models.plants.assembly import Assembly
from sim.loop.build import build
from sim.loop.closed_loop import System, run
from sim.loop.recorder import Recorder
from sim.loop.recording import Recording
from sim.plant.batch import diagnose
from sim.rerun.live import LiveStream
from sim.rerun.scene import GHOST_OFFSET
from sim.rerun.sink import write_recording
from sim.scenario.files import load

TICKS = 60
PUSH = {"kind": "external-torque", "torque_nm": 0.01, "start_s": 2.0, "duration_s": 1.0}


class Written(NamedTuple):
    path: Path
    recording: Recording
    assembly: Assembly


def system(trials: int) -> tuple[System, dict[str, Any]]:
    scenario = load("nacs/disturbance", {"run.ticks": TICKS, "faults": [PUSH]})
    return build(scenario, np.arange(3, 3 + trials)), scenario.model_dump(mode="json")


@pytest.fixture(autouse=True, scope="module")
def strict() -> Any:
    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(False)


@pytest.fixture(scope="module")
def one(tmp_path_factory: pytest.TempPathFactory) -> Written:
    return written(tmp_path_factory.mktemp("one") / "recording.rrd", 1)


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> Written:
    return written(tmp_path_factory.mktemp("two") / "recording.rrd", 2)


def written(path: Path, trials: int) -> Written:
    loop, configuration = system(trials)
    recording = run(loop)
    write_recording(path, "nacs/disturbance", recording, loop.plant.assembly, loop.feedback.source, configuration)
    return Written(path, recording, loop.plant.assembly)


def column(path: Path, entity: str, component: str) -> tuple[np.ndarray, list[Any]]:
    """Instants (ns) and values of one component of one entity."""
    found: list[tuple[int, Any]] = []
    for chunk in RrdReader(path).stream().filter(content=entity).to_chunks():
        batch = chunk.to_record_batch()
        if component in batch.schema.names and "sim_time" in batch.schema.names:
            instants = batch.column("sim_time").cast("int64").to_pylist()
            found += zip(instants, batch.column(component).to_pylist(), strict=True)
    found.sort(key=lambda row: row[0])
    return np.array([t for t, _ in found]), [v for _, v in found]


def entities(path: Path) -> set[str]:
    return {chunk.entity_path for chunk in RrdReader(path).stream().to_chunks()}


def test_the_file_is_complete(one: Written) -> None:
    checked = subprocess.run(
        [Path(sys.executable).with_name("rerun"), "rrd", "verify", one.path], capture_output=True, text=True, check=False
    )
    assert checked.returncode == 0, checked.stdout + checked.stderr


def test_a_blueprint_is_inside(one: Written) -> None:
    assert len(RrdReader(one.path).recordings()) == 1
    assert len(RrdReader(one.path).blueprints()) == 1


def test_instants_are_exact_and_every_tick_has_a_row(one: Written) -> None:
    exact = 100_000_000 * np.arange(TICKS)
    for entity, component in (
        ("/world/bus", "Transform3D:quaternion"),
        ("/world/estimate/nis-fading", "Transform3D:quaternion"),
        ("/wheels/speed", "Scalars:scalars"),
        ("/attitude/error_axes", "Measurements:values"),
        ("/consistency/nis/ekf", "Scalars:scalars"),
    ):
        np.testing.assert_array_equal(column(one.path, entity, component)[0], exact, err_msg=entity)


def test_every_visible_geom_is_drawn_once_and_nothing_that_only_collides(one: Written) -> None:
    scene, present = one.assembly.scene, entities(one.path)
    for i in range(scene.ngeom):
        geom = scene.geom(i)
        body = scene.body(int(geom.bodyid[0])).name if geom.bodyid[0] else "lab"
        assert (f"/world/{body}/{geom.name}" in present) == (scene.geom_group[i] < 3), geom.name


def test_ghosts_and_outline_have_the_plate_though_it_is_drawn_as_meshes(one: Written) -> None:
    for entity in ("/world/bus/outline/cylinders", "/world/estimate/nis-fading/edges_of_cylinders"):
        batches = [chunk.to_record_batch() for chunk in RrdReader(one.path).stream().filter(content=entity).to_chunks()]
        radii = [batch.column("Cylinders3D:radii").to_pylist() for batch in batches if "Cylinders3D:radii" in batch.schema.names]
        assert max(np.ravel(radii)) == pytest.approx(0.165, abs=1e-6), entity


def test_bodies_stand_where_the_plant_says(one: Written) -> None:
    channels = one.recording.channels
    truth = diagnose(one.assembly, channels["truth/qpos"][:, 0], channels["truth/qvel"][:, 0])
    for body in range(1, one.assembly.model.nbody):
        entity = f"/world/{one.assembly.model.body(body).name}"
        place = np.array(column(one.path, entity, "Transform3D:translation")[1])[:, 0]
        turn = np.array(column(one.path, entity, "Transform3D:quaternion")[1])[:, 0]
        np.testing.assert_allclose(place, truth.position[:, body], atol=1e-6)
        np.testing.assert_allclose(turn, truth.quaternion[:, body], atol=1e-6)


def test_a_ghost_differs_from_the_body_by_the_error_of_its_observer(one: Written) -> None:
    channels = one.recording.channels
    body = np.array(column(one.path, "/world/bus", "Transform3D:quaternion")[1])[:, 0]
    place = np.array(column(one.path, "/world/bus", "Transform3D:translation")[1])[:, 0]
    for name in one.recording.observers:
        ghost = np.array(column(one.path, f"/world/estimate/{name}", "Transform3D:quaternion")[1])[:, 0]
        beside = np.array(column(one.path, f"/world/estimate/{name}", "Transform3D:translation")[1])[:, 0]
        expected = quaternion.error(channels[f"{name}/mean"][:, 0, :4], channels["truth/state"][:, 0, :4])
        np.testing.assert_allclose(quaternion.error(ghost, body), expected, atol=1e-6)  # poses are stored in single precision
        np.testing.assert_allclose(beside - place, np.broadcast_to(GHOST_OFFSET, place.shape), atol=1e-6)
        plotted = np.array(column(one.path, f"/attitude/error/{name}", "Scalars:scalars")[1])[:, 0]
        np.testing.assert_allclose(plotted, 1e3 * np.linalg.norm(expected, axis=-1), rtol=1e-9, atol=1e-9)


def test_units_of_the_series(one: Written) -> None:
    state = one.recording.channels["truth/state"][:, 0]
    np.testing.assert_allclose(column(one.path, "/wheels/speed", "Scalars:scalars")[1], state[:, 7:] * 60 / (2 * np.pi))
    np.testing.assert_allclose(column(one.path, "/rate/truth", "Scalars:scalars")[1], np.degrees(state[:, 4:7]))
    sigma = one.recording.channels["nis-fading/sigma"][:, 0, :3]
    np.testing.assert_allclose(column(one.path, "/attitude/error_axes", "Measurements:variances")[1], (1e3 * sigma) ** 2)


def test_faults_and_detections_are_told(one: Written) -> None:
    instants, states = column(one.path, "/state/fault", "StateChange:state")
    np.testing.assert_array_equal(instants, 1_000_000_000 * np.array([0, 2, 3]))
    assert [state[0].split()[0] for state in states] == ["none", "push", "none"]
    texts = [text[0] for text in column(one.path, "/events", "TextLog:text")[1]]
    assert any(text.startswith("fault begins: push") for text in texts)
    assert any(text.startswith("nis-fading declares a fault (0.") for text in texts)


def test_the_configuration_is_a_property(one: Written) -> None:
    [chunk] = RrdReader(one.path).stream().filter(content="/__properties/configuration").to_chunks()
    assert chunk.to_record_batch().column("run.ticks").to_pylist() == [[str(TICKS)]]


def test_several_trials_go_under_their_numbers(two: Written) -> None:
    present = entities(two.path)
    assert {"/trial_3/world/bus", "/trial_4/world/bus", "/trial_4/wheels/speed"} <= present
    assert not any(path.startswith("/world") for path in present)
    for i, number in enumerate((3, 4)):
        speed = column(two.path, f"/trial_{number}/wheels/speed", "Scalars:scalars")[1]
        np.testing.assert_allclose(speed, two.recording.channels["truth/state"][:, i, 7:] * 60 / (2 * np.pi))


def test_a_loop_without_feedback_observer_or_detector_can_be_written(tmp_path: Path) -> None:
    overrides = {"run.ticks": 5, "faults": [], "observers": {"a filter": {"type": "ekf"}}, "control.feedback": "truth"}
    scenario = load("nacs/disturbance", overrides)
    loop = build(scenario, np.arange(1))
    write_recording(tmp_path / "recording.rrd", "nacs/disturbance", run(loop), loop.plant.assembly, "truth", {})
    assert r"/attitude/error/a\ filter" in entities(tmp_path / "recording.rrd")


def test_without_a_viewer_live_says_so() -> None:
    loop, configuration = system(1)
    with pytest.raises(ConnectionError, match=r"^no Rerun viewer listens at 127\.0\.0\.1:9; start one with .*$"):
        LiveStream("nacs/disturbance", loop, loop.feedback.source, configuration, "rerun+http://127.0.0.1:9/proxy")


def test_live_rows_equal_the_written_ones(one: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The stream goes to a file in place of a viewer."""
    path = tmp_path / "live.rrd"

    class Accepting:
        def close(self) -> None: ...

    monkeypatch.setattr("sim.rerun.live.socket.create_connection", lambda *_, **__: Accepting())
    monkeypatch.setattr(rr.RecordingStream, "connect_grpc", lambda stream, _, default_blueprint: stream.save(path, default_blueprint))
    loop, configuration = system(1)
    with LiveStream("nacs/disturbance", loop, loop.feedback.source, configuration) as live:
        seen: list[int] = []

        def on_tick(tick: int, recorder: Recorder) -> None:
            live.on_tick("loop", tick, recorder)
            seen.append(tick)

        run(loop, on_tick)
    assert seen == list(range(TICKS))
    for entity, component in (
        ("/world/bus", "Transform3D:quaternion"),
        ("/world/estimate/nis-fading", "Transform3D:quaternion"),
        ("/wheels/speed", "Scalars:scalars"),
        ("/attitude/error/ekf", "Scalars:scalars"),
        ("/consistency/nis/ekf", "Scalars:scalars"),
        ("/state/fault", "StateChange:state"),
    ):
        instants, values = column(path, entity, component)
        expected_instants, expected = column(one.path, entity, component)
        np.testing.assert_array_equal(instants, expected_instants)
        np.testing.assert_equal(values, expected, err_msg=entity)  # NaN at the first tick, where nothing is predicted
