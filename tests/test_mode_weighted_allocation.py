"""Allocation by the probable health of the wheels: limits, failed wheels, the latch."""

import numpy as np
import pytest

from control.allocation import PseudoInverseAllocation
from control.mode_weighted_allocation import ModeWeightedAllocation
from control.tracking import Estimate
from models.attitude.quaternion import IDENTITY
from models.plants.wheels import pyramid

AXES = pyramid()
HEALTH = np.array([[1.0, 1, 1, 1], [0, 1, 1, 1], [1, 0.25, 1, 1]])  # healthy, wheel 1 dead, wheel 2 weak
LAW = ModeWeightedAllocation(AXES, 1.0, HEALTH, latch_above=0.9, latch_ticks=3)
TORQUE = 0.1 * np.random.default_rng(8).standard_normal((200, 3))


def told(modes) -> Estimate:
    return Estimate(IDENTITY, np.zeros(3), np.zeros(4), None if modes is None else np.asarray(modes, dtype=float))


def share(modes, torque: np.ndarray = TORQUE, law: ModeWeightedAllocation = LAW) -> np.ndarray:
    """Wheel torques with nothing latched."""
    return law.step(torque, told(modes), law.start(torque.shape[:-1]))[0]


def through(history) -> list[np.ndarray]:
    """Wheel torques for one body torque, tick by tick."""
    memory, wheels = LAW.start(()), []
    for modes in history:
        wheel, memory = LAW.step(TORQUE[0], told(modes), memory)
        wheels.append(wheel)
    return wheels


@pytest.mark.parametrize("modes", [None, [1.0, 0.0, 0.0]])
def test_healthy_wheels_share_as_the_pseudo_inverse_does(modes):
    plain = PseudoInverseAllocation(AXES, 1.0)
    expected, _ = plain.step(TORQUE, told(None), plain.start((200,)))
    np.testing.assert_allclose(share(modes), expected, atol=1e-15)


def test_a_dead_wheel_is_left_alone_and_the_others_give_all():
    wheel = share([0.0, 1.0, 0.0])
    np.testing.assert_allclose(-wheel @ AXES.T, TORQUE, atol=1e-15)
    np.testing.assert_allclose(wheel[:, 0], 1e-6 * (wheel[:, 1] + wheel[:, 2] - wheel[:, 3]), rtol=1e-8)  # its weight in the sum
    three = np.linalg.inv(AXES[:, 1:])  # three wheels leave no choice
    np.testing.assert_allclose(wheel[:, 1:], -TORQUE @ three.T, rtol=1e-4, atol=1e-6)


def test_the_fault_itself_turns_the_torque_of_one_who_does_not_know():
    fault = np.array([0.0, 1.0, 1.0, 1.0])
    knowing, unknowing = (-(share(modes) * fault) @ AXES.T for modes in ([0.0, 1.0, 0.0], None))
    np.testing.assert_allclose(knowing, TORQUE, atol=1e-6)
    assert np.linalg.norm(unknowing - TORQUE, axis=-1).mean() > 0.2 * np.linalg.norm(TORQUE, axis=-1).mean()


@pytest.mark.parametrize("modes", [[0.7, 0.3, 0.0], [0.2, 0.2, 0.6], [0.0, 0.0, 1.0]])
def test_any_mixture_asks_for_the_whole_torque_at_the_least_weighted_cost(modes):
    wheel, weight = share(modes), np.array(modes) @ HEALTH
    np.testing.assert_allclose(-wheel @ AXES.T, TORQUE, atol=1e-15)
    null = np.array([1.0, -1.0, -1.0, 1.0])
    np.testing.assert_allclose(AXES @ null, 0.0, atol=1e-15)
    np.testing.assert_allclose((wheel / weight) @ null, 0.0, atol=1e-15)  # stationary along what can be moved freely


def test_a_wheel_is_asked_for_less_the_less_probable_its_health_is():
    asked = np.array([np.abs(share([1.0 - mu, mu, 0.0])[:, 0]).sum() for mu in np.linspace(0.0, 1.0, 11)])
    assert (np.diff(asked) < 0).all()


def test_a_demand_beyond_the_drives_keeps_its_direction():
    wheel = share([0.0, 1.0, 0.0], 100.0 * TORQUE)
    np.testing.assert_allclose(np.abs(wheel).max(axis=-1), 1.0, rtol=1e-14)
    given = -wheel @ AXES.T
    np.testing.assert_allclose(np.cross(given, TORQUE), 0.0, atol=1e-15)
    assert (np.sum(given * TORQUE, axis=-1) > 0).all()


