"""Six testbeds with wheels in one room: the world, the analytic model with stored momentum, the loop, wheel faults, what is written."""

import tomllib

import numpy as np
import pytest
from pydantic import ValidationError

from control.formation_law import FormationLaw
from models.attitude import modified_rodrigues
from models.attitude.quaternion import attitude_matrix
from models.dynamics.attitude_by_rodrigues import AttitudeByRodrigues
from models.dynamics.process import runge_kutta
from models.plants.formation_nacs import FormationNacsParameters, compile_testbeds
from models.plants.inertia import point_mass
from models.plants.nacs import WHEELS, NacsParameters, compile_nacs
from models.plants.register.entries import kind_of
from sim.bad_input import BadInput
from sim.campaign.blocks import simulate
from sim.controllers.drives import effectors
from sim.faults.timeline import schedule
from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.metrics.results import rows
from sim.plant.batch import Plant, Truth
from sim.plant.formation import FormationPlant
from sim.report.register import write_report
from sim.rerun.register import write_recording
from sim.scenario import files
from sim.scenario.catalogue import SCENARIOS
from sim.scenario.formation import FormationScenario
from sim.sensors.sensors import SENSOR_SETS
from sim.tables.register import tables_of

FILE = SCENARIOS / "formation" / "nacs.toml"
TRUTH = {"truth": {"feedback": "truth"}}
AUKF = {"aukf": {"feedback": "aukf"}}
IDEAL = {"wheel_coulomb_nm": 0.0, "wheel_viscous_nms": 0.0, "bearing_viscous_nms": 0.0, "gravity_m_s2": 0.0}
QUIET = IDEAL | {"air_torque_nm": 0.0, "drive_torque_noise_nm": 0.0, "command_bits": 0}


def scenario(ticks=100, trials=1, plant=None, **more) -> FormationScenario:
    data = tomllib.loads(FILE.read_text())
    data["run"] |= {"ticks": ticks, "trials": trials, "seed": 5}
    data |= {"phases": {}, "loops": TRUTH} | more
    data["plant"] |= plant or {}
    return FormationScenario.model_validate(data)


def flown(described, loop="truth", trials=1, recorded=1, first=0):
    return run(build(described, np.arange(first, first + trials), loop=loop), recorded=np.arange(recorded))


def off(found):
    """|sigma_i - sigma_0| of the first recorded trial, (ticks, agents)."""
    return np.linalg.norm(found.channels["truth/state"][:, 0, :, :3] - found.channels["reference/leader"][:, None, :3], axis=-1)


# the world ------------------------------------------------------------------------------------------------------------------


def test_each_testbed_is_a_nacs_of_its_own():
    parameters = FormationNacsParameters()
    together = compile_testbeds(parameters).model
    assert together.nv == 6 * compile_nacs().model.nv
    for number, own in enumerate(parameters.testbeds):
        alone, prefix = compile_nacs(own).model, f"testbed_{number + 1}/"
        for body in (alone.body(index) for index in range(1, alone.nbody)):
            there = together.body(prefix + body.name)
            for field in ("mass", "ipos", "iquat", "inertia", "subtreemass"):
                np.testing.assert_array_equal(getattr(there, field), getattr(body, field), err_msg=f"{prefix}{body.name}.{field}")
        for wheel in WHEELS:
            np.testing.assert_array_equal(together.actuator(prefix + wheel).gainprm, alone.actuator(wheel).gainprm)
            assert together.joint(prefix + wheel).damping[0] == alone.joint(wheel).damping[0] > 0.0
    masses = [together.body(f"testbed_{number + 1}/bus").subtreemass[0] for number in range(6)]
    np.testing.assert_allclose(masses, NacsParameters().mass_kg, rtol=1e-12)
    assert len({tuple(moments) for moments in (together.body(f"testbed_{n + 1}/bus").inertia for n in range(6))}) == 6


