"""MuJoCo's testbed against closed forms: what the plant must do whoever wrote its engine."""

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipj, ellipk

from models.attitude.quaternion import IDENTITY, angle, attitude_matrix, from_rotation_vector, normalize
from models.plants.assembly import Assembly, ImpossibleInertia
from models.plants.inertia import tensor
from models.plants.nacs import BALANCE_MASSES, MJCF, WHEELS, NacsParameters, compile_nacs
from sim.plant.batch import Plant, SimulationFailed, diagnose

FREE = {"wheel_coulomb_nm": 0.0, "wheel_viscous_nms": 0.0, "bearing_viscous_nms": 0.0}
WEIGHTLESS = FREE | {"gravity_m_s2": 0.0, "centre_of_mass_um": (0.0, 0.0, 0.0)}
DIAGONAL = (0.021867, 0.0172994, 0.0316484, 0.0, 0.0, 0.0)  # the published moments without the products: planar motions stay planar
STILL = np.array([1.0, -1.0, -1.0, 1.0])  # wheel pattern whose torques and momenta cancel: W @ STILL = 0, so the body stays at rest
NO_TORQUE = np.zeros(3)


def assembly(stop: bool = False, **parameters) -> Assembly:
    """The testbed, without its tilt stop unless asked for."""
    made = compile_nacs(NacsParameters(**parameters))
    if not stop:
        made.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    return made


def fly(plant: Plant, seconds: float, samples: int, motor=0.0, torque_B=NO_TORQUE) -> list:
    """Truth at the start and after each of `samples` equal parts of `seconds`."""
    steps = round(seconds / samples / plant.step_s)
    path = [plant.truth()]
    for _ in range(samples):
        plant.advance(motor, torque_B, steps)
        path.append(plant.truth())
    return path


def column(path: list, name: str) -> np.ndarray:
    return np.array([getattr(truth, name) for truth in path])


def forward(made: Assembly, qpos=None, qvel=None) -> mujoco.MjData:
    data = mujoco.MjData(made.model)
    mujoco.mj_resetDataKeyframe(made.model, data, made.model.keyframe(made.keyframe).id)
    data.qpos[:] = data.qpos if qpos is None else qpos
    data.qvel[:] = data.qvel if qvel is None else qvel
    mujoco.mj_forward(made.model, data)
    return data


# mass properties ------------------------------------------------------------------------------------------------------------


def test_with_wheels_locked_the_testbed_has_the_published_inertia():
    made = assembly()
    mass = np.zeros((made.model.nv, made.model.nv))
    mujoco.mj_fullM(made.model, forward(made), mass)
    published = tensor((0.021867, 0.0172994, 0.0316484, -0.001532, -0.000631, -0.000781))
    np.testing.assert_allclose(mass[:3, :3], published, rtol=1e-9)  # the bearing's block: everything else locked


def test_the_parts_add_up_to_the_published_inertia_about_the_centre_of_rotation():
    made = assembly()
    data, total = forward(made), np.zeros((3, 3))
    body_of_lab = data.body("bus").xmat.reshape(3, 3).T
    for i in range(1, made.model.nbody):
        axes = body_of_lab @ data.ximat[i].reshape(3, 3)
        r = body_of_lab @ (data.xipos[i] - data.body("bus").xpos)
        total += axes @ np.diag(made.model.body_inertia[i]) @ axes.T + made.model.body_mass[i] * (r @ r * np.eye(3) - np.outer(r, r))
    np.testing.assert_allclose(total, NacsParameters().inertia, rtol=1e-9)


@pytest.mark.parametrize("offset_um", [(0.5, -0.4, 1.0), (0.0, 0.0, 0.0), (300.0, -200.0, 2000.0)])
def test_the_centre_of_mass_is_where_the_parameter_says(offset_um):
    made = assembly(centre_of_mass_um=offset_um)
    data = forward(made)
    r = data.body("bus").xmat.reshape(3, 3).T @ (data.subtree_com[0] - data.body("bus").xpos)
    np.testing.assert_allclose(1e6 * r, offset_um, atol=1e-6)  # rounding of a metre, in micrometres
    assert made.model.body_mass.sum() == pytest.approx(3.2, rel=1e-12)


