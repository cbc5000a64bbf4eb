"""Parts of the loop, one by one: references, draws, random streams, sensors, and what each fault does to a short closed loop."""

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from control.tracking import Estimate, Target
from models.attitude.quaternion import error, from_rotation_vector, inverse, multiply, to_rotation_vector
from sim import randomness
from sim.draws import Draw, Number
from sim.faults.effects import ACTIVE
from sim.faults.timeline import Timeline
from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.loop.recording import Recording
from sim.plant.batch import Truth, diagnose
from sim.randomness import Stream
from sim.scenario.files import load
from sim.scenario.references import Hold, Sinusoid
from sim.sensors.sensors import SENSOR_SETS, SensorArrays, Sensors, SensorSettings, draw_noise

# references --------------------------------------------------------------------------------------------------------------------

REFERENCES = [
    Sinusoid(type="sinusoid", amplitude_deg=(4.0, 6.0, 7.0), period_s=(40.0, 50.0, 30.0)),
    Sinusoid(type="sinusoid", amplitude_deg=(50.0, 40.0, 60.0), period_s=(7.0, 11.0, 5.0), phase_deg=(10.0, -40.0, 200.0)),
    Hold(type="hold", rotation_vector_deg=(20.0, -30.0, 100.0)),
]


@pytest.mark.parametrize("reference", REFERENCES)
def test_a_references_rates_and_accelerations_are_its_derivatives(reference):
    time, h = np.linspace(0.0, 60.0, 601), 1e-4
    now, ahead, behind = (reference.at(time + t) for t in (0.0, h, -h))
    np.testing.assert_allclose(np.linalg.norm(now.q_DN, axis=-1), 1.0, rtol=1e-14)
    rate = to_rotation_vector(multiply(ahead.q_DN, inverse(behind.q_DN))) / (2 * h)
    np.testing.assert_allclose(now.omega_DN_D, rate, atol=1e-7)  # h^2 of the third derivative; rounding / h is 1e-12
    np.testing.assert_allclose(now.alpha_DN_D, (ahead.omega_DN_D - behind.omega_DN_D) / (2 * h), atol=1e-6)


def test_a_sinusoid_reaches_its_amplitude_and_repeats_after_its_period():
    reference = Sinusoid(type="sinusoid", amplitude_deg=(30.0, 0.0, 0.0), period_s=(8.0, 1.0, 1.0))
    np.testing.assert_allclose(reference.at(np.array(2.0)).q_DN, from_rotation_vector(np.radians([30.0, 0.0, 0.0])), atol=1e-15)
    np.testing.assert_allclose(reference.at(np.array(9.3)).q_DN, reference.at(np.array(1.3)).q_DN, atol=1e-14)


@pytest.mark.parametrize("reference", REFERENCES)
def test_a_reference_answers_for_one_instant_as_for_many(reference):
    time = np.linspace(0.0, 10.0, 6)
    for many, one in zip(reference.at(time), reference.at(time[4]), strict=True):
        np.testing.assert_array_equal(many[4], one)


# draws -------------------------------------------------------------------------------------------------------------------------

DRAWS = {  # draw: (mean, standard deviation)
    "constant": (Draw(constant=3.0), 3.0, 0.0),
    "uniform": (Draw(uniform=(-1.0, 5.0)), 2.0, 6 / 12**0.5),
    "normal": (Draw(normal=(1.0, 0.3)), 1.0, 0.3),
    "log_uniform": (Draw(log_uniform=(0.01, 1.0)), 0.99 / np.log(100), (0.9999 / 2 / np.log(100) - (0.99 / np.log(100)) ** 2) ** 0.5),
    "choice": (Draw(choice=(1.0, 2.0, 6.0)), 3.0, (14 / 3) ** 0.5),
}
every_draw = pytest.mark.parametrize(("draw", "mean", "deviation"), DRAWS.values(), ids=DRAWS.keys())


