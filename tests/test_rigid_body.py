"""The seven-state model and the faults of its wheels against plain writings of the textbook and of the paper."""

import numpy as np
import pytest

from models.attitude.quaternion import attitude_matrix, normalize
from models.dynamics.process import predict, runge_kutta
from models.dynamics.rigid_body import RigidBody
from models.dynamics.wheel_faults import WheelFault, lost_axis, stack
from models.dynamics.wheeled_body import WheeledBody
from models.plants.freeflyer import FreeflyerParameters
from models.plants.nacs import NacsParameters
from models.plants.wheels import crossed, pyramid

W, J_W = crossed(), 0.1
SKEW = np.array([[399.0, 12.0, -7.0], [12.0, 377.0, 5.0], [-7.0, 5.0, 340.0]])
WMAP = np.diag([399.0, 377.0, 377.0])
STUCK = WheelFault.stuck(4, 2, torque=0.7).on_body(W)
BODIES = {
    "wheels": RigidBody(SKEW, -W, J_W * W),
    "wheels, diagonal": RigidBody(WMAP, -W, J_W * W),
    "direct torque": RigidBody(SKEW, np.eye(3), np.zeros((3, 0)), np.array([0.3, -0.2, 0.1])),
    "a stuck wheel": RigidBody(SKEW, STUCK.torque_map, J_W * W, STUCK.constant_torque_B),
}
every_body = pytest.mark.parametrize("body", BODIES.values(), ids=BODIES.keys())


def states(body: RigidBody, *shape: int, seed: int = 5) -> tuple[np.ndarray, np.ndarray]:
    """Random states (..., 7) and commands [torques, wheel speeds] (..., r + s)."""
    rng = np.random.default_rng(seed)
    torque, momentum = body.torque_map.shape[-1], body.momentum_map.shape[-1]
    attitude, rate = normalize(rng.standard_normal((*shape, 4))), rng.normal(0, 0.2, (*shape, 3))
    command = np.concatenate([rng.normal(0, 1, (*shape, torque)), rng.normal(0, 200, (*shape, momentum))], axis=-1)
    return np.concatenate([attitude, rate], axis=-1), command


def textbook(body: RigidBody, state: np.ndarray, command: np.ndarray) -> np.ndarray:
    """Markley & Crassidis (2014), eq. 3.20 and 3.147, in vectors."""
    vector, scalar, rate = state[:3], state[3], state[4:]
    u, s = np.split(command, [body.torque_map.shape[-1]])
    torque = body.torque_map @ u + body.constant_torque_B
    acceleration = np.linalg.solve(body.inertia, torque - np.cross(rate, body.inertia @ rate + body.momentum_map @ s))
    return np.concatenate([0.5 * (scalar * rate + np.cross(vector, rate)), [-0.5 * vector @ rate], acceleration])


def central_differences(function, state: np.ndarray, h: float) -> np.ndarray:
    return np.stack([(function(state + h * e) - function(state - h * e)) / (2 * h) for e in np.eye(len(state))], axis=1)


@every_body
def test_the_derivative_is_the_textbooks(body):
    for state, command in zip(*states(body, 20), strict=True):
        np.testing.assert_allclose(body.derivative(state, command), textbook(body, state, command), rtol=1e-12, atol=1e-15)


@every_body
def test_the_jacobian_is_that_of_finite_differences(body):
    for state, command in zip(*states(body, 10), strict=True):
        here = body.linearize(state, command)
        numeric = central_differences(lambda x, u=command: textbook(body, x, u), state, 1e-2)  # quadratic: exact but for rounding
        np.testing.assert_allclose(here.jacobian, numeric, atol=1e-12)
        np.testing.assert_array_equal(here.derivative, body.derivative(state, command))


def test_the_transition_is_the_sensitivity_of_the_runge_kutta_step():
    body = BODIES["wheels"]
    for state, command in zip(*states(body, 5), strict=True):
        step = predict(body, state, command, 0.1)
        numeric = central_differences(lambda x, u=command: runge_kutta(body, x, u, 0.1), state, 1e-4)
        np.testing.assert_allclose(step.transition, numeric, atol=1e-9)  # h^2 and rounding / h


@pytest.mark.parametrize("parameters", [FreeflyerParameters(), FreeflyerParameters(wheel_layout="pyramid")], ids=["crossed", "pyramid"])
def test_it_is_the_eleven_state_model_with_the_wheel_speeds_given(parameters):
    seven, eleven = parameters.process(), parameters.full_process()
    state, command = states(seven, 20)
    theirs = eleven.derivative(np.concatenate([state, command[:, 4:]], axis=1), command[:, :4])
    np.testing.assert_allclose(seven.derivative(state, command), theirs[:, :7], rtol=1e-11, atol=1e-14)
    np.testing.assert_allclose(seven.momentum(state, command), eleven.momentum(np.concatenate([state, command[:, 4:]], axis=1)), rtol=1e-12)


