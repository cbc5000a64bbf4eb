"""Gains mixed by mode probabilities: shapes, limits, bits, and what a law makes of them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from control.gain_blending import blend
from control.proportional_derivative import ProportionalDerivative
from control.tracking import Estimate, Target
from models.attitude.quaternion import IDENTITY, normalize

RNG = np.random.default_rng(12)
GAINS = {"scalars": RNG.random(3), "vectors": RNG.random((3, 3)), "matrices": RNG.random((3, 3, 3)), "oblong": RNG.random((3, 2, 5))}
SOMEWHERE = Target(normalize(RNG.standard_normal(4)), RNG.standard_normal(3), np.zeros(3))


def probabilities(*shape: int) -> np.ndarray:
    return np.random.default_rng(5).dirichlet(np.ones(3), shape)


def estimate(modes: np.ndarray | None, trials: int = 6) -> Estimate:
    rng = np.random.default_rng(9)
    return Estimate(normalize(rng.standard_normal((trials, 4))), rng.standard_normal((trials, 3)), np.zeros((trials, 4)), modes)


@pytest.mark.parametrize("name", GAINS)
@pytest.mark.parametrize("lead", [(), (1,), (7,), (2, 3)])
def test_the_mixture_is_the_weighted_sum_for_any_shape_and_leading_axes(name, lead):
    gains, mu = GAINS[name], probabilities(*lead)
    mixed = blend(gains, mu)
    assert mixed.shape == (*lead, *gains.shape[1:])
    np.testing.assert_allclose(mixed, np.tensordot(mu, gains, axes=1), rtol=1e-15)


@pytest.mark.parametrize("name", GAINS)
def test_a_mode_that_is_certain_has_exactly_its_own_gains(name):
    np.testing.assert_array_equal(blend(GAINS[name], np.eye(3)), GAINS[name])


@pytest.mark.parametrize("name", GAINS)
def test_without_probabilities_the_healthy_mode_is_certain(name):
    np.testing.assert_array_equal(blend(GAINS[name], None), GAINS[name][0])


def test_a_number_is_the_gain_of_every_mode():
    assert blend(0.3, probabilities(4)) == 0.3
    assert blend(0.3, None) == 0.3


@given(st.lists(st.floats(0.0, 1.0), min_size=2, max_size=2).filter(lambda p: sum(p) > 0.1), st.floats(-5, 5), st.floats(-5, 5))
def test_a_mixture_lies_between_its_gains(weights, first, second):
    mu = np.array(weights) / sum(weights)
    assert min(first, second) - 1e-14 <= blend((first, second), mu) <= max(first, second) + 1e-14


@pytest.mark.parametrize("gains", [np.ones(2), np.ones((4, 3)), np.ones(1)])
def test_gains_that_are_not_one_a_mode_are_refused(gains):
    with pytest.raises(ValueError, match=f"gains for {len(gains)} modes, probabilities of 3"):
        blend(gains, probabilities(5))


@pytest.mark.parametrize("modes", [3, 9])  # nine: where a sum may be taken in another order
def test_a_trial_has_the_same_bits_in_any_batch_and_layout(modes):
    rng = np.random.default_rng(3)
    mu, gains = rng.dirichlet(np.ones(modes), 1000), rng.random((modes, 3, 3))
    everyone = blend(gains, mu)
    turned = np.asfortranarray(mu)  # as a bank of filters may keep them, modes first
    for size in (1, 3, 10, 64):
        np.testing.assert_array_equal(blend(gains, mu[7 : 7 + size]), everyone[7 : 7 + size])
        np.testing.assert_array_equal(blend(gains, turned[7 : 7 + size]), everyone[7 : 7 + size])
    np.testing.assert_array_equal(blend(gains, turned[5]), everyone[5])


# in quaternion feedback --------------------------------------------------------------------------------------------------------


def test_feedback_uses_the_blended_gains_of_each_trial():
    modes = np.array([[1.0, 0.0], [0.0, 1.0], [0.85, 0.15], [0.5, 0.5], [0.25, 0.75], [0.9, 0.1]])
    torque = ProportionalDerivative((70.0, 100.0), (100.0, 135.0)).step(estimate(modes), SOMEWHERE)
    for trial, (healthy, faulty) in enumerate(modes):
        single = ProportionalDerivative(70.0 * healthy + 100.0 * faulty, 100.0 * healthy + 135.0 * faulty)
        np.testing.assert_allclose(torque[trial], single.step(estimate(None), SOMEWHERE)[trial], rtol=1e-14)


def test_feedback_without_knowledge_of_the_mode_uses_the_healthy_gains():
    blended, single = ProportionalDerivative((70.0, 100.0), (100.0, 135.0)), ProportionalDerivative(70.0, 100.0)
    np.testing.assert_array_equal(blended.step(estimate(None), SOMEWHERE), single.step(estimate(None), SOMEWHERE))
    np.testing.assert_array_equal(single.step(estimate(probabilities(6)), SOMEWHERE), single.step(estimate(None), SOMEWHERE))


def test_feedback_for_fewer_modes_than_are_estimated_is_refused():
    told = Estimate(IDENTITY, np.zeros(3), np.zeros(4), np.array([0.5, 0.3, 0.2]))
    with pytest.raises(ValueError, match="gains for 2 modes, probabilities of 3"):
        ProportionalDerivative((70.0, 100.0), 100.0).step(told, SOMEWHERE)