@every_draw
def test_a_draw_stays_within_its_bounds_and_has_its_moments(draw, mean, deviation):
    rng, count = np.random.default_rng(1), 20_000
    sample = np.array([draw.sample(rng) for _ in range(count)])
    low, high = draw.bounds()
    assert low <= sample.min()
    assert sample.max() <= high
    assert sample.mean() == pytest.approx(mean, abs=5 * deviation / count**0.5)
    assert sample.std() == pytest.approx(deviation, rel=0.03)  # five deviations of it and more


@every_draw
def test_every_kind_of_draw_takes_the_same_share_of_the_stream(draw, mean, deviation):
    used, untouched = np.random.default_rng(1), np.random.default_rng(1)
    draw.sample(used)
    untouched.random()
    assert used.random() == untouched.random()


@every_draw
def test_a_greater_share_is_a_greater_value(draw, mean, deviation):
    values = [draw.quantile(share) for share in np.linspace(0.0, 0.999, 50)]
    assert (np.diff(values) >= 0.0).all()
    assert deviation == 0.0 or values[-1] > values[0]


def test_quantiles_and_bounds_by_hand():
    normal = Draw(normal=(1.0, 0.3))
    assert normal.bounds() == pytest.approx((-0.5, 2.5))  # five deviations
    assert normal.quantile(0.841344746) == pytest.approx(1.3, rel=1e-6)  # one
    assert Draw(uniform=(-1.0, 5.0)).quantile(0.25) == 0.5
    assert Draw(log_uniform=(0.01, 1.0)).quantile(0.5) == pytest.approx(0.1)
    assert Draw(choice=(1.0, 2.0, 6.0)).bounds() == (1.0, 6.0)


def test_every_choice_is_drawn_equally_often():
    rng = np.random.default_rng(1)
    sample = [Draw(choice=(1.0, 2.0, 6.0)).sample(rng) for _ in range(9000)]
    np.testing.assert_allclose([sample.count(value) for value in (1.0, 2.0, 6.0)], 3000, atol=5 * 2000**0.5)


def test_a_plain_number_is_a_constant_draw():
    assert TypeAdapter(Number).validate_python(2).sample(np.random.default_rng(0)) == 2.0


@pytest.mark.parametrize(
    "wrong",
    [
        *({}, {"uniform": [2, 1]}, {"uniform": [2, 2]}, {"log_uniform": [0, 1]}, {"log_uniform": [2, 2]}, {"normal": [0, -1]}),
        *({"choice": []}, {"constant": 1, "uniform": [0, 1]}, {"gamma": [1, 2]}, True, "fast"),
    ],
)
def test_what_is_no_draw_is_refused(wrong):
    with pytest.raises(ValidationError):
        TypeAdapter(Number).validate_python(wrong)


# random streams ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("draw", [randomness.normals, randomness.uniforms])
def test_a_trial_gets_the_same_numbers_in_any_batch(draw):
    everyone = draw(7, np.arange(10), Stream.GYRO, 50, 3)
    np.testing.assert_array_equal(draw(7, np.array([3]), Stream.GYRO, 50, 3)[:, 0], everyone[:, 3])
    np.testing.assert_array_equal(draw(7, np.array([9, 0, 3]), Stream.GYRO, 50, 3), everyone[:, [9, 0, 3]])


@pytest.mark.parametrize("draw", [randomness.normals, randomness.uniforms])
def test_a_longer_run_begins_like_a_shorter_one(draw):
    np.testing.assert_array_equal(draw(7, np.arange(3), Stream.AIR, 50, 3), draw(7, np.arange(3), Stream.AIR, 500, 3)[:50])


def test_seeds_trials_and_streams_share_no_numbers():
    keys = [(seed, trial, stream) for seed in (1, 2) for trial in (0, 1) for stream in (*Stream, Stream.FAULT + 1)]
    numbers = np.concatenate([randomness.generator(*key).random(1000) for key in keys])
    assert len(np.unique(numbers)) == len(numbers)


