"""The analytic model against a plain writing of the textbook, finite differences, and what must be conserved."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from models.attitude.quaternion import attitude_matrix, normalize
from models.dynamics.process import predict, predict_euler, runge_kutta
from models.dynamics.wheeled_body import DRAG_SMOOTHING, WheeledBody
from models.plants.assembly import ImpossibleInertia
from models.plants.nacs import NacsParameters, compile_nacs

NACS = NacsParameters(wheel_coulomb_nm=1e-4, wheel_viscous_nms=2e-6)
KINDS = {
    "eq. 10": NACS.process(),
    "coupled": NACS.process(coupled=True),
    "with drag": NACS.process(wheel_drag=True),
    "coupled, with drag": NACS.process(coupled=True, wheel_drag=True),
    "as eq. 24 is printed": NACS.process(gyroscopic_sign=1.0),
    "printed inertia": NacsParameters(inertia_kg_m2="printed").process(coupled=True),
}
every_kind = pytest.mark.parametrize("body", KINDS.values(), ids=KINDS.keys())


def states(count: int, wheel_speed: float, seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Random states (count, 11) and wheel torques (count, 4)."""
    rng = np.random.default_rng(seed)
    attitude, rate = normalize(rng.standard_normal((count, 4))), rng.normal(0, 0.5, (count, 3))
    return np.concatenate([attitude, rate, rng.normal(0, wheel_speed, (count, 4))], axis=1), rng.normal(0, 5e-3, (count, 4))


def textbook(body: WheeledBody, state: np.ndarray, motor: np.ndarray) -> np.ndarray:
    """Markley & Crassidis (2014), eq. 3.20 and 3.147, component by component; coupled: both balances solved as one system."""
    vector, scalar, rate, speed = state[:3], state[3], state[4:7], state[7:]
    J, W, J_w = body.inertia, body.wheel_axes, body.wheel_inertia
    torque = motor - body.wheel_coulomb * np.tanh(speed / DRAG_SMOOTHING) - body.wheel_viscous * speed
    momentum = J @ rate
    for wheel in range(4):
        momentum = momentum + J_w * speed[wheel] * W[:, wheel]
    gyroscopic = body.gyroscopic_sign * np.cross(rate, momentum)
    if body.coupled:  # total momentum turns with the frame; each wheel answers to its torque alone
        mass = np.block([[J, J_w * W], [J_w * W.T, J_w * np.eye(4)]])
        accelerations = np.linalg.solve(mass, np.concatenate([gyroscopic, torque]))
    else:
        accelerations = np.concatenate([np.linalg.solve(J, gyroscopic - W @ torque), torque / J_w])
    kinematics = 0.5 * np.append(scalar * rate + np.cross(vector, rate), -vector @ rate)
    return np.concatenate([kinematics, accelerations])


def central_differences(function, state: np.ndarray, h: float) -> np.ndarray:
    return np.stack([(function(state + h * e) - function(state - h * e)) / (2 * h) for e in np.eye(len(state))], axis=1)


@every_kind
def test_the_derivative_is_the_textbooks(body):
    for state, motor in zip(*states(20, 300.0), strict=True):
        theirs = textbook(body, state, motor)
        np.testing.assert_allclose(body.derivative(state, motor), theirs, rtol=1e-11, atol=1e-11 * np.abs(theirs).max())  # rounding


@every_kind
def test_the_drift_is_the_derivative_without_torque_or_drag(body):
    for state, _ in zip(*states(5, 300.0), strict=True):
        free = WheeledBody(body.inertia, body.wheel_axes, body.wheel_inertia, body.coupled, body.gyroscopic_sign)
        np.testing.assert_allclose(free.derivative(state, np.zeros(4)), body.drift(state), atol=1e-11)


@every_kind
def test_the_jacobian_is_that_of_finite_differences(body):
    for state, motor in zip(*states(10, 1.0), strict=True):  # slow wheels: where the dry friction bends
        numeric = central_differences(lambda x, u=motor: body.derivative(x, u), state, 1e-4)
        np.testing.assert_allclose(body.linearize(state, motor).jacobian, numeric, atol=1e-6)  # h^2 of tanh''' and rounding / h: 1e-8


@every_kind
def test_the_transition_is_the_sensitivity_of_the_runge_kutta_step(body):
    for state, motor in zip(*states(5, 20.0), strict=True):
        step = predict(body, state, motor, 0.1)
        np.testing.assert_allclose(
            step.state, runge_kutta(body, state, motor, 0.1), rtol=1e-14, atol=1e-13
        )  # the sum is bracketed otherwise
        numeric = central_differences(lambda x, u=motor: runge_kutta(body, x, u, 0.1), state, 1e-4)
        np.testing.assert_allclose(step.transition, numeric, atol=1e-6)  # as above


def test_the_transition_is_the_sensitivity_of_the_flow_itself():
    body = KINDS["coupled"]
    state, motor = (x[0] for x in states(1, 100.0))

    def flow(start: np.ndarray) -> np.ndarray:
        return solve_ivp(lambda _, x: body.derivative(x, motor), (0, 0.02), start, "DOP853", rtol=1e-12, atol=1e-12).y[:, -1]

    np.testing.assert_allclose(predict(body, state, motor, 0.02).transition, central_differences(flow, state, 1e-3), atol=2e-6)


def test_eulers_transition_is_one_plus_the_jacobian():
    body, (state, motor) = KINDS["eq. 10"], (x[0] for x in states(1, 100.0))
    step = predict_euler(body, state, motor, 0.1)
    np.testing.assert_allclose(step.state, state + 0.1 * body.derivative(state, motor), rtol=1e-15)
    numeric = central_differences(lambda x: x + 0.1 * body.derivative(x, motor), state, 1e-2)
    np.testing.assert_allclose(step.transition, numeric, atol=1e-9)  # quadratic: central differences are exact


