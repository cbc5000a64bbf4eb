"""Faults in closed loops: what sensors, network, drives, bodies and laws make of them, in every family."""

import json

import numpy as np
import pytest

from sim.loop.body_parts import LOCKING
from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.loop.recording import Recording
from sim.scenario import files

LASTS = {"start_s": 0.1, "end_s": 0.2}
DURING, AFTER = slice(10, 20), slice(20, 30)
FORMATION = {"run.ticks": 30, "run.tick_s": 0.01, "phases": {}}
CONSENSUS = {"run.ticks": 30}
OTHERS = [0, 2, 3, 4, 5]


def flown(name: str, *faults: dict, loop: str | None = None, trials: int = 2, **changes) -> Recording:
    """A loop of 0.3 s with faults from 0.1 to 0.2 s."""
    short = FORMATION if name.startswith("formation") else CONSENSUS
    scenario = files.load(name, short | changes | {"faults": [LASTS | fault for fault in faults]})
    return run(build(scenario, np.arange(trials), loop=loop))


def misread(recording: Recording) -> np.ndarray:
    """Readings minus the truth, (ticks, trials, agents, n)."""
    reading = recording.channels["reading"]
    return reading - recording.channels["truth/state"][..., : reading.shape[-1]]


AGENTS = pytest.mark.parametrize(("name", "loop"), [("formation/fault-free", "truth"), ("consensus/fault-free", "exact")])


# sensors of single agents ---------------------------------------------------------------------------------------------------


@AGENTS
def test_a_bias_and_noise_are_of_the_agents_that_have_them(name, loop):
    plain = misread(flown(name, loop=loop))
    biased = misread(flown(name, {"kind": "bias", "agents": [2], "size": 0.5}, loop=loop))
    np.testing.assert_allclose(biased[DURING, :, 1] - plain[DURING, :, 1], 0.5, atol=1e-12)
    np.testing.assert_allclose(biased[DURING][:, :, OTHERS], plain[DURING][:, :, OTHERS], atol=1e-12)
    np.testing.assert_allclose(biased[AFTER], plain[AFTER], atol=1e-12)
    noisy = misread(flown(name, {"kind": "noise", "agents": [2], "factor": 3.0}, loop=loop))
    np.testing.assert_allclose(noisy[DURING, :, 1], 3.0 * plain[DURING, :, 1], atol=1e-12)
    np.testing.assert_allclose(noisy[DURING][:, :, OTHERS], plain[DURING][:, :, OTHERS], atol=1e-12)


@AGENTS
def test_readings_of_an_agent_come_late(name, loop):
    still = {"sensors.position_std_m": 0.0, "sensors.speed_std_m_s": 0.0} if "consensus" in name else {"reading_deviation": 0.0}
    recording = flown(name, {"kind": "delay", "agents": [2], "delay_s": 0.03}, loop=loop, **still)
    truth, reading = recording.channels["truth/state"], recording.channels["reading"]
    size = reading.shape[-1]
    np.testing.assert_allclose(reading[DURING, :, 1], truth[7:17, :, 1, :size], atol=1e-15)
    np.testing.assert_array_equal(reading[:, :, OTHERS], truth[:, :, OTHERS, :size])
    between = flown(name, {"kind": "delay", "agents": "all", "delay_s": 0.025, "start_s": 0.0, "end_s": 0.3}, loop=loop, **still).channels
    truth, reading = between["truth/state"][..., :size], between["reading"]
    np.testing.assert_allclose(reading[3:], 0.5 * (truth[1:-2] + truth[:-3]), atol=1e-13)
    np.testing.assert_array_equal(reading[0], truth[0])


SILENT = [("formation/fault-free", loop, start) for loop in ("aukf", "pf", "truth") for start in (0.0, 0.1)]
SILENT += [("consensus/fault-free", loop, 0.0) for loop in ("exact", "none", "adtl")]
SILENT += [("consensus/fault-free", loop, 0.1) for loop in ("exact", "none", "adtl", "aukf", "mupf-b", "mupf-a")]


