"""MuJoCo's flexible spacecraft against the linear model of its channels and what must be conserved."""

import tomllib

import mujoco
import numpy as np
import pytest
from pydantic import ValidationError
from scipy.linalg import eigh, expm

from models.attitude.quaternion import IDENTITY, normalize
from models.plants.assembly import ImpossibleInertia
from models.plants.flexible import MJCF, PANELS, WHEELS, compile_flexible, prepare_flexible
from models.plants.flexible_parameters import FLEXIBLE_SETS, FlexibleParameters
from models.plants.inertia import tensor
from sim.plant.batch import Plant, Truth, diagnose

SETS = tuple(FLEXIBLE_SETS)
every_set = pytest.mark.parametrize("name", SETS)


def fly(plant: Plant, ticks: int, tick_s: float, motor: np.ndarray | None = None, torque_B: np.ndarray | None = None) -> list[Truth]:
    """Truth at every tick, under wheel torques (ticks, 4) and external torques (ticks, 3), both zero once they end."""
    path, steps = [plant.truth()], round(tick_s / plant.step_s)
    for k in range(ticks):
        wheels = motor[k][None] if motor is not None and k < len(motor) else np.zeros((1, 4))
        plant.advance(wheels, torque_B[k] if torque_B is not None and k < len(torque_B) else np.zeros(3), steps)
        path.append(plant.truth())
    return path


def fresh(name: str, **parameters: object) -> tuple[FlexibleParameters, Plant]:
    chosen = FlexibleParameters(set=name, **parameters)
    return chosen, Plant(compile_flexible(chosen), 1)


def column(path: list[Truth], field: str) -> np.ndarray:
    return np.array([getattr(truth, field)[0] for truth in path])


def panel_angles(plant: Plant, path: list[Truth]) -> np.ndarray:
    """(ticks + 1, 2) rad."""
    return column(path, "qpos")[:, [plant.assembly.model.joint(name).qposadr[0] for name in PANELS]]


def mass_matrix(model: mujoco.MjModel) -> np.ndarray:
    data, mass = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, mass)
    return mass


def mode(model: mujoco.MjModel) -> float:
    """Frequency, rad/s, of the mode in which both panels turn alike, of MuJoCo's mass matrix and springs at rest."""
    panels = [model.joint(name).dofadr[0] for name in PANELS]
    stiffness = np.zeros(model.nv)
    stiffness[panels] = [model.joint(name).stiffness[0] for name in PANELS]
    alike = np.delete(np.eye(model.nv), panels[1], axis=1)
    alike[panels[1], panels[0]] = 1.0
    squares = eigh(alike.T @ np.diag(stiffness) @ alike, alike.T @ mass_matrix(model) @ alike, eigvals_only=True)
    assert np.abs(squares[:-1]).max() < 1e-9 * squares[-1]  # all else is free
    return float(np.sqrt(squares[-1]))


def pulses(name: str, axis: int) -> tuple[float, np.ndarray]:
    """Tick s, and torques (ticks, 3) N m about one axis that turn the hub by some 1e-4 rad."""
    tick, size = (0.5, 0.05) if name == "boeing702" else (0.1, 3e-6)
    shape = np.concatenate([np.full(8, 1.0), np.zeros(6), np.full(5, -1.6)])
    return tick, size * shape[:, None] * np.eye(3)[axis]


# mass properties ----------------------------------------------------------------------------------------------------------------


def test_with_panels_and_wheels_locked_the_satellite_has_6000_in_azimuth_and_15000_in_elevation():
    made = compile_flexible()
    np.testing.assert_allclose(mass_matrix(made.model)[3:6, 3:6], np.diag([15000.0, 14000.0, 6000.0]), rtol=1e-12, atol=1e-9)


@every_set
def test_the_whole_has_the_inertia_of_the_table_about_its_centre_of_mass(name):
    parameters = FlexibleParameters(set=name)
    model = compile_flexible(parameters).model
    largest = parameters.inertia.max()
    np.testing.assert_allclose(mass_matrix(model)[3:6, 3:6], parameters.inertia, rtol=1e-12, atol=1e-13 * largest)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.subtree_com[1], 0.0, atol=1e-14)
    assert model.body_mass.sum() == pytest.approx(parameters.mass_kg, rel=1e-14)


