"""Error dynamics, feed-forward, sliding mode and torque limit: eq. 17, 18, 32, 35-40 of Hill et al. (2021) on the exact model."""

from typing import NamedTuple

import numpy as np
import pytest

from control.feed_forward import BodyModel, feed_forward, gyroscopic_coupling, times
from control.proportional_derivative import ProportionalDerivative
from control.sliding_mode import SlidingMode
from control.torque_limit import AxisLimited
from control.tracking import Controller, Estimate, Target, TrackingError, tracking_error
from models.attitude.quaternion import cross, from_rotation_vector, multiply, normalize, xi
from models.dynamics.process import runge_kutta
from models.dynamics.wheeled_body import WheeledBody
from sim.scenario.references import Sinusoid

R = np.sqrt(0.5)
PYRAMID = np.array([[R, -R, 0.0, 0.0], [R, R, R, R], [0.0, 0.0, R, -R]])  # eq. 11 and table 1
INERTIA = np.array([[399.0, 12.0, -20.0], [12.0, 377.0, 8.0], [-20.0, 8.0, 360.0]])  # table 1's, tilted, so that no product is zero
TRUTH = WheeledBody(INERTIA, PYRAMID, wheel_inertia=0.1)  # eq. 3 and 4, with dh_w/dt = -T_c
BODY = BodyModel(INERTIA, 0.1 * PYRAMID)
INVERSE = np.linalg.pinv(PYRAMID)
PRINTED = BodyModel(np.diag([399.0, 377.0, 377.0]), 0.1 * PYRAMID)


class Situation(NamedTuple):
    estimate: Estimate
    target: Target
    error: TrackingError


def situations(count: int = 50, size: float = 1.0) -> Situation:
    """Random states and targets with rates of `size` rad/s and wheels of 100 rad/s."""
    rng = np.random.default_rng(17)
    q, q_d = normalize(rng.standard_normal((2, count, 4)))
    omega, omega_d, alpha_d = size * rng.standard_normal((3, count, 3))
    estimate, target = Estimate(q, omega, 100.0 * rng.standard_normal((count, 4))), Target(q_d, omega_d, alpha_d)
    return Situation(estimate, target, tracking_error(estimate, target))


def error_acceleration(now: Situation, torque_B: np.ndarray) -> np.ndarray:
    """dw_e/dt by eq. 17, with domega/dt of the model."""
    estimate, target, error = now
    motion = TRUTH.derivative(np.concatenate(estimate[:3], axis=-1), -times(INVERSE, torque_B))
    wanted = times(error.rotation, target.omega_DN_D)
    return motion[..., 4:7] + cross(error.rate, wanted) - times(error.rotation, target.alpha_DN_D)


def norm(vector: np.ndarray) -> np.ndarray:
    return np.sqrt(np.sum(vector**2, axis=-1))


# error dynamics ----------------------------------------------------------------------------------------------------------------


def test_eq_17_is_the_derivative_of_the_rate_error():
    now, h = situations(), 1e-4
    (q, omega, wheels, *_), (q_d, omega_d, alpha_d), _ = now
    torque = 500.0 * np.random.default_rng(1).standard_normal((50, 3))
    motion = TRUTH.derivative(np.concatenate([q, omega, wheels], axis=-1), -times(INVERSE, torque))
    ahead, behind = (
        tracking_error(
            Estimate(multiply(from_rotation_vector(t * omega), q), omega + t * motion[:, 4:7], wheels),
            Target(multiply(from_rotation_vector(t * omega_d), q_d), omega_d + t * alpha_d, alpha_d),
        ).rate
        for t in (h, -h)
    )
    np.testing.assert_allclose(error_acceleration(now, torque), (ahead - behind) / (2 * h), atol=1e-6)  # h^2 times rates cubed


def test_sigma_is_skew_symmetric_and_does_no_work():
    estimate, target, error = situations()
    coupling = gyroscopic_coupling(BODY, estimate, error, target)
    assert np.abs(coupling).max() > 300.0
    np.testing.assert_allclose(coupling, -coupling.swapaxes(-1, -2), atol=1e-12)
    np.testing.assert_allclose(np.sum(error.rate * times(coupling, error.rate), axis=-1), 0.0, atol=1e-11)


def test_with_this_sigma_eq_18_is_eq_4_14_and_17():
    now = situations()
    estimate, target, error = now
    torque = 500.0 * np.random.default_rng(1).standard_normal((50, 3))
    coupled = times(gyroscopic_coupling(BODY, estimate, error, target), error.rate)
    needed = feed_forward(BODY, estimate, error, target)
    actual = times(INERTIA, error_acceleration(now, torque))
    np.testing.assert_allclose(torque + coupled - needed, actual, atol=1e-11)
    assert norm(torque - coupled - needed - actual).min() > 1.0  # with the other sign of Sigma
    assert norm(torque + coupled + needed - actual).min() > 1.0  # and of what is fed forward


