"""What stands between the parts of a loop: who is told what, which random numbers go where, and settings that must reach what they set."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from control.tracking import Estimate
from models.attitude.quaternion import from_rotation_vector, multiply, to_rotation_vector
from models.dynamics.measurement import WholeState
from models.dynamics.vector_part_measurement import VectorPart
from models.plants.nacs import NacsParameters
from sim import randomness
from sim.estimators.believed import Models
from sim.estimators.observer import Place
from sim.estimators.settings import Aukf, Imm, Pf, WheelMode
from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.parts import Decision
from sim.plant.batch import Truth
from sim.scenario.files import load
from sim.sensors.sensors import SENSOR_SETS
from sim.user_code.user_code import UserCode

RPM = 2.0 * np.pi / 60.0


@dataclass
class Overheard:
    """An estimator or the drives of a loop, and what went in or out."""

    part: Any
    told: list[Any] = field(default_factory=list)
    read: list[np.ndarray] = field(default_factory=list)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.part, name)

    def step(self, belief: Any, known: Any, reading: np.ndarray, dt: float) -> Any:
        self.told.append(known)
        self.read.append(reading)
        return self.part.step(belief, known, reading, dt)

    def give(self, tick: int, decision: Any, estimate: Any, *more: Any) -> Any:
        given = self.part.give(tick, decision, estimate, *more)
        self.told.append((decision, estimate, given))
        return given


# what filters are told ------------------------------------------------------------------------------------------------------------


def test_filters_are_told_what_was_commanded_and_the_wheel_speeds_that_were_read_last() -> None:
    faults = [
        {"kind": "bias", "sensor": "wheels", "size": 7.0, "start_s": 1.0, "duration_s": 1.0},
        {"kind": "drop-out", "sensor": "wheels", "start_s": 2.5, "duration_s": 1.0},
        {"kind": "effectiveness", "wheel": 1, "remaining": 0.3, "start_s": 1.0, "duration_s": 2.0},
    ]
    system = build(load("nacs/fault-free", {"run.ticks": 50, "faults": faults}), np.arange(3))
    spy = Overheard(system.estimators[0])
    channels = run(replace(system, estimators=(spy, *system.estimators[1:]))).channels
    held, read = np.zeros((3, 4)), []
    for reading in channels["reading"][..., 7:]:
        held = np.where(np.isnan(reading), held, reading)
        read.append(held)
    told = np.array(spy.told)  # of ticks 1 and on, what happened since the tick before
    np.testing.assert_array_equal(told[..., :4], channels["command"][:-1])
    np.testing.assert_array_equal(told[..., 4:], read[:-1])
    assert np.abs(channels["applied"] - channels["command"])[12:28, :, 0].min() > 0.0  # which nobody is told
    assert np.abs(told[..., 4:] - channels["truth/state"][:-1, :, 7:])[12:18].min() > 4.0  # nor this
    assert len(np.unique(told[26:34, 0, 4])) == 1


def test_the_filter_of_a_lost_trial_is_told_its_first_reading_again_and_again() -> None:
    """So that it cannot break down; the others are told theirs."""

    class SecondFromTickFive:
        ticks = 0

        def judge(self, *_: object) -> np.ndarray:
            self.ticks += 1
            return np.array([False, self.ticks > 5, False])

    system = build(load("nacs/fault-free", {"run.ticks": 9}), np.arange(3))
    spy = Overheard(system.estimators[0])
    read = run(replace(system, estimators=(spy, *system.estimators[1:]), loss=SecondFromTickFive())).channels["reading"]
    seen = np.array(spy.read)  # of ticks 1 and on
    np.testing.assert_array_equal(seen[4:, 1], np.broadcast_to(read[0, 1], (4, 11)))
    np.testing.assert_array_equal(seen[:4], read[1:5])
    np.testing.assert_array_equal(seen[:, [0, 2]], read[1:, [0, 2]])
    np.testing.assert_array_equal(np.array(spy.told)[4:, 1], 0.0)  # and that its drives rest


# random numbers -------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["nacs/disturbance", "monolithic/fault-free", "formation/nacs-faults", "consensus/fault-free"])
def test_no_two_purposes_share_their_random_numbers(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A stream that is opened twice gives two parts of the loop the same numbers: noise of drives that is noise of readings, say."""
    opened: list[tuple[int, int, int]] = []
    whole = randomness.generator

    def generator(*key: int) -> np.random.Generator:
        opened.append(key)
        return whole(*key)

    monkeypatch.setattr(randomness, "generator", generator)
    monkeypatch.setattr("sim.faults.timeline.generator", generator)
    noisy = {"sensors.dropout_probability": 0.1, "sensors.jitter_s": 0.01, "sensors.quaternion_noise": 1e-4}
    scenario = load(name, noisy if name.startswith(("nacs", "mono")) else {})
    for loop in scenario.loop_names:
        opened.clear()
        build(scenario, np.arange(2), loop=loop)
        assert len(opened) == len(set(opened)), loop
        assert len({stream for *_, stream in opened}) >= (1 if name.startswith("consensus") else 3)