@pytest.mark.parametrize("name", BALANCE_MASSES)
def test_a_balance_mass_moves_the_centre_of_mass_by_its_share_of_the_travel(name):
    made = assembly(**WEIGHTLESS)
    plant = Plant(made, 1)
    plant.hold(name, 0.02)
    settled = fly(plant, 1.0, 1)[-1]  # sixty time constants of the rail's drive
    data = forward(made, settled.qpos[0])
    r = attitude_matrix(settled.q_BN[0]) @ np.diag([1.0, -1.0, -1.0]) @ (data.subtree_com[0] - data.body("bus").xpos)
    expected = 0.05 / 3.2 * 0.02 * np.eye(3)[BALANCE_MASSES.index(name)]
    np.testing.assert_allclose(r, expected, atol=1e-9)


def test_nacs_xml_as_it_is_equals_the_parameter_table():
    file, table = mujoco.MjModel.from_xml_path(str(MJCF)), compile_nacs().scene
    full = {}
    for name, model in (("file", file), ("table", table)):
        axes = np.zeros((model.nbody, 9))
        for i in range(model.nbody):
            mujoco.mju_quat2Mat(axes[i], model.body_iquat[i])
        axes = axes.reshape(-1, 3, 3)
        full[name] = axes @ (model.body_inertia[:, :, None] * axes.swapaxes(1, 2))
    np.testing.assert_allclose(full["file"], full["table"], atol=1e-11)  # ten digits in the file
    np.testing.assert_allclose(file.body_ipos, table.body_ipos, atol=1e-11)
    for field in ("body_mass", "body_pos", "dof_damping", "dof_frictionloss", "dof_armature", "jnt_range", "actuator_gainprm"):
        np.testing.assert_allclose(getattr(file, field), getattr(table, field), rtol=1e-12, atol=0, err_msg=field)
    for field in ("actuator_biasprm", "actuator_ctrlrange", "actuator_forcerange", "actuator_dynprm", "qpos0", "key_qpos"):
        np.testing.assert_allclose(getattr(file, field), getattr(table, field), rtol=1e-12, atol=0, err_msg=field)
    np.testing.assert_allclose(np.abs(np.sum(file.body_quat * table.body_quat, axis=1)), 1.0, atol=1e-12)
    assert file.opt.timestep == table.opt.timestep
    np.testing.assert_array_equal(file.opt.gravity, table.opt.gravity)


def test_an_inertia_that_leaves_no_bus_is_refused():
    with pytest.raises(ImpossibleInertia, match="without wheels and masses no rigid body is left"):
        compile_nacs(NacsParameters(inertia_kg_m2=(2e-3, 2e-3, 2e-3, 0.0, 0.0, 0.0)))


# torque-free motion -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("offset_um", [(0.0, 0.0, 0.0), (300.0, -200.0, 2000.0)], ids=["balanced", "off balance"])
def test_torque_free_motion_with_spinning_wheels_is_that_of_the_analytic_model(offset_um):
    made = assembly(**WEIGHTLESS | {"centre_of_mass_um": offset_um})  # without gravity a force of the bearing alone, and no torque
    body = NacsParameters(**WEIGHTLESS).process(coupled=True)
    start = np.concatenate([normalize(np.array([0.1, -0.2, 0.3, 0.9])), [0.12, -0.08, 0.1], [300.0, 300.0, -300.0, 300.0]])
    plant = Plant(made, 1)
    plant.start(start[:4], start[4:7], start[7:])
    path = fly(plant, 100.0, 100)
    momentum = diagnose(made, column(path, "qpos"), column(path, "qvel")).momentum_N[:, 0]
    assert np.linalg.norm(momentum - momentum[0], axis=1).max() < 1e-9 * np.linalg.norm(momentum[0])
    np.testing.assert_allclose(momentum[0], attitude_matrix(start[:4]).T @ body.momentum(start), rtol=1e-9)

    seconds = np.arange(101.0)
    exact = solve_ivp(lambda _, x: body.derivative(x, np.zeros(4)), (0, 100), start, "DOP853", seconds, rtol=1e-10, atol=1e-12)
    apart = np.degrees(angle(column(path, "q_BN")[:, 0], normalize(exact.y[:4].T)))
    assert apart.max() < 1e-4
    np.testing.assert_allclose(column(path, "omega_wheel")[-1, 0], exact.y[7:, -1], atol=1e-5)


