"""Output feedback of Rososhansky (2017, eq. 3.12) on the exact model: what it cancels, how it decays, and how long a tumble takes."""

import numpy as np
import pytest

from control.feed_forward import BodyModel
from control.output_feedback import OutputFeedback, sig
from control.torque_limit import AxisLimited
from control.tracking import Controller, Estimate, Target, tracking_error
from models.attitude.quaternion import IDENTITY, from_rotation_vector, multiply, normalize
from models.dynamics.process import runge_kutta
from models.dynamics.rigid_body import RigidBody

INERTIA = np.array([[20.0, 1.2, 0.9], [1.2, 17.0, 1.4], [0.9, 1.4, 15.0]])
BELIEVED = BodyModel(np.diag(np.diag(INERTIA)), np.zeros((3, 0)))
EXACT = BodyModel(INERTIA, np.zeros((3, 0)))
REST = Target(IDENTITY, np.zeros(3), np.zeros(3))
K1 = 0.05
every_power = pytest.mark.parametrize("power", [1.0, 0.75, 0.6])


def estimate(state: np.ndarray) -> Estimate:
    return Estimate(state[..., :4], state[..., 4:], np.zeros((*state.shape[:-1], 0)))


def fly(law: Controller, start: np.ndarray, duration: float, dt: float, target: Target = REST) -> np.ndarray:
    """States (ticks + 1, ..., 7) of the thesis' body, the torque being held over a tick."""
    body, state = RigidBody(INERTIA, np.eye(3), np.zeros((3, 0))), start
    path = [state]
    for _ in range(round(duration / dt)):
        state = runge_kutta(body, state, law.step(estimate(state), target), dt)
        path.append(state)
    return np.array(path)


def random_states(count: int, rate: float, seed: int = 3) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.concatenate([normalize(rng.standard_normal((count, 4))), rate * rng.standard_normal((count, 3))], axis=1)


def norm(vector: np.ndarray) -> np.ndarray:
    return np.linalg.norm(vector, axis=-1)


@every_power
def test_the_rate_of_the_closed_loop_obeys_the_law_alone(power):
    """The gyroscopic torque, that of stored momentum included, is cancelled: domega/dt = -k2 sig^(2a-1)(xi)."""
    wheels = 0.1 * np.array([[1.0, 0.0], [0.0, 1.0], [0.5, -0.5]])
    body, state, speed = RigidBody(INERTIA, np.eye(3), wheels), random_states(20, 0.5), np.array([80.0, -30.0])
    law = OutputFeedback(BodyModel(INERTIA, wheels), power=power)
    torque = law.step(estimate(state)._replace(omega_wheel=np.tile(speed, (20, 1))), REST)
    motion = body.derivative(state, np.concatenate([torque, np.tile(speed, (20, 1))], axis=1))
    wanted = -K1 * np.sign(state[:, :3]) * np.abs(state[:, :3]) ** power
    surface = sig(state[:, 4:], 1 / power) - sig(wanted, 1 / power)
    np.testing.assert_allclose(motion[:, 4:], -15.0 * sig(surface, 2 * power - 1), rtol=1e-9, atol=1e-12)


@every_power
def test_what_the_observer_corrects_is_taken_out_again(power):
    """The estimated rate of the observer domega/dt = J^-1 (torque - omega x J omega) + gamma^2 kappa sig^a(q~) obeys the law alone, too."""
    state, law = random_states(20, 0.3), OutputFeedback(EXACT, power=power)
    missed = 0.02 * np.random.default_rng(8).standard_normal((20, 3))
    turn = np.concatenate([missed, np.sqrt(1 - np.sum(missed**2, axis=1, keepdims=True))], axis=1)
    read = multiply(turn, state[:, :4]) * np.where(np.arange(20)[:, None] % 2, 1.0, -1.0)  # of either sign
    body = RigidBody(INERTIA, np.eye(3), np.zeros((3, 0)))
    with_it = body.derivative(state, law.step(estimate(state)._replace(q_read=read), REST))[:, 4:] + 40.0 * sig(missed, power)
    without = body.derivative(state, law.step(estimate(state), REST))[:, 4:]
    np.testing.assert_allclose(with_it, without, rtol=1e-9, atol=1e-10)
    assert norm(law.step(estimate(state)._replace(q_read=read), REST) - law.step(estimate(state), REST)).min() > 1.0
    read[5] = np.nan
    nothing = law.step(estimate(state)._replace(q_read=read), REST)[5]
    np.testing.assert_array_equal(nothing, law.step(estimate(state), REST)[5])