# latch -------------------------------------------------------------------------------------------------------------------------

SURE, UNSURE, CLEAR = [0.05, 0.95, 0.0], [0.3, 0.7, 0.0], [1.0, 0.0, 0.0]


def test_a_mode_that_lasts_is_believed_for_good():
    wheels = through([CLEAR, SURE, SURE, SURE, UNSURE, CLEAR, CLEAR])
    dead = share([0.0, 1.0, 0.0])[0]
    np.testing.assert_array_equal(wheels[3:], [dead] * 4)  # from the third tick in a row on
    assert abs(wheels[2][0]) > 0.01 * np.abs(wheels[2]).max()  # before, only as probable as it is


def test_a_mode_that_comes_and_goes_is_not():
    wheels = through([SURE, SURE, UNSURE, SURE, SURE, CLEAR])
    np.testing.assert_array_equal(wheels[-1], share(CLEAR)[0])


def test_being_healthy_for_long_does_not_hide_a_later_fault():
    np.testing.assert_array_equal(through([CLEAR] * 20 + [SURE] * 3)[-1], share([0.0, 1.0, 0.0])[0])


def test_two_latched_modes_are_both_believed():
    weak = [0.0, 0.02, 0.98]
    last = through([SURE] * 3 + [weak] * 3 + [CLEAR])[-1]
    both = ModeWeightedAllocation(AXES, 1.0, np.array([[0.0, 0.25, 1, 1]]))
    np.testing.assert_array_equal(last, share(None, law=both)[0])


def test_silence_about_the_modes_changes_no_memory():
    _, memory = LAW.step(TORQUE[0], told(SURE), LAW.start(()))
    np.testing.assert_array_equal(LAW.step(TORQUE[0], told(None), memory)[1], memory)
    np.testing.assert_array_equal(memory, [0.0, 1.0, 0.0])


def test_every_trial_latches_by_itself_and_has_the_same_bits_in_any_batch():
    modes = np.random.default_rng(2).dirichlet([0.1, 0.1, 0.1], (8, 200))  # eight ticks, mostly certain of something

    def fly(which) -> tuple[np.ndarray, np.ndarray]:
        memory = LAW.start(TORQUE[which].shape[:-1])
        for now in modes[:, which]:
            wheel, memory = LAW.step(TORQUE[which], told(now), memory)
        return wheel, memory

    everyone, memory = fly(slice(None))
    assert 0 < (memory[:, 1:] >= 3).any(axis=-1).sum() < 200
    for size in (1, 3, 10, 64):
        np.testing.assert_array_equal(fly(slice(7, 7 + size))[0], everyone[7 : 7 + size])
    np.testing.assert_array_equal(fly(5)[0], everyone[5])


# lost axes ---------------------------------------------------------------------------------------------------------------------


def test_a_mode_that_leaves_no_torque_about_an_axis_says_which():
    r = np.sqrt(0.5)
    pairs = np.array([[r, -r, 0.0, 0.0], [r, r, r, r], [0.0, 0.0, r, -r]])
    law = ModeWeightedAllocation(pairs, 1.0, np.array([[1.0, 1, 1, 1], [0, 1, 1, 1], [0, 0, 1, 1]]))
    healthy, one_dead, two_dead = law.lost_axes
    assert healthy is None
    assert one_dead is None
    np.testing.assert_allclose(two_dead, [1.0, 0.0, 0.0], atol=1e-14)
    wheel = share([0.0, 0.0, 1.0], law=law)
    assert np.abs(wheel).max() < 1.0  # finite: nothing was scaled down
    np.testing.assert_allclose(-(wheel * [0, 0, 1, 1]) @ pairs.T, TORQUE * [0, 1, 1], atol=1e-5)  # the other axes are served


def test_a_latch_is_told_and_that_of_the_healthy_mode_is_none():
    memory, told_of = LAW.start(()), []
    for modes in [CLEAR] * 5 + [SURE] * 3 + [CLEAR] * 2:
        _, memory = LAW.step(TORQUE[0], told(modes), memory)
        told_of.append(bool(LAW.notes(memory)["latched"]))
    assert told_of == [False] * 7 + [True] * 3
    assert PseudoInverseAllocation(AXES, 1.0).notes(memory) == {}