def test_torque_free_motion_of_an_asymmetric_body_is_jacobis():
    """Wheels that stand still relative to N keep doing so without friction: the rest is Euler's body of inertia J - J_w W W'."""
    made = assembly(**WEIGHTLESS)
    moments, axes = np.linalg.eigh(made.inertia - made.wheel_inertia * made.wheel_axes @ made.wheel_axes.T)
    axes[:, 2] *= np.linalg.det(axes)
    start = np.array([0.05, 0.0, 0.3])
    energy, square = moments @ start**2, np.sum((moments * start) ** 2)  # 2 E and H^2, with H^2 > 2 E I_2
    i1, i2, i3 = moments
    low, high = energy * i3 - square, square - energy * i1
    amplitude = np.sqrt([low / (i1 * (i3 - i1)), low / (i2 * (i3 - i2)), high / (i3 * (i3 - i1))])
    parameter = (i2 - i1) * low / ((i3 - i2) * high)
    time = np.arange(101.0)
    sn, cn, dn, _ = ellipj(time * np.sqrt((i3 - i2) * high / (i1 * i2 * i3)), parameter)  # Landau & Lifshitz, sec. 37
    exact = (amplitude * np.stack([cn, sn, dn], axis=1)) @ axes.T

    plant = Plant(made, 1)
    plant.start(IDENTITY, axes @ start, -made.wheel_axes.T @ axes @ start)
    rate = column(fly(plant, 100.0, 100), "omega_BN_B")[:, 0]
    np.testing.assert_allclose(rate, exact, atol=1e-7)  # balance masses on springs give by 1e-9 m


def test_energy_is_conserved_without_dissipation():
    made = assembly(**FREE, centre_of_mass_um=(100.0, 0.0, 2000.0))
    plant = Plant(made, 1)
    plant.start(from_rotation_vector(np.array([0.3, -0.2, 0.0])), np.array([0.1, 0.2, -0.3]), 50.0 * np.array([1.0, 2.0, -1.0, 0.5]))
    path = fly(plant, 60.0, 60)
    energy = diagnose(made, column(path, "qpos"), column(path, "qvel")).energy[1:, 0]  # after the balance masses have sagged by 3 um
    height = diagnose(made, column(path, "qpos"), 0 * column(path, "qvel")).energy[1:, 0]
    assert np.ptp(energy) < 1e-3 * np.ptp(height)  # the rails' dampers take 1e-8 W


def test_the_bearings_drag_is_all_that_a_yawing_body_loses():
    made = assembly(**WEIGHTLESS | {"bearing_viscous_nms": 1e-3, "inertia_kg_m2": DIAGONAL})
    plant = Plant(made, 1)
    plant.start(IDENTITY, np.array([0.0, 0.0, 1.0]), np.array([1, 1, 1, 1]) * np.sqrt(0.5))  # wheels at rest relative to N
    rate = column(fly(plant, 20.0, 20), "omega_BN_B")[:, 0, 2]
    inertia = DIAGONAL[2] - 2 * made.wheel_inertia
    np.testing.assert_allclose(rate, np.exp(-1e-3 / inertia * np.arange(21.0)), rtol=1e-6)


# gravity ----------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("amplitude_deg", [1.0, 20.0])
def test_a_low_centre_of_mass_makes_a_pendulum_of_the_analytic_period(amplitude_deg):
    made = assembly(**FREE, inertia_kg_m2=DIAGONAL, centre_of_mass_um=(0.0, 0.0, 2000.0))
    plant, amplitude = Plant(made, 1), np.radians(amplitude_deg)
    plant.start(from_rotation_vector(np.array([amplitude, 0.0, 0.0])), np.zeros(3), np.zeros(4))
    path = fly(plant, 20.0, 2000)
    tilt = 2 * np.arctan2(column(path, "q_BN")[:, 0, 0], column(path, "q_BN")[:, 0, 3])
    falling = np.flatnonzero((tilt[:-1] > 0) & (tilt[1:] <= 0))
    crossing = 0.01 * (falling + tilt[falling] / (tilt[falling] - tilt[falling + 1]))
    inertia = DIAGONAL[0] - made.wheel_inertia  # the free wheels' spin about x stays behind: (W W')_xx = 1
    small = 2 * np.pi * np.sqrt(inertia / (3.2 * 9.80665 * 2e-3))
    exact = small * 2 / np.pi * ellipk(np.sin(amplitude / 2) ** 2)
    np.testing.assert_allclose(np.diff(crossing), exact, rtol=1e-4)  # balance_z sags by 3 um: 1.3e-5