@pytest.mark.parametrize(("name", "loop", "start"), SILENT)
def test_a_silent_sensor_of_an_agent_leaves_nothing_undefined(name, loop, start):
    only = {} if start else {"loops": {loop: files.dumped(files.load(name))["loops"][loop]}}
    recording = flown(name, {"kind": "drop-out", "agents": [2], "start_s": start}, loop=loop, **only)
    silent = np.zeros((30, 2, 6), dtype=bool)
    silent[round(100 * start) : 20, :, 1] = True
    reading = recording.channels["reading"]
    np.testing.assert_array_equal(np.isnan(reading), np.broadcast_to(silent[..., None], reading.shape))
    assert np.isfinite(recording.channels["truth/state"]).all()
    assert np.isfinite(recording.channels.get(f"{loop}/mean", recording.channels.get("estimate", np.zeros(1)))).all()
    if name.startswith("formation") and start:
        assert not any(recording.figures.get(f"{loop}/lost", np.zeros(1)).ravel())


def test_one_sensor_of_an_agent_may_be_silent_alone():
    reading = flown("consensus/fault-free", {"kind": "drop-out", "sensor": "speed"}, loop="exact").channels["reading"]
    assert np.isnan(reading[DURING, ..., 2:]).all()
    assert np.isfinite(reading[..., :2]).all()


# messages in the plane ------------------------------------------------------------------------------------------------------


def test_agents_in_the_plane_lose_messages_and_hear_late():
    plain = flown("consensus/fault-free", loop="exact").channels
    for fault in (
        {"kind": "message-loss", "probability": 1.0},
        {"kind": "message-delay", "delay_s": 0.05},
        {"kind": "cut", "links": [[0, 1]]},
    ):
        other = flown("consensus/fault-free", fault, loop="exact").channels
        np.testing.assert_array_equal(other["force"][:10], plain["force"][:10])
        apart = np.abs(other["force"] - plain["force"])[10].max(axis=(0, 2))
        alone = fault["kind"] == "cut"
        assert (apart > 1e-9).tolist() == [True, *([not alone] * 5)]


def test_a_cut_link_counts_nothing_for_agents_in_the_plane():
    cut = [[0, 1], [1, 2]]  # the first agent hears nobody
    recording = flown("consensus/fault-free", {"kind": "cut", "links": cut}, loop="exact")
    learned, force = recording.channels["learned"], recording.channels["force"]
    np.testing.assert_allclose(force[DURING, :, 0], -learned[DURING, :, 0], atol=1e-12)  # its errors are nothing to it
    assert np.abs(force[AFTER, :, 0] + learned[AFTER, :, 0]).min() > 1e-3


def test_a_drawn_loss_and_a_drawn_delay_are_each_trials_own():
    uniform = {"uniform": [0.0, 1.0]}
    late = {"kind": "message-delay", "delay_s": {"uniform": [0.0, 0.08]}}
    many = flown("consensus/fault-free", {"kind": "message-loss", "probability": uniform}, late, loop="exact", trials=5).channels
    scenario = files.load(
        "consensus/fault-free", CONSENSUS | {"faults": [LASTS | {"kind": "message-loss", "probability": uniform}, LASTS | late]}
    )
    alone = run(build(scenario, np.array([3]), loop="exact")).channels
    for key in ("force", "truth/state"):
        np.testing.assert_array_equal(alone[key][:, 0], many[key][:, 3])


# drives, bodies and laws ----------------------------------------------------------------------------------------------------


