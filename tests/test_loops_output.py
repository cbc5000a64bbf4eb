"""Recording and report of several closed loops."""

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
from scipy.stats import chi2

from models.attitude import quaternion
from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.loop.recording import Recording
from sim.metrics.one_body import evaluate
from sim.plant.batch import diagnose
from sim.plant.kinds import compile_plant
from sim.report.register import write_report
from sim.rerun.loops import scene as rerun_loops_scene
from sim.rerun.loops.recording import write_loops
from sim.rerun.loops.scene import stage
from sim.rerun.sink import write_recording
from sim.scenario.files import load
from sim.scenario.one_body import Scenario
from sim.series.events import state_timelines
from sim.series.line_styles import line_styles
from sim.series.loops import flights, running_rms

TICKS, ONSET = 40, 20
FLOAT = {"kind": "float", "wheel": 1, "start_s": 2.0, "duration_s": 2.0}


class Flown(NamedTuple):
    scenario: Scenario
    recordings: dict[str, Recording]
    path: Path

    def channel(self, loop: str, name: str) -> np.ndarray:
        return self.recordings[loop].channels[name][:, 0]


def fly(name: str, path: Path, trials: int = 1, **overrides: Any) -> Flown:
    scenario = load(name, {"run.ticks": TICKS, "faults": [FLOAT], **overrides})
    recordings = {loop: run(build(single, np.arange(3, 3 + trials))) for loop, single in scenario.singles().items()}
    write_loops(path, name, scenario, recordings, scenario.model_dump(mode="json"))
    return Flown(scenario, recordings, path)


@pytest.fixture(autouse=True, scope="module")
def strict() -> Any:
    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(False)


@pytest.fixture(scope="module")
def probe(tmp_path_factory: pytest.TempPathFactory) -> Flown:
    """Ten loops: 3-1-3 Euler angles, seven states, blended gains of two modes, loops that are spared the fault."""
    return fly("wmap/compare", tmp_path_factory.mktemp("probe") / "recording.rrd")


@pytest.fixture(scope="module")
def testbed(tmp_path_factory: pytest.TempPathFactory) -> Flown:
    """Six loops of two trials: eleven states, five modes, observers without modes."""
    return fly("nacs/imm-wheel-failure", tmp_path_factory.mktemp("testbed") / "recording.rrd", trials=2)


def column(path: Path, entity: str, component: str) -> tuple[np.ndarray, np.ndarray]:
    """Instants (ns) and values of one component of one entity."""
    found: list[tuple[int, Any]] = []
    for chunk in RrdReader(path).stream().filter(content=entity).to_chunks():
        batch = chunk.to_record_batch()
        if component in batch.schema.names and "sim_time" in batch.schema.names:
            instants = batch.column("sim_time").cast("int64").to_pylist()
            found += zip(instants, batch.column(component).to_pylist(), strict=True)
    found.sort(key=lambda row: row[0])
    return np.array([t for t, _ in found]), np.array([v for _, v in found])


def scalars(path: Path, entity: str) -> np.ndarray:
    instants, values = column(path, entity, "Scalars:scalars")
    np.testing.assert_array_equal(instants, 100_000_000 * np.arange(len(values)), err_msg=entity)
    return values


def entities(path: Path) -> set[str]:
    return {chunk.entity_path for chunk in RrdReader(path).stream().to_chunks()}


def test_the_file_is_complete_and_laid_out(probe: Flown) -> None:
    verify = [Path(sys.executable).with_name("rerun"), "rrd", "verify", probe.path]
    checked = subprocess.run(verify, capture_output=True, text=True, check=False)
    assert checked.returncode == 0, checked.stdout + checked.stderr
    assert len(RrdReader(probe.path).recordings()) == len(RrdReader(probe.path).blueprints()) == 1


def test_every_loop_has_its_plant_at_a_place_of_its_own_with_its_own_motion(probe: Flown) -> None:
    assembly = compile_plant(probe.scenario.plant)
    places = stage(flights(probe.scenario, probe.recordings), assembly).places
    assert set(places) == set(probe.recordings)
    apart = [np.linalg.norm(places[a] - places[b]) for a in places for b in places if a < b]
    assert min(apart) > 4.92  # m, the shield's diameter
    for loop in probe.recordings:
        truth = diagnose(assembly, probe.channel(loop, "truth/qpos"), probe.channel(loop, "truth/qvel"))
        [placed] = [chunk.to_record_batch() for chunk in RrdReader(probe.path).stream().filter(content=f"/world/{loop}").to_chunks()]
        np.testing.assert_allclose(placed.column("Transform3D:translation").to_pylist()[0][0], places[loop], atol=1e-5)
        hull = f"/world/{loop}/hull"
        turn = column(probe.path, hull, "Transform3D:quaternion")[1][:, 0]
        np.testing.assert_allclose(turn, truth.quaternion[:, 1], atol=1e-6)  # poses are stored in single precision
        desired = column(probe.path, f"/world/{loop}/reference", "Transform3D:quaternion")[1][:, 0]
        off = quaternion.angle(turn, desired)
        expected = quaternion.angle(probe.channel(loop, "truth/state")[:, :4], probe.recordings[loop].channels["reference/q"])
        np.testing.assert_allclose(off, expected, atol=2e-6)
        labels = column(probe.path, f"/world/{loop}/label", "Points3D:labels")[1][:, 0]
        assert labels[-1] == f"{loop}: {np.degrees(expected[-1]):.2f} deg off"