def test_each_testbed_has_its_inertia_about_its_centre_of_rotation():
    parameters = FormationNacsParameters()
    model = compile_testbeds(parameters).model
    for number, prefix in enumerate(f"testbed_{n + 1}/" for n in range(6)):
        bodies = [b for b in (model.body(i) for i in range(1, model.nbody)) if b.name.startswith(prefix)]
        total = np.zeros((3, 3))
        for body in bodies:  # all are mounted in the bus, whose origin is the centre of rotation
            own = body.name == prefix + "bus"
            mount = np.eye(3) if own else attitude_matrix(np.roll(body.quat, -1)).T
            axes = mount @ attitude_matrix(np.roll(body.iquat, -1)).T
            place = (0.0 if own else body.pos) + mount @ body.ipos
            total += axes * body.inertia @ axes.T + point_mass(float(body.mass[0]), place)
        np.testing.assert_allclose(total, parameters.inertia_scale[number] * NacsParameters().inertia, rtol=0, atol=1e-12)


def test_the_world_has_the_options_of_a_testbed():
    one, all_of_them = compile_nacs().model.opt, compile_testbeds().model.opt
    for field in ("timestep", "integrator", "tolerance", "cone", "disableflags", "enableflags", "iterations", "solver"):
        assert getattr(all_of_them, field) == getattr(one, field), field
    np.testing.assert_array_equal(all_of_them.gravity, one.gravity)


def test_a_testbed_among_others_moves_as_alone_also_when_it_leans_on_its_stop():
    parameters, random = FormationNacsParameters(), np.random.default_rng(3)
    together = FormationPlant(compile_testbeds(parameters), 1)
    alone = [Plant(compile_nacs(own), 1) for own in parameters.testbeds]
    attitude = modified_rodrigues.to_quaternion(np.append(0.03 * random.standard_normal((5, 3)), [[0.128, 0.0, 0.1]], axis=0))
    speed = 150.0 * random.standard_normal((6, 4))
    together.start(attitude, np.zeros(3), speed.ravel())
    for plant, q, wheels in zip(alone, attitude, speed, strict=True):
        plant.start(q, np.zeros(3), wheels)
    stopped = False
    for _ in range(150):
        torque, push = 0.008 * random.standard_normal((6, 4)), 2e-4 * random.standard_normal((6, 3))
        push[5, 0] = 0.05
        together.advance(torque.reshape(1, -1), push[None], 1)
        for plant, own, pushed in zip(alone, torque, push, strict=True):
            plant.advance(own[None], pushed[None], 1)
        truths, truth = [plant.truth() for plant in alone], together.truth()
        np.testing.assert_allclose(truth.q_BN[0], [t.q_BN[0] for t in truths], rtol=0, atol=1e-10)
        np.testing.assert_allclose(truth.omega_BN_B[0], [t.omega_BN_B[0] for t in truths], rtol=0, atol=1e-9)
        np.testing.assert_allclose(truth.omega_wheel.reshape(6, 4), [t.omega_wheel[0] for t in truths], rtol=0, atol=1e-7)
        stopped |= bool(np.hypot(*truth.q_BN[0, 5, :2]) > np.sin(np.radians(14.9)))
    assert stopped


def test_the_room_is_drawn_with_a_colour_for_each_testbed():
    scene = compile_testbeds().scene
    accents = {tuple(scene.geom(f"testbed_{number + 1}/plate_rim").rgba) for number in range(6)}
    assert len(accents) == 6
    stands = [scene.geom(f"testbed_{number + 1}/pedestal_column").pos[:2] for number in range(6)]
    np.testing.assert_allclose(stands, FormationNacsParameters().places[:, :2], rtol=0, atol=1e-12)
    gaps = np.linalg.norm(np.diff(FormationNacsParameters().places, axis=0), axis=-1)
    np.testing.assert_allclose(gaps, FormationNacsParameters().apart_m, rtol=1e-12)


# the analytic model and the law ---------------------------------------------------------------------------------------------