def test_noise_of_drives_air_and_readings_is_independent() -> None:
    scenario = load("nacs/fault-free", {"run.ticks": 2500, "sensors.quaternion_noise": 1e-4, "sensors.jitter_s": 0.01})
    system = build(scenario, np.arange(4))
    noise, drives = system.sensors.noise, system.effectors
    walk = np.diff(noise.gyro_bias, axis=0, prepend=0.0)[1:]
    white = (noise.attitude, noise.gyro, noise.wheel, noise.quaternion, noise.age[..., None], drives.drive_noise)
    columns = np.concatenate([walk, *(part[1:] for part in (*white, drives.disturbance_B))], axis=-1).reshape(4 * 2499, -1)
    correlation = np.abs(np.corrcoef(columns.T)) - np.eye(columns.shape[1])
    correlation[-3:, -3:] = 0.0  # the air alone is not white, so that chance correlates its axes more
    assert correlation.max() < 4.5 / len(columns) ** 0.5  # of 250 pairs


def test_drives_err_by_the_torque_that_is_stated() -> None:
    effectors = build(load("nacs/fault-free", {"run.ticks": 500, "plant.drive_torque_noise_nm": 3e-5}), np.arange(10)).effectors
    asked, nobody = Decision(np.full((10, 3), 1e-3), None, {}), Estimate(np.zeros(4), np.zeros(3), np.zeros(4))
    given = [effectors.give(k, asked, nobody, np.zeros((10, 11)), effectors.rest(), np.zeros(10, bool)).notes for k in range(500)]
    error = np.array([one["applied"] - one["command"] for one in given])
    assert error.std() == pytest.approx(3e-5, rel=0.03)  # 20 000 numbers: six deviations
    assert abs(np.mean(error[1:] * error[:-1])) < 5 * 9e-10 / 20_000**0.5


def test_a_set_point_has_as_many_steps_as_its_bits_say() -> None:
    system = build(load("nacs/fault-free", {"run.ticks": 40, "plant.command_bits": 4, "start.attitude_error_deg": 20.0}), np.arange(3))
    step = 2.0 * system.plant.assembly.wheel_torque_limit / 16
    command = run(system).channels["command"] / step
    np.testing.assert_allclose(command, np.round(command), atol=1e-12)
    assert {-1, 0, 1} <= set(np.round(command).astype(int).ravel().tolist())


# sensors --------------------------------------------------------------------------------------------------------------------------


def test_an_attitude_is_read_in_whole_steps_of_its_rotation_vector() -> None:
    step, scenario = 0.02, load("nacs/fault-free", {"run.ticks": 2, "sensors": {"set": "ideal", "attitude_resolution_rad": 0.02}})
    vectors = np.random.default_rng(3).uniform(-0.5, 0.5, (200, 3))
    sensors = build(scenario, np.arange(200)).sensors
    states = np.concatenate([from_rotation_vector(vectors), np.zeros((200, 7))], axis=-1)
    truth = Truth(0.0, states[:, :4], states[:, 4:7], states[:, 7:], states, states)
    read = to_rotation_vector(sensors.read(0, truth, states[None])[:, :4])
    np.testing.assert_allclose(read / step, np.round(vectors / step), atol=1e-9)