def test_momentum_in_inertial_space_is_conserved_without_torque():
    body = BODIES["wheels"]
    state, command = (x[0] for x in states(body, 1))
    command[:4] = 0.0
    path = [state]
    for _ in range(2000):
        path.append(runge_kutta(body, path[-1], command, 0.02))
    path = np.array(path)
    total = np.einsum("kji,kj->ki", attitude_matrix(normalize(path[:, :4])), body.momentum(path, command))
    assert np.ptp(path[:, 4], axis=0) > 0.05  # it does tumble
    np.testing.assert_allclose(total, np.broadcast_to(total[0], total.shape), atol=1e-9 * np.linalg.norm(total[0]))  # RK4


@every_body
@pytest.mark.parametrize("size", [1, 3, 10, 64])
def test_a_trial_has_the_same_bits_in_any_batch_with_sigma_points_too(body, size):
    state, command = states(body, 300, 15)
    command = command[:, :1]
    for function in (body.derivative, lambda x, u: body.linearize(x, u).jacobian, lambda x, u: predict(body, x, u, 0.1).transition):
        everyone = function(state, command)
        for first in (0, 137):
            some = slice(first, first + size)
            np.testing.assert_array_equal(function(state[some], command[some]), everyone[some])
        np.testing.assert_array_equal(function(state[5], command[5]), everyone[5])


def test_fault_modes_stack_as_a_leading_axis_and_are_each_what_they_are_alone():
    faults = [
        WheelFault.healthy(4),
        WheelFault.floating(4, 1),
        WheelFault.stuck(4, 3, torque=-0.4),
        WheelFault.partial(4, 2, remaining=0.3),
    ]
    parameters = FreeflyerParameters()
    together = parameters.process(fault=stack(faults, batch_axes=2))
    state, command = states(together, 4, 10, 15)
    derivative = together.derivative(state, command[0, :, :1])
    assert derivative.shape == (4, 10, 15, 7)
    for mode, fault in enumerate(faults):
        alone = parameters.process(fault=fault)
        np.testing.assert_array_equal(derivative[mode], alone.derivative(state[mode], command[0, :, :1]))
        shared = together.derivative(state[0], command[0, :, :1])  # states without an axis of modes grow one
        np.testing.assert_array_equal(shared[mode], alone.derivative(state[0], command[0, :, :1]))
    jacobian = together.linearize(state, command[0, :, :1]).jacobian
    np.testing.assert_array_equal(jacobian[2], parameters.process(fault=faults[2]).linearize(state[2], command[0, :, :1]).jacobian)


# faults of the wheels ------------------------------------------------------------------------------------------------------------


def test_a_fault_acts_as_eq_12_says():
    command = np.array([[0.3, -0.2, 0.1, 1.0], [1.0, 1.0, -1.0, 0.0]])
    sigma, failed = np.array([0.0, 1.0, 0.4, 1.0]), np.array([5.0, 0.7, 0.0, -1.0])
    acted = WheelFault(sigma, failed).act(command)
    for row in range(2):
        for wheel in range(4):
            expected = command[row, wheel] + sigma[wheel] * (failed[wheel] - command[row, wheel])
            assert acted[row, wheel] == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize(
    ("fault", "given"),
    [
        (WheelFault.healthy(4), [1.0, 2.0, 3.0, 4.0]),
        (WheelFault.floating(4, 1), [0.0, 2.0, 3.0, 4.0]),
        (WheelFault.floating(4, 2, 4), [1.0, 0.0, 3.0, 0.0]),
        (WheelFault.locked(4, 3), [1.0, 2.0, 0.0, 4.0]),
        (WheelFault.stuck(4, 1, torque=-0.5), [-0.5, 2.0, 3.0, 4.0]),
        (WheelFault.partial(4, 4, remaining=0.25), [1.0, 2.0, 3.0, 1.0]),
    ],
)
def test_named_faults_give_what_their_names_say(fault, given):
    np.testing.assert_allclose(fault.act(np.array([1.0, 2.0, 3.0, 4.0])), given, atol=1e-15)


