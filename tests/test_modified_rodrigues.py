"""Modified Rodrigues parameters and the analytic model in them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial.transform import Rotation

from models.attitude import modified_rodrigues, quaternion
from models.dynamics.attitude_by_rodrigues import AttitudeByRodrigues
from models.dynamics.process import runge_kutta
from models.dynamics.rigid_body import RigidBody
from models.plants.formation import FormationParameters

vectors = hnp.arrays(np.float64, (3,), elements=st.floats(-3.0, 3.0, width=32))


@given(vectors)
def test_quaternions_come_back_with_their_own_set(sigma):
    np.testing.assert_allclose(modified_rodrigues.from_quaternion(modified_rodrigues.to_quaternion(sigma)), sigma, atol=1e-12)


def test_the_sign_of_a_quaternion_chooses_the_set():
    q = quaternion.normalize(np.array([0.4, -0.3, 0.2, 0.5]))
    sigma, other = modified_rodrigues.from_quaternion(q), modified_rodrigues.from_quaternion(-q)
    assert np.linalg.norm(sigma) < 1.0 < np.linalg.norm(other)
    np.testing.assert_allclose(modified_rodrigues.shadow(sigma), other, atol=1e-14)
    np.testing.assert_allclose(modified_rodrigues.shorter(other), sigma, atol=1e-14)
    np.testing.assert_allclose(modified_rodrigues.nearer(sigma, other + 0.1), other, atol=1e-14)


def test_they_are_scipy_s():
    rotations = Rotation.random(50, random_state=3)
    np.testing.assert_allclose(
        modified_rodrigues.shorter(modified_rodrigues.from_quaternion(rotations.as_quat())), rotations.as_mrp(), atol=1e-12
    )


def test_the_published_starts_are_turns_of_up_to_286_degrees():
    from sim.scenario.formation import STARTS  # noqa: PLC0415

    length = np.linalg.norm(np.array(STARTS), axis=-1)
    np.testing.assert_allclose(length, [2.0, 0.8, 2.8, 1.2, 3.0, 2.4], atol=1e-12)
    assert np.degrees(4.0 * np.arctan(length.max())) == pytest.approx(286.26, abs=0.01)


@given(vectors, vectors)
def test_rates_follow_the_quaternion_s_kinematics(sigma, omega):
    q, step = modified_rodrigues.to_quaternion(sigma), 1e-6
    moved = quaternion.multiply(quaternion.from_rotation_vector(step * omega), q)
    back = quaternion.multiply(quaternion.from_rotation_vector(-step * omega), q)
    slope = (modified_rodrigues.from_quaternion(moved) - modified_rodrigues.from_quaternion(back)) / (2.0 * step)
    v = modified_rodrigues.rate(sigma, omega)
    np.testing.assert_allclose(v, slope, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(modified_rodrigues.body_rate(sigma, v), omega, atol=1e-10)


def test_the_model_is_the_rigid_body_in_other_coordinates():
    """Ten seconds through half a turn, against the quaternion's equations."""
    parameters = FormationParameters()
    process, dt = parameters.process(), 0.01
    bodies = RigidBody(parameters.inertia[2], np.eye(3), np.zeros((3, 0)))
    sigma, omega = np.array([0.7, -0.4, 0.5]), np.array([0.4, -0.2, 0.3])
    state = np.concatenate([sigma, modified_rodrigues.rate(sigma, omega)])
    other = np.concatenate([modified_rodrigues.to_quaternion(sigma), omega])
    one, largest = AttitudeByRodrigues(process.inertia[2]), 0.0
    for k in range(1000):
        torque = 0.05 * np.array([np.sin(0.01 * k), 1.0, -0.5])
        state, other = runge_kutta(one, state, torque, dt), runge_kutta(bodies, other, torque, dt)
        largest = max(largest, float(np.linalg.norm(state[:3])))
    assert largest > 1.5
    q = quaternion.normalize(other[:4])
    assert np.degrees(quaternion.angle(modified_rodrigues.to_quaternion(state[:3]), q)) < 1e-6
    np.testing.assert_allclose(modified_rodrigues.body_rate(state[:3], state[3:]), other[4:], atol=1e-8)


def test_the_torque_for_an_acceleration_gives_it():
    random = np.random.default_rng(4)
    process = FormationParameters().process()
    state, wanted = random.normal(size=(5, 6, 6)), random.normal(size=(5, 6, 3))
    given_torque = process.torque(state, wanted)
    np.testing.assert_allclose(process.derivative(state, given_torque)[..., 3:], wanted, atol=1e-11)
    np.testing.assert_array_equal(process.derivative(state, given_torque)[..., :3], state[..., 3:])


def test_the_jacobian_is_that_of_finite_differences():
    random = np.random.default_rng(5)
    process = FormationParameters().process()
    state, torque, step = random.normal(size=(3, 6, 6)), random.normal(size=(3, 6, 3)), 1e-6
    jacobian = process.linearize(state, torque).jacobian
    for i in range(6):
        shift = step * np.eye(6)[i]
        slope = (process.derivative(state + shift, torque) - process.derivative(state - shift, torque)) / (2.0 * step)
        np.testing.assert_allclose(jacobian[..., i], slope, rtol=2e-6, atol=2e-6)


def test_an_agent_is_the_same_in_any_batch():
    random = np.random.default_rng(6)
    process = FormationParameters().process(believed=True)
    state, torque = random.normal(size=(64, 6, 6)), random.normal(size=(64, 6, 3))
    whole = runge_kutta(process, state, torque, 0.01)
    for trials in (1, 3, 10):
        np.testing.assert_array_equal(runge_kutta(process, state[:trials], torque[:trials], 0.01), whole[:trials])


def test_of_a_set_with_a_missing_component_nobody_knows_which_it_is():
    torn = np.array([[0.9, np.nan, 0.9], [0.1, 0.0, np.nan]])
    assert np.isnan(modified_rodrigues.shorter(torn)).all()
    assert np.isnan(modified_rodrigues.nearer(torn, np.zeros((2, 3)))).all()