def test_runge_kutta_converges_with_the_fourth_power_of_the_step():
    body = KINDS["coupled"]
    state, motor = (x[0] for x in states(1, 200.0))
    exact = solve_ivp(lambda _, x: body.derivative(x, motor), (0, 1), state, "DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    errors = []
    for steps in (10, 20, 40, 80):
        x = state
        for _ in range(steps):
            x = runge_kutta(body, x, motor, 1 / steps)
        errors.append(np.linalg.norm((x - exact)[:7]))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders[-1], 4.0, atol=0.2)  # the next order still shows
    assert errors[-1] < 1e-5


def run(body: WheeledBody, state: np.ndarray, motor: np.ndarray, seconds: float, dt: float = 0.005) -> np.ndarray:
    path = [state]
    for _ in range(round(seconds / dt)):
        path.append(runge_kutta(body, path[-1], motor, dt))
    return np.array(path)


def momentum_N(body: WheeledBody, path: np.ndarray) -> np.ndarray:
    return np.einsum("kji,kj->ki", attitude_matrix(normalize(path[:, :4])), body.momentum(path))


def kinetic_energy(body: WheeledBody, path: np.ndarray) -> np.ndarray:
    """Of the body without the spin of its wheels, and of that spin relative to N, J."""
    rate, spin = path[:, 4:7], path[:, 7:] + path[:, 4:7] @ body.wheel_axes
    rest = body.inertia - body.wheel_inertia * body.wheel_axes @ body.wheel_axes.T
    return 0.5 * np.einsum("ki,ij,kj->k", rate, rest, rate) + 0.5 * body.wheel_inertia * np.sum(spin**2, axis=1)


@pytest.mark.parametrize("kind", ["eq. 10", "coupled", "coupled, with drag"])
def test_momentum_is_conserved_whatever_the_motors_do(kind):
    body, (state, motor) = KINDS[kind], states(1, 100.0)
    path = run(body, state[0], 0.1 * motor[0], 20.0)
    total = momentum_N(body, path)
    np.testing.assert_allclose(total, np.broadcast_to(total[0], total.shape), atol=1e-8 * np.linalg.norm(total[0]))  # RK4 at 5 ms


def test_energy_is_conserved_without_torque_if_the_coupling_is_kept():
    state = states(1, 100.0)[0][0]
    kept, neglected = (kinetic_energy(KINDS[kind], run(KINDS[kind], state, np.zeros(4), 20.0)) for kind in ("coupled", "eq. 10"))
    np.testing.assert_allclose(kept, kept[0], rtol=1e-9)  # RK4 at 5 ms
    assert np.ptp(neglected) > 1e4 * np.ptp(kept)  # what eq. 10 leaves out


def test_the_gyroscopic_sign_of_eq_24_breaks_the_conservation_of_momentum():
    body, state = KINDS["as eq. 24 is printed"], states(1, 100.0)[0][0]
    total = momentum_N(body, run(body, state, np.zeros(4), 20.0))
    assert np.linalg.norm(total - total[0], axis=1).max() > 0.1 * np.linalg.norm(total[0])  # right sign: 1e-8


@every_kind
def test_the_gyroscopic_torque_does_no_work_with_either_sign(body):
    free = WheeledBody(body.inertia, body.wheel_axes, body.wheel_inertia, body.coupled, body.gyroscopic_sign)
    for state in states(10, 300.0)[0]:
        resisting = free.inertia - (free.wheel_inertia * free.wheel_axes @ free.wheel_axes.T if free.coupled else 0.0)
        torque = resisting @ free.drift(state)[4:7]
        assert abs(state[4:7] @ torque) < 1e-13 * np.linalg.norm(torque) * 10  # W; orthogonal but for rounding


def test_the_printed_inertia_runs_in_the_analytic_model_and_no_rigid_body_has_it():
    printed = NacsParameters(inertia_kg_m2="printed")
    body = printed.process()
    assert np.isfinite(run(body, states(1, 50.0)[0][0], np.zeros(4), 5.0)).all()
    with pytest.raises(ImpossibleInertia, match=r"'printed'.*break the triangle inequality: 0\.173\d* > 0\.02\d* \+ 0\.03\d* kg m2"):
        compile_nacs(printed)


@every_kind
@pytest.mark.parametrize("size", [1, 3, 10, 64])
def test_a_state_has_the_same_derivative_bit_for_bit_in_any_batch(body, size):
    state, motor = states(1000, 100.0)
    everyone = [*body.linearize(state, motor), *predict(body, state, motor, 0.1)]
    for first in (0, 137, 900):
        some = slice(first, first + size)
        alone = [*body.linearize(state[some], motor[some]), *predict(body, state[some], motor[some], 0.1)]
        assert all(np.array_equal(a, b[some]) for a, b in zip(alone, everyone, strict=True))
    alone = [*body.linearize(state[5], motor[5]), *predict(body, state[5], motor[5], 0.1)]
    assert all(np.array_equal(a, b[5]) for a, b in zip(alone, everyone, strict=True))


@every_kind
def test_two_leading_axes_are_as_good_as_one(body):
    state, motor = states(6, 100.0)
    stacked = body.derivative(state.reshape(2, 3, 11), motor.reshape(2, 3, 4))
    np.testing.assert_array_equal(stacked.reshape(6, 11), body.derivative(state, motor))
