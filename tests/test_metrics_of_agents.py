"""Figures of merit of formations, of agents in the plane and of windows of time, from recordings made by hand: every value by hand too."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from models.attitude.modified_rodrigues import from_quaternion
from models.attitude.quaternion import from_rotation_vector
from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.loop.recording import Recording
from sim.metrics import antenna_study, consensus, formation, windows
from sim.scenario.files import load

# formations -----------------------------------------------------------------------------------------------------------------------


def formation_metrics() -> dict[tuple[str, str, str], np.ndarray]:
    """Ten ticks of 0.5 s, two trials, of which the second has twice the errors."""
    once = np.arange(1.0, 11.0)[::-1]  # 10, 9, ... 1
    both = np.stack([once, 2.0 * once], axis=-1)
    gaps = both.copy()
    gaps[:4], gaps[7, 1] = np.nan, np.nan
    figures = {
        "skae": both, "fkae": 0.02 * both, "station_angle": np.radians(both), "formation_angle": np.radians(3.0 * both),
        "peak_torque": both[::-1], "acceleration_error": 0.1 * both, "peak_wheel_speed": 7.0 * both,
        "saturated": (both > 6.0).astype(float), "aukf/velocity_squared": both**2,
        "pf/velocity_squared": 4.0 * both**2, "aukf/nees": gaps, "aukf/lost": (both == 4.0).astype(float),
    }  # fmt: skip
    recording = Recording(0.5, np.arange(2), {}, {}, (), {}, figures, np.arange(2))
    settings = {"run.ticks": 10, "run.tick_s": 0.5, "phases": {"late": [3.5, 5.0]}}
    changes = {"observers": {"aukf": {"type": "aukf"}}, "loops": {"own": {"feedback": "aukf"}}}
    return {m[:3]: m.values for m in formation.evaluate("own", recording, load("formation/fault-free", settings | changes))}


FORMATION = {
    ("own", "skae", "all"): 5.5, ("own", "skae", "late"): 2.0, ("own", "skae_start", "all"): 10.0, ("own", "skae_start", "late"): 3.0,
    ("own", "fkae", "all"): 0.11, ("own", "fkae_start", "late"): 0.06, ("own", "fkae_end", "all"): 0.02,
    ("own", "station_angle_deg", "late"): (14 / 3) ** 0.5, ("own", "formation_angle_deg", "all"): 3.0 * 38.5**0.5,
    ("own", "peak_torque", "all"): 10.0, ("own", "leader_acceleration_error", "late"): 0.1 * (14 / 3) ** 0.5,
    ("own", "peak_wheel_speed", "late"): 21.0, ("own", "rms_velocity_error", "late"): (14 / 3) ** 0.5,
    ("own/pf", "rms_velocity_error", "late"): 2.0 * (14 / 3) ** 0.5,
}  # fmt: skip


@pytest.mark.parametrize("key", FORMATION, ids=" ".join)
def test_a_formation_made_by_hand(key: tuple[str, str, str]) -> None:
    np.testing.assert_allclose(formation_metrics()[key], [FORMATION[key], 2.0 * FORMATION[key]], rtol=1e-12)


def test_a_formation_s_shares_counts_and_gaps() -> None:
    found = formation_metrics()
    np.testing.assert_allclose(found["own", "saturated_share", "all"], [0.4, 0.7])
    np.testing.assert_array_equal(found["own", "lost_filters", "all"], [1, 1])  # at the seventh tick of one, at the ninth of the other
    np.testing.assert_array_equal(found["own", "lost_filters", "late"], [0, 1])
    np.testing.assert_allclose(found["own", "nees_mean", "all"], [3.5, (12 + 10 + 8 + 4 + 2) / 5])
    np.testing.assert_array_equal(found["own", "settling_time_s", "all"], [3.0, 4.0])  # 0.1 is not yet below 0.1


def test_figures_of_a_flying_formation_are_those_of_its_states() -> None:
    """Sums over agents written out; the shadow set is not left here."""
    scenario = load("formation/nacs", {"run.ticks": 12, "phases": {}})
    found = run(build(scenario, np.arange(1), loop="aukf"))
    sigma = from_quaternion(found.channels["truth/q_BN"])[:, 0]
    leader = found.channels["reference/leader"]
    skae = [np.sqrt(sum(np.sum((own - lead[:3]) ** 2) for own in agents)) for agents, lead in zip(sigma, leader, strict=True)]
    np.testing.assert_allclose(found.figures["skae"][:, 0], skae, rtol=1e-9)
    torque, p = found.channels["torque_B"][:, 0], found.channels["control/acceleration"][:, 0]
    np.testing.assert_allclose(found.figures["peak_torque"][:, 0], np.abs(torque).max(axis=(1, 2)))
    limited = np.isclose(np.abs(torque), scenario.plant.torque_limit_nm, rtol=1e-12)
    np.testing.assert_allclose(found.figures["saturated"][:, 0], limited.mean(axis=(1, 2)))
    off = [np.sqrt(sum(np.sum((own - lead[6:]) ** 2) for own in agents)) for agents, lead in zip(p, leader, strict=True)]
    np.testing.assert_allclose(found.figures["acceleration_error"][:, 0], off, rtol=1e-9)
    np.testing.assert_allclose(found.figures["peak_wheel_speed"][:, 0], np.abs(found.channels["truth/wheel_speed"]).max(axis=(1, 2, 3)))
    np.testing.assert_array_equal(found.figures["aukf/lost"], 0.0)
    wrong = (found.channels["aukf/mean"] - found.channels["truth/state"])[:, 0, :, 3:]
    np.testing.assert_allclose(found.figures["aukf/velocity_squared"][:, 0], np.sum(wrong**2, axis=(1, 2)) / 6, rtol=1e-9)


# agents in the plane --------------------------------------------------------------------------------------------------------------


def test_agents_made_by_hand() -> None:
    """Two agents 3 m east and 4 m north of the leader for 15 s, then 0.03 and 0.04 m; the second trial is lost at 2 s."""
    ticks, dt = 160, 0.125
    truth = np.zeros((ticks, 2, 2, 4))
    truth[:, :, 0, 0], truth[:, :, 1, 1] = 3.0, 4.0
    truth[120:] *= 0.01
    leader = np.tile([10.0, -5.0], (ticks, 1))
    truth[..., :2] += leader[:, None, None]
    mean = truth + np.array([0.1, 0.2, 0.3, 0.6])
    learned = np.full((ticks, 2, 2, 2), 0.5)
    learned[16:, 1] = np.nan
    force = np.zeros((ticks, 2, 2, 2))
    force[:, :, 0, 0], force[:, :, 1, 1] = 0.6, 0.8
    channels = {
        "truth/state": truth, "reference/leader": leader, "learned": learned, "unknown": np.full_like(learned, 0.2), "force": force,
        "f/mean": mean, "f/nees": np.full((ticks, 2, 2), 4.0), "f/nis": np.full((ticks, 2, 2), 3.0),
    }  # fmt: skip
    found = {m[:3]: m.values for m in consensus.evaluate("own", Recording(dt, np.arange(2), channels, {"f": None}))}
    expected = {
        ("own", "aem", "start"): 5.0, ("own", "rem", "start"): 5.0, ("own", "aem", "0-2s"): 5.0, ("own", "aem", "15-20s"): 0.05,
        ("own", "rem", "all"): (120 * 5.0 + 40 * 0.05) / 160, ("own", "effort", "all"): 1.0, ("own", "settled_s", "all"): 15.0,
        ("own/f", "rms_position_error", "all"): 0.05**0.5, ("own/f", "rms_velocity_error", "2-10s"): 0.45**0.5,
        ("own/f", "nees_mean", "all"): 4.0, ("own/f", "nis_mean", "5-15s"): 3.0,
    }  # fmt: skip
    for key, value in expected.items():
        np.testing.assert_allclose(found[key], value, rtol=1e-12, err_msg=str(key))
    np.testing.assert_allclose(found["own", "dynamics_error", "0-2s"], 0.3)
    np.testing.assert_allclose(found["own", "dynamics_error", "2-10s"], [0.3, np.nan])
    np.testing.assert_array_equal(found["own", "lost_s", "all"], [np.nan, 2.0])


def test_agents_that_stray_at_last_have_not_settled() -> None:
    absolute = np.array([[0.2, 0.05, 0.2], [0.05, 0.05, 0.05], [0.2, 0.1, 0.05]])
    np.testing.assert_array_equal(consensus._settled(absolute, np.array([0.0, 0.5, 1.0])), [np.nan, 0.0, 1.0])


# antennas -------------------------------------------------------------------------------------------------------------------------


def test_switches_and_pointing_of_antennas_made_by_hand() -> None:
    """Azimuth is about z and elevation about x; the second trial never switches."""
    switched, from_grid, theta = np.zeros((10, 2, 2)), np.zeros((10, 2, 2)), np.ones((10, 2, 2, 2))
    switched[[3, 7], 0, 0], switched[5, 0, 1], from_grid[7, 0, 0] = 1, 1, 1
    theta[-1, 0] = [[0.25, 0.5], [0.125, 0.2]]
    truth, wanted = np.zeros((10, 2, 7)), np.zeros((10, 3))
    wanted[:, 2] = 0.02
    turn = np.zeros((10, 2, 3))
    turn[:5], turn[5:, 0] = 0.3, [0.01, 0.0, 0.04]
    turn[5:, 1] = [0.0, 0.0, 0.02]
    truth[..., :4] = from_rotation_vector(turn)
    torque = np.tile([3.0, 2.0, 1.0], (10, 2, 1))
    channels = {
        "truth/state": truth, "reference/q": from_rotation_vector(wanted), "torque_B": torque, "control/switched": switched,
        "control/from_grid": from_grid, "control/theta": theta,
    }  # fmt: skip
    recording, assembly = Recording(0.5, np.arange(2), channels, {}), SimpleNamespace(inertia=np.diag([2.0, 3.0, 4.0]))
    rows = [*antenna_study._switching(assembly, recording), *antenna_study._pointing(recording, "loop")]
    found = {m[:2]: m.values for m in rows}
    expected = {
        ("azimuth", "switches"): [2, 0], ("elevation", "switches"): [1, 0], ("azimuth", "from_grid"): [1, 0],
        ("azimuth", "first_switch_s"): [1.5, np.nan], ("elevation", "first_switch_s"): [2.5, np.nan],
        ("azimuth", "natural_frequency"): [1.0, 0.5], ("elevation", "natural_frequency"): [2.0, 0.5**0.5],  # sqrt(1 / (theta_1 J))
        ("azimuth", "damping_ratio"): [0.25, 0.25], ("elevation", "damping_ratio"): [0.2, 0.5**1.5],  # theta_2 omega / 2
        ("azimuth", "theta_1"): [0.25, 1.0], ("elevation", "theta_2"): [0.2, 1.0],
        ("azimuth", "rms_pointing_deg"): [np.degrees(0.02), 0.0], ("elevation", "rms_pointing_deg"): [np.degrees(0.01), 0.0],
        ("azimuth", "rms_torque"): [1.0, 1.0], ("elevation", "rms_torque"): [3.0, 3.0],
    }  # fmt: skip
    for key, values in expected.items():
        np.testing.assert_allclose(found[key], values, rtol=1e-9, atol=1e-12, err_msg=str(key))


# windows of a body ----------------------------------------------------------------------------------------------------------------


def body(turn: np.ndarray, rate: np.ndarray, **channels: np.ndarray) -> Recording:
    """Ticks of 0.5 s of one trial, turned by rotation vectors (ticks, 3) from the reference, which stands turned itself."""
    ticks = len(turn)
    truth = np.concatenate([from_rotation_vector(turn), rate], axis=-1)[:, None]
    still = {"reference/q": np.tile([0.0, 0, 0, 1], (ticks, 1)), "reference/omega": np.tile([0.0, 0.0, 1e-5], (ticks, 1))}
    return Recording(0.5, np.arange(1), {"truth/state": truth, **still, **channels}, {"f": None})


def test_windows_made_by_hand() -> None:
    turn, rate = np.zeros((8, 3)), np.zeros((8, 3))
    turn[:, 0] = [0.1, 0.1, 0.01, 1.9e-3, 1.9e-3, 1.9e-3, 2.2e-3, 0.01]  # half of it is the vector part: the region is 1e-3
    rate[:, 1] = [3e-2, 4e-2, 1e-4, 1e-4, 4e-5, 0.0, 0.0, 0.0]  # and 50e-6
    rate[:, 2] = [0.0, 3e-2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    spans = {"first": (0.0, 1.0), "then": (1.0, 4.0), "never": (9.0, 10.0)}
    found = {row[:2]: row[3][0] for row in windows.of_the_body(body(turn, rate), spans)}
    expected = {
        ("time_to_region_s", "state"): 2.0, ("final_attitude", "all"): np.sin(0.005), ("final_scalar", "all"): np.cos(0.005),
        ("rate_least", "first"): 3e-2, ("rate_peak", "first"): 5e-2, ("rate_least", "then"): 0.0, ("rate_peak", "then"): 1e-4,
    }  # fmt: skip
    assert found == {key: pytest.approx(value, rel=1e-9) for key, value in expected.items()}


def test_windows_of_an_estimate_made_by_hand() -> None:
    still = np.zeros((8, 3))
    off = np.zeros((8, 3))
    off[:, 1] = [0.3, 0.3, 0.06, 0.02, 1e-3, 1e-3, 0.3, 0.3]
    mean = np.concatenate([-from_rotation_vector(off), np.tile([0.0, 3e-5, 0.0], (8, 1))], axis=-1)[:, None]  # of the other sign
    ess = np.arange(8.0)[:, None]
    recording = body(still, still, **{"f/mean": mean, "f/ess": ess})
    found = {row[:2]: row[3][0] for row in windows.of_an_estimate(recording, "f", {"first": (0.0, 2.0), "last": (2.0, 4.0)})}
    sines = np.sin(off[:, 1] / 2)
    expected = {
        ("time_to_region_s", "estimate"): 2.0, ("lost", "all"): 1.0,
        ("rms_attitude_error", "first"): np.sqrt(np.sum(sines[:4] ** 2) / 12), ("rms_rate_error", "first"): 3e-5 / 3**0.5,
        ("rms_attitude_error", "last"): np.sqrt(np.sum(sines[4:] ** 2) / 12), ("rms_rate_error", "last"): 3e-5 / 3**0.5,
        ("ess_median", "all"): 3.5, ("ess_median", "first"): 1.5, ("ess_median", "last"): 5.5,
    }  # fmt: skip
    assert found == {key: pytest.approx(value, rel=1e-6) for key, value in expected.items()}
    kept = {row[:2]: row[3][0] for row in windows.of_an_estimate(recording, "f", {"middle": (0.5, 3.0)})}
    assert kept["lost", "all"] == 0.0  # half of the window's errors are below 0.1 rad