@pytest.mark.parametrize(
    ("name", "variances"),
    [  # rad2, (rad/s)2, (rad/s)2
        ("bench", (4e-4**2, 3e-6 + 3.5e-4**2 / 12, 0.25 + (16000 * RPM / 4096) ** 2 / 12)),
        ("paper", (1.2e-5, 3e-6 + 3.5e-4**2 / 12, 2.42e-3 * (2000 * RPM / 4) ** 2 + 0.40906154**2 / 12)),
        ("vn100", (1.6e-7, 5 * 6.1e-5**2 + 3.5e-4**2 / 12, 0.25 + 0.40906154**2 / 12)),
        ("wmap", (2e-6, 5e-7, 0.0)),
        ("ideal", (0.0, 0.0, 0.0)),
        ("tracker", (4e-8, 3e-6 + 3.5e-4**2 / 12, 0.25 + 0.40906154**2 / 12)),
    ],
)
def test_a_set_of_sensors_has_the_variances_of_its_source(name: str, variances: tuple[float, ...]) -> None:
    np.testing.assert_allclose(SENSOR_SETS[name].variances, variances, rtol=1e-6)


def test_a_reading_in_steps_has_a_twelfth_of_the_steps_square_as_variance() -> None:
    coarse = SENSOR_SETS["ideal"].model_copy(
        update={"attitude_resolution_rad": 1e-2, "gyro_resolution_rad_s": 0.03, "wheel_bits": 4, "wheel_full_scale_rad_s": 8.0}
    )
    np.testing.assert_allclose(coarse.variances, (8.3333333e-6, 7.5e-5, 8.3333333e-2), rtol=1e-6)
    ramp = np.linspace(0.0, 1.0, 100_001)  # a hundred steps
    np.testing.assert_allclose(np.var(1e-2 * np.round(ramp / 1e-2) - ramp), coarse.variances[0], rtol=1e-3)


# filters --------------------------------------------------------------------------------------------------------------------------


def test_a_mode_says_of_its_wheels_what_the_file_says() -> None:
    modes = (
        (),
        (WheelMode(kind="hard-over", wheel=2, torque_nm=1e-3),),
        (WheelMode(kind="float", wheel=4, torque_nm=1e-3), WheelMode(kind="effectiveness", wheel=1, remaining=0.3)),
        (WheelMode(kind="lock", wheel=3),),
    )
    faults = Imm(type="imm", tuning="consistent", filter={"type": "ekf"}, modes=modes).faults(4)
    torques = [[0, 0, 0, 0], [0, 1e-3, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]]
    np.testing.assert_allclose([fault.indicator for fault in faults], [[0, 0, 0, 0], [0, 1, 0, 0], [0.7, 0, 0, 1], [0, 0, 1, 0]])
    np.testing.assert_allclose([fault.torque for fault in faults], torques)


def test_a_wheel_that_runs_away_is_found_by_the_mode_that_says_so() -> None:
    modes = [[], [{"kind": "float", "wheel": 2}], [{"kind": "hard-over", "wheel": 2, "torque_nm": 1e-3}]]
    settings = {
        "run.ticks": 60,
        "observers": {"imm": {"type": "imm", "filter": {"type": "mekf"}, "modes": modes}},
        "control.feedback": "imm",
        "faults": [{"kind": "constant-output", "wheel": 2, "torque_nm": 1e-3, "start_s": 2.0, "duration_s": 4.0}],
    }
    found = run(build(load("nacs/fault-free", settings), np.arange(3))).channels["imm/modes"]
    assert found[5:20, :, 0].min() > 0.9
    assert found[40:, :, 2].min() > 0.9


@pytest.mark.parametrize("kind", [Aukf, Pf])
def test_a_filter_that_is_told_vectors_reads_vectors(kind: Any) -> None:
    place = Place(Models.of(NacsParameters()), SENSOR_SETS["bench"], 4, 0.1)
    for measured, read in (("vector", VectorPart), ("quaternion", WholeState)):
        built = kind(type=kind.model_fields["type"].annotation.__args__[0], tuning="consistent", measured=measured).build(place)
        inner = getattr(built, "unscented", None) or getattr(built, "filter", built)
        assert isinstance(inner.measurement_model, read), measured


GUEST = """
from typing import NamedTuple
import numpy as np
class Belief(NamedTuple):
    mean: np.ndarray
    covariance: np.ndarray
class {name}:
    def __init__(self, setting):
        pass
    def initial(self, measurement):
        return Belief(measurement, np.diag([{variances}]))
    def step(self, belief, command, measurement, dt):
        return Belief(measurement, np.diag([{variances}]))
"""


