"""MuJoCo's monolithic spacecraft against the analytic model, Jacobi's elliptic functions and what must be conserved."""

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipj

from models.attitude.quaternion import IDENTITY, angle, attitude_matrix
from models.dynamics.rigid_body import RigidBody
from models.plants.assembly import ImpossibleInertia
from models.plants.inertia import principal, tensor
from models.plants.monolithic import INERTIA_SETS, MJCF, MonolithicParameters, compile_monolithic
from sim.plant.batch import Dispersion, Plant, diagnose

INERTIA = np.array([[20.0, 1.2, 0.9], [1.2, 17.0, 1.4], [0.9, 1.4, 15.0]])
VECTOR = np.array([-0.6, 0.4, -0.2])
NO_TORQUE = np.zeros(3)
START = np.concatenate([VECTOR, [np.sqrt(1 - VECTOR @ VECTOR)], np.ones(3)])


def fresh(trials: int = 1, start: np.ndarray = START, **parameters) -> Plant:
    plant = Plant(compile_monolithic(MonolithicParameters(**parameters)), trials)
    plant.start(start[:4], start[4:], np.zeros(0))
    return plant


def fly(plant: Plant, ticks: int, torque_B=NO_TORQUE, steps: int = 10) -> np.ndarray:
    """States (ticks + 1, trials, 7) under a torque that is constant, or constant over a tick, (ticks, 3)."""
    path = [plant.truth().state]
    for torque in np.broadcast_to(torque_B, (ticks, 3)):
        plant.advance(np.zeros((plant.trials, 0)), torque, steps)
        path.append(plant.truth().state)
    return np.array(path)


def momentum_N(states: np.ndarray, inertia: np.ndarray = INERTIA) -> np.ndarray:
    return np.einsum("...ji,...j->...i", attitude_matrix(states[..., :4]), states[..., 4:] @ inertia)


def euler(_time: float, state: np.ndarray, torque: np.ndarray) -> np.ndarray:
    """Euler's equations and the kinematics, in vectors."""
    vector, scalar, rate = state[:3], state[3], state[4:]
    return np.concatenate(
        [
            0.5 * (scalar * rate + np.cross(vector, rate)),
            [-0.5 * vector @ rate],
            np.linalg.solve(INERTIA, torque - np.cross(rate, INERTIA @ rate)),
        ]
    )


def test_without_torque_energy_and_momentum_stay():
    """60 s from the thesis' 1 rad/s about each axis."""
    plant = fresh()
    path = fly(plant, 600)[:, 0]
    energy = 0.5 * np.einsum("ki,ij,kj->k", path[:, 4:], INERTIA, path[:, 4:])
    assert energy[0] == pytest.approx(29.5)
    assert np.abs(energy / energy[0] - 1).max() < 1e-9
    momentum = momentum_N(path)
    assert np.linalg.norm(momentum - momentum[0], axis=1).max() / np.linalg.norm(momentum[0]) < 1e-9
    assert np.abs(path[:, 4:] - 1).max() > 0.3  # it does tumble
    truth = plant.truth()
    says = diagnose(plant.assembly, truth.qpos, truth.qvel)
    np.testing.assert_allclose(says.energy, energy[-1], rtol=1e-12)
    np.testing.assert_allclose(says.momentum_N[0], momentum[-1], rtol=1e-10)


def test_the_tumble_is_that_of_an_accurate_integration():
    path = fly(fresh(), 600)[:, 0]
    exact = solve_ivp(euler, (0, 60), START, args=(np.zeros(3),), method="DOP853", rtol=1e-13, atol=1e-14, t_eval=0.1 * np.arange(601)).y.T
    assert angle(path[:, :4], exact[:, :4]).max() < 1e-7
    np.testing.assert_allclose(path[:, 4:], exact[:, 4:], atol=1e-8)


def test_the_tumble_about_principal_axes_is_jacobis():
    """Rates in principal axes are elliptic functions (Markley & Crassidis 2014, eq. 3.157; Landau & Lifshitz, sec. 37)."""
    moments, frame = np.linalg.eigh(INERTIA)  # ascending: A < B < C
    rate = np.array([0.5, 0.0, 0.9])  # in principal axes, the middle one at zero
    plant = fresh(start=np.concatenate([IDENTITY, frame @ rate]))
    path = fly(plant, 300)[:, 0, 4:] @ frame
    low, middle, high = moments
    energy, square = moments @ rate**2, np.sum((moments * rate) ** 2)  # 2 T and |H|^2
    assert square > energy * middle  # about the greatest axis
    speed = np.sqrt((high - middle) * (square - energy * low) / (low * middle * high))
    modulus = (middle - low) * (energy * high - square) / ((high - middle) * (square - energy * low))
    handed = np.linalg.det(frame)
    sn, cn, dn, _ = ellipj(speed * 0.1 * np.arange(301), modulus)
    expected = np.column_stack([rate[0] * cn, np.sqrt((energy * high - square) / (middle * (high - middle))) * sn, rate[2] * dn])
    expected[:, 1] *= handed
    np.testing.assert_allclose(path, expected, atol=1e-8)


