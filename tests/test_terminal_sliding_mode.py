"""The consensus law at the start of Rososhansky (2017), figure 5.5, and the parts that it is made of."""

import numpy as np
import pytest

from control.communication_graph import CommunicationGraph
from control.terminal_sliding_mode import Lumped, TerminalSlidingMode, lumped, signed_power
from models.plants.agents import AgentsParameters

GRAPH = CommunicationGraph.of(6, ((1, 2, 0.7), (2, 3, 0.6), (3, 4, 0.7), (4, 5, 0.8), (5, 6, 0.9)), ((1, 0.8), (6, 0.9)))
LAW = TerminalSlidingMode()


def seen(place, speed, leader):
    """What agents see of each other over the ideal network."""
    own = np.concatenate([place, speed], axis=-1)
    heard = np.concatenate([np.broadcast_to(leader, (*own.shape[:-2], 1, 4)), own], axis=-2)
    return lumped(own, heard[..., None, :, :], GRAPH.listening)


RNG = np.random.default_rng(8)
FIGURE = [(3.3, -6.8), (-12.8, -2.8), (7.9, 17.3), (-3.6, -10.8), (14.8, -24.9), (-15.1, 32.7)]


def test_the_commands_at_the_start_are_those_of_the_figure():
    start = AgentsParameters().start
    sliding = LAW.step(seen(start[:, :2], start[:, 2:], [0.5, 0.0, 0.0, 0.5]), np.zeros((6, 2)))
    np.testing.assert_allclose(sliding.force, FIGURE, rtol=0.01, atol=0.05)  # the figure is read to 0.1 N


def test_lumped_errors_are_sums_over_neighbours_and_the_leader():
    place, leader = RNG.standard_normal((4, 6, 2)), RNG.standard_normal(2)
    laplacian = np.diag(GRAPH.listening.sum(axis=-1)) - GRAPH.weights
    found = seen(place, 2.0 * place, np.concatenate([leader, 2.0 * leader]))
    np.testing.assert_allclose(found.position, laplacian @ (place - leader), atol=1e-12)
    np.testing.assert_allclose(found.velocity, 2.0 * found.position, atol=1e-12)


def test_on_the_leader_there_is_nothing_but_what_was_learned():
    learned = RNG.standard_normal((6, 2))
    np.testing.assert_array_equal(LAW.step(Lumped(np.zeros((6, 2)), np.zeros((6, 2))), learned).force, -learned)


def test_every_axis_is_pushed_against_its_surface_by_more_than_the_bound():
    error, rate = RNG.standard_normal((2, 50, 6, 2))
    sliding = LAW.step(seen(error, rate, np.zeros(4)), np.zeros((6, 2)))
    assert (sliding.force * np.sign(sliding.surface) < 0.0).all()
    far = np.abs(sliding.surface) > 0.2
    assert (np.abs(sliding.force)[far] > 1.0).all()
    assert (np.abs(sliding.robust) <= 1.0).all()


def test_signed_power():
    np.testing.assert_allclose(signed_power(np.array([-4.0, 0.0, 9.0]), 0.5), [-2.0, 0.0, 3.0])


@pytest.mark.parametrize("wrong", [{"exponent": 0.0}, {"exponent": 1.2}, {"width": 0.0}, {"bound": -1.0}])
def test_impossible_settings_are_refused(wrong):
    with pytest.raises(ValueError, match=f"{next(iter(wrong))} = "):
        TerminalSlidingMode(**wrong)


def test_dynamics_by_hand():
    state = np.array([1.0, 2.0, 0.5, -0.3]) * np.ones((6, 1))
    force = AgentsParameters().unknown_force(state, np.array([3.0, -1.0]))
    np.testing.assert_allclose(force[3], [12 * 2.0 * np.sin(-0.3 * 0.5 / 2 + np.pi / 4), -4 * 1.0 * np.cos(-0.7 * -0.3 / 2)])