def test_gauss_markov_noise_is_stationary_with_its_deviation_and_correlation_time():
    dt, tau, std, trials = 0.1, 0.5, 2.0, 20_000
    noise = randomness.gauss_markov(np.random.default_rng(3).standard_normal((60, trials)), np.array(std), np.array(tau), dt)
    np.testing.assert_allclose(noise.std(axis=1), std, rtol=0.03)  # six deviations, from the first tick on
    lags = np.arange(1, 11)
    correlation = [np.mean(noise[20] * noise[20 + lag]) / std**2 for lag in lags]
    np.testing.assert_allclose(correlation, np.exp(-lags * dt / tau), atol=6 / trials**0.5)


# sensors -----------------------------------------------------------------------------------------------------------------------

IDEAL = SENSOR_SETS["ideal"]
WHEELS, TICK = 4, 0.1


def moving(ticks: int, trials: int) -> np.ndarray:
    """States (ticks, trials, 11) of bodies that turn at a constant rate, each at its own."""
    time, spin = TICK * np.arange(ticks)[:, None, None], 0.1 + 0.01 * np.arange(trials)[:, None] * np.array([1.0, -1.0, 0.5])
    wheels = 10.0 * time + np.arange(trials)[:, None] + np.array([1.0, 2.0, 3.0, 4.0])
    return np.concatenate([from_rotation_vector(time * spin), np.broadcast_to(spin, (ticks, trials, 3)), wheels], axis=-1)


def readings(settings: SensorSettings, states: np.ndarray, seed: int = 1) -> np.ndarray:
    """What the sensors say of states (ticks, trials, 11)."""
    ticks, trials = states.shape[:2]
    everyone = SensorArrays.of([settings] * trials)
    noise = draw_noise(everyone, seed, np.arange(trials), ticks, WHEELS, TICK)
    sensors = Sensors(everyone, noise, Timeline(TICK), TICK)
    past, out = np.full_like(states, np.nan), np.empty_like(states)
    for k, state in enumerate(states):
        past[k] = state  # what is yet to come is not known
        out[k] = sensors.read(k, Truth(k * TICK, state[:, :4], state[:, 4:7], state[:, 7:], state, state), past)
    return out


def differing(**changes) -> SensorSettings:
    """Ideal sensors but for some settings."""
    return SensorSettings(**(IDEAL.model_dump() | changes))


def test_ideal_sensors_read_the_truth():
    states = moving(20, 3)
    np.testing.assert_array_equal(readings(IDEAL, states), states)


def test_each_sensors_noise_has_the_deviation_that_is_stated():
    settings, states = SensorSettings(gyro_bias_rad_s=0, gyro_bias_walk_rad_s_sqrt_s=0), moving(200, 100)
    got = readings(settings, states)
    turn, rate = error(got[..., :4], states[..., :4]), got[..., 4:7] - states[..., 4:7]
    wheel = got[..., 7:] - states[..., 7:]
    deviations = np.sqrt(settings.variances)
    for noise, deviation in zip((turn, rate, wheel), deviations, strict=True):
        np.testing.assert_allclose(noise.std(axis=(0, 1)), deviation, rtol=0.03)  # 20 000 readings: six deviations
        np.testing.assert_allclose(noise.mean(axis=(0, 1)), 0.0, atol=5 * deviation / 20_000**0.5)
    np.testing.assert_allclose(deviations[0], 4e-4)


def test_the_noise_of_the_attitude_is_a_small_rotation_and_keeps_unit_length():
    got = readings(differing(attitude_noise_rad=0.3), moving(50, 20))
    np.testing.assert_allclose(np.linalg.norm(got[..., :4], axis=-1), 1.0, rtol=1e-14)