def test_a_high_centre_of_mass_falls_over_and_is_caught_by_the_tilt_stop():
    made = assembly(stop=True, **FREE, centre_of_mass_um=(0.0, 0.0, -2000.0))
    plant = Plant(made, 1)
    plant.start(from_rotation_vector(np.radians([0.1, 0.0, 0.0])), np.zeros(3), np.zeros(4))
    lean = np.degrees(np.arccos(attitude_matrix(column(fly(plant, 30.0, 600), "q_BN")[:, 0])[:, 2, 2]))
    assert 29.0 < lean.max() < 31.0


def test_pushed_hard_the_tilt_stays_at_its_stop_while_yaw_turns_freely():
    plant = Plant(assembly(stop=True), 1)
    path = fly(plant, 20.0, 2000, torque_B=np.array([0.03, 0.0, 0.004]))
    matrix = attitude_matrix(column(path, "q_BN")[:, 0])
    lean = np.degrees(np.arccos(matrix[:, 2, 2]))
    heading = np.unwrap(np.arctan2(matrix[:, 0, 1], matrix[:, 0, 0]))
    assert 29.0 < lean.max() < 31.0
    assert np.degrees(heading[-1] - heading[0]) > 360.0


# wheels -----------------------------------------------------------------------------------------------------------------------


def test_the_pattern_of_these_tests_leaves_the_body_at_rest():
    np.testing.assert_allclose(assembly().wheel_axes @ STILL, 0.0, atol=1e-15)


@pytest.mark.parametrize(("coulomb", "viscous"), [(1e-4, 0.0), (0.0, 1e-6), (1e-4, 1e-6)])
def test_a_wheel_spins_down_as_dry_and_viscous_friction_say(coulomb, viscous):
    made = assembly(**WEIGHTLESS | {"wheel_coulomb_nm": coulomb, "wheel_viscous_nms": viscous})
    plant, start = Plant(made, 1), 100.0
    plant.start(IDENTITY, np.zeros(3), start * STILL)
    path, time = fly(plant, 20.0, 200), np.linspace(0, 20, 201)
    if viscous:
        exact = (start + coulomb / viscous) * np.exp(-viscous * time / made.wheel_inertia) - coulomb / viscous
    else:
        exact = start - coulomb / made.wheel_inertia * time
    speed = column(path, "omega_wheel")[:, 0] * STILL
    turning, standing = exact > 1.0, exact < -1.0  # between them the friction, a soft constraint, lets go of its limit
    np.testing.assert_allclose(speed[turning], exact[turning, None] * np.ones(4), rtol=1e-9)
    np.testing.assert_allclose(speed[standing], 0.0, atol=1e-4)
    np.testing.assert_allclose(column(path, "omega_BN_B"), 0.0, atol=1e-9)


@pytest.mark.parametrize("torque", [1e-6, 1e-3, -0.02])
def test_the_drive_delivers_the_commanded_torque_exactly(torque):
    made = assembly(**WEIGHTLESS)
    plant = Plant(made, 1)
    speed = column(fly(plant, 0.2, 2, motor=torque * STILL), "omega_wheel")[:, 0] * STILL
    np.testing.assert_allclose(speed[1:], np.outer([0.1, 0.2], np.full(4, torque / made.wheel_inertia)), rtol=1e-10)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_drive_saturates_at_its_torque_limit(sign):
    made = assembly(**WEIGHTLESS)
    speed = fly(Plant(made, 1), 0.1, 1, motor=sign * 5.0 * STILL)[-1].omega_wheel[0] * STILL
    np.testing.assert_allclose(speed, sign * made.wheel_torque_limit * 0.1 / made.wheel_inertia, rtol=1e-10)