def test_mujoco_moves_as_the_model_with_stored_momentum_does():
    """The model is exact with the wheels' absolute spin; a law and its filters know the spin relative to the body."""
    parameters = FormationNacsParameters(testbed=NacsParameters.model_validate(IDEAL))
    plant, process, one = FormationPlant(compile_testbeds(parameters), 1), parameters.process(), parameters.testbed
    random = np.random.default_rng(4)
    sigma, speed = 0.03 * random.standard_normal((6, 3)), 80.0 * random.standard_normal((6, 4))
    plant.start(modified_rodrigues.to_quaternion(sigma), np.zeros(3), speed.ravel())
    state, spin = np.concatenate([sigma, np.zeros((6, 3))], axis=-1), one.wheel_inertia_kg_m2 * speed
    torque = 0.001 * random.standard_normal((6, 4))
    step, axes = one.step_s, one.wheel_axes
    for _ in range(100):
        plant.advance(torque.reshape(1, -1), np.zeros(3), 1)
        middle = (axes @ (spin + 0.5 * step * torque)[..., None])[..., 0]  # held half-way, which the model takes for constant
        state = runge_kutta(process, state, np.concatenate([-(axes @ torque[..., None])[..., 0], middle], axis=-1), step)
        spin = spin + step * torque
    reached = modified_rodrigues.from_quaternion(plant.truth().q_BN[0])
    np.testing.assert_allclose(reached, state[:, :3], rtol=0, atol=2e-7)
    blind = np.concatenate([sigma, np.zeros((6, 3))], axis=-1)
    for _ in range(100):
        blind = runge_kutta(process, blind, -(axes @ torque[..., None])[..., 0], step)
    assert np.abs(blind[:, :3] - reached).max() > 1e-4


def test_the_law_s_torque_gives_the_wanted_acceleration_whatever_the_wheels_hold():
    random = np.random.default_rng(6)
    body = AttitudeByRodrigues(FormationNacsParameters().believed_inertia)
    state, wanted, stored = 0.1 * random.standard_normal((6, 6)), random.standard_normal((6, 3)), 0.01 * random.standard_normal((6, 3))
    torque = body.torque(state, wanted, stored)
    np.testing.assert_allclose(body.derivative(state, np.concatenate([torque, stored], axis=-1))[:, 3:], wanted, rtol=1e-12)
    assert np.abs(torque - body.torque(state, wanted)).max() > 1e-4
    law, nobody = FormationLaw(body.inertia, limit=10.0), np.zeros((6, 7))
    np.testing.assert_array_equal(law.step(state, np.zeros((1, 7, 6)), nobody, wanted, stored=stored), torque)


# drives ---------------------------------------------------------------------------------------------------------------------


def drives(testbed=None, faults=(), ticks=10):
    described = scenario(ticks=ticks, faults=faults)
    laid = schedule([described.faults] * 2, described.parts, 5, np.arange(2), ticks, 0.01)
    own = FormationNacsParameters(testbed=testbed or NacsParameters.model_validate(QUIET))
    return effectors(own, compile_testbeds(own), laid, 5, np.arange(2), 0.01)


def test_wheels_give_the_body_what_is_asked():
    axes, torque = NacsParameters().wheel_axes, 0.02 * np.random.default_rng(1).uniform(-1.0, 1.0, (2, 6, 3))
    given = drives().give(0, torque, np.zeros(3))
    np.testing.assert_allclose(-(axes @ given.wheel.reshape(2, 6, 4, 1))[..., 0], torque, rtol=0, atol=1e-15)
    assert np.abs(given.body).max() == 0.0
    stepped = drives(NacsParameters(drive_torque_noise_nm=0.0)).give(0, torque, np.zeros(3)).wheel
    step = 2.0 * NacsParameters().torque_limit / 2**12
    np.testing.assert_allclose(stepped / step, np.round(stepped / step), atol=1e-9)
    assert 0.0 < np.abs(stepped - given.wheel).max() <= 0.5 * step * (1 + 1e-9)


def test_the_largest_demand_about_all_axes_is_within_the_drives_limit():
    full = np.full((2, 6, 3), FormationNacsParameters().torque_limit_nm) * [1.0, 1.0, -1.0]
    assert np.abs(drives().give(0, full, np.zeros(3)).wheel).max() < NacsParameters().torque_limit


def test_a_failed_wheel_of_one_testbed_gives_its_share_and_no_other_less():
    fails = [{"kind": "wheel-failure", "agents": [3], "wheel": 2, "remaining": 0.25, "start_s": 0.05, "end_s": 0.08}]
    torque = np.full((2, 6, 3), 0.005)
    healthy, failing = (drives(faults=fails).give(k, torque, np.zeros(3)).wheel.reshape(2, 6, 4) for k in (4, 5))
    expected = healthy.copy()
    expected[:, 2, 1] *= 0.25
    np.testing.assert_array_equal(failing, expected)
    np.testing.assert_array_equal(drives(faults=fails).give(8, torque, np.zeros(3)).wheel.reshape(2, 6, 4), healthy)