def test_panelsat_is_a_hub_of_22_g_m2_about_each_axis_and_two_rods():
    parameters = FlexibleParameters(set="panelsat")
    across = 0.1 * 0.3**2 / 12 + 0.1 * (0.1 + 0.15) ** 2  # of a panel about the middle
    width = 0.1 * 0.12**2 / 12
    np.testing.assert_allclose(np.diag(parameters.inertia), 0.022 + 2 * np.array([across, across + width, width]), rtol=1e-12)


def test_another_inertia_and_centre_of_mass_are_reached_by_reassembling():
    other, offset = tensor((15500.0, 14500.0, 6300.0, 100.0, -50.0, 30.0)), np.array([0.01, -0.02, 0.03])
    made = compile_flexible()
    hub = made.reassemble(other, offset)
    model, body = made.model, made.model.body(hub.body)
    body.mass, body.ipos, body.inertia, body.iquat = hub.mass, hub.centre_of_mass, hub.moments, hub.axes
    data = mujoco.MjData(model)
    mujoco.mj_setConst(model, data)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.subtree_com[1], offset, atol=1e-14)
    steiner = 3500.0 * (offset @ offset * np.eye(3) - np.outer(offset, offset))
    np.testing.assert_allclose(mass_matrix(model)[3:6, 3:6] - steiner, other, rtol=1e-12, atol=1e-9)


def test_flexible_xml_as_it_is_equals_the_parameter_table():
    file, table = mujoco.MjModel.from_xml_path(str(MJCF)), compile_flexible().scene
    full = {}
    for name, model in (("file", file), ("table", table)):
        axes = np.zeros((model.nbody, 9))
        for i in range(model.nbody):
            mujoco.mju_quat2Mat(axes[i], model.body_iquat[i])
        axes = axes.reshape(-1, 3, 3)
        full[name] = axes @ (model.body_inertia[:, :, None] * axes.swapaxes(1, 2))
    np.testing.assert_allclose(full["file"], full["table"], atol=1e-9)  # digits in the file
    np.testing.assert_allclose(file.body_ipos, table.body_ipos, atol=1e-14)
    fields = ("body_mass", "body_pos", "jnt_stiffness", "jnt_axis", "dof_damping", "dof_frictionloss", "dof_armature", "actuator_ctrlrange")
    for field in fields:
        np.testing.assert_allclose(getattr(file, field), getattr(table, field), rtol=1e-12, atol=0, err_msg=field)
    np.testing.assert_allclose(np.abs(np.sum(file.body_quat * table.body_quat, axis=1)), 1.0, atol=1e-12)
    assert file.opt.timestep == table.opt.timestep
    assert not file.opt.gravity.any()
    assert file.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
    assert not file.dof_damping.any()


# what a person gives and sees ---------------------------------------------------------------------------------------------------


def test_a_file_names_a_set_and_overrides_what_it_likes():
    given = tomllib.loads('set = "panelsat"\npanel_spring_nm_rad = 0.02\ninertia_kg_m2 = [0.04, 0.041, 0.03, 0, 0, 0]\n')
    parameters = FlexibleParameters(**given)
    assert (parameters.panel_spring_nm_rad, parameters.inertia[0, 0], parameters.step_s) == (0.02, 0.04, 0.002)
    assert FlexibleParameters(**parameters.model_dump()) == parameters
    assert FlexibleParameters() == FlexibleParameters(set="boeing702")
    for values in FLEXIBLE_SETS.values():
        assert set(values) <= set(FlexibleParameters.model_fields)


@every_set
def test_every_parameter_has_unit_and_provenance(name):
    rows = list(FlexibleParameters(set=name).table())
    assert ["type", *(row[0] for row in rows)] == list(FlexibleParameters.model_fields)
    assert all(unit and meaning and source.startswith(("published", "datasheet", "chosen")) for _, _, unit, meaning, source in rows)