def test_a_users_covariance_is_of_the_components_or_of_a_rotation_by_its_size(tmp_path: Path) -> None:
    """The estimate is the reading and its covariance constant, so that the NEES is a sum of squares by hand."""
    variances = {"Components": "1e-6, 2e-6, 3e-6, 4e-6", "Rotation": "1e-6, 2e-6, 3e-6"}
    rest = ", 5e-6, 6e-6, 7e-6, 0.1, 0.2, 0.3, 0.4"
    for name, attitude in variances.items():
        (tmp_path / f"{name}.py").write_text(GUEST.format(name=name, variances=attitude + rest))
    guests = UserCode(tuple(f"{tmp_path / name}.py:{name}" for name in variances))
    settings = {"run.ticks": 20, "sensors": {"set": "bench", "attitude_noise_rad": 0.01}}
    channels = run(build(load("nacs/fault-free", settings, guests.names), np.arange(3), guests)).channels
    truth, reading = channels["truth/state"], channels["reading"]
    others = np.sum((truth - reading)[..., 4:] ** 2 / np.array([5e-6, 6e-6, 7e-6, 0.1, 0.2, 0.3, 0.4]), axis=-1)
    turn = to_rotation_vector(multiply(truth[..., :4], reading[..., :4] * [-1, -1, -1, 1]))
    by_turn = np.sum(turn**2 / np.array([1e-6, 2e-6, 3e-6]), axis=-1) + others
    np.testing.assert_allclose(channels["rotation/nees"], by_turn, rtol=1e-6)
    # a small turn moves the quaternion by half of it in the tangent space, in which a covariance of the components is half as wide
    tangent = np.linalg.inv(channels_to_turn(reading[..., :4], np.diag([1e-6, 2e-6, 3e-6, 4e-6])))
    by_components = np.einsum("...i,...ij,...j->...", turn, tangent, turn) + others
    np.testing.assert_allclose(channels["components/nees"], by_components, rtol=1e-6)


def channels_to_turn(q: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Covariance (..., 3, 3) of the small rotation d = 2 vec(dq * q^-1) that goes with one of the components of q."""
    basis = 2.0 * np.stack([multiply(one, q * [-1, -1, -1, 1])[..., :3] for one in np.eye(4)], axis=-1)
    return basis @ covariance @ basis.swapaxes(-1, -2)


# agents that learn ----------------------------------------------------------------------------------------------------------------


def test_a_failed_command_leaves_agents_with_its_constant_force_alone() -> None:
    """force = -W phi - h + constant: with exact knowledge the dynamics cancel, force + (f + d) + h is the constant."""
    scenario = load("consensus/command-fault", {"run.ticks": 30, "faults.0.start_s": 0.1, "faults.0.end_s": 0.2})
    system = build(scenario, np.arange(2), loop="exact")
    spy = Overheard(system.effectors)
    run(replace(system, effectors=spy))
    for tick, (decision, estimate, given) in enumerate(spy.told):
        force = given.notes["force"]
        if 10 <= tick < 20:
            left = force + estimate.unknown + decision.notes["sliding"].robust
            np.testing.assert_allclose(left, -0.0125, atol=1e-12)
            assert np.abs(estimate.unknown).min() > 1e-3
        else:
            np.testing.assert_array_equal(force, decision.effort)


def test_settings_of_a_learner_reach_its_filter() -> None:
    changes = {"loops.mupf-b.threshold": 0.0, "loops.mupf-b.particles": 33, "loops.mupf-b.resampling": "systematic", "run.ticks": 6}
    told = {"tuning.state_std": 2e-3, "tuning.reading_std": 3e-4, "tuning.weight_std": 0.05, "tuning.first_weight_std": 0.7}
    scenario = load("consensus/fault-free", changes | told)
    filter_ = build(scenario, np.arange(1), loop="mupf-b").estimators[0].filter
    assert (filter_.threshold, filter_.particles, filter_.resampling.__name__) == (0.0, 33, "systematic")
    np.testing.assert_allclose(filter_.motion_noise, 4e-6 * np.eye(4))
    np.testing.assert_allclose(filter_.measurement_noise, 9e-8 * np.eye(4))
    np.testing.assert_allclose(filter_.parameter_noise, 2.5e-3)
    np.testing.assert_allclose(filter_.parameter_variance, 0.49)