def test_the_air_is_as_strong_and_as_lasting_as_round_a_single_testbed():
    ticks, one = 3000, NacsParameters()
    windy = drives(NacsParameters.model_validate(QUIET | {"air_torque_nm": 1e-4}), ticks=ticks)
    air = np.stack([windy.give(k, np.zeros((2, 6, 3)), np.zeros(3)).body for k in range(ticks)])
    assert air.std() == pytest.approx(1e-4, rel=0.05)
    assert np.mean(air[1:] * air[:-1]) / np.mean(air**2) == pytest.approx(np.exp(-0.01 / one.air_torque_correlation_s), abs=0.01)


def test_tachometers_read_the_momentum_of_the_wheels():
    speed = 300.0 * np.random.default_rng(2).standard_normal((2, 24))
    blank = np.zeros((2, 6, 4))
    stored = drives().stored(Truth(0.0, blank, blank[..., :3], speed, blank, blank))
    one = NacsParameters()
    np.testing.assert_allclose(stored.true[1, 5], one.wheel_inertia_kg_m2 * one.wheel_axes @ speed[1, 20:], rtol=1e-12)
    error = np.abs(stored.read - stored.true) / one.wheel_inertia_kg_m2
    assert 0.0 < error.max() < 6.0  # rad/s: noise of 0.5 a wheel, in steps of 0.4


# the loop -------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("loop", ["truth", "aukf", "pf"])
def test_a_trial_has_the_same_bits_in_any_batch(loop):
    observers = {"aukf": {"type": "aukf"}, "pf": {"type": "pf", "particles": 20}}
    lossy = [{"kind": "message-loss", "start_s": 0.05, "end_s": 0.2, "probability": 0.5}]
    described = scenario(ticks=25, observers=observers, loops={loop: {"feedback": loop}}, faults=lossy)
    many, few, one = (flown(described, loop, trials, trials) for trials in (10, 3, 1))
    of_trials = {name: values for name, values in many.channels.items() if not name.startswith("reference/")}
    for name, values in of_trials.items():
        np.testing.assert_array_equal(values[:, :3], few.channels[name], err_msg=name)
        np.testing.assert_array_equal(values[:, :1], one.channels[name], err_msg=name)
    later = flown(described, loop, 2, first=2)
    np.testing.assert_array_equal(later.figures["fkae"], many.figures["fkae"][:, 2:4])
    assert not np.array_equal(many.figures["fkae"][:, 0], many.figures["fkae"][:, 1])


def test_the_law_is_told_what_the_wheels_hold():
    described, k = scenario(ticks=150), 120
    found, graph = flown(described), described.communication()
    state, p, asked = (found.channels[name][k, 0] for name in ("truth/state", "control/acceleration", "applied"))
    said = np.concatenate([found.channels["reference/leader"][None, k, :6], state])[None]
    axes, inertia = NacsParameters().wheel_axes, NacsParameters().wheel_inertia_kg_m2
    stored = inertia * (axes @ found.channels["truth/wheel_speed"][k, 0][..., None])[..., 0]
    law = FormationLaw(described.plant.believed_inertia, limit=0.02)
    np.testing.assert_allclose(law.step(state, said, graph.listening, p, stored=stored), asked, rtol=0, atol=1e-15)
    assert np.abs(law.step(state, said, graph.listening, p) - asked).max() > 1e-4


def test_a_filter_that_is_told_what_the_wheels_hold_knows_the_rates_better(monkeypatch):
    described = scenario(ticks=150, loops={"truth": {"feedback": "truth", "watching": ["aukf"]}})
    told = flown(described).figures["aukf/velocity_squared"][20:].mean()
    monkeypatch.setattr("sim.controllers.drives.TACHOMETER", SENSOR_SETS["bench"].model_copy(update={"wheel_full_scale_rad_s": 1e-9}))
    untold = flown(described).figures["aukf/velocity_squared"][20:].mean()
    assert told < 0.9 * untold