def test_what_cannot_be_is_refused_in_one_line():
    with pytest.raises(ImpossibleInertia, match=r"no rigid body has it, .*triangle inequality: 15000 > 6000 \+ 7000") as refusal:
        compile_flexible(FlexibleParameters(inertia_kg_m2=(15000.0, 7000.0, 6000.0, 0.0, 0.0, 0.0)))
    assert "\n" not in str(refusal.value)
    with pytest.raises(ImpossibleInertia, match=r"without panels and wheels no rigid body is left, .* not positive") as refusal:
        compile_flexible(FlexibleParameters(inertia_kg_m2=(7500.0, 14000.0, 7000.0, 0.0, 0.0, 0.0)))
    assert "\n" not in str(refusal.value)
    with pytest.raises(ValidationError, match="mass_kg = 120 must exceed that of four wheels and two panels together"):
        FlexibleParameters(mass_kg=120.0)
    with pytest.raises(ValidationError, match=r"wheel_inertia_kg_m2 = 0\.2 must not exceed twice wheel_transverse_inertia_kg_m2"):
        FlexibleParameters(wheel_inertia_kg_m2=0.2)
    with pytest.raises(ValidationError, match=r"step_s = 0\.5 would damp the mode of 0\.099 Hz; at most 0\.1608"):
        FlexibleParameters(step_s=0.5)
    with pytest.raises(ValidationError, match="'boeing702' or 'panelsat'"):
        FlexibleParameters(set="hubble")
    for wrong in ({"panel_spring_nm_rad": 0.0}, {"mode_frequency_factor": -1.0}, {"panel_length_m": float("nan")}, {"springs": 1.0}):
        with pytest.raises(ValidationError):
            FlexibleParameters(**wrong)


@every_set
def test_what_a_person_looks_at_has_the_same_state_and_no_weight(name):
    made = compile_flexible(FlexibleParameters(set=name))
    assert (made.scene.nq, made.scene.nv, made.scene.nu) == (made.model.nq, made.model.nv, made.model.nu) == (13, 12, 4)
    assert made.scene.ngeom > 50 > made.model.ngeom
    np.testing.assert_array_equal(made.scene.body_mass, made.model.body_mass)
    np.testing.assert_array_equal(made.scene.body_inertia, made.model.body_inertia)


@every_set
def test_the_picture_has_the_size_of_the_plant_and_one_look(name):
    parameters = FlexibleParameters(set=name, panel_length_m=FlexibleParameters(set=name).panel_length_m * 0.9)
    scene = compile_flexible(parameters).scene
    data = mujoco.MjData(scene)
    mujoco.mj_forward(scene, data)
    last = scene.geom("blanket_13")
    tip = data.geom("blanket_13").xpos[2] + last.size[2]
    assert tip == pytest.approx(parameters.hinge_offset_m + parameters.panel_length_m, rel=3e-3)
    assert 2 * last.size[0] == pytest.approx(parameters.panel_width_m, rel=1e-12)
    spar = data.geom("spar_11").xpos[2] + scene.geom("spar_11").size[1]
    assert spar == pytest.approx(parameters.hinge_offset_m + parameters.panel_length_m, rel=3e-3)
    looks = {scene.geom(i).name.partition("_")[0] for i in range(scene.ngeom)} & {"comsat", "cubesat"}
    assert looks == {parameters.look}
    assert (scene.geom_group == 2).all()


# wheels -------------------------------------------------------------------------------------------------------------------------


def test_the_pyramid_serves_all_axes_alike_and_the_physics_stands_as_it_says():
    made = compile_flexible()
    np.testing.assert_allclose(made.wheel_axes @ made.wheel_axes.T, 4 / 3 * np.eye(3), atol=1e-6)  # digits of the cant
    data = mujoco.MjData(made.model)
    mujoco.mj_forward(made.model, data)
    np.testing.assert_allclose(data.xaxis[[made.model.joint(name).id for name in WHEELS]].T, made.wheel_axes, atol=1e-15)


def test_fast_cuts_of_a_degree_on_both_axes_take_a_third_of_the_torque_limit():
    parameters = FlexibleParameters()
    accelerate = 2 * (2 * np.radians(1.0) / 40.0) / 10.0  # rate reverses, smoothed over 10 s
    worst = np.abs(np.linalg.pinv(parameters.wheel_axes))  # signs at their worst
    wheel = worst @ (accelerate * np.array([15000.0, 0.0, 6000.0]))
    assert wheel.max() < parameters.torque_limit / 3


# the mode -----------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "held", "free", "coupling"), [("boeing702", 0.070, 0.070 * 2**0.5, 0.5), ("panelsat", 0.35, 0.443, 0.375)]
)
def test_frequencies_and_coupling_are_those_asked_for(name, held, free, coupling):
    channel = FlexibleParameters(set=name).linear_channel(0, wheels_locked=True)
    assert channel.coupling == pytest.approx(coupling, rel=1e-12)
    digits = 1e-8 if name == "boeing702" else 1e-3
    assert channel.held_frequency / (2 * np.pi) == pytest.approx(held, rel=digits)
    assert channel.free_frequency / (2 * np.pi) == pytest.approx(free, rel=digits)