def test_wheels_of_testbeds_in_formation_fail_like_those_of_one():
    quiet = {"plant.testbed.drive_torque_noise_nm": 0.0}
    given = {
        kind: flown("formation/nacs", {"kind": kind, "agents": [2], "wheel": 3, **more}, loop="truth", **quiet).channels
        for kind, more in (("float", {}), ("constant-output", {"torque_nm": 1e-3}), ("effectiveness", {"remaining": 0.5}), ("lock", {}))
    }
    plain = flown("formation/nacs", loop="truth", **quiet).channels
    torque = {kind: channels["wheel_torque"][10, :, 1] for kind, channels in given.items()}
    expected = np.tile(plain["wheel_torque"][10, :, 1], (1, 1))
    assert np.abs(expected).min() > 0.0
    for kind, value in (("float", 0.0), ("constant-output", 1e-3), ("effectiveness", 0.5 * expected[:, 2]), ("lock", expected[:, 2])):
        np.testing.assert_array_equal(torque[kind][:, [0, 1, 3]], expected[:, [0, 1, 3]])
        np.testing.assert_allclose(torque[kind][:, 2], value, rtol=1e-14)
        others = given[kind]["wheel_torque"][10][:, OTHERS]
        np.testing.assert_array_equal(others, plain["wheel_torque"][10][:, OTHERS])
    speed = given["lock"]["truth/wheel_speed"]
    assert np.abs(speed[10, :, 1, 2]).min() > 1.0
    assert np.abs(speed[17:20, :, 1, 2]).max() < 0.1
    assert np.abs(speed[17:20, :, 0]).max() > 1.0
    assert np.abs(np.diff(speed[20:, :, 1, 2], axis=0)).max() > 0.01  # and turns again


def test_the_dry_friction_of_a_bearing_that_seizes_slowly_grows_linearly():
    fault = {"kind": "lock", "wheel": 2, "start_s": 1.0, "duration_s": 1.0, "shape": "ramp"}
    system = build(files.load("nacs/fault-free", {"run.ticks": 30, "faults": [fault]}), np.arange(2))
    given, plant = [], system.plant
    plant.set_wheel_friction = lambda which, wheel, coulomb: given.append((wheel, which.all(), coulomb))
    run(system)
    own, most = plant.wheel_coulomb[:, 1], LOCKING * plant.assembly.wheel_torque_limit
    assert [(wheel, everyone) for wheel, everyone, _ in given] == [(1, True)] * 10  # nothing of it at first, nine parts, and back
    for k, (*_, coulomb) in enumerate(given[:-1], 1):
        np.testing.assert_allclose(coulomb, (1 - k / 10) * own + k / 10 * most, rtol=1e-13)
    np.testing.assert_array_equal(given[-1][2], own)


def test_a_braked_wheel_slows_down_by_the_brakes_torque_over_its_inertia():
    """J_w d(Omega)/dt = -(T + T_own) sign(Omega) - c Omega of a wheel that floats, and it stands in the end."""
    braked = {"kind": "friction", "wheel": 2, "torque_nm": 3e-4, "start_s": 1.0, "duration_s": 7.0}
    floating = {"kind": "float", "wheel": 2, "start_s": 1.0, "duration_s": 7.0}
    settings = {"run.ticks": 80, "start.wheel_speed_rad_s": [0.0, 80.0, 0.0, 0.0], "faults": [floating, braked], "plant.air_torque_nm": 0.0}
    scenario = files.load("nacs/fault-free", settings | {"reference.amplitude_deg": [0.0, 0.0, 0.0]})
    speed = run(build(scenario, np.arange(1))).channels["truth/state"][:, 0, 8]
    plant = scenario.plant
    slope = (3e-4 + plant.wheel_coulomb_nm + plant.wheel_viscous_nms * np.mean(speed[12:30])) / plant.wheel_inertia_kg_m2
    assert (speed[12] - speed[30]) / 1.8 == pytest.approx(slope, rel=0.03)  # the body turns a little with it
    assert np.abs(speed[-10:]).max() < 1.0


def test_one_agent_is_pushed_and_another_made_heavier():
    push = {"kind": "external-torque", "agents": [2], "torque_nm": 0.05, "direction": [0, 0, 1]}
    plain, pushed = flown("formation/fault-free", loop="truth"), flown("formation/fault-free", push, loop="truth")
    apart = np.abs(pushed.channels["truth/state"] - plain.channels["truth/state"])[12].max(axis=(0, 2))
    assert apart[1] > 1e-5
    assert np.delete(apart, 1).max() < 0.05 * apart[1]  # they hear of it
    heavier = {"kind": "inertia", "agents": [5], "add_kg_m2": [20.0, 20.0, 20.0]}
    both = flown("formation/fault-free", push | {"agents": "all"}, heavier, loop="truth").channels["truth/state"]
    light = flown("formation/fault-free", push | {"agents": "all"}, loop="truth").channels["truth/state"]
    apart = np.abs(both - light)[11].max(axis=(0, 2))
    assert apart[4] > 1e-6
    assert np.delete(apart, 4).max() == 0.0