def test_the_gyros_bias_starts_and_walks_as_stated():
    settings = differing(gyro_bias_rad_s=1e-3, gyro_bias_walk_rad_s_sqrt_s=2e-3)
    bias = draw_noise(SensorArrays.of([settings] * 2000), 1, np.arange(2000), 41, WHEELS, TICK).gyro_bias
    np.testing.assert_allclose(bias[0].std(), 1e-3, rtol=0.05)  # five deviations
    np.testing.assert_allclose(bias[40].std(), np.hypot(1e-3, 2e-3 * 4.0**0.5), rtol=0.05)
    states = moving(41, 2)
    np.testing.assert_allclose(readings(settings, states)[..., 4:7] - states[..., 4:7], bias[:, :2], atol=1e-15)


@pytest.mark.parametrize(("settings", "part", "step"), [
    (differing(gyro_resolution_rad_s=0.01), slice(4, 7), 0.01),
    (differing(wheel_bits=12), slice(7, 11), 2 * 8000 * 2 * np.pi / 60 / 4096),
])  # fmt: skip
def test_a_reading_is_the_nearest_whole_number_of_steps(settings, part, step):
    states = moving(50, 5)
    got = readings(settings, states)[..., part]
    np.testing.assert_allclose(got / step, np.round(got / step), atol=1e-9)
    assert np.abs(got - states[..., part]).max() <= step / 2 * (1 + 1e-9)
    assert len(np.unique(got)) > 3


def test_readings_end_at_the_sensors_range():
    states = moving(10, 3)
    states[..., 4:7] *= 1e3
    states[..., 7:] *= -1e3
    got = readings(IDEAL, states)
    np.testing.assert_array_equal(got[..., 4:7], np.clip(states[..., 4:7], -34.9, 34.9))
    np.testing.assert_array_equal(got[1:, :, 7:], -IDEAL.wheel_full_scale_rad_s)


def test_a_sensor_that_one_trial_lacks_or_reads_seldom_is_read_in_the_others():
    blind, seldom = differing(gyro=False), differing(wheel_period_s=0.3)
    everyone, states = SensorArrays.of([IDEAL, blind, seldom]), moving(7, 3)
    sensors = Sensors(everyone, draw_noise(everyone, 1, np.arange(3), 7, WHEELS, TICK), Timeline(TICK), TICK)
    expected = states.copy()
    expected[:, 1, 4:7] = np.nan
    expected[[1, 2, 4, 5], 2, 7:] = np.nan
    for k, state in enumerate(states):
        read = sensors.read(k, Truth(k * TICK, state[:, :4], state[:, 4:7], state[:, 7:], state, state), states[: k + 1])
        np.testing.assert_array_equal(read, expected[k])
        np.testing.assert_array_equal(sensors.due(k)["due"], ~np.isnan(expected[k]))
    ideal = SensorArrays.of([IDEAL])
    assert Sensors(ideal, draw_noise(ideal, 1, np.arange(1), 7, WHEELS, TICK), Timeline(TICK), TICK).due(3) == {}


def test_a_late_reading_describes_the_past():
    states = moving(30, 3)
    np.testing.assert_allclose(readings(differing(latency_s=0.3), states)[3:], states[:-3], atol=1e-14)
    np.testing.assert_allclose(readings(differing(latency_s=0.3), states)[:3], np.broadcast_to(states[0], (3, 3, 11)), atol=1e-14)
    between = readings(differing(latency_s=0.25), states)[3:]
    np.testing.assert_allclose(between[..., 4:], 0.5 * (states[1:-2, :, 4:] + states[:-3, :, 4:]), rtol=1e-12)
    halfway = error(between[..., :4], states[:-3, :, :4])
    np.testing.assert_allclose(halfway, 0.05 * states[:-3, :, 4:7], atol=1e-12)  # half a tick of a constant rate