@pytest.mark.parametrize("loop", ["truth", "aukf"])
def test_the_formation_converges_within_its_limits(loop):
    found = flown(scenario(ticks=900, loops={loop: {"feedback": loop}}), loop)
    fkae, skae = found.figures["fkae"][:, 0], found.figures["skae"][:, 0]
    assert fkae[0] > 0.9
    assert fkae[800:].max() < 0.01
    assert skae[800:].max() < 0.01
    torque, speed = found.channels["applied"], found.channels["truth/wheel_speed"]
    assert np.abs(torque).max() == 0.02  # cut off in the beginning, and never beyond
    assert 100.0 < np.abs(speed).max() < NacsParameters().no_load_speed
    tilt = 2.0 * np.degrees(np.arcsin(np.hypot(*np.moveaxis(found.channels["truth/q_BN"], -1, 0)[:2])))
    assert tilt.max() < 25.0


def test_a_failed_wheel_disturbs_its_testbed_most_and_neighbours_hear_of_it():
    quick = [[0.0, 0.0, 0.1]] * 3 + [[0.0, 0.0, -0.1]] * 3
    fails = [{"kind": "wheel-failure", "agents": [3], "wheel": 2, "start_s": 0.3, "end_s": 6.0}]
    healthy, failing = (flown(scenario(ticks=600, faults=faults, start={"mrp": quick})) for faults in ([], fails))
    np.testing.assert_array_equal(healthy.channels["truth/state"][:30], failing.channels["truth/state"][:30])
    change = np.linalg.norm(healthy.channels["truth/state"][..., :3] - failing.channels["truth/state"][..., :3], axis=-1)[:, 0].max(axis=0)
    assert np.argmax(change) == 2
    assert change[2] > 1e-3
    assert change[[1, 3]].min() > 1e-4
    assert np.abs(failing.channels["wheel_torque"][30:, 0, 2, 1]).max() == 0.0
    speed = np.abs(failing.channels["truth/wheel_speed"][40:, 0, 2, 1])
    assert (np.diff(speed[speed > 1.0]) < 0.1).all()  # it coasts


def test_friction_gravity_and_air_raise_the_floor_of_the_law():
    ideal = off(flown(scenario(ticks=1300, plant={"testbed": QUIET, "inertia_scale": [1.0] * 6})))
    real = off(flown(scenario(ticks=1300)))
    assert ideal[1100:].mean() < 0.8 * real[1100:].mean()


def test_more_inertia_is_given_to_every_bus_and_centres_of_mass_are_kept():
    parameters = FormationNacsParameters(testbed=NacsParameters.model_validate(IDEAL))
    heavier = FormationPlant(compile_testbeds(parameters), 2)
    heavier.set_inertias(parameters.inertia + np.diag([0.01, 0.02, 0.02]))
    heavier.advance(np.zeros((2, 24)), np.array([1e-3, 0.0, 0.0]), 1)
    free = parameters.process().inertia + np.diag([0.01, 0.02, 0.02])
    expected = np.linalg.solve(free, np.array([1e-3, 0.0, 0.0])) * 0.01
    np.testing.assert_allclose(heavier.truth().omega_BN_B[1], expected, rtol=0, atol=1e-8)
    hanging = compile_testbeds()
    same, untouched = FormationPlant(hanging, 1), FormationPlant(hanging, 1)
    same.set_inertias(hanging.inertia)
    for plant in (same, untouched):
        plant.advance(np.zeros((1, 24)), np.zeros(3), 50)
    np.testing.assert_allclose(same.truth().omega_BN_B, untouched.truth().omega_BN_B, rtol=0, atol=1e-12)
    assert np.abs(untouched.truth().omega_BN_B).min() > 0.0


def test_balance_masses_go_to_their_set_points():
    parameters = FormationNacsParameters(testbed=NacsParameters.model_validate(IDEAL | {"balance_position_mm": (10.0, -5.0, 2.0)}))
    assembly = compile_testbeds(parameters)
    plant = FormationPlant(assembly, 1)
    for actuator, place in kind_of(parameters).holds(parameters).items():
        plant.hold(actuator, place)
    plant.advance(np.zeros((1, 24)), np.zeros(3), 100)
    where = [int(assembly.model.joint(f"testbed_{n + 1}/balance_{axis}").qposadr[0]) for n in range(6) for axis in "xyz"]
    np.testing.assert_allclose(plant.truth().qpos[0, where], 6 * [0.010, -0.005, 0.002], rtol=0, atol=1e-5)


# files ----------------------------------------------------------------------------------------------------------------------