def test_a_periodic_and_a_random_torque_act_on_an_agent():
    plain = flown("formation/fault-free", loop="truth").channels["truth/state"]
    for kind in ("periodic-torque", "uniform-torque"):
        other = flown("formation/fault-free", {"kind": kind, "agents": [2], "amplitude_nm": 0.05}, loop="truth").channels["truth/state"]
        apart = np.abs(other - plain)[11].max(axis=(0, 2))
        assert apart[1] > 1e-6
        assert np.delete(apart, 1).max() == 0.0


def test_a_torque_by_agent_moves_each_as_its_own_number_says():
    """Agents 1 and 5 are disturbed as by torques of one and of five times the pulsation that are theirs alone."""
    torque = {"kind": "periodic-torque", "amplitude_nm": 0.05}
    both = flown("formation/fault-free", torque | {"agents": [1, 5], "by_agent": True}, loop="truth").channels["truth/state"]
    apart = flown("formation/fault-free", torque | {"agents": [1]}, torque | {"agents": [5], "pulsation_rad_s": 5.0}, loop="truth")
    np.testing.assert_allclose(both, apart.channels["truth/state"], rtol=0.0, atol=1e-14)
    alike = flown("formation/fault-free", torque | {"agents": [1, 5]}, loop="truth").channels["truth/state"]
    assert np.abs(both - alike)[:, :, 4].max() > 1e-6


@pytest.mark.parametrize("name", ["nacs/fault-free", "monolithic/fault-free"])
def test_more_inertia_is_added_to_each_trials_own(name):
    added = [1e-3, 1e-3, 1e-3] if name.startswith("nacs") else [1.0, 1.0, 1.0]
    scenario = files.load(name, {"run.ticks": 20, "faults": [{"kind": "inertia", "add_kg_m2": added, "start_s": 0.0, "end_s": 0.1}]})
    system = build(scenario, np.arange(2), loop=scenario.loop_names[0])
    given = []
    system.plant.set_mass_properties = lambda which, inertia, centre: given.append((which, inertia, centre))
    run(system)
    np.testing.assert_allclose(given[0][1], system.plant.inertia + np.diag(added), rtol=1e-15)
    np.testing.assert_array_equal(given[-1][1], system.plant.inertia)
    np.testing.assert_array_equal(given[0][2], system.plant.centre_of_mass)