def test_a_torque_on_the_body_turns_it_as_in_the_analytic_model():
    torque = 0.1 * np.sin(0.1 * np.arange(200)[:, None] * np.array([1.0, 1.7, 2.3]) + np.array([0.0, 1.0, 2.0]))
    plant = fresh()
    path, state = fly(plant, 200, torque)[:, 0], START
    for k, now in enumerate(torque):
        state = solve_ivp(euler, (0, 0.1), state, args=(now,), method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
        np.testing.assert_allclose(path[k + 1], state, atol=1e-8)
    gained = momentum_N(path[-1]) - momentum_N(path[0])
    impulse = 0.1 * np.einsum("kji,kj->i", attitude_matrix(path[:-1, :4]), torque)
    np.testing.assert_allclose(gained, impulse, atol=0.1 * np.abs(torque).sum(0).max() * 0.1)  # the body turns by 0.1 rad within a tick


def test_the_process_is_the_same_body():
    made = compile_monolithic()
    assert isinstance(made.process, RigidBody)
    state, torque = START + 0.0, np.array([0.1, -0.05, 0.02])
    np.testing.assert_allclose(made.process.derivative(state[None], torque[None])[0], euler(0.0, state, torque), rtol=1e-13, atol=1e-14)
    model, data = made.model, mujoco.MjData(made.model)
    data.qpos[3:] = state[[3, 0, 1, 2]]
    data.qvel[3:] = state[4:]
    data.qfrc_applied[3:] = torque
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.qacc[3:], euler(0.0, state, torque)[4:], rtol=1e-12, atol=1e-14)


def test_another_inertia_leaves_the_rates_and_changes_the_momentum():
    """Table 3.3 of the thesis: whole tensors are exchanged at 100 and 300 s."""
    plant, other = fresh(trials=3), np.diag([10.0, 10.0, 5.0])
    before = plant.truth().state
    plant.set_mass_properties(np.array([False, True, True]), other, np.zeros(3))
    np.testing.assert_array_equal(plant.truth().state, before)
    path = fly(plant, 100)
    kept, changed = momentum_N(path[:, 0]), momentum_N(path[:, 1], other)
    np.testing.assert_allclose(kept, np.broadcast_to(kept[0], kept.shape), atol=1e-8)
    np.testing.assert_allclose(changed, np.broadcast_to(changed[0], changed.shape), atol=1e-8)
    assert np.abs(changed[0] - kept[0]).max() > 3.0
    np.testing.assert_array_equal(path[:, 1], path[:, 2])
    plant.set_mass_properties(np.array([False, True, False]), INERTIA, np.zeros(3))
    again = momentum_N(fly(plant, 50)[:, 1])
    np.testing.assert_allclose(again, np.broadcast_to(again[0], again.shape), atol=1e-8)


def test_trials_can_be_of_different_inertia_and_are_the_same_in_any_batch():
    rng = np.random.default_rng(2)
    tensors = INERTIA * (1 + 0.1 * rng.standard_normal((10, 1, 1)))
    nothing = np.zeros(10)

    def tumble(some: slice) -> np.ndarray:
        plant = fresh(trials=len(nothing[some]))
        plant.disperse(Dispersion(tensors[some], np.zeros_like(tensors[some, 0]), {}))
        return fly(plant, 20, np.array([0.1, -0.1, 0.05]))

    everyone = tumble(slice(None))
    assert np.ptp(everyone[-1, :, 4]) > 1e-4
    np.testing.assert_array_equal(tumble(slice(4, 7)), everyone[:, 4:7])


def test_monolithic_xml_as_it_is_equals_the_parameter_table():
    file, table = mujoco.MjModel.from_xml_path(str(MJCF)), compile_monolithic().scene
    for model in (file, table):
        axes = np.zeros(9)
        mujoco.mju_quat2Mat(axes, model.body_iquat[1])
        axes = axes.reshape(3, 3)
        np.testing.assert_allclose(axes @ np.diag(model.body_inertia[1]) @ axes.T, INERTIA, atol=1e-12)
        np.testing.assert_array_equal(model.body_ipos[1], np.zeros(3))
        assert model.body_mass.sum() == 95.0
        assert model.opt.timestep == 0.01
        assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
        assert not model.opt.gravity.any()
    moments = principal(INERTIA)[0]
    assert moments[0] < moments[1] + moments[2]


def test_what_a_person_looks_at_has_the_same_state_and_no_weight():
    made = compile_monolithic()
    assert (made.scene.nq, made.scene.nv, made.scene.nu) == (made.model.nq, made.model.nv, made.model.nu) == (7, 6, 0)
    assert made.scene.ngeom > 50 > made.model.ngeom
    np.testing.assert_array_equal(made.scene.body_mass, made.model.body_mass)


def test_parameters_and_refusals():
    assert INERTIA_SETS["true"] == (20.0, 17.0, 15.0, 1.2, 0.9, 1.4)
    np.testing.assert_array_equal(MonolithicParameters().inertia, INERTIA)
    np.testing.assert_array_equal(MonolithicParameters(inertia_kg_m2="believed").inertia, np.diag([20.0, 17.0, 15.0]))
    np.testing.assert_array_equal(MonolithicParameters(inertia_kg_m2=(10, 10, 5, 0, 0, 0)).inertia, tensor((10, 10, 5, 0, 0, 0)))
    rows = list(MonolithicParameters().table())
    assert [row[0] for row in rows] == ["inertia_kg_m2", "believed_inertia_kg_m2", "mass_kg", "step_s"]
    assert all(row[4].startswith(("published", "chosen")) for row in rows)
    with pytest.raises(ImpossibleInertia, match=r"inertia_kg_m2 = .*no rigid body has it, .*triangle inequality: 30 > 10 \+ 15"):
        compile_monolithic(MonolithicParameters(inertia_kg_m2=(30.0, 10.0, 15.0, 0.0, 0.0, 0.0)))
