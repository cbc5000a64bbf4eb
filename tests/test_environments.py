"""Environments of Gymnasium: checked by its own checker, one body alone as in a batch, ends, dispersion and bad input."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

import nacs
from benchmarks import tracking_policy
from sim.loop import tracking_task
from tests.test_fmu import FAULTS

gymnasium = pytest.importorskip("gymnasium")
from gymnasium.utils.env_checker import check_env  # noqa: E402

import nacs.environments  # noqa: E402

NAME = "nacs/Tracking-v0"
SHORT = {"run.ticks": 20, "phases": {}}


def test_gymnasium_has_nothing_to_say() -> None:
    check_env(gymnasium.make(NAME, set=SHORT).unwrapped)


def test_a_body_alone_is_the_first_of_a_batch_to_the_bit_over_two_episodes_with_faults() -> None:
    how = {"set": SHORT | {"run.ticks": 45, "faults": FAULTS[:2]}}
    one, many = gymnasium.make(NAME, **how), gymnasium.make_vec(NAME, num_envs=3, **how)
    assert isinstance(many.unwrapped, nacs.environments.TrackingVectorEnv)
    alone, together = one.reset(seed=5)[0], many.reset(seed=5)[0]
    np.testing.assert_array_equal(together[0], alone)
    random = np.random.default_rng(0)
    for tick in range(2 * 46 - 1):
        action = 0.1 * random.normal(size=(3, 3))
        reading, rewards, terminated, truncated, told = many.step(action)
        if tick == 45:  # the step after the last begins the next episodes
            alone, info = one.reset()
            assert rewards.tolist() == [0.0, 0.0, 0.0]
            assert not truncated.any()
        else:
            alone, reward, over, cut, info = one.step(action[0])
            assert (rewards[0], bool(terminated[0]), bool(truncated[0])) == (reward, over, cut)
            assert cut == (tick in (44, 90))
        np.testing.assert_array_equal(reading[0], alone)
        assert told["error_deg"][0] == info["error_deg"]
        assert not np.array_equal(reading[1], alone)
        assert many.observation_space.contains(reading)


def test_the_reward_of_a_tick_by_hand() -> None:
    """Half a degree off is worth a half, full torque about all axes costs a hundredth."""
    changes = {"sensors.set": "ideal", "start.attitude_error_deg": 0.0, "reference": {"type": "hold"}, "plant.air_torque_nm": 0.0}
    still = changes | {
        "start.euler_313_deg": [0.0, 0.0, 0.5],
        "plant.centre_of_mass_um": [0.0, 0.0, 0.0],
        "plant.drive_torque_noise_nm": 0.0,
    }
    one = gymnasium.make(NAME, set=SHORT | still).unwrapped
    first, info = one.reset(seed=1)
    assert info["error_deg"] == pytest.approx(0.5, abs=1e-9)
    np.testing.assert_allclose(first, [*np.radians([0.0, 0.0, 0.5]), *np.zeros(10)], atol=1e-9)
    assert tracking_task.reward(one.loop, np.zeros((1, 3)))[0] == pytest.approx(0.5, abs=1e-9)
    assert tracking_task.reward(one.loop, np.ones((1, 3)))[0] == pytest.approx(0.49, abs=1e-9)
    assert one.step(np.zeros(3))[1] == pytest.approx(0.5, abs=1e-5)  # the balance masses settle by nanometres


def test_a_body_at_its_stop_has_failed_and_begins_again() -> None:
    many = gymnasium.make_vec(NAME, num_envs=2, set=SHORT | {"run.ticks": 60})
    many.reset(seed=2)
    push = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    for _ in range(50):
        _, _, terminated, truncated, _ = many.step(push)
        if terminated.any():
            break
    assert terminated.tolist() == [True, False]
    assert not truncated.any()
    again, rewards, terminated, _, _ = many.step(push)
    assert not terminated.any()
    assert rewards[0] == 0.0
    assert np.linalg.norm(again[0, :3]) < np.radians(8.0)  # where it began, beside where the reference is by now
    np.testing.assert_allclose(again[0, 9:], 0.0, atol=5.0)
    alone = gymnasium.make(NAME, set=SHORT | {"run.ticks": 60}).unwrapped
    alone.reset(seed=2)
    while not alone.step(push[0])[2]:
        pass
    with pytest.raises(nacs.NacsError, match="the episode is over; reset"):
        alone.step(push[0])


def test_what_is_dispersed_differs_from_body_to_body_and_from_episode_to_episode() -> None:
    same = {"sensors.set": "ideal", "start.attitude_error_deg": 0.0, "plant.air_torque_nm": 0.0, "plant.drive_torque_noise_nm": 0.0}
    seen = []
    for dispersion in ({}, {"plant.centre_of_mass_um.0": {"uniform": [20.0, 60.0]}}):
        many = gymnasium.make_vec(NAME, num_envs=2, set=SHORT | same, dispersion=dispersion)
        for _ in range(2):
            many.reset(seed=3 if not seen else None)
            seen.append(many.step(np.zeros((2, 3)))[0])
    assert np.array_equal(seen[0][0], seen[0][1])
    assert np.array_equal(seen[0], seen[1])
    assert not np.array_equal(seen[2][0], seen[2][1])
    assert not np.array_equal(seen[2], seen[3])


def test_the_policy_that_comes_along_follows_the_reference() -> None:
    gains = tracking_policy.read()
    many = gymnasium.make_vec(NAME, num_envs=4, set=SHORT | {"run.ticks": 60})
    observed, _ = many.reset(seed=11)
    rewards = np.zeros((60, 4))
    for tick in range(60):
        observed, rewards[tick], _, _, _ = many.step(tracking_policy.action(gains, observed))
    assert rewards[30:].min() > 0.9


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ({"scenario": "formation/fault-free"}, "has several agents"),
        ({"scenario": "nacs/faultfree"}, "did you mean nacs/fault-free"),
        ({"scenario": "monolithic/fault-free"}, "no wheels whose limit could be taken; give torque_nm"),
        ({"torque_nm": -1.0}, "torque_nm = -1.0: must be positive"),
        ({"loop": "other"}, "no such loop"),
        ({"dispersion": {"run.tick_s": {"uniform": [0.1, 0.2]}}}, "dispersion.run.tick_s: keys of plant, start, sensors, faults"),
        ({"dispersion": {"plant.mass_kg": {"uniform": [4.0]}}}, "dispersion.plant.mass_kg"),
        ({"dispersion": {"plant.mas_kg": {"uniform": [3.0, 4.0]}}}, "dispersion.plant.mas_kg"),
    ],
)
def test_what_cannot_be_made(how: dict, said: str) -> None:
    with pytest.raises(nacs.NacsError) as wrong:
        nacs.environments.TrackingEnv(**how)
    assert said in str(wrong.value)
    assert "\n" not in str(wrong.value)


def test_actions_that_cannot_be_taken() -> None:
    many = nacs.environments.TrackingVectorEnv(2, set=SHORT)
    with pytest.raises(nacs.NacsError, match="no episode has begun"):
        many.step(np.zeros((2, 3)))
    many.reset(seed=1)
    with pytest.raises(nacs.NacsError, match=r"action of shape \(2, 4\): must have 6 numbers"):
        many.step(np.zeros((2, 4)))
    with pytest.raises(nacs.NacsError, match="action is not finite"):
        many.step(np.full((2, 3), np.nan))
    with pytest.raises(nacs.NacsError, match="num_envs=0: must be a whole number"):
        nacs.environments.TrackingVectorEnv(0)
    with pytest.raises(nacs.NacsError, match=r"seed=\[1, 2\]: must be a whole number"):
        many.reset(seed=[1, 2])
    with pytest.raises(nacs.NacsError, match="share a clock"):
        many.reset(options={"reset_mask": np.array([True, False])})


def test_without_gymnasium_it_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    monkeypatch.delitem(sys.modules, "nacs.environments")
    with pytest.raises(nacs.NacsError, match=r"needs gymnasium: pip install 'nacs-twin\[rl\]'"):
        __import__("nacs.environments")


def test_the_example_flies() -> None:
    example = Path(__file__).parents[1] / "docs" / "examples" / "learn_with_gymnasium.py"
    flown = runpy.run_path(str(example))
    assert flown["over"].all()
    assert flown["returned"].min() > 30.0