def test_the_inertia_of_a_body_drifts_from_its_own_to_another():
    other = {"kind": "inertia", "inertia_kg_m2": [10, 10, 5, 0, 0, 0], "start_s": 0.1, "end_s": 0.2, "shape": "ramp"}
    scenario = files.load("monolithic/fault-free", {"run.ticks": 30, "faults": [other]})
    system = build(scenario, np.arange(2), loop="true-state")
    given = []
    system.plant.set_mass_properties = lambda which, inertia, _: given.append(inertia[0] if which.any() else None)
    run(system)
    own = system.plant.inertia[0]
    moved = [one for one in given if one is not None]
    assert len(moved) == 10  # nothing of it at first, nine parts, and back
    for k, one in enumerate(moved[:-1], 1):
        np.testing.assert_allclose(one, (1 - k / 10) * own + k / 10 * np.diag([10.0, 10.0, 5.0]), rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(moved[-1], own)


def test_what_agents_in_the_plane_are_told_and_pushed_to_do():
    still = flown("consensus/fault-free", {"kind": "no-command", "agents": [2]}, loop="exact").channels["force"]
    assert not still[DURING, :, 1].any()
    assert np.abs(still[DURING][:, :, OTHERS]).min() > 0.0
    fixed = flown("consensus/fault-free", {"kind": "constant-command", "agents": [2], "force_n": [0.5, -0.5]}, loop="exact")
    np.testing.assert_array_equal(fixed.channels["force"][DURING, :, 1], np.broadcast_to([0.5, -0.5], (10, 2, 2)))
    plain = flown("consensus/fault-free", loop="exact").channels["truth/state"]
    pushed = flown("consensus/fault-free", {"kind": "external-force", "agents": [2], "force_n": [2.0, 0.0]}, loop="exact")
    speed = (pushed.channels["truth/state"] - plain)[11, :, 1, 2:]
    np.testing.assert_allclose(speed, np.broadcast_to([2.0 * 0.01, 0.0], (2, 2)), atol=2e-4)
    assert (pushed.channels["truth/state"] - plain)[11, :, [0, 2]].max() == 0.0


def test_dynamics_and_sliding_terms_are_of_single_agents_and_drawn():
    faults = [
        {"kind": "dynamics", "agents": [2], "gain": [{"uniform": [2.0, 4.0]}, 1.0]},
        {"kind": "constant-sliding", "agents": [3], "constant_n": 0.2},
    ]
    recording, plain = (flown("consensus/fault-free", *which, loop="none", trials=3) for which in (faults, ()))
    unknown, normal = (one.channels["unknown"] for one in (recording, plain))
    gain = (unknown[10, :, 1, 0] - 0.1 * np.sin(0.5 * 0.1 * 2)) / (normal[10, :, 1, 0] - 0.1 * np.sin(0.5 * 0.1 * 2))
    assert ((gain > 2.0) & (gain < 4.0)).all()
    assert len(np.unique(gain)) == 3
    np.testing.assert_array_equal(np.delete(unknown[10], 1, axis=1), np.delete(normal[10], 1, axis=1))
    changed = np.abs(recording.channels["force"] - plain.channels["force"])[10].max(axis=(0, 2)) > 0.0
    assert changed.tolist() == [False, False, True, False, False, False]


def test_gains_are_of_the_agents_that_have_them():
    recording = flown("formation/fault-free", {"kind": "gains", "agents": [2], "k1": 0.0, "gamma": 0.0}, loop="truth")
    plain = flown("formation/fault-free", loop="truth")
    changed = np.abs(recording.channels["torque_B"] - plain.channels["torque_B"])[10].max(axis=(0, 2)) > 0.0
    assert changed.tolist() == [False, True, False, False, False, False]


# what a person sees ---------------------------------------------------------------------------------------------------------

SEEN = {
    "nacs/fault-free": (["run.ticks=60"], "[{kind='bias',sensor='gyro',size={uniform=[0.01,0.02]},start_s=2,end_s=4,shape='ramp'}]"),
    "formation/nacs": (
        ["run.ticks=60", "phases={}"],
        "[{kind='lock',agents=[2],wheel=1,start_s=0.1,duration_s=0.3},{kind='drop-out',agents=[3],start_s={uniform=[0.1,0.2]},end_s=0.5}]",
    ),
    "consensus/fault-free": (
        ["run.ticks=200", "loops={exact={type='exact'},none={type='none'}}"],
        "[{kind='message-loss',probability={uniform=[0.1,0.9]},start_s=0.1,end_s=1,shape='intermittent',period_s=0.2},"
        "{kind='external-force',agents=[2],force_n=[1,0],start_s=0.5,duration_s=0.5}]",
    ),
}


@pytest.mark.parametrize("name", SEEN)
def test_a_run_of_every_family_with_its_faults_is_reported(nacs, tmp_path, name):
    settings, faults = SEEN[name]
    told = [part for setting in [*settings, f"faults={faults}"] for part in ("--set", setting)]
    result = nacs("run", name, "--trials", 2, "--out", "it", *told)
    assert result.code == 0, result.err
    assert {path.name for path in (tmp_path / "it").iterdir()} >= {"recording.rrd", "report.png", "summary.json", "trials.parquet"}
    rows = json.loads((tmp_path / "it" / "summary.json").read_text())["rows"]
    assert len(rows) > 10