def test_the_feed_forward_is_written_as_eq_32():
    estimate, target, error = situations()
    for i in range(50):
        wanted, momentum = error.rotation[i] @ target.omega_DN_D[i], 0.1 * PYRAMID @ estimate.omega_wheel[i]
        printed = np.cross(wanted, momentum) + np.cross(wanted, INERTIA @ wanted) + INERTIA @ error.rotation[i] @ target.alpha_DN_D[i]
        np.testing.assert_allclose(feed_forward(BODY, estimate, error, target)[i], printed, atol=1e-11)


def test_a_body_on_its_reference_stays_there_under_either_law():
    estimate, target, _ = situations()
    on_it = estimate._replace(q_BN=target.q_DN, omega_BN_B=target.omega_DN_D)
    now = Situation(on_it, target, tracking_error(on_it, target))
    for law in (ProportionalDerivative(70.0, 100.0, BODY), SlidingMode(0.15, 0.15, BODY, boundary_layer=0.01)):
        np.testing.assert_allclose(error_acceleration(now, law.step(on_it, target)), 0.0, atol=1e-13)
    idle = ProportionalDerivative(70.0, 100.0).step(on_it, target)
    assert norm(error_acceleration(now, idle)).min() > 0.01  # without feed-forward it would leave


# Lyapunov functions ------------------------------------------------------------------------------------------------------------

MOVING = Sinusoid(type="sinusoid", amplitude_deg=(30.0, 40.0, 20.0), period_s=(300.0, 200.0, 400.0))


def fly(law: Controller, seconds: float, dt: float, trials: int = 12) -> Situation:
    """Situations (ticks, trials, ...) of the exact model from random attitudes, after a reference that moves."""
    ticks = round(seconds / dt)
    targets = MOVING.at(dt * np.arange(ticks))
    start = situations(trials, 0.05).estimate
    state, path = np.concatenate(start[:3], axis=-1), np.empty((ticks, trials, 11))
    for k in range(ticks):
        path[k] = state
        torque = law.step(Estimate(state[:, :4], state[:, 4:7], state[:, 7:]), Target(*(part[k] for part in targets)))
        state = runge_kutta(TRUTH, state, -times(INVERSE, torque), dt)
        state[:, :4] = normalize(state[:, :4])
    estimate = Estimate(path[..., :4], path[..., 4:7], path[..., 7:])
    target = Target(*(part[:, None] for part in targets))
    return Situation(estimate, target, tracking_error(estimate, target))


def energy(error: TrackingError, proportional: float) -> np.ndarray:
    """V of eq. A2, J."""
    return 0.5 * np.sum(error.rate * times(INERTIA, error.rate), axis=-1) + 2.0 * proportional * (1.0 - error.dq[..., 3])


def test_under_feedback_the_energy_of_the_error_falls_as_eq_A5_says():
    now, law = situations(), ProportionalDerivative(70.0, 100.0, BODY)
    acceleration = error_acceleration(now, law.step(now.estimate, now.target))
    attitude = 0.5 * times(xi(now.error.dq), now.error.rate)
    slope = np.sum(now.error.rate * times(INERTIA, acceleration), axis=-1) - 2.0 * 70.0 * attitude[:, 3]
    np.testing.assert_allclose(slope, -100.0 * np.sum(now.error.rate**2, axis=-1), rtol=1e-11)


def test_feedback_with_feed_forward_never_gains_energy_and_comes_to_the_reference():
    followed = fly(ProportionalDerivative(70.0, 100.0, BODY), 200.0, 0.1)
    assert (np.diff(energy(followed.error, 70.0), axis=0) < 1e-8).all()  # J, of some hundred at the start
    assert norm(followed.error.dq[-1, :, :3]).max() < 1e-4
    behind = fly(ProportionalDerivative(70.0, 100.0), 200.0, 0.1)
    assert norm(behind.error.dq[-1, :, :3]).min() > 1e-3


@pytest.mark.parametrize("layer", [0.0, 10.0])
def test_the_surface_is_approached_at_the_rate_K(layer):
    """dS/dt = -K sign(S) (eq. 37 to 39), or -K S / phi within the layer."""
    now, law = situations(), SlidingMode(0.3, ((0.1, 0.2, 0.4),), BODY, layer)
    acceleration = error_acceleration(now, law.step(now.estimate, now.target))
    attitude = 0.5 * times(xi(now.error.dq), now.error.rate)
    surface = now.error.rate + 0.3 * now.error.dq[:, :3]
    toward = np.clip(surface / layer, -1.0, 1.0) if layer else np.sign(surface)
    np.testing.assert_allclose(acceleration + 0.3 * attitude[:, :3], -np.array([0.1, 0.2, 0.4]) * toward, atol=1e-12)