def test_a_wheel_that_is_not_there_cannot_fail():
    with pytest.raises(ValueError, match="no wheel 5 among 4; they count from 1"):
        WheelFault.floating(4, 5)
    with pytest.raises(ValueError, match="no wheel 0 among 4"):
        WheelFault.partial(4, 0, remaining=0.5)


@pytest.mark.parametrize("axes", [crossed(), pyramid()], ids=["crossed", "pyramid"])
@pytest.mark.parametrize("fault", [WheelFault.floating(4, 1), WheelFault.stuck(4, 2, torque=0.3), WheelFault.partial(4, 3, remaining=0.6)])
def test_on_the_body_acts_what_the_motors_actually_give(axes, fault):
    command = np.random.default_rng(2).normal(size=(6, 4))
    body = fault.on_body(axes)
    np.testing.assert_allclose(command @ body.torque_map.T + body.constant_torque_B, -fault.act(command) @ axes.T, atol=1e-14)


def test_the_paper_s_faulty_body_torque_is_that_of_mode_two():
    """Eq. 10 to 12: T_c is shared by the pseudo-inverse of L, wheel 1 gives nothing, L (I - sigma) L^+ T_c arrives."""
    parameters, fault = FreeflyerParameters(), WheelFault.floating(4, 1)
    L = parameters.wheel_axes
    torque = np.array([0.6, -0.3, 0.8])
    state, command = (x[0] for x in states(parameters.process(), 1))
    command[:4] = -np.linalg.pinv(L) @ torque
    direct = RigidBody(parameters.inertia, np.eye(3), parameters.wheel_inertia_kg_m2 * L)
    arrives = L @ np.diag([0.0, 1.0, 1.0, 1.0]) @ np.linalg.pinv(L) @ torque
    np.testing.assert_allclose(
        parameters.process(fault=fault).derivative(state, command),
        direct.derivative(state, np.concatenate([arrives, command[4:]])),
        rtol=1e-12,
        atol=1e-15,
    )
    assert not np.allclose(arrives, torque, atol=0.1)


def test_three_of_four_wheels_reach_every_axis_and_two_do_not():
    for axes in (crossed(), pyramid()):
        for wheel in (1, 2, 3, 4):
            assert lost_axis(axes, WheelFault.floating(4, wheel)) is None
        assert lost_axis(axes, WheelFault.healthy(4)) is None
        assert lost_axis(axes, WheelFault.partial(4, 1, 2, 3, remaining=0.1)) is None


@pytest.mark.parametrize(("failed", "axis"), [((1, 2), [1.0, 0.0, 0.0]), ((3, 4), [0.0, 0.0, 1.0])])
def test_two_wheels_of_a_plane_lost_lose_the_axis_that_only_they_reached(failed, axis):
    np.testing.assert_allclose(lost_axis(crossed(), WheelFault.floating(4, *failed)), axis, atol=1e-15)


def test_about_the_lost_axis_no_command_gives_torque():
    for axes, fault in ((crossed(), WheelFault.locked(4, 1, 3)), (pyramid(), WheelFault.stuck(4, 2, 3, torque=0.1))):
        axis = lost_axis(axes, fault)
        assert np.linalg.norm(axis) == pytest.approx(1.0, abs=1e-14)
        np.testing.assert_allclose(axis @ fault.on_body(axes).torque_map, 0.0, atol=1e-15)


@pytest.mark.parametrize("fault", [WheelFault.floating(4, 1), WheelFault.stuck(4, 2, torque=2e-3), WheelFault.partial(4, 3, remaining=0.6)])
@pytest.mark.parametrize("wheel_drag", [False, True])
def test_the_eleven_state_model_may_believe_in_a_fault(fault, wheel_drag):
    parameters = NacsParameters(wheel_coulomb_nm=1e-4)
    healthy = parameters.process(coupled=True, wheel_drag=wheel_drag)
    faulty = WheeledBody(
        healthy.inertia, healthy.wheel_axes, healthy.wheel_inertia, True, -1.0, healthy.wheel_coulomb, healthy.wheel_viscous, fault
    )
    rng = np.random.default_rng(1)
    state = np.concatenate([normalize(rng.normal(size=(8, 4))), rng.normal(0, 0.3, (8, 3)), rng.normal(0, 20, (8, 4))], axis=1)
    command = rng.normal(0, 5e-3, (8, 4))
    mine, theirs = faulty.linearize(state, command), healthy.linearize(state, fault.act(command))
    np.testing.assert_array_equal(mine.derivative, theirs.derivative)
    np.testing.assert_array_equal(mine.jacobian, theirs.jacobian)
    assert not np.allclose(mine.derivative, healthy.derivative(state, command))
