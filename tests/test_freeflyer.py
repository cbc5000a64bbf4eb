"""MuJoCo's free flyer against the analytic model and what must be conserved."""

import mujoco
import numpy as np
import pytest
from pydantic import ValidationError
from scipy.integrate import solve_ivp

from models.attitude.quaternion import IDENTITY, angle, attitude_matrix, normalize
from models.dynamics.wheel_faults import WheelFault, lost_axis
from models.plants.assembly import ImpossibleInertia
from models.plants.freeflyer import MJCF, WHEELS, FreeflyerParameters, compile_freeflyer
from models.plants.inertia import tensor
from sim.plant.batch import Plant

TICK = 0.1  # s
START = np.concatenate([normalize(np.array([0.1, -0.2, 0.3, 0.9])), [0.01, 0.01, 0.0486], [100.0, -50.0, 80.0, 30.0]])  # 0.464 rpm about z


def fly(plant: Plant, motor: np.ndarray) -> np.ndarray:
    """Analytic states (ticks + 1, 11) of the first trial under wheel torques (ticks, 4), constant over a tick."""
    steps, path = round(TICK / plant.step_s), [plant.truth().state[0]]
    for torque in motor:
        plant.advance(torque[None], np.zeros(3), steps)
        path.append(plant.truth().state[0])
    return np.array(path)


def sines(ticks: int) -> np.ndarray:
    """Wheel torques (ticks, 4) that give up to the paper's 1 N m about each body axis."""
    body = np.sin(2 * np.pi * TICK * np.arange(ticks)[:, None] / np.array([31.0, 47.0, 73.0]))
    return -body @ np.linalg.pinv(FreeflyerParameters().wheel_axes).T


def fresh(start: np.ndarray = START, **parameters) -> Plant:
    plant = Plant(compile_freeflyer(FreeflyerParameters(**parameters)), 1)
    plant.start(start[:4], start[4:7], start[7:])
    return plant


def momentum_N(states: np.ndarray) -> np.ndarray:
    body = FreeflyerParameters().full_process()
    return np.einsum("kji,kj->ki", attitude_matrix(states[:, :4]), body.momentum(states))


def locked_inertia(model: mujoco.MjModel) -> np.ndarray:
    """Block of the free joint's rotation, about the origin of B: everything else locked."""
    data, mass = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, mass)
    return mass[3:6, 3:6]


# mass properties ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("layout", ["crossed", "pyramid"])
def test_with_wheels_locked_the_whole_has_the_published_inertia_about_its_centre_of_mass(layout):
    model = compile_freeflyer(FreeflyerParameters(wheel_layout=layout)).model
    np.testing.assert_allclose(locked_inertia(model), np.diag([399.0, 377.0, 377.0]), rtol=1e-12, atol=1e-10)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.subtree_com[1], 0.0, atol=1e-14)
    assert model.body_mass.sum() == pytest.approx(840.0, rel=1e-14)


def test_another_inertia_and_centre_of_mass_are_reached_by_reassembling():
    other, offset = tensor((420.0, 350.0, 380.0, 10.0, -5.0, 3.0)), np.array([0.01, -0.02, 0.03])
    made = compile_freeflyer()
    hull = made.reassemble(other, offset)
    model, body = made.model, made.model.body(hull.body)
    body.mass, body.ipos, body.inertia, body.iquat = hull.mass, hull.centre_of_mass, hull.moments, hull.axes
    data = mujoco.MjData(model)
    mujoco.mj_setConst(model, data)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.subtree_com[1], offset, atol=1e-14)
    steiner = 840.0 * (offset @ offset * np.eye(3) - np.outer(offset, offset))
    np.testing.assert_allclose(locked_inertia(model) - steiner, other, rtol=1e-12, atol=1e-10)


def test_freeflyer_xml_as_it_is_equals_the_parameter_table():
    file, table = mujoco.MjModel.from_xml_path(str(MJCF)), compile_freeflyer().scene
    full = {}
    for name, model in (("file", file), ("table", table)):
        axes = np.zeros((model.nbody, 9))
        for i in range(model.nbody):
            mujoco.mju_quat2Mat(axes[i], model.body_iquat[i])
        axes = axes.reshape(-1, 3, 3)
        full[name] = axes @ (model.body_inertia[:, :, None] * axes.swapaxes(1, 2))
    np.testing.assert_allclose(full["file"], full["table"], atol=1e-9)  # digits in the file
    np.testing.assert_allclose(file.body_ipos, table.body_ipos, atol=1e-11)
    for field in ("body_mass", "body_pos", "dof_damping", "dof_frictionloss", "dof_armature", "actuator_gear", "actuator_ctrlrange"):
        np.testing.assert_allclose(getattr(file, field), getattr(table, field), rtol=1e-12, atol=0, err_msg=field)
    np.testing.assert_allclose(np.abs(np.sum(file.body_quat * table.body_quat, axis=1)), 1.0, atol=1e-12)
    assert file.opt.timestep == table.opt.timestep
    assert not file.opt.gravity.any()
    assert file.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4