def test_jitter_makes_a_reading_late_by_up_to_its_size():
    states = moving(400, 20)
    age = (states[5:, 0, 7] - readings(differing(latency_s=0.1, jitter_s=0.2), states)[5:, 0, 7]) / 10.0  # wheels gain 10 rad/s in a second
    assert 0.1 - 1e-12 <= age.min() < 0.11
    assert 0.29 < age.max() <= 0.3 + 1e-12
    assert age.mean() == pytest.approx(0.2, abs=5 * 0.2 / 12**0.5 / 395**0.5)


def test_each_sensor_drops_out_by_itself_at_the_stated_rate():
    lost = np.isnan(readings(differing(dropout_probability=0.1), moving(200, 50)))
    for part in (slice(0, 4), slice(4, 7), slice(7, 11)):
        np.testing.assert_array_equal(lost[..., part].any(axis=-1), lost[..., part].all(axis=-1))
    sensor = lost[..., [0, 4, 7]]
    np.testing.assert_allclose(sensor.mean(axis=(0, 1)), 0.1, atol=5 * 0.3 / 100)  # 10 000 readings
    assert (sensor[..., 0] & sensor[..., 1]).mean() == pytest.approx(0.01, abs=5 * 0.1 / 100)


# faults, in a short closed loop ------------------------------------------------------------------------------------------------

QUIET = {
    "run.ticks": 60,
    "sensors": {"set": "ideal"},
    "control.feedback": "truth",
    "observers": {"ekf": {"type": "ekf", "tuning": "paper"}},
    "reference": {"type": "sinusoid", "amplitude_deg": [10.0, 12.0, 14.0], "period_s": [7.0, 8.0, 9.0]},
    "plant.air_torque_nm": 0.0,
    "plant.drive_torque_noise_nm": 0.0,
    "plant.command_bits": 0,
}
STILL = {  # no torque but what a fault brings
    "reference": {"type": "hold"},
    "start.attitude_error_deg": 0.0,
    "control.proportional_nm": 1e-12,
    "control.derivative_nms": 1e-12,
    "plant.gravity_m_s2": 0.0,
    "plant.centre_of_mass_um": [0.0, 0.0, 0.0],
    "plant.bearing_viscous_nms": 0.0,
    "plant.wheel_coulomb_nm": 0.0,
    "plant.wheel_viscous_nms": 0.0,
}
WITHIN, AFTER = slice(20, 40), slice(40, 60)


def fly(*faults: dict, trials: int = 3, **changes) -> tuple[Recording, np.ndarray]:
    """A closed loop of six seconds with faults from 2 to 4 s unless they say otherwise; its recording and true states."""
    timed = [{"start_s": 2.0, "duration_s": 2.0} | fault for fault in faults]
    system = build(load("nacs/fault-free", QUIET | changes | {"faults": timed}), np.arange(trials))
    recording = run(system)
    expected = np.zeros((60, trials), dtype=bool)
    for fault in timed:
        expected[round(10 * fault["start_s"]) : round(10 * (fault["start_s"] + fault["duration_s"]))] = True
    np.testing.assert_array_equal(recording.channels["fault"], expected)
    return recording, recording.channels["truth/state"]


def apart_from(window: slice) -> np.ndarray:
    return np.delete(np.arange(60), np.arange(60)[window])


def test_without_faults_the_drives_get_what_is_commanded_and_the_readings_are_the_truth():
    recording, truth = fly()
    np.testing.assert_array_equal(recording.channels["applied"], recording.channels["command"])
    np.testing.assert_array_equal(recording.channels["reading"], truth)
    assert np.abs(recording.channels["command"]).min(axis=(1, 2)).max() > 1e-6  # so that what follows means something


@pytest.mark.parametrize(("fault", "wheels", "share"), [
    ({"kind": "float", "wheel": 2}, [1], 0.0),
    ({"kind": "float", "wheel": "all"}, [0, 1, 2, 3], 0.0),
    ({"kind": "effectiveness", "wheel": 3, "remaining": 0.4}, [2], 0.4),
    ({"kind": "no-command"}, [0, 1, 2, 3], 0.0),
])  # fmt: skip
def test_a_faulty_drive_gives_its_share_of_the_command_and_no_other_does(fault, wheels, share):
    channels = fly(fault)[0].channels
    expected = channels["command"].copy()
    expected[WITHIN, :, wheels] *= share
    np.testing.assert_allclose(channels["applied"], expected, rtol=1e-14)