def test_two_testbeds_or_twelve_fly_by_the_file_alone():
    pair = {"inertia_scale": [1.0, 0.9], "centre_of_mass_um": [[0.0, 0.0, 1.0], [1.0, 0.0, 1.0]]}
    graph = {"links": [[1, 2, 0.5]], "leader": [[1, 0.5]]}
    assert flown(scenario(ticks=5, plant=pair, graph=graph)).channels["truth/wheel_speed"].shape == (5, 1, 2, 4)
    wide = {"links": [[i, i + 1, 0.5] for i in range(1, 12)], "leader": [[1, 0.5]]}
    assert flown(scenario(ticks=3, plant={"repeat": 2}, graph=wide)).channels["truth/state"].shape == (3, 1, 12, 6)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"plant.apart": 1.0}, "plant.apart: unknown key; did you mean apart_m?"),
        ({"plant.testbed.mass": 1.0}, "plant.testbed.mass: unknown key; did you mean mass_kg?"),
        ({"plant.inertia_scale": [1.0, 1.0]}, "inertia_scale is of 2 testbeds, centre_of_mass_um of 6"),
        ({"plant.testbed.inertia_kg_m2": "printed"}, "testbed 1: inertia_kg_m2 = .*no rigid body has it"),
        ({"plant.type": "formation-nac"}, "plant"),
        (
            {"faults": [{"kind": "wheel-failure", "agents": [7], "wheel": 1, "start_s": 1.0, "end_s": 2.0}]},
            "there is no agent 7; there are 6",
        ),
        (
            {"faults": [{"kind": "wheel-failure", "agents": [1], "wheel": 5, "start_s": 1.0, "end_s": 2.0}]},
            "there is no wheel 5; each agent has 4",
        ),
        (
            {"faults": [{"kind": "wheel-failure", "agents": [1], "wheel": 1, "remaining": 2, "start_s": 1.0, "end_s": 2.0}]},
            "faults.0.remaining",
        ),
        ({"faults": [{"kind": "inertia", "add_kg_m2": [1.0, 0.0, 0.0], "start_s": 1.0, "end_s": 2.0}]}, "no rigid body has the inertia of"),
        ({"start.mrp": []}, "start.mrp"),
    ],
)
def test_bad_files_give_one_clear_line(change, complaint):
    with pytest.raises(BadInput, match=complaint) as refused:
        files.load("formation/nacs", change)
    assert "\n" not in str(refused.value)


def test_wheels_fail_only_where_there_are_some():
    data = tomllib.loads((SCENARIOS / "formation" / "link-cut.toml").read_text())
    data["faults"] = [{"kind": "wheel-failure", "agents": [1], "wheel": 1, "start_s": 1.0, "end_s": 2.0}]
    with pytest.raises(ValidationError, match="there is no wheel 1; each agent has 0"):
        FormationScenario.model_validate(data)


def test_every_number_says_where_it_comes_from():
    table = list(FormationNacsParameters().table())
    assert {name for name, *_ in table} >= {"inertia_scale", "centre_of_mass_um", "torque_limit_nm"}
    assert all(provenance.startswith(("chosen", "published", "datasheet")) for *_, provenance in table)


def test_a_run_is_told_drawn_and_recorded(tmp_path):
    loops = TRUTH | AUKF
    fails = [{"kind": "wheel-failure", "agents": [2, 3], "wheel": 4, "remaining": 0.3, "start_s": 0.1, "end_s": 0.4}]
    described = scenario(ticks=60, trials=2, loops=loops, faults=fails, phases={"failing": [0.1, 0.4]})
    block = simulate(described, np.arange(2), np.array([1]))
    metrics, found = block.metrics, block.recordings
    names = {m.metric for m in metrics}
    assert {"skae", "fkae", "settling_time_s", "peak_wheel_speed", "saturated_share"} <= names
    share = next(m for m in metrics if m.metric == "saturated_share" and m.phase == "all")
    assert 0.0 < share.values.min() <= share.values.max() < 1.0
    assert len(tables_of(rows(metrics), described, 2, (), None)) == 2
    write_report(tmp_path / "report.png", "formation/t", described, found)
    write_recording(tmp_path / "recording.rrd", "formation/t", described, found, {"a": 1})
    assert (tmp_path / "report.png").stat().st_size > 50_000
    assert (tmp_path / "recording.rrd").stat().st_size > 100_000
    assert found["truth"].occurrences[0].text == "wheel 4 of 2, 3 at 30 %"