@every_set
@pytest.mark.parametrize("factor", [0.6, 0.75, 1.0, 1.25, 1.4])
def test_mujoco_has_the_frequencies_of_the_linear_model(name, factor):
    parameters = FlexibleParameters(set=name, mode_frequency_factor=factor)
    channel = parameters.linear_channel(0)
    assert mode(compile_flexible(parameters).model) == pytest.approx(channel.free_frequency, rel=1e-11)
    held = prepare_flexible(parameters).spec
    held.delete(held.joint("hub"))
    held.delete(held.key("rest"))
    assert mode(held.compile()) == pytest.approx(channel.held_frequency, rel=1e-11)
    plain = FlexibleParameters(set=name).linear_channel(0)
    assert channel.held_frequency == pytest.approx(factor * plain.held_frequency, rel=1e-14)
    assert channel.coupling == plain.coupling


@every_set
def test_the_mass_matrix_of_the_channel_is_mujoco_s(name):
    parameters = FlexibleParameters(set=name)
    model = compile_flexible(parameters).model
    mass, panels = mass_matrix(model), [model.joint(panel).dofadr[0] for panel in PANELS]
    wheels = [model.joint(wheel).dofadr[0] for wheel in WHEELS]
    free = mass - mass[:, wheels] @ np.linalg.solve(mass[np.ix_(wheels, wheels)], mass[wheels])  # no torque on the wheels
    for axis in range(3):
        channel = parameters.linear_channel(axis)
        found = np.array(
            [
                [free[3 + axis, 3 + axis], mass[3 + axis, panels].sum()],
                [mass[panels, 3 + axis].sum(), mass[np.ix_(panels, panels)].sum()],
            ]
        )
        np.testing.assert_allclose(found, channel.mass, rtol=1e-12, atol=1e-13 * channel.mass.max())


@every_set
def test_free_oscillation_simulated_has_the_free_frequency(name):
    parameters, plant = fresh(name)
    exact, tick = parameters.linear_channel(0).free_frequency, pulses(name, 0)[0]
    path = fly(plant, 600, tick, torque_B=pulses(name, 0)[1])[100:]
    bend, time = panel_angles(plant, path)[:, 0], np.array([truth.time for truth in path])

    def misfit(frequency: float) -> float:
        basis = np.stack([np.cos(frequency * time), np.sin(frequency * time)], axis=1)
        return float(np.linalg.lstsq(basis, bend)[1][0])

    near = exact * (1 + 1e-4 * np.array([-1.0, 0.0, 1.0]))
    low, middle, high = (misfit(frequency) for frequency in near)
    vertex = near[1] + (near[1] - near[0]) * 0.5 * (low - high) / (low - 2 * middle + high)
    assert vertex == pytest.approx(exact, rel=1e-6)
    assert np.sqrt(middle / len(bend)) < 1e-4 * np.abs(bend).max()


# motion -------------------------------------------------------------------------------------------------------------------------