def test_a_floating_wheel_coasts():
    _, truth = fly(
        {"kind": "float", "wheel": 1}, **STILL | {"start.wheel_speed_rad_s": [100.0, 0.0, 0.0, 0.0], "control.derivative_nms": 0.01}
    )
    np.testing.assert_allclose(truth[WITHIN, :, 7], np.broadcast_to(truth[20, :, 7], (20, 3)), rtol=1e-6)


def test_effectiveness_may_differ_from_trial_to_trial():
    channels = fly({"kind": "effectiveness", "wheel": 1, "remaining": {"uniform": [0.2, 0.8]}}, trials=5)[0].channels
    share = channels["applied"][WITHIN, :, 0] / channels["command"][WITHIN, :, 0]
    np.testing.assert_allclose(share, np.broadcast_to(share[0], share.shape), rtol=1e-12)
    assert len(np.unique(share[0])) == 5
    assert ((share > 0.2) & (share < 0.8)).all()


def test_a_constant_output_is_what_the_drive_gives_whatever_it_is_told():
    recording, truth = fly({"kind": "constant-output", "wheel": 4, "torque_nm": 5e-4}, **STILL)
    np.testing.assert_array_equal(recording.channels["applied"][WITHIN, :, 3], 5e-4)
    np.testing.assert_allclose(recording.channels["applied"][apart_from(WITHIN)], recording.channels["command"][apart_from(WITHIN)])
    np.testing.assert_allclose(truth[40, :, 10] - truth[20, :, 10], 5e-4 * 2.0 / 1.740138e-5, rtol=0.02)  # the body recoils by 0.1 %


def test_a_locked_wheel_stops_relative_to_the_body_and_turns_again_afterwards():
    _, truth = fly({"kind": "lock", "wheel": 2}, **{"start.wheel_speed_rad_s": [0.0, 80.0, 0.0, 0.0]})
    assert np.abs(truth[20, :, 8]).min() > 50.0
    assert np.abs(truth[22:40, :, 8]).max() < 0.05  # a tenth of what the sensor can tell
    assert np.abs(truth[41:, :, 8]).max() > 2.0


def test_overlapping_faults_do_not_undo_each_other():
    _, truth = fly({"kind": "lock", "wheel": 2, "duration_s": 1.0}, {"kind": "lock", "wheel": 2, "start_s": 2.5, "duration_s": 1.5})
    assert np.abs(truth[22:40, :, 8]).max() < 0.05
    assert np.abs(truth[41:, :, 8]).max() > 2.0
    stuck, dead = (
        {"kind": "constant-output", "wheel": 1, "torque_nm": 1e-3},
        {"kind": "float", "wheel": 1, "start_s": 3.0, "duration_s": 1.0},
    )
    applied = fly(stuck, dead)[0].channels["applied"][..., 0]
    np.testing.assert_array_equal(applied[20:30], 1e-3)
    np.testing.assert_array_equal(applied[30:40], 0.0)


def test_the_momentum_of_a_wheel_that_locks_goes_into_the_body():
    loose = STILL | {"start.wheel_speed_rad_s": [100.0, 0.0, 0.0, 0.0]}
    recording, truth = fly({"kind": "lock", "wheel": 1}, **loose)
    assembly = build(load("nacs/fault-free", QUIET | loose), np.arange(1)).plant.assembly
    total = diagnose(assembly, recording.channels["truth/qpos"], recording.channels["truth/qvel"]).momentum_N
    np.testing.assert_allclose(total, np.broadcast_to(total[0, 0], total.shape), atol=1e-9)
    spin = 1.740138e-5 * 100.0 * assembly.wheel_axes[:, 0]
    np.testing.assert_allclose(truth[22, :, 4:7] @ assembly.inertia, np.broadcast_to(spin, (3, 3)), rtol=0.05, atol=2e-5)