def test_what_a_person_looks_at_has_the_same_state_and_no_weight():
    made = compile_freeflyer()
    assert (made.scene.nq, made.scene.nv, made.scene.nu) == (made.model.nq, made.model.nv, made.model.nu) == (11, 10, 4)
    assert made.scene.ngeom > 50 > made.model.ngeom
    np.testing.assert_array_equal(made.scene.body_mass, made.model.body_mass)
    np.testing.assert_array_equal(made.scene.body_inertia, made.model.body_inertia)
    assert [made.scene.joint(name).name for name in WHEELS] == list(WHEELS)


def test_a_body_that_cannot_be_is_refused_in_one_line():
    with pytest.raises(
        ImpossibleInertia, match=r"inertia_kg_m2 = .*no rigid body has it, .*triangle inequality: 399 > 100 \+ 200"
    ) as refusal:
        compile_freeflyer(FreeflyerParameters(inertia_kg_m2=(399.0, 100.0, 200.0, 0.0, 0.0, 0.0)))
    assert "\n" not in str(refusal.value)
    with pytest.raises(ImpossibleInertia, match="without wheels no rigid body is left"):
        compile_freeflyer(FreeflyerParameters(inertia_kg_m2=(6.0, 6.0, 6.0, 0.0, 0.0, 0.0)))
    with pytest.raises(ValidationError, match="mass_kg = 20 must exceed that of four wheels together"):
        FreeflyerParameters(mass_kg=20.0)


def test_every_parameter_has_unit_and_provenance():
    rows = list(FreeflyerParameters().table())
    assert ["type", *(row[0] for row in rows)] == list(FreeflyerParameters.model_fields)
    assert all(unit and meaning and source.startswith(("published", "datasheet", "chosen")) for _, _, unit, meaning, source in rows)


# wheels -------------------------------------------------------------------------------------------------------------------------


def test_the_layout_is_eq_11():
    a = b = c = d = 1 / np.sqrt(2)
    printed = np.array([[a, -a, 0, 0], [b, b, c, c], [0, 0, d, -d]])
    np.testing.assert_allclose(FreeflyerParameters().wheel_axes, printed, atol=1e-16)
    tilted = FreeflyerParameters(wheel_tilt_xy_deg=30.0, wheel_tilt_yz_deg=70.0).wheel_axes
    np.testing.assert_allclose(np.linalg.norm(tilted, axis=0), 1.0, atol=1e-15)  # a2 + b2 = c2 + d2 = 1
    np.testing.assert_allclose(tilted[:, 0], [0.5, np.sqrt(0.75), 0.0], atol=1e-15)


def test_the_wheels_of_the_physics_stand_as_the_layout_says():
    for layout in ("crossed", "pyramid"):
        made = compile_freeflyer(FreeflyerParameters(wheel_layout=layout))
        data = mujoco.MjData(made.model)
        mujoco.mj_forward(made.model, data)
        joints = [made.model.joint(name).id for name in WHEELS]
        np.testing.assert_allclose(data.xaxis[joints].T, made.wheel_axes, atol=1e-15)


@pytest.mark.parametrize("layout", ["crossed", "pyramid"])
def test_no_motor_clips_one_newton_metre_about_each_axis_even_with_a_wheel_lost(layout):
    parameters = FreeflyerParameters(wheel_layout=layout)
    corners = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), axis=-1).reshape(-1, 3)  # linear: the worst is in a corner
    faults = [WheelFault.healthy(4), *(WheelFault.floating(4, wheel) for wheel in (1, 2, 3, 4))]
    worst = max(np.abs(corners @ np.linalg.pinv(fault.on_body(parameters.wheel_axes).torque_map).T).max() for fault in faults)
    assert 1.0 < worst < parameters.torque_limit


def test_a_motor_turns_the_body_by_minus_its_torque():
    parameters = FreeflyerParameters()
    for wheel, torque in enumerate(np.eye(4)):
        after = fly(fresh(np.append(IDENTITY, np.zeros(7))), torque[None])[-1]
        expected = -parameters.wheel_axes[:, wheel] / np.diag(parameters.inertia) * TICK
        np.testing.assert_allclose(after[4:7], expected, atol=1e-3 * np.abs(expected).max())  # J_w / J of the wheels' own answer
        assert after[7 + wheel] == pytest.approx(TICK / parameters.wheel_inertia_kg_m2, rel=1e-3)