def test_the_surface_is_reached_in_time_and_the_error_dies_out_on_it():
    slope, reaching, dt = 0.15, 0.15, 0.01
    _, _, error = fly(SlidingMode(slope, reaching, BODY), 60.0, dt)
    surface = np.abs(error.rate + slope * error.dq[..., :3])
    reached = surface[0].max() / reaching  # s
    assert reached < 3.0
    within = np.arange(len(surface)) * dt > reached + 0.1
    assert surface[within].max() < 2.0 * reaching * dt  # it chatters by a tick's worth
    assert (np.diff(np.sum(surface**2, axis=-1), axis=0)[surface[:-1].min(axis=-1) > 2.0 * reaching * dt] < 0).all()
    start, end = round(5.0 / dt), round(25.0 / dt)
    quarter = np.tan(0.5 * np.arctan2(norm(error.dq[..., :3]), error.dq[..., 3]))  # exactly exponential on the surface
    np.testing.assert_allclose(quarter[end] / quarter[start], np.exp(-0.5 * slope * 20.0), rtol=0.03)


def test_a_boundary_layer_stops_the_chatter():
    def restless(layer: float) -> float:
        now = fly(SlidingMode(0.15, 0.15, BODY, layer), 40.0, 0.1, trials=4)
        acceleration = np.diff(now.error.rate[-100:], axis=0) / 0.1
        return float(np.abs(acceleration).max())

    assert restless(0.0) > 0.1  # two thirds of K, up and down
    assert restless(0.05) < 0.01


def test_outside_the_boundary_layer_the_law_is_the_printed_one():
    now = situations()
    np.testing.assert_array_equal(
        SlidingMode(0.15, 0.15, BODY, 1e-6).step(now.estimate, now.target), SlidingMode(0.15, 0.15, BODY).step(now.estimate, now.target)
    )


# modes -------------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("reaching", [(0.15, 2.0), ((0.15, 0.1, 0.2), (2.0, 1.0, 3.0))])
def test_the_gains_are_those_of_the_modes_blended(reaching):
    now = situations(3)
    modes = np.array([[1.0, 0.0], [0.0, 1.0], [0.85, 0.15]])
    torque = SlidingMode((0.15, 1.5), reaching, BODY).step(now.estimate._replace(mode_probabilities=modes), now.target)
    for trial, mu in enumerate(modes):
        mixed = mu @ np.array(reaching)
        single = SlidingMode(float(mu @ [0.15, 1.5]), float(mixed) if mixed.ndim == 0 else (tuple(mixed),), BODY)
        np.testing.assert_allclose(torque[trial], single.step(now.estimate, now.target)[trial], rtol=1e-13)
    with pytest.raises(ValueError, match="gains for 2 modes, probabilities of 3"):
        SlidingMode(0.15, reaching, BODY).step(now.estimate._replace(mode_probabilities=np.eye(3)), now.target)


@pytest.mark.parametrize(
    "law", [SlidingMode((0.15, 1.5), (0.15, 2.0), BODY), AxisLimited(ProportionalDerivative((70.0, 100.0), (100.0, 135.0), BODY), 20.0)]
)
def test_a_trial_has_the_same_bits_in_any_batch(law):
    now = situations(1000)
    told = now.estimate._replace(mode_probabilities=np.random.default_rng(1).dirichlet(np.ones(2), 1000))

    def some(which) -> np.ndarray:
        return law.step(Estimate(*(None if part is None else part[which] for part in told)), Target(*(part[which] for part in now.target)))

    everyone = some(slice(None))
    for size in (1, 3, 10, 64):
        np.testing.assert_array_equal(some(slice(7, 7 + size)), everyone[7 : 7 + size])
    np.testing.assert_array_equal(some(5), everyone[5])


# torque limit ------------------------------------------------------------------------------------------------------------------


def test_each_axis_is_cut_off_by_itself():
    now, law = situations(), ProportionalDerivative(70.0, 100.0)
    free, held = law.step(now.estimate, now.target), AxisLimited(law, 20.0).step(now.estimate, now.target)
    small = np.abs(free) <= 20.0
    assert 10 < small.sum() < 140
    np.testing.assert_array_equal(held[small], free[small])
    np.testing.assert_array_equal(held[~small], 20.0 * np.sign(free)[~small])


def test_wheels_cut_off_one_by_one_would_leave_no_torque_about_y():
    """Table 2 has 1.00 N m RMS about each body axis for the switching law with the gains of table 1; so the limit is the axes'."""
    signs = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    attitude, rate = np.array([0.0, 0.0, 0.0, 1.0]), 0.01 * signs  # a hundredth of a radian per second off, in any direction
    told, level = Estimate(np.tile(attitude, (8, 1)), rate, np.zeros((8, 4))), Target(attitude, np.zeros(3), np.zeros(3))
    law = SlidingMode(0.15, 0.15, PRINTED)
    wanted = law.step(told, level)
    np.testing.assert_allclose(wanted / -signs, np.tile([60.0, 57.0, 57.0], (8, 1)), atol=0.6)  # I K, sixty times the limit
    by_wheel = -np.clip(-times(INVERSE, wanted), -1.0, 1.0) @ PYRAMID.T
    np.testing.assert_allclose(by_wheel, -signs * [np.sqrt(2.0), 0.0, np.sqrt(2.0)], atol=1e-12)
    by_axis = AxisLimited(law, 1.0).step(told, level)
    np.testing.assert_array_equal(by_axis, -signs)
    assert np.abs(times(INVERSE, by_axis)).max() == pytest.approx(1.5 * R)  # 1.06 N m: a little more than a wheel has