def test_an_external_torque_adds_its_impulse_to_the_momentum():
    recording, _ = fly({"kind": "external-torque", "torque_nm": 1e-4, "direction": [0.0, 0.0, 2.0]}, **STILL)
    assembly = build(load("nacs/fault-free", QUIET | STILL), np.arange(1)).plant.assembly
    total = diagnose(assembly, recording.channels["truth/qpos"], recording.channels["truth/qvel"]).momentum_N
    np.testing.assert_allclose(total[20], 0.0, atol=1e-12)
    np.testing.assert_allclose(total[40], np.broadcast_to([0.0, 0.0, 2e-4], (3, 3)), atol=2e-6)  # the body turns by 0.4 deg meanwhile
    np.testing.assert_allclose(total[-1], total[40], atol=1e-12)


def test_a_planar_push_has_its_size_and_an_azimuth_of_its_own_in_every_trial():
    system = build(
        load("nacs/fault-free", QUIET | {"faults": [{"kind": "external-torque", "torque_nm": 5e-3, "start_s": 1.0, "duration_s": 1.0}]}),
        np.arange(50),
    )
    push = np.stack([system.effectors.faults.push(k) for k in range(60)])
    np.testing.assert_allclose(np.linalg.norm(push[10:20], axis=-1), 5e-3, rtol=1e-12)
    np.testing.assert_array_equal(push[..., 2], 0.0)
    np.testing.assert_array_equal(push[20:], 0.0)
    assert (np.histogram(np.arctan2(push[10, :, 1], push[10, :, 0]), 4, (-np.pi, np.pi))[0] > 2).all()


def test_another_inertia_answers_a_torque_differently_and_then_the_own_one_returns():
    own = [0.021867, 0.0172994, 0.0316484, 0.0, 0.0, 0.0]
    push = {"kind": "external-torque", "torque_nm": 1e-3, "direction": [0.0, 0.0, 1.0], "start_s": 0.0, "duration_s": 6.0}
    heavy = {"kind": "inertia", "inertia_kg_m2": [0.04, 0.035, 0.06, 0.0, 0.0, 0.0]}
    _, truth = fly(push, heavy, **STILL | {"plant.inertia_kg_m2": own})
    gain = np.diff(truth[..., 6], axis=0) / TICK
    spinning = 2 * 1.740138e-5  # free wheels' spin about z stays behind: (W W')_zz = 2
    for window, moment in ((slice(5, 20), own[2]), (slice(25, 40), 0.06), (slice(45, 59), own[2])):
        np.testing.assert_allclose(gain[window], 1e-3 / (moment - spinning), rtol=1e-3)
    assert (gain > 0).all()  # the rate is kept at both changes


def test_more_noise_is_more_noise_of_that_sensor_alone():
    changes = {"sensors": {"set": "bench", "gyro_bias_rad_s": 0.0, "gyro_bias_walk_rad_s_sqrt_s": 0.0}}
    recording, truth = fly({"kind": "noise", "sensor": "gyro", "factor": 10.0}, trials=40, **changes)
    reading = recording.channels["reading"]
    gyro, wheel, turn = reading[..., 4:7] - truth[..., 4:7], reading[..., 7:] - truth[..., 7:], error(reading[..., :4], truth[..., :4])
    for window, factor in ((slice(0, 20), 1.0), (WITHIN, 10.0), (AFTER, 1.0)):
        assert gyro[window].std() == pytest.approx(factor * 1.732e-3, rel=0.07)  # 2400 readings: five deviations
        assert turn[window].std() == pytest.approx(4e-4, rel=0.07)
        assert wheel[window].std() == pytest.approx(0.51, rel=0.07)