def test_back_emf_ends_the_wheels_acceleration_at_the_no_load_speed():
    parameters = NacsParameters(**WEIGHTLESS)
    made, K, R = assembly(**WEIGHTLESS), parameters.motor_constant_nm_a, parameters.winding_resistance_ohm
    plant, limit, top = Plant(made, 1), made.wheel_torque_limit, parameters.no_load_speed
    speed = column(fly(plant, 5.0, 500, motor=limit * STILL), "omega_wheel")[:, 0, 0]
    bend = top - limit * R / K**2  # beyond, the voltage is used up: torque = K (V - K omega) / R
    after = 0.01 * np.arange(501) - bend * made.wheel_inertia / limit
    fading = top - (top - bend) * np.exp(-np.maximum(after, 0) * K**2 / (R * made.wheel_inertia))
    exact = np.where(after < 0, bend + limit / made.wheel_inertia * after, fading)
    np.testing.assert_allclose(speed, exact, atol=1e-3 * top)  # one step meets the bend
    assert speed[-1] == pytest.approx(top, rel=1e-9)
    assert top == pytest.approx(8000 * 2 * np.pi / 60, rel=1e-3)
    assert made.wheel_speed_limit == top


def test_the_body_feels_the_opposite_of_the_wheel_torque():
    made = assembly(**WEIGHTLESS)
    motor = np.array([1e-3, 2e-3, -1e-3, 5e-4])
    after = fly(Plant(made, 1), 0.01, 1, motor=motor)[-1]
    resisting = made.inertia - made.wheel_inertia * made.wheel_axes @ made.wheel_axes.T
    np.testing.assert_allclose(after.omega_BN_B[0], 0.01 * np.linalg.solve(resisting, -made.wheel_axes @ motor), rtol=1e-3)


def test_an_external_torque_is_resolved_in_the_body_frame():
    made = assembly(**WEIGHTLESS)
    plant, push = Plant(made, 1), np.array([1e-3, -2e-3, 5e-4])
    plant.start(normalize(np.array([0.5, -0.3, 0.6, 0.2])), np.zeros(3), np.zeros(4))
    resisting = made.inertia - made.wheel_inertia * made.wheel_axes @ made.wheel_axes.T
    rate = fly(plant, 0.01, 1, torque_B=push)[-1].omega_BN_B[0]
    np.testing.assert_allclose(rate, 0.01 * np.linalg.solve(resisting, push), rtol=1e-3)


def test_a_spinning_wheel_on_a_turning_body_gives_the_gyroscopic_torque():
    made = assembly(**WEIGHTLESS)
    rate, speed = np.array([0.2, -0.3, 0.5]), np.array([300.0, -100.0, 200.0, 50.0])
    spinning, standing = np.zeros((2, made.model.nv))
    spinning[:3] = standing[:3] = rate
    spinning[3:7] = speed
    gain = [forward(made, qvel=v).qacc[:3].copy() for v in (spinning, standing)]
    resisting = made.inertia - made.wheel_inertia * made.wheel_axes @ made.wheel_axes.T
    torque = resisting @ (gain[0] - gain[1])
    np.testing.assert_allclose(torque, -np.cross(rate, made.wheel_inertia * made.wheel_axes @ speed), rtol=1e-4, atol=1e-7)


def test_large_dry_friction_locks_a_wheel_to_the_body_and_keeps_the_momentum():
    made = assembly(**WEIGHTLESS | {"wheel_coulomb_nm": 1e-5})
    plant = Plant(made, 2)
    plant.start(IDENTITY, np.zeros(3), np.array([200.0, 0.0, 0.0, 0.0]))
    plant.set_wheel_friction(np.array([False, True]), 0, 1.0)
    path = fly(plant, 1.0, 10)
    momentum = diagnose(made, column(path, "qpos"), column(path, "qvel")).momentum_N
    np.testing.assert_allclose(momentum[:, 1], np.broadcast_to(momentum[0, 1], (11, 3)), atol=1e-9 * np.linalg.norm(momentum[0, 1]))
    assert abs(path[-1].omega_wheel[1, 0]) < 1e-3  # rad/s, a five-hundredth of what the sensor can tell
    assert path[-1].omega_wheel[0, 0] > 199.0


# the plant as a part of the twin ----------------------------------------------------------------------------------------------