def test_the_sampled_channel_is_the_exponential_and_the_transfer_function_its_laplace_transform():
    channel = FlexibleParameters().linear_channel(0)
    rates, push = channel.rates
    whole = expm(0.7 * np.block([[rates, push[:, None]], [np.zeros((1, 5))]]))
    sampled = channel.sampled(0.7)
    np.testing.assert_allclose(sampled.transition, whole[:4, :4], rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(sampled.input, whole[:4, 4], rtol=1e-12, atol=1e-18)
    s = np.array([[0.1 + 0.2j, 0.5j], [0.01, 2.0 - 1j]])
    direct = np.linalg.solve(channel.mass * s[..., None, None] ** 2 + channel.stiffness, np.array([1.0, 0.0])[:, None])[..., 0, 0]
    np.testing.assert_allclose(channel.transfer(s), direct, rtol=1e-12)


@every_set
@pytest.mark.parametrize("axis", range(3))
def test_wheel_pulses_move_hub_and_panels_as_the_linear_model_says(name, axis):
    parameters, plant = fresh(name)
    tick, torque = pulses(name, axis)
    path = fly(plant, 600, tick, motor=-torque @ np.linalg.pinv(parameters.wheel_axes).T)
    grow, push = parameters.linear_channel(axis).sampled(tick)
    state = [np.zeros(4)]
    for k in range(600):
        state.append(grow @ state[-1] + push * (torque[k, axis] if k < len(torque) else 0.0))
    linear, bend, turn = np.array(state), panel_angles(plant, path), 2.0 * column(path, "q_BN")[:, :3]
    swing = np.abs(linear[:, 0]).max()
    assert 1e-5 < swing < 1e-2
    np.testing.assert_allclose(turn, linear[:, :1] * np.eye(3)[axis], atol=2e-5 * swing)
    np.testing.assert_allclose(bend, np.stack([linear[:, 1]] * 2, axis=1), atol=(2e-4 if axis == 0 else 1e-9) * swing)
    assert (np.abs(bend).max() > 0.01 * swing) == (axis == 0)


@every_set
def test_azimuth_does_not_bend_the_panels(name):
    _, plant = fresh(name)
    tick, torque = pulses(name, 2)
    path = fly(plant, 400, tick, torque_B=1e3 * torque)
    assert np.abs(column(path, "omega_BN_B")[:, 2]).max() * tick > 1e-3
    assert np.abs(panel_angles(plant, path)).max() < 1e-12


@every_set
def test_300_s_of_ringing_keep_energy_and_momentum(name):
    """Energy of everything, J, of which the mode has its coupling's share after a short pulse about x; wheels stand still."""
    parameters, plant = fresh(name)
    tick, size = (0.5, 5.0) if name == "boeing702" else (0.1, 3e-3)
    path = fly(plant, round(300 / tick), tick, torque_B=size * np.eye(3)[:1])[1:]
    found = diagnose(plant.assembly, column(path, "qpos"), column(path, "qvel"))
    strain = parameters.spring * (panel_angles(plant, path) ** 2).sum(axis=1) / 2
    assert strain.max() == pytest.approx(parameters.linear_channel(0).coupling * found.energy[0], rel=0.05)
    assert np.abs(found.energy / found.energy[0] - 1).max() < 1e-6
    assert np.linalg.norm(found.momentum_N - found.momentum_N[0], axis=1).max() < 1e-10 * np.linalg.norm(found.momentum_N[0])


@every_set
def test_momentum_stays_with_wheels_spinning_rates_about_all_axes_and_panels_ringing(name):
    parameters, plant = fresh(name)
    rate, tick = ([1e-3, -2e-3, 3e-3], 0.5) if name == "boeing702" else ([0.05, -0.02, 0.04], 0.1)
    plant.start(normalize(np.array([0.1, -0.2, 0.3, 0.9])), np.array(rate), np.array([100.0, -50.0, 80.0, 30.0]))
    ticks = round(100 / tick)
    wave = np.sin(np.arange(ticks)[:, None] * tick * np.array([0.5, 0.3, 0.4, 0.2]))
    path = fly(plant, ticks, tick, motor=0.2 * parameters.torque_limit * wave)
    found = diagnose(plant.assembly, column(path, "qpos"), column(path, "qvel"))
    assert np.abs(panel_angles(plant, path)).max() > 1e-4
    assert np.linalg.norm(found.momentum_N - found.momentum_N[0], axis=1).max() < 1e-10 * np.linalg.norm(found.momentum_N[0])
    drift = np.abs(found.position[:, 1] - found.position[0, 1]).max()
    assert drift < 1e-9 * parameters.hinge_offset_m  # panels that flap alike balance each other


def test_the_seven_state_model_believes_the_panels_locked():
    parameters = FlexibleParameters()
    body, torque = parameters.process(), np.array([0.1, -0.2, 0.3, 0.05])
    state = np.concatenate([IDENTITY, np.zeros(3)])
    motion = body.derivative(state, np.concatenate([torque, np.zeros(4)]))
    np.testing.assert_allclose(parameters.inertia @ motion[4:], -parameters.wheel_axes @ torque, rtol=1e-12, atol=1e-15)
    assert compile_flexible(parameters).process.size == 7


def test_a_trial_flies_the_same_bits_alone_and_among_others():
    rates = np.random.default_rng(0).normal(0, 1e-3, (5, 3))

    def flown(which: np.ndarray) -> np.ndarray:
        plant = Plant(compile_flexible(), len(which), 1)
        plant.start(IDENTITY, rates[which], np.zeros(4))
        for torque in np.sin(np.arange(200).reshape(50, 4)):
            plant.advance(np.tile(torque, (len(which), 1)), np.zeros(3), 2)
        truth = plant.truth()
        return np.concatenate([truth.qpos, truth.qvel], axis=1)

    np.testing.assert_array_equal(flown(np.array([3]))[0], flown(np.arange(5))[3])