def test_a_bias_shifts_every_axis_of_that_sensor_alone():
    for sensor, size in (("gyro", 0.01), ("wheels", -3.0)):
        recording, truth = fly({"kind": "bias", "sensor": sensor, "size": size})
        shift = recording.channels["reading"] - truth
        expected = np.zeros_like(shift)
        expected[WITHIN, :, slice(4, 7) if sensor == "gyro" else slice(7, 11)] = size
        np.testing.assert_allclose(shift, expected, atol=1e-12)
    recording, truth = fly({"kind": "bias", "sensor": "attitude", "size": 0.02})
    turn = error(recording.channels["reading"][..., :4], truth[..., :4])
    np.testing.assert_allclose(turn[WITHIN], 0.02, atol=1e-14)
    np.testing.assert_allclose(turn[apart_from(WITHIN)], 0.0, atol=1e-14)


@pytest.mark.parametrize(
    ("sensor", "part"), [("attitude", slice(0, 4)), ("gyro", slice(4, 7)), ("wheels", slice(7, 11)), ("all", slice(0, 11))]
)
def test_a_silent_sensor_says_nothing_and_the_others_go_on(sensor, part):
    recording, truth = fly({"kind": "drop-out", "sensor": sensor})
    expected = truth.copy()
    expected[WITHIN, :, part] = np.nan
    np.testing.assert_array_equal(recording.channels["reading"], expected)
    assert np.isfinite(recording.channels["ekf/mean"]).all()


def test_feedback_on_readings_holds_the_last_one_and_before_the_first_takes_the_body_to_be_level_and_at_rest():
    recording, _ = fly({"kind": "drop-out", "sensor": "all", "start_s": 0.0}, **{"control.feedback": "measurement"})
    command = recording.channels["command"]
    np.testing.assert_array_equal(command[:20, 0], command[:20, 1])  # trials that know nothing do the same
    assert np.abs(command[20, 0] - command[20, 1]).max() > 1e-4
    recording, truth = fly({"kind": "drop-out", "sensor": "all"}, **{"control.feedback": "measurement"})
    assert np.isfinite(truth).all()
    law = build(load("nacs/fault-free", QUIET), np.arange(1)).law.controller
    held = truth[19]
    for k in range(20, 40):
        target = Target(*(recording.channels[f"reference/{part}"][k] for part in ("q", "omega", "alpha")))
        torque = law.step(Estimate(held[:, :4], held[:, 4:7], held[:, 7:]), target)
        np.testing.assert_allclose(recording.channels["torque_B"][k], torque, atol=1e-15)


def test_a_delay_shows_the_past():
    recording, truth = fly({"kind": "delay", "delay_s": 0.2})
    expected = truth.copy()
    expected[WITHIN] = truth[18:38]
    np.testing.assert_allclose(recording.channels["reading"], expected, atol=1e-13)


def test_a_drawn_fault_begins_at_its_own_instant_in_every_trial_whoever_else_flies():
    pushes = [{"kind": "external-torque", "torque_nm": {"uniform": [1e-3, 2e-3]}, "start_s": {"uniform": [1.0, 4.0]}, "duration_s": 1.0}]
    scenario = load("nacs/fault-free", QUIET | {"faults": pushes})
    everyone, alone = (build(scenario, trials).effectors.faults for trials in (np.arange(20), np.array([13])))
    pushed, alone_pushed = (np.stack([laid.push(k) for k in range(60)]) for laid in (everyone, alone))
    np.testing.assert_array_equal(alone_pushed[:, 0], pushed[:, 13])
    assert len({occurrence.start_tick for occurrence in everyone.occurrences}) > 5
    active_at = np.stack([everyone.at(ACTIVE, k) for k in range(60)])
    np.testing.assert_array_equal(active_at.sum(axis=0), 10)
    for occurrence in everyone.occurrences:
        active = np.flatnonzero(active_at[:, occurrence.trial])
        assert (active[0], active[-1] + 1) == (occurrence.start_tick, occurrence.end_tick)
