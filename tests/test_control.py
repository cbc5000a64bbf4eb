"""Quaternion feedback and allocation: signs by simulation of the analytic model, limits by property."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from control.allocation import PseudoInverseAllocation
from control.proportional_derivative import ProportionalDerivative
from control.tracking import Estimate, Target, tracking_error
from models.attitude.quaternion import IDENTITY, angle, attitude_matrix, from_rotation_vector, multiply, normalize, xi
from models.dynamics.process import runge_kutta
from models.plants.nacs import NacsParameters
from sim.scenario.references import Sinusoid

NACS = NacsParameters()
BODY = NACS.process(coupled=True)
PD = ProportionalDerivative(proportional=0.4, derivative=0.075)
ALLOCATION = PseudoInverseAllocation(NACS.wheel_axes, NACS.torque_limit)
LIMIT = NACS.torque_limit
LEVEL = Target(IDENTITY, np.zeros(3), np.zeros(3))
DT = 0.05

torques = arrays(float, 3, elements=st.floats(-0.2, 0.2, allow_subnormal=False))


def estimate(state: np.ndarray) -> Estimate:
    return Estimate(state[..., :4], state[..., 4:7], state[..., 7:])


def wheels_for(torque: np.ndarray) -> np.ndarray:
    """What the allocation asks of the wheels; it looks at nothing but the torque."""
    nobody = Estimate(IDENTITY, np.zeros(3), np.zeros(4))
    wheel, memory = ALLOCATION.step(torque, nobody, ALLOCATION.start(torque.shape[:-1]))
    assert memory.shape == (*torque.shape[:-1], 0)
    return wheel


def at_rest(rotation_vector: np.ndarray) -> np.ndarray:
    return np.concatenate([from_rotation_vector(rotation_vector), np.zeros((*rotation_vector.shape[:-1], 7))], axis=-1)


def close_loop(state: np.ndarray, targets: Target, sign: float = 1.0) -> np.ndarray:
    """States (ticks + 1, ..., 11) of the body under feedback, one target a tick."""
    path = [state]
    for target in zip(*targets, strict=True):
        motor = wheels_for(sign * PD.step(estimate(path[-1]), Target(*target)))
        after = runge_kutta(BODY, path[-1], motor, DT)
        path.append(np.concatenate([normalize(after[..., :4]), after[..., 4:]], axis=-1))
    return np.array(path)


def held(target: Target, ticks: int) -> Target:
    return Target(*(np.broadcast_to(part, (ticks, *part.shape)) for part in target))


def spread(trials: int, degrees: float) -> np.ndarray:
    """Rotation vectors (trials, 3) of a given angle about axes in all directions."""
    axes = np.random.default_rng(6).standard_normal((trials, 3))
    return np.radians(degrees) * axes / np.linalg.norm(axes, axis=1, keepdims=True)


# feedback ----------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("degrees", [1.0, 30.0, 90.0, 179.0])
def test_feedback_turns_the_body_to_where_it_should_be(degrees):
    path = close_loop(at_rest(spread(20, degrees)), held(LEVEL, 400))
    assert np.degrees(angle(path[-1, :, :4], IDENTITY)).max() < 1e-3  # twenty seconds are twenty time constants
    assert np.abs(path[-1, :, 4:7]).max() < 1e-4


def test_the_signs_of_eq_9_and_27_as_printed_drive_the_body_away():
    path = close_loop(at_rest(spread(20, 1.0)), held(LEVEL, 100), sign=-1.0)
    assert np.degrees(angle(path[:, :, :4], IDENTITY)).max(axis=0).min() > 90.0


def test_a_small_error_is_answered_by_half_the_proportional_gain():
    turn, rate = 1e-4 * np.array([1.0, -2.0, 3.0]), np.array([0.01, 0.02, -0.03])
    told = Estimate(from_rotation_vector(turn), rate, np.zeros(4))
    np.testing.assert_allclose(PD.step(told, LEVEL), -0.5 * 0.4 * turn - 0.075 * rate, atol=1e-12)  # sine: 1e-4 cubed


def test_neither_the_sign_of_the_attitude_nor_that_of_the_target_matters():
    state = at_rest(spread(20, 100.0))
    state[:, 4:7] = 0.1
    target = Target(from_rotation_vector(np.array([0.2, -0.5, 0.1])), np.array([0.01, 0.02, 0.03]), np.zeros(3))
    torque = PD.step(estimate(state), target)
    turned = estimate(state)._replace(q_BN=-state[:, :4])
    np.testing.assert_array_equal(PD.step(turned, target), torque)
    np.testing.assert_array_equal(PD.step(estimate(state), target._replace(q_DN=-target.q_DN)), torque)


def test_the_body_never_unwinds_the_long_way():
    start = at_rest(spread(20, 20.0))
    start[:, :4] *= -1.0  # the other sign of the same attitude
    error = np.degrees(angle(close_loop(start, held(LEVEL, 200))[..., :4], IDENTITY))
    assert error.max() < 20.0 + 1e-9


def test_a_body_that_follows_exactly_is_left_alone():
    rng = np.random.default_rng(1)
    q, omega = normalize(rng.standard_normal((10, 4))), rng.standard_normal((10, 3))
    np.testing.assert_allclose(PD.step(Estimate(q, omega, np.zeros((10, 4))), Target(q, omega, np.zeros((10, 3)))), 0.0, atol=1e-15)


def test_the_rate_error_is_the_rate_of_the_attitude_error():
    """d(dq)/dt = Xi(dq) (omega - A(dq) omega_d) / 2, by central differences."""
    rng, h = np.random.default_rng(2), 1e-4
    q, q_d = normalize(rng.standard_normal((2, 50, 4)))
    omega, omega_d = rng.standard_normal((2, 50, 3))
    now = tracking_error(Estimate(q, omega, np.zeros(4)), Target(q_d, omega_d, np.zeros(3)))
    ahead, behind = (
        tracking_error(
            Estimate(multiply(from_rotation_vector(t * omega), q), omega, np.zeros(4)),
            Target(multiply(from_rotation_vector(t * omega_d), q_d), omega_d, np.zeros(3)),
        ).dq
        for t in (h, -h)
    )
    np.testing.assert_allclose((0.5 * xi(now.dq) @ now.rate[..., None])[..., 0], (ahead - behind) / (2 * h), atol=1e-7)  # h^2
    np.testing.assert_allclose(now.rotation, attitude_matrix(q) @ attitude_matrix(q_d).swapaxes(-1, -2), atol=1e-14)
    assert (now.dq[:, 3] >= 0).all()


def test_a_sinusoid_is_followed_with_the_lag_of_a_law_without_feedforward():
    reference = Sinusoid(type="sinusoid", amplitude_deg=(4.0, 6.0, 7.0), period_s=(40.0, 50.0, 30.0))
    targets = reference.at(DT * np.arange(2400))
    start = np.concatenate([targets.q_DN[0], targets.omega_DN_D[0], np.zeros(4)])
    path = close_loop(start, targets)
    error = angle(path[:-1, :4], targets.q_DN)[400:]
    lag = 2 / 0.4 * np.abs(targets.alpha_DN_D @ NACS.inertia).max()  # K_p error / 2 holds the body at the target's acceleration
    assert 0.3 * lag < error.max() < 3 * lag  # three axes and the gyroscopic torque


def test_feedback_has_the_same_bits_for_a_trial_in_any_batch():
    rng = np.random.default_rng(3)
    state = np.concatenate([normalize(rng.standard_normal((1000, 4))), rng.standard_normal((1000, 7))], axis=1)
    target = Target(normalize(rng.standard_normal(4)), rng.standard_normal(3), np.zeros(3))
    everyone = wheels_for(PD.step(estimate(state), target))
    for size in (1, 3, 10, 64):
        np.testing.assert_array_equal(wheels_for(PD.step(estimate(state[7 : 7 + size]), target)), everyone[7 : 7 + size])
    np.testing.assert_array_equal(wheels_for(PD.step(estimate(state[5]), target)), everyone[5])
    assert wheels_for(PD.step(estimate(state.reshape(10, 20, 5, 11)), target)).shape == (10, 20, 5, 4)


# allocation --------------------------------------------------------------------------------------------------------------------


@given(torques)
def test_below_the_limit_the_wheels_give_the_body_the_torque_that_is_asked_for(torque):
    small = 0.1 * torque  # at most 20 mN m an axis, 27 mN m a wheel
    wheel = wheels_for(small)
    np.testing.assert_allclose(-NACS.wheel_axes @ wheel, small, atol=1e-16)
    assert np.abs(wheel).max() < LIMIT


@given(torques)
def test_beyond_the_limit_the_direction_is_kept_and_one_wheel_is_at_its_limit(torque):
    wheel = wheels_for(20.0 * torque)
    assert np.abs(wheel).max() <= LIMIT * (1 + 1e-15)
    given_to_body = -NACS.wheel_axes @ wheel
    np.testing.assert_allclose(np.cross(given_to_body, 20.0 * torque), 0.0, atol=1e-15)
    assert given_to_body @ torque >= 0.0
    if np.linalg.norm(torque) > 0.01:  # 0.2 N m is more than four drives can do
        assert np.abs(wheel).max() == pytest.approx(LIMIT, rel=1e-14)


@given(torques)
def test_no_torque_is_wasted_on_wheels_that_work_against_each_other(torque):
    null = np.array([1.0, -1.0, -1.0, 1.0])
    np.testing.assert_allclose(NACS.wheel_axes @ null, 0.0, atol=1e-15)
    assert wheels_for(torque) @ null == pytest.approx(0.0, abs=1e-16)


def test_nothing_is_asked_of_the_wheels_for_no_torque():
    np.testing.assert_array_equal(wheels_for(np.zeros((2, 3))), 0.0)


def test_each_trial_is_limited_by_itself():
    torque = np.array([[1e-3, 0.0, 0.0], [1.0, 0.0, 0.0]])
    np.testing.assert_array_equal(wheels_for(torque), [wheels_for(row) for row in torque])
    np.testing.assert_allclose(-NACS.wheel_axes @ wheels_for(torque)[0], torque[0], atol=1e-18)