def test_other_mass_properties_keep_the_rate_and_give_the_wanted_response():
    made = assembly(**FREE)
    wanted, centre = tensor((0.03, 0.025, 0.04, -0.001, 0.0005, 0.0008)), np.array([2e-3, -4e-3, 5e-4])
    plant, push = Plant(made, 5), np.vstack([1e-3 * np.eye(3), np.zeros((2, 3))])
    plant.start(IDENTITY, np.zeros(3), np.zeros(4))
    changed = np.array([True, True, True, True, False])
    plant.set_mass_properties(changed, wanted[None], centre[None])
    np.testing.assert_array_equal(plant.truth().omega_BN_B, 0.0)
    plant.advance(0.0, push, 1)
    gain = plant.truth().omega_BN_B / plant.step_s
    resisting = wanted - made.wheel_inertia * made.wheel_axes @ made.wheel_axes.T
    np.testing.assert_allclose(np.linalg.inv((gain[:3] - gain[3]).T / 1e-3), resisting, rtol=1e-3, atol=5e-6)  # the masses still give
    weight = np.cross(centre, [0.0, 0.0, 3.2 * 9.80665])
    np.testing.assert_allclose(resisting @ gain[3], weight, atol=2e-4)  # while the balance masses begin to sag: 4e-5
    untouched = Plant(made, 1)
    untouched.advance(0.0, NO_TORQUE, 1)
    np.testing.assert_array_equal(plant.truth().omega_BN_B[4], untouched.truth().omega_BN_B[0])


def test_other_mass_properties_keep_a_rate_that_is_not_zero():
    plant = Plant(assembly(), 2)
    plant.start(IDENTITY, np.array([0.1, 0.2, -0.3]), np.full(4, 50.0))
    fly(plant, 1.0, 1)
    before = plant.truth()
    plant.set_mass_properties(np.array([True, False]), tensor((0.03, 0.025, 0.04, 0.0, 0.0, 0.0))[None], np.zeros((1, 3)))
    np.testing.assert_array_equal(plant.truth().state, before.state)


@pytest.fixture
def tidy(tmp_path, monkeypatch):
    """An empty working directory, which must stay so: MuJoCo left alone writes a log into it."""
    monkeypatch.chdir(tmp_path)
    yield
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("tidy")
@pytest.mark.parametrize("sick", [np.nan, np.inf])
def test_a_command_that_is_no_number_fails_loudly_with_trial_and_time(sick):
    plant = Plant(assembly(), 4)
    command = np.zeros((4, 4))
    fly(plant, 0.5, 5)
    command[2, 1] = sick
    with pytest.raises(SimulationFailed, match=r"trial 2 failed at t = 0\.500 s: ") as failure:
        plant.advance(command, NO_TORQUE, 10)
    assert failure.value.trial == 2


@pytest.mark.usefixtures("tidy")
@pytest.mark.parametrize("torque", [np.nan, 1e14])
def test_an_unstable_simulation_fails_loudly_with_trial_and_time(torque):
    plant = Plant(assembly(), 3)
    push = np.zeros((3, 3))
    push[1, 0] = torque
    with pytest.raises(SimulationFailed, match=r"trial 1 failed at t = 0\.000 s: .*BADQACC"):
        plant.advance(np.zeros(4), push, 10)


def flown(trials: np.ndarray, threads: int) -> np.ndarray:
    """Ten trials that all differ, of which some are flown."""
    rng = np.random.default_rng(11)
    rate, speed, motor = rng.normal(0, 0.2, (10, 3)), rng.normal(0, 100, (10, 4)), rng.normal(0, 0.01, (10, 4))
    plant = Plant(assembly(stop=True), len(trials), threads)
    plant.start(from_rotation_vector(rate[trials]), rate[trials], speed[trials])
    path = fly(plant, 5.0, 10, motor=motor[trials], torque_B=0.1 * rate[trials])
    return np.concatenate([column(path, "qpos"), column(path, "qvel")], axis=-1)


def test_a_trial_flies_the_same_bits_alone_and_among_ten_and_on_two_threads():
    everyone = flown(np.arange(10), 1)
    np.testing.assert_array_equal(flown(np.arange(10), 2), everyone)
    for trial in (0, 3, 9):
        np.testing.assert_array_equal(flown(np.array([trial]), 1)[:, 0], everyone[:, trial])


def test_the_wheels_and_masses_that_the_twin_names_exist():
    made = assembly()
    assert [made.model.joint(name).name for name in (*WHEELS, *BALANCE_MASSES)] == [*WHEELS, *BALANCE_MASSES]
    assert (made.scene.nq, made.scene.nv, made.scene.nu) == (made.model.nq, made.model.nv, made.model.nu)
    assert made.scene.ngeom > made.model.ngeom
