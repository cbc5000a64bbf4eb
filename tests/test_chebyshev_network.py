"""The network against NumPy's Chebyshev series, and the agents' model against differences and its own linear part."""

import numpy as np
import pytest
from numpy.polynomial import chebyshev

from control.adaptive_network_law import AdaptiveNetworkLaw
from models.chebyshev_network import ChebyshevNetwork
from models.dynamics.planar_agent import PlanarAgent, runge_kutta_of_motion
from models.dynamics.process import runge_kutta

NETWORK = ChebyshevNetwork()
AGENT = PlanarAgent(NETWORK, 2.0)
RNG = np.random.default_rng(5)


def test_the_thesis_network_has_13_terms_and_26_weights():
    assert (NETWORK.terms, NETWORK.size) == (13, 26)


def test_the_basis_is_a_constant_and_three_polynomials_of_each_input():
    x = RNG.uniform(-2.0, 2.0, (5, 6, 4))
    expected = [np.ones((5, 6))]
    expected += [chebyshev.chebval(x[..., j], np.eye(4)[i]) for j in range(4) for i in (1, 2, 3)]
    np.testing.assert_allclose(NETWORK.basis(x), np.stack(expected, axis=-1), atol=1e-12)


def test_slope_by_differences():
    x, h = RNG.uniform(-1.5, 1.5, (3, 4)), 1e-6
    moved = [(NETWORK.basis(x + h * e) - NETWORK.basis(x - h * e)) / (2 * h) for e in np.eye(4)]
    np.testing.assert_allclose(NETWORK.slope(x), np.stack(moved, axis=-1), atol=1e-7)


def test_jacobian_of_the_agent_by_differences():
    x, u, h = RNG.uniform(-1.0, 1.0, (2, 30)), RNG.standard_normal((2, 2)), 1e-6
    moved = [(AGENT.derivative(x + h * e, u) - AGENT.derivative(x - h * e, u)) / (2 * h) for e in np.eye(30)]
    here = AGENT.linearize(x, u)
    np.testing.assert_allclose(here.jacobian, np.stack(moved, axis=-1), atol=1e-7)
    np.testing.assert_array_equal(here.derivative, AGENT.derivative(x, u))


def test_acceleration_is_linear_in_the_weights():
    motion, weights, u = RNG.standard_normal((7, 4)), RNG.standard_normal((7, 26)), RNG.standard_normal((7, 2))
    linear = (AGENT.by_weights(motion) @ weights[..., None])[..., 0] + u / 2.0
    np.testing.assert_allclose(AGENT.acceleration(motion, weights, u), linear, atol=1e-12)


def test_the_integrator_of_the_motion_alone_is_the_common_one():
    x, u = RNG.uniform(-1.0, 1.0, (4, 61, 30)), RNG.standard_normal((4, 1, 2))
    np.testing.assert_allclose(runge_kutta_of_motion(AGENT, x, u, 0.01), runge_kutta(AGENT, x, u, 0.01), atol=1e-14)


def test_the_adaptive_law_cancels_what_the_network_adds_to_the_surface():
    """d/dt (|s|^2 / 2 + |W* - W|^2 / 2 Gamma) of ds/dt = (W* - W) phi is zero (the proof behind eq. 5.29)."""
    law, dt = AdaptiveNetworkLaw(5.0), 1e-4
    wanted, weights = RNG.standard_normal((2, 26))
    s, phi = RNG.standard_normal(2), NETWORK.basis(RNG.uniform(-1.0, 1.0, 4))

    def energy(s, weights):
        return 0.5 * s @ s + np.sum((wanted - weights) ** 2) / 10.0

    after = energy(s + dt * (wanted - weights).reshape(2, 13) @ phi, law.step(weights, s, phi, dt))
    assert abs(after - energy(s, weights)) < 1e-3 * dt * abs(s @ ((wanted - weights).reshape(2, 13) @ phi)) + 200 * dt**2


def test_a_network_of_nothing_is_refused():
    with pytest.raises(ValueError, match="order = 0"):
        ChebyshevNetwork(order=0)
