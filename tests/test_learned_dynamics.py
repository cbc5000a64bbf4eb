"""A filter that learns the testbed's unmodelled torque: the torque itself, the model, the filter, and the loops that use it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2

from control.disturbance_compensation import DisturbanceCompensation
from control.proportional_derivative import ProportionalDerivative
from control.tracking import Estimate, Target
from estimation.fading import StrongTracking
from estimation.joint_unscented import JointUnscentedFilter
from estimation.state_space import Multiplicative
from estimation.unscented import UnscentedFilter
from models.attitude import quaternion
from models.dynamics.learned_torque import BodyWithLearnedTorque, TorqueBasis
from models.dynamics.rigid_body import RigidBody
from models.dynamics.unmodelled_torque import UnmodelledTorque, vertical
from models.plants.nacs import NacsParameters, compile_nacs
from sim.bad_input import BadInput
from sim.campaign.blocks import simulate
from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.loop.recording import Recording
from sim.metrics.one_body import evaluate
from sim.plant.batch import Plant
from sim.scenario.files import load
from sim.scenario.one_body import Scenario
from sim.series.learned import learned_curves, learners
from sim.series.loops import flights

Array = NDArray[np.floating]

ROUGH = NacsParameters(centre_of_mass_um=(40.0, -30.0, 150.0), wheel_coulomb_nm=1e-4, wheel_viscous_nms=4e-7, bearing_viscous_nms=2e-4)
NAME = "nacs/learned-dynamics"
DT = 0.1
PROCESS, READING = np.repeat([[2e-5, 1e-4], [4e-4, 1.7e-3]], 3, axis=-1)  # deviations of rotations, rad, and rates, rad/s


def body(parameters: NacsParameters = ROUGH) -> RigidBody:
    axes = parameters.wheel_axes
    return RigidBody(parameters.inertia, -axes, parameters.wheel_inertia_kg_m2 * axes)


def unmodelled(parameters: NacsParameters = ROUGH) -> UnmodelledTorque:
    return UnmodelledTorque(
        weight=np.array(parameters.mass_kg * parameters.gravity_m_s2),
        centre_of_mass=parameters.centre_of_mass,
        wheel_axes=parameters.wheel_axes,
        wheel_coulomb=np.array(parameters.wheel_coulomb_nm),
        wheel_viscous=np.array(parameters.wheel_viscous_nms),
        bearing_viscous=np.array(parameters.bearing_viscous_nms),
    )


def motions(rng: np.random.Generator, *lead: int) -> Array:
    """Attitudes tilted by some degrees at any heading, and slow rates."""
    tilt = quaternion.from_rotation_vector(np.concatenate([0.1 * rng.standard_normal((*lead, 2)), np.zeros((*lead, 1))], axis=-1))
    heading = quaternion.from_rotation_vector(np.concatenate([np.zeros((*lead, 2)), rng.uniform(-3.0, 3.0, (*lead, 1))], axis=-1))
    return np.concatenate([quaternion.multiply(tilt, heading), 0.05 * rng.standard_normal((*lead, 3))], axis=-1)


def test_the_vertical_is_a_column_of_the_attitude_matrix() -> None:
    attitude = quaternion.normalize(np.random.default_rng(3).standard_normal((20, 4)))
    np.testing.assert_allclose(vertical(attitude), quaternion.attitude_matrix(attitude)[..., 2], atol=1e-15)


def test_the_unmodelled_torque_is_what_mujoco_applies() -> None:
    parameters = ROUGH.model_copy(update={"step_s": 1e-3})
    assembly, rng, trials = compile_nacs(parameters), np.random.default_rng(5), 6
    plant, motion = Plant(assembly, trials), motions(rng, trials)
    plant.start(motion[:, :4], motion[:, 4:], rng.uniform(50.0, 200.0, (trials, 4)) * rng.choice([-1.0, 1.0], (trials, 4)))
    tau = 2e-4 * rng.standard_normal((trials, 4))
    plant.advance(tau, np.zeros((trials, 3)), 300)  # the balance masses settle on their rails
    before = plant.truth().state
    plant.advance(tau, np.zeros((trials, 3)), 1)
    now = plant.truth().state
    plant.advance(tau, np.zeros((trials, 3)), 1)
    bend = (plant.truth().state[:, 4:7] - before[:, 4:7]) / (2.0 * parameters.step_s)
    axes, spin = parameters.wheel_axes, parameters.wheel_inertia_kg_m2
    momentum = now[:, 4:7] @ parameters.inertia + spin * now[:, 7:] @ axes.T
    found = bend @ (parameters.inertia - spin * axes @ axes.T) + np.cross(now[:, 4:7], momentum) + tau @ axes.T
    expected = unmodelled(parameters).at(now)
    assert np.abs(expected).max(axis=0).min() > 2e-4
    np.testing.assert_allclose(found, expected, atol=4e-6)
    for part in ("weight", "wheel_coulomb", "wheel_viscous", "bearing_viscous"):  # each of them would be missed
        without = UnmodelledTorque(**{**vars(unmodelled(parameters)), part: np.array(0.0)}).at(now)
        assert np.abs(found - without).max() > 8e-6, part


def test_the_model_is_the_rigid_body_and_the_torque_of_its_network() -> None:
    rng = np.random.default_rng(7)
    known, basis = body(), TorqueBasis(("tilt", "rate", "wheels"))
    model = BodyWithLearnedTorque(known, basis)
    motion, weights = motions(rng, 3, 5), 1e-4 * rng.standard_normal((3, 5, model.parameters))
    command = np.concatenate([1e-3 * rng.standard_normal((3, 5, 4)), rng.uniform(-400.0, 400.0, (3, 5, 4))], axis=-1)
    assert (basis.terms, model.parameters) == (28, 84)
    inputs = np.concatenate(
        [vertical(motion[..., :4])[..., :2] / np.sin(0.2), motion[..., 4:] / 0.1, command[..., 4:] / 500.0], axis=-1
    ).clip(-1.0, 1.0)
    phi = np.concatenate([np.ones((3, 5, 1)), *(np.cos(k * np.arccos(inputs)) for k in (1, 2, 3))], axis=-1)
    order = [0, *(1 + 9 * k + i for i in range(9) for k in range(3))]  # all polynomials of an input together
    torque = (weights.reshape(3, 5, 3, 28) @ phi[..., order, None])[..., 0]
    np.testing.assert_allclose(model.torque(motion, weights, command[..., 4:]), torque, atol=1e-15)
    added = model.derivative(motion, weights, command) - known.derivative(motion, command)
    np.testing.assert_allclose(added[..., 4:] @ known.inertia, torque, atol=1e-15)
    np.testing.assert_array_equal(added[..., :4], 0.0)


def test_the_sensitivity_is_the_change_of_the_motion_with_the_weights() -> None:
    rng = np.random.default_rng(8)
    model = BodyWithLearnedTorque(body(), TorqueBasis(("tilt", "wheels")))
    motion, command = motions(rng, 4), np.concatenate([np.zeros((4, 4)), rng.uniform(-400.0, 400.0, (4, 4))], axis=-1)
    middle = model.move(motion, np.zeros(model.parameters), command, 0.5 * DT)
    slope = model.sensitivity(middle, command, DT)
    moved = [
        model.move(np.repeat(motion[:, None], model.parameters, axis=1), step * np.eye(model.parameters), command[:, None], DT)
        for step in (1e-4, -1e-4)
    ]
    found = np.swapaxes(Multiplicative().difference(*moved), -1, -2) / 2e-4
    np.testing.assert_allclose(slope[:, 3:], found[:, 3:], atol=0.003 * np.abs(slope[:, 3:]).max())
    # a turn counts what acts early for more: phi at a third of the step, not at half
    np.testing.assert_allclose(slope[:, :3], found[:, :3], atol=0.03 * np.abs(slope[:, :3]).max())


def joint(basis: TorqueBasis | None, walk: float = 1e-6, first: float = 1e-3, **how: Any) -> JointUnscentedFilter:
    model = BodyWithLearnedTorque(body(), basis)
    return JointUnscentedFilter(
        process=model,
        process_noise=np.diag(PROCESS**2),
        parameter_noise=np.full(model.parameters, walk**2),
        measurement_noise=np.diag(READING**2),
        prior=np.concatenate([quaternion.IDENTITY, np.zeros(3)]),
        prior_variance=np.ones(6),
        parameter_variance=np.full(model.parameters, first**2),
        **how,
    )


def flight(ticks: int, trials: int, torque: Array, seed: int) -> tuple[Array, Array]:
    """Readings (ticks, trials, 7) of bodies under a constant torque in B, and commands: wheels at known speeds that do nothing."""
    rng, known = np.random.default_rng(seed), body()
    state = motions(rng, trials)
    command = np.concatenate([np.zeros((trials, 4)), rng.uniform(-300.0, 300.0, (trials, 4))], axis=-1)
    model, readings = BodyWithLearnedTorque(known, TorqueBasis(())), []
    for _ in range(ticks):
        readings.append(Multiplicative().displace(state, READING * rng.standard_normal((trials, 6))))
        state = model.move(state, np.broadcast_to(torque, (trials, 3)), command, DT)
        state = Multiplicative().displace(state, PROCESS * rng.standard_normal((trials, 6)))
    return np.stack(readings), command


def test_a_known_constant_is_learned_and_its_deviation_is_honest() -> None:
    torque = np.array([4e-4, -2e-4, 1e-4])
    learner, trials = joint(TorqueBasis(()), walk=1e-9), 200
    readings, command = flight(100, trials, torque, 11)
    belief = learner.initial(readings[0])
    for reading in readings[1:]:
        belief = learner.step(belief, command, reading, DT)
    error = belief.mean[:, 7:] - torque
    assert np.abs(error).max() < 1e-4
    normalized = np.einsum("ki,kij,kj->k", error, np.linalg.inv(belief.covariance[:, 6:, 6:]), error)
    low, high = chi2.ppf([0.0005, 0.9995], 3 * trials) / trials
    assert low < normalized.mean() < high
    assert np.all(belief.lost == 0.0)


@pytest.mark.parametrize("inputs", [(), ("tilt", "wheels")])
def test_it_is_the_unscented_filter_of_the_joint_state(inputs: Any) -> None:
    learner = joint(TorqueBasis(inputs), first=1e-4, alpha=0.5)
    model = learner.process
    assert isinstance(model, BodyWithLearnedTorque)
    whole = UnscentedFilter(
        process=model,  # type: ignore[arg-type]
        process_noise=np.diag([*np.diag(learner.process_noise), *learner.parameter_noise]),
        measurement_noise=np.diag([*np.diag(learner.measurement_noise), *np.ones(model.parameters)]),
        prior=np.concatenate([learner.prior, np.zeros(model.parameters)]),
        prior_variance=np.concatenate([learner.prior_variance, learner.parameter_variance]),
        space=Multiplicative(),
        alpha=0.5 * np.sqrt(6.0 / (6.0 + model.parameters)),  # points as far out
        integrate=lambda _, x, u, dt: np.concatenate([model.move(x[..., :7], x[..., 7:], u, dt), x[..., 7:]], axis=-1),
    )
    readings, command = flight(40, 2, np.array([4e-4, -2e-4, 1e-4]), 12)
    readings[20, 0, :4], readings[25, 1, 4:], readings[30] = np.nan, np.nan, np.nan
    padded = np.concatenate([readings, np.full((*readings.shape[:-1], model.parameters), np.nan)], axis=-1)
    mine, theirs = learner.initial(readings[0]), whole.initial(padded[0])
    for reading, wide in zip(readings[1:], padded[1:], strict=True):
        mine, theirs = learner.step(mine, command, reading, DT), whole.step(theirs, command, wide, DT)
        np.testing.assert_allclose(mine.nis, theirs.nis, rtol=0.02, atol=0.02)
    deviation = np.sqrt(np.diagonal(theirs.covariance, axis1=-2, axis2=-1))
    apart = Multiplicative().difference(mine.mean, theirs.mean)
    assert np.abs(apart / deviation).max() < 0.02
    np.testing.assert_allclose(np.sqrt(np.diagonal(mine.covariance, axis1=-2, axis2=-1)), deviation, rtol=0.01)


@pytest.mark.parametrize("basis", [None, TorqueBasis(()), TorqueBasis()])
def test_a_trial_is_the_same_bits_in_any_batch(basis: TorqueBasis | None) -> None:
    learner = joint(basis, fading=StrongTracking())
    readings, command = flight(6, 64, np.array([4e-4, -2e-4, 1e-4]), 13)
    readings[3, 0, :4] = np.nan

    def fly(trials: int) -> list[Array]:
        belief = learner.initial(readings[0, :trials])
        for reading in readings[1:, :trials]:
            belief = learner.step(belief, command[:trials], reading, DT)
        return [belief.mean[0], belief.covariance[0], belief.nis[0]]

    alone = fly(1)
    for trials in (3, 10, 64):
        for one, other in zip(alone, fly(trials), strict=True):
            np.testing.assert_array_equal(one, other, err_msg=f"{trials}")


def test_forgetting_leaves_no_weight_less_known_than_at_first() -> None:
    learner = joint(TorqueBasis(), fading=StrongTracking())
    readings, command = flight(200, 3, np.array([4e-4, -2e-4, 1e-4]), 14)
    readings[50::20] += 0.02  # surprises, which fade everything
    belief = learner.initial(readings[0])
    for reading in readings[1:]:
        belief = learner.step(belief, command, reading, DT)
    variance = np.diagonal(belief.covariance, axis1=-2, axis2=-1)[:, 6:]
    assert np.all(belief.memory.elapsed > 19.0)
    assert np.all((variance > 0.0) & (variance <= learner.parameter_variance * (1.0 + 1e-9)))
    assert np.linalg.eigvalsh(belief.covariance).min() > -1e-12


CALM = {
    "plant.air_torque_nm": 0.0,
    "plant.drive_torque_noise_nm": 0.0,
    "plant.wheel_coulomb_nm": 0.0,
    "plant.wheel_viscous_nms": 0.0,
    "plant.bearing_viscous_nms": 0.0,
    "run.seed": 4242,
}


def single(loop: str, ticks: int, **overrides: Any) -> Scenario:
    return load(NAME, {"run.ticks": ticks} | overrides).singles()[loop]


def fly(scenario: Scenario, trials: int = 3) -> Recording:
    return run(build(scenario, np.arange(trials)))


@pytest.mark.parametrize(("offset", "loop", "most"), [((4.0, -3.0, 0.0), "constant", 0.25), ((0.0, 0.0, 150.0), "learned", 0.12)])
def test_the_torque_of_gravity_is_learned(offset: tuple[float, float, float], loop: str, most: float) -> None:
    recording = fly(single(loop, 300, **CALM | {"plant.centre_of_mass_um": list(offset)}))
    observer = recording.observers[0]
    late = slice(150, None)
    truth, learned = recording.channels["truth/unmodelled"][late], recording.channels[f"{observer}/learned"][late]
    assert np.sqrt(np.mean((learned - truth) ** 2)) < most * np.sqrt(np.mean(truth**2))


def test_the_learned_term_makes_the_loop_track_better() -> None:
    shard = simulate(load(NAME, {"run.ticks": 300, "run.seed": 515}), np.arange(4), np.zeros(0, dtype=np.int64))
    found = {(m.subject, m.metric, m.phase): m.values for m in shard.metrics}
    late = {loop: found[loop, "tracking_error_deg", "0-30"] for loop in ("plain", "constant", "learned-estimate", "learned", "exact")}
    assert np.mean(late["learned"] / late["plain"]) < 0.6
    assert np.all(late["learned"] < 0.75 * late["plain"])
    assert np.all(late["learned"] < 0.9 * late["learned-estimate"])
    assert np.all(late["exact"] < late["learned"])
    assert found["plain", "nis_mean", "0-30"].min() > 20.0
    assert np.all(np.abs(found["learned", "nis_mean", "0-30"] - 6.0) < 1.0)
    np.testing.assert_array_equal(found["plain", "learned_torque_relative", "0-30"], 1.0)
    assert np.all(found["learned", "learned_torque_relative", "0-30"] < 0.25)


def test_a_trial_of_the_loop_is_the_same_in_any_batch() -> None:
    scenario = single("learned", 12)
    alone, among = (run(build(scenario, trials)) for trials in (np.array([2]), np.arange(4)))
    assert alone.channels["network/learned"].any()
    for channel, values in alone.channels.items():
        if not channel.startswith("reference/"):
            np.testing.assert_array_equal(among.channels[channel][:, 2:3], values, err_msg=channel)


def test_metrics_are_what_they_say() -> None:
    scenario = single("learned", 60, phases={"late": [3.0, 6.0]})
    system = build(scenario, np.arange(2))
    recording = run(system)
    found = {
        (m.metric, m.phase): m.values for m in evaluate(recording, system.plant.assembly, "learned", scenario) if m.subject == "learned"
    }
    truth, learned = recording.channels["truth/unmodelled"][30:], recording.channels["network/learned"][30:]
    np.testing.assert_allclose(found["learned_torque_error", "late"], np.sqrt(np.mean((learned - truth) ** 2, axis=(0, 2))))
    np.testing.assert_allclose(found["unmodelled_torque", "late"], np.sqrt(np.mean(truth**2, axis=(0, 2))))
    low, high = chi2.ppf([0.025, 0.975], 6)
    nis = recording.channels["network/nis"][1:]
    np.testing.assert_allclose(found["nis_inside_share", "all"], np.mean((nis > low) & (nis < high), axis=0))


def test_curves_show_what_was_learned_and_what_was_applied() -> None:
    scenario = load(NAME, {"run.ticks": 40})
    recordings = simulate(scenario, np.arange(2), np.arange(2)).recordings
    several = flights(scenario, recordings, position=1)
    assert [flight.name for flight in learners(several)] == ["constant", "linear", "learned-estimate", "learned"]
    found = {curve.path: curve for curve in learned_curves(several)}
    assert set(found) == {"learned/torque_x", "learned/torque_y", "learned/torque_z", "learned/error"}
    channels, about_y = recordings["learned"].channels, found["learned/torque_y"]
    assert about_y.names[-2:] == ("learned [mN m]", "applied in learned [mN m]")
    np.testing.assert_allclose(about_y.values[:, -1], 1e3 * channels["truth/unmodelled"][:, 1, 1])
    np.testing.assert_allclose(about_y.values[:, -2], 1e3 * channels["network/learned"][:, 1, 1])


def test_compensation_subtracts_and_needs_something_to_subtract() -> None:
    law = ProportionalDerivative(0.4, 0.075)
    still = Estimate(quaternion.IDENTITY, np.zeros(3), np.zeros(4))
    target = Target(quaternion.IDENTITY, np.zeros(3), np.zeros(3))
    torque = np.array([1e-4, 0.0, -2e-4])
    np.testing.assert_array_equal(DisturbanceCompensation(law).step(still._replace(learned_torque_B=torque), target), -torque)
    with pytest.raises(ValueError, match="learned torque"):
        DisturbanceCompensation(law).step(still, target)


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ({"observers.network.inputs": []}, r"observers\.network.*inputs = \[\]: a network needs"),
        ({"observers.network.inputs": ["tilt", "tilt"]}, "each once"),
        ({"observers.network.inputs": ["sun"]}, "observers.network"),
        ({"observers.network.order": 0}, "observers.network"),
        ({"observers.network": {"type": "ekf"}}, r"loops\.learned\.control\.compensate_learned: 'network' learns no torque"),
        ({"plant": {"type": "freeflyer"}}, r"observers\.plain: .* needs plant\.type = 'nacs'"),
        ({"faults": [{"kind": "lock", "wheel": 1, "start_s": 1.0, "duration_s": 1.0}]}, r"faults\.0 \(lock\): changes the torque"),
        ({"observers.plain.tuning": {"process_noise": [1, 1, 1], "measurement_noise": [1e-20, 1, 1]}}, "singular"),
    ],
)
def test_bad_input_is_one_clear_line(overrides: dict[str, Any], message: str) -> None:
    with pytest.raises(BadInput, match=message) as bad:
        load(NAME, overrides)
    assert "\n" not in str(bad.value)