def test_with_the_printed_gains_the_lyapunov_function_always_decreases():
    assert (1 + K1**2 / 2) ** 2 < 4 * K1 * (15 - K1 / 2)
    path = fly(OutputFeedback(EXACT), random_states(40, 0.3), 4.0, 0.002)
    surface = path[..., 4:] + K1 * path[..., :3]
    value = 2 * (1 - path[..., 3]) + 0.5 * np.sum(surface**2, axis=-1)
    assert value[0].max() > 3.0  # among them near -1
    assert (np.diff(value, axis=0) < 0.0).all()


def test_as_printed_the_attitude_dies_out_with_a_time_constant_of_two_over_k1():
    start = np.concatenate([from_rotation_vector(np.array([0.1, -0.2, 0.15])), np.zeros(3)])
    path = fly(OutputFeedback(EXACT), start[None], 80.0, 0.02)[:, 0]
    decay = norm(path[2000:, :3]) / norm(path[:-2000, :3])  # over 40 s
    np.testing.assert_allclose(decay[500:], np.exp(-1.0), rtol=5e-3)


def test_a_power_below_one_brings_the_attitude_home_in_finite_time():
    """On the surface dq/dt = -k1 sig^a(dq) / 2, which is at a level after 2 (|q0|^(1-a) - |q|^(1-a)) / (k1 (1-a)): at zero after 209 s."""
    start, power = np.concatenate([from_rotation_vector(np.array([0.2, -0.4, 0.3])), np.zeros(3)]), 0.85
    path = fly(OutputFeedback(EXACT, power=power), start[None], 170.0, 0.01)[:, 0]
    away, levels = np.abs(path[:, :3]).max(axis=1), np.array([1e-2, 1e-3, 1e-4, 1e-5])
    arrived = 0.01 * np.array([np.argmax(away < level) for level in levels])
    np.testing.assert_allclose(arrived, 2 * (away[0] ** 0.15 - levels**0.15) / (K1 * 0.15), rtol=0.03)
    assert arrived[-1] < 0.45 * 2 / K1 * np.log(away[0] / levels[-1])  # a = 1


def test_a_tumble_of_one_rad_per_second_is_stopped_by_a_tenth_of_a_newton_metre():
    """The thesis' case (sec. 3.3), which no torque of that size can stop before |H| / (sqrt 3 0.1 N m) = 198 s."""
    vector = np.array([-0.6, 0.4, -0.2])
    start = np.tile(np.concatenate([vector, [np.sqrt(1 - vector @ vector)], np.ones(3)]), (4, 1))
    start[1:, :4] = normalize(np.random.default_rng(5).standard_normal((3, 4)))
    law, dt = AxisLimited(OutputFeedback(BELIEVED), 0.1), 0.05
    path, when = fly(law, start, 600.0, dt), dt * np.arange(12001)
    bound = norm(INERTIA @ np.ones(3)) / (np.sqrt(3) * 0.1)
    assert bound == pytest.approx(197.6, abs=0.1)
    momentum = norm(path[..., 4:] @ INERTIA)
    assert (np.abs(np.diff(momentum, axis=0)) <= np.sqrt(3) * 0.1 * dt * (1 + 1e-9)).all()
    rate = norm(path[..., 4:])
    assert rate[when < 197.6].min() > 0.06
    assert rate[when > 260.0].max() < 0.06
    assert np.abs(path[-1, :, :3]).max() < 5e-3
    assert path[-1, :, 3].min() > 0.9999


def test_as_printed_the_long_way_is_taken_and_can_be_avoided():
    start = np.concatenate([-from_rotation_vector(np.array([0.3, 0.2, -0.4])), np.zeros(3)])[None]
    long, short = (fly(OutputFeedback(EXACT, shortest=s), start, 300.0, 0.1)[:, 0] for s in (False, True))
    assert long[0, 3] < -0.9
    assert long[-1, 3] > 0.999
    assert norm(long[:, :3]).max() > 0.99  # by way of half a turn
    assert short[-1, 3] < -0.999
    assert (np.diff(norm(short[100:, :3])) <= 0.0).all()


def test_it_regulates_to_the_target_and_not_to_the_origin():
    target = Target(normalize(np.array([0.3, -0.5, 0.2, 0.7])), np.zeros(3), np.zeros(3))
    last = fly(OutputFeedback(EXACT), random_states(5, 0.1), 600.0, 0.125, target)[-1]
    np.testing.assert_allclose(tracking_error(estimate(last), target).dq, np.tile(IDENTITY, (5, 1)), atol=1e-5)


@pytest.mark.parametrize("power", [0.5, 1.01])
def test_a_power_for_which_nothing_is_proved_is_refused(power):
    with pytest.raises(ValueError, match=r"need 1/2 < a <= 1"):
        OutputFeedback(EXACT, power=power)