def test_long_flights_are_thinned_out_in_the_scene_but_not_in_the_plots(probe: Flown, tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.setattr(rerun_loops_scene, "ROWS_MOST", 10)
    path = tmp_path / "recording.rrd"
    write_loops(path, "wmap/compare", probe.scenario, probe.recordings, {})
    whole = column(probe.path, "/world/pd-imm/hull", "Transform3D:quaternion")[1]
    instants, thinned = column(path, "/world/pd-imm/hull", "Transform3D:quaternion")
    np.testing.assert_array_equal(instants, 400_000_000 * np.arange(10))
    np.testing.assert_array_equal(thinned, whole[::4])
    assert len(scalars(path, "/tracking/angle")) == TICKS


def test_plots_hold_what_was_recorded(probe: Flown) -> None:
    loops = list(probe.recordings)
    angle, torque = scalars(probe.path, "/tracking/angle"), scalars(probe.path, "/control/torque_y/pd")
    attitude, nis = scalars(probe.path, "/estimation/attitude"), scalars(probe.path, "/estimation/nis")
    for i, loop in enumerate(loops):
        state, target = probe.channel(loop, "truth/state"), probe.recordings[loop].channels["reference/q"]
        np.testing.assert_allclose(angle[:, i], np.degrees(quaternion.angle(state[:, :4], target)), rtol=1e-12)
        np.testing.assert_allclose(scalars(probe.path, f"/wheels/speed/{loop}"), state[:, 7:] * 60 / (2 * np.pi), rtol=1e-12)
        closing = probe.scenario.loops[loop].control.feedback
        np.testing.assert_array_equal(nis[:, i], probe.channel(loop, f"{closing}/nis"))
        mean = probe.channel(loop, f"{closing}/mean")
        np.testing.assert_allclose(attitude[:, i], np.degrees(quaternion.angle(mean[:, :4], state[:, :4])), rtol=1e-6)
    pd = [loop for loop in loops if loop.startswith("pd")]
    np.testing.assert_array_equal(torque, np.stack([probe.channel(loop, "torque_B")[:, 1] for loop in pd], axis=-1))


def test_modes_and_the_gains_that_they_blend(probe: Flown) -> None:
    modal = [loop for loop, settings in probe.scenario.loops.items() if settings.control.feedback == "imm"]
    faulty = scalars(probe.path, "/modes/any_fault")
    for i, loop in enumerate(modal):
        np.testing.assert_allclose(faulty[:, i], 1.0 - probe.channel(loop, "imm/modes")[:, 0], atol=1e-15)
    healthy, failed = probe.channel("smc-imm", "imm/modes").T
    smc = [loop for loop in probe.recordings if loop.startswith("smc")]
    slope = scalars(probe.path, "/gains/sliding-mode/slope_rad_s")
    np.testing.assert_allclose(slope[:, smc.index("smc-imm")], 0.15 * healthy + 1.5 * failed)
    np.testing.assert_array_equal(slope[:, smc.index("smc-ukf")], 0.15)


def test_the_running_rms_ends_in_each_phase_at_the_metric(probe: Flown) -> None:
    assembly = compile_plant(probe.scenario.plant)
    for i, (loop, single) in enumerate(probe.scenario.singles().items()):
        values = {(m.metric, m.phase): m.values[0] for m in evaluate(probe.recordings[loop], assembly, loop, single)}
        for name in ("phi", "theta", "psi") if single.faults else ():
            running = scalars(probe.path, f"/tracking/rmse_{name}")[:, i]
            assert running[ONSET - 1] == pytest.approx(values[f"rmse_{name}_deg", "nominal"], rel=1e-9)
            assert running[-1] == pytest.approx(values[f"rmse_{name}_deg", "fault"], rel=1e-9)


def test_a_running_rms_starts_anew() -> None:
    np.testing.assert_allclose(running_rms(np.array([3.0, 4.0, 2.0, 0.0]), [2]), [3.0, np.sqrt(12.5), 2.0, np.sqrt(2.0)])
    np.testing.assert_allclose(running_rms(np.array([[3.0, 1.0], [4.0, 1.0]]), [5]), [[3.0, 1.0], [np.sqrt(12.5), 1.0]])


def test_the_fault_and_what_is_believed_of_it_are_told(probe: Flown) -> None:
    instants, states = column(probe.path, "/state/fault", "StateChange:state")
    np.testing.assert_array_equal(instants, [0, 2_000_000_000])
    assert states[:, 0].tolist() == ["none", "wheel 1 floats"]
    believed = np.argmax(probe.channel("pd-imm", "imm/modes"), axis=-1)
    names = np.array(["healthy", "wheel 1 floats"])[believed]
    assert state_timelines(flights(probe.scenario, probe.recordings))["pd-imm"] == [
        (k, name) for k, name in enumerate(names) if k == 0 or name != names[k - 1]
    ]
    texts = column(probe.path, "/events", "TextLog:text")[1][:, 0].tolist()
    assert "fault begins: wheel 1 floats (not in pd-imm-no-fault, smc-imm-no-fault)" in texts


def test_several_trials_and_many_modes(testbed: Flown) -> None:
    present = entities(testbed.path)
    assert {"/trial_3/world/pd-imm/bus", "/trial_4/world/pd-imm/bus", "/trial_4/tracking/rmse_x"} <= present
    assert not any(path.startswith(("/world", "/tracking")) for path in present)
    for i, number in enumerate((3, 4)):
        modes = scalars(testbed.path, f"/trial_{number}/modes/each/smc-imm-realloc")
        np.testing.assert_array_equal(modes, testbed.recordings["smc-imm-realloc"].channels["imm-any/modes"][:, i])
    assert "/trial_3/modes/each/pd-imm" not in present  # two modes: all is said by the probability of a failure
    bands = {path for path in present if path.startswith("/trial_3/estimation/nis_band/")}
    assert bands == {"/trial_3/estimation/nis_band/10"}  # rotation vectors and quaternions alike: a unit quaternion counts three


def test_what_a_failed_run_leaves_can_be_drawn(probe: Flown, tmp_path: Path) -> None:
    whole = probe.recordings["smc-imm"]
    channels = {name: array[:7] for name, array in whole.channels.items()}
    left = {"smc-imm": Recording(whole.dt, whole.trials, channels, whole.thresholds, whole.occurrences)}
    write_loops(tmp_path / "recording.rrd", "wmap/compare", probe.scenario, left, {})
    write_report(tmp_path / "report.png", "wmap/compare", probe.scenario, left)
    assert scalars(tmp_path / "recording.rrd", "/tracking/angle").shape == (7, 1)
    assert (tmp_path / "report.png").is_file()


def test_loops_look_different_and_alike_where_they_are_alike(probe: Flown) -> None:
    found = line_styles(probe.scenario)
    for colour in ("on_light", "on_dark"):
        assert len({getattr(look, colour) for look in found.values()}) == len(found)
    assert found["pd-imm-realloc"].dashes == found["smc-imm-realloc"].dashes != found["pd-imm"].dashes
    assert found["pd-imm"].family == found["pd-ukf"].family != found["smc-imm"].family


def test_the_report_of_the_probe(probe: Flown, tmp_path: Path, figures: list[Figure]) -> None:
    write_report(tmp_path / "report.png", "wmap/compare", probe.scenario, probe.recordings)
    assert matplotlib.image.imread(tmp_path / "report.png").shape[:2] == (1632, 2080)
    panels = figures[0].axes
    assert len(panels) == 9
    labels = [text.get_text() for text in figures[0].legends[0].get_texts() if text.get_text().strip()]
    assert sorted(labels) == sorted(probe.recordings)
    drawn = [line.get_ydata() for line in panels[0].lines]
    ends = scalars(probe.path, "/tracking/rmse_phi")[-1]
    for end in ends:
        assert any(len(y) == TICKS - ONSET and y[-1] == pytest.approx(end, rel=1e-9) for y in drawn)
    printed = probe.scenario.published
    assert printed is not None
    assert any(np.array_equal(y, [printed.values["smc-ukf"]["rmse_phi_deg@fault"]]) for y in drawn)


def test_the_report_of_the_testbed(testbed: Flown, tmp_path: Path, figures: list[Figure]) -> None:
    write_report(tmp_path / "report.png", "nacs/imm-wheel-failure", testbed.scenario, testbed.recordings)
    panels = figures[0].axes
    assert panels[0].get_title(loc="left") == "(a) RMSE about x, restarted at the fault"
    assert panels[6].get_ylabel() == "torque on the body [mN m]"
    lanes_drawn = [text.get_text() for text in panels[4].get_yticklabels()]
    assert lanes_drawn == ["smc-imm-realloc", "smc-imm", "pd-imm-realloc", "pd-imm"]


def test_one_loop_with_modes_and_without_estimated_wheel_speeds(probe: Flown, tmp_path: Path) -> None:
    path, single = tmp_path / "recording.rrd", probe.scenario.singles()["pd-imm"]
    recording = probe.recordings["pd-imm"]
    write_recording(path, "wmap/pd-imm", recording, compile_plant(single.plant), "imm", {})
    np.testing.assert_array_equal(scalars(path, "/modes/imm"), probe.channel("pd-imm", "imm/modes"))
    present = entities(path)
    assert "/attitude/error/imm" in present
    assert "/wheels/error/imm" not in present
    np.testing.assert_allclose(scalars(path, "/consistency/nis_band")[0], chi2.ppf([0.025, 0.975], 6))
    np.testing.assert_allclose(scalars(path, "/consistency/nees_band")[0], chi2.ppf([0.025, 0.975], 6))