@pytest.mark.parametrize("axis", range(3))
def test_a_positive_torque_turns_the_quaternion_s_own_component_positive(axis):
    plant = fresh(np.append(IDENTITY, np.zeros(7)))
    plant.advance(np.zeros((1, 4)), np.eye(3)[axis], round(1.0 / plant.step_s))
    truth = plant.truth()
    assert truth.omega_BN_B[0, axis] > 1e-3
    np.testing.assert_allclose(truth.q_BN[0, :3], 0.5 * 0.5 * truth.omega_BN_B[0, axis] * np.eye(3)[axis], atol=1e-6)  # half of rate t / 2


def test_the_free_joint_is_q_BN_and_the_rate_in_B():
    """A(q) maps N to B: with the body turned a quarter about z, its x axis points to y of N, and a rate about it stays there."""
    quarter = np.array([0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])
    plant = fresh(np.concatenate([quarter, [0.1, 0.0, 0.0], np.zeros(4)]))
    after = fly(plant, np.zeros((10, 4)))[-1]
    np.testing.assert_allclose(attitude_matrix(after[:4]) @ [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], atol=1e-6)  # wheels turn along
    np.testing.assert_allclose(plant.truth().qpos[0, 3:7], np.roll(after[:4], 1), atol=0)
    data = mujoco.MjData(plant.assembly.model)
    data.qpos[:] = plant.truth().qpos[0]
    mujoco.mj_forward(plant.assembly.model, data)
    np.testing.assert_allclose(data.body("hull").xmat.reshape(3, 3).T, attitude_matrix(after[:4]), atol=1e-15)


# motion -------------------------------------------------------------------------------------------------------------------------


def test_a_quarter_of_an_hour_of_wheel_torques_leaves_momentum_and_place_where_they_were():
    plant = fresh()
    total = momentum_N(fly(plant, sines(9000)))
    assert np.linalg.norm(total - total[0], axis=1).max() < 1e-10 * np.linalg.norm(total[0])
    assert np.abs(plant.truth().qpos[0, :3]).max() < 1e-9


def test_the_attitude_is_that_of_the_coupled_analytic_model():
    body, motor = FreeflyerParameters().full_process(coupled=True), sines(1500)
    exact = [START]
    for torque in motor:
        flow = solve_ivp(lambda _, x, u=torque: body.derivative(x, u), (0, TICK), exact[-1], "DOP853", rtol=1e-11, atol=1e-12)
        exact.append(flow.y[:, -1])
    exact, path = np.array(exact), fly(fresh(), motor)
    assert np.degrees(angle(path[:, :4], normalize(exact[:, :4]))).max() < 1e-7
    np.testing.assert_allclose(path[:, 4:7], exact[:, 4:7], atol=1e-10)
    np.testing.assert_allclose(path[:, 7:], exact[:, 7:], atol=1e-7)
    assert np.degrees(angle(exact[-1, :4], START[:4])) > 10.0


def test_the_seven_state_model_is_right_to_the_share_of_the_wheels_inertia():
    parameters, motor = FreeflyerParameters(), sines(300)
    path = fly(fresh(), motor)
    body = parameters.process()
    here = 0.5 * (path[:-1] + path[1:])
    model = body.derivative(here[:, :7], np.concatenate([motor, here[:, 7:]], axis=1))[:, 4:]
    np.testing.assert_allclose((path[1:, 4:7] - path[:-1, 4:7]) / TICK, model, atol=2e-3 * np.abs(model).max())


def test_a_seized_wheel_gives_its_momentum_to_the_body_and_then_none():
    plant = fresh()
    before = fly(plant, np.zeros((10, 4)))
    plant.set_wheel_friction(np.array([True]), 0, 40 * 3.0)
    after = fly(plant, np.tile([1.0, 0.0, 0.0, 0.0], (100, 1)))
    total = momentum_N(np.concatenate([before, after]))
    assert abs(after[-1, 7]) < 1e-3
    assert np.linalg.norm(total - total[0], axis=1).max() < 1e-7 * np.linalg.norm(total[0])
    assert np.linalg.norm(after[-1, 4:7] - before[-1, 4:7]) > 0.01  # 10 N m s into 390 kg m2
    locked = WheelFault.locked(4, 1)
    assert lost_axis(plant.assembly.wheel_axes, locked) is None
    np.testing.assert_array_equal(locked.act(np.array([1.0, 0.0, 0.0, 0.0])), 0.0)


def test_a_trial_flies_the_same_bits_alone_and_among_others():
    starts = START + np.random.default_rng(0).normal(0, 1e-2, (5, 11))
    starts[:, :4] = normalize(starts[:, :4])

    def flown(which: np.ndarray) -> np.ndarray:
        plant = Plant(compile_freeflyer(), len(which), 1)
        plant.start(starts[which, :4], starts[which, 4:7], starts[which, 7:])
        for torque in sines(50):
            plant.advance(np.tile(torque, (len(which), 1)), np.zeros(3), 2)
        return plant.truth().state

    np.testing.assert_array_equal(flown(np.array([3]))[0], flown(np.arange(5))[3])
