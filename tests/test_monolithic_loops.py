"""A body without wheels and without a rate gyro in closed loop: what acts on it, what is read, what the filters draw, what is judged."""

import json

import numpy as np
import pytest

from models.attitude import quaternion
from models.plants.inertia import tensor
from models.plants.monolithic import MonolithicParameters
from sim.estimators.particle_draws import ParticleDraws
from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.loop.recording import Recording
from sim.metric import Metric
from sim.metrics.claims import gyroless
from sim.metrics.one_body import evaluate
from sim.metrics.results import Row, rows
from sim.plant.batch import diagnose
from sim.scenario.files import load

TICK = 0.01
FILTERS = ("aukf-printed", "aukf-matched", "pf-printed", "pf-matched", "mekf")


def fly(
    loop: str = "true-state", ticks: int = 40, trials=(0, 1), scenario: str = "fault-free", **settings
) -> tuple[Recording, list[Metric]]:
    single = load(f"monolithic/{scenario}", {"run.ticks": ticks, "faults": []} | settings).singles()[loop]
    system = build(single, np.array(trials))
    recording = run(system)
    return recording, evaluate(recording, system.plant.assembly, loop, single)


def found(metrics: list[Metric], metric: str, phase: str) -> np.ndarray:
    return next(m.values for m in metrics if (m.metric, m.phase) == (metric, phase))


def momentum(recording: Recording, inertia=None) -> np.ndarray:
    truth = recording.channels["truth/state"]
    inertia = MonolithicParameters().inertia if inertia is None else inertia
    return np.einsum("...ji,...j->...i", quaternion.attitude_matrix(truth[..., :4]), truth[..., 4:] @ inertia)


def test_it_starts_as_the_thesis_says():
    recording, _ = fly()
    np.testing.assert_allclose(
        recording.channels["truth/state"][0], np.tile([-0.6, 0.4, -0.2, np.sqrt(0.44), 1.0, 1.0, 1.0], (2, 1)), atol=1e-12
    )
    recording, _ = fly(scenario="no-command")
    np.testing.assert_array_equal(recording.channels["truth/state"][0, :, 4:], 0.0)


def test_without_torque_the_loop_keeps_energy_and_momentum():
    """60 s of the whole loop, its controller giving nothing."""
    fault = [{"kind": "no-command", "start_s": 0.0, "duration_s": 60.0}]
    single = load("monolithic/fault-free", {"run.ticks": 6000, "faults": fault}).singles()["true-state"]
    system = build(single, np.arange(1))
    recording = run(system)
    assert np.abs(recording.channels["torque_B"]).max() == pytest.approx(0.1)
    assert not recording.channels["applied"].any()
    energy = diagnose(system.plant.assembly, recording.channels["truth/qpos"], recording.channels["truth/qvel"]).energy[:, 0]
    assert energy[0] == pytest.approx(29.5)
    assert np.abs(energy / energy[0] - 1.0).max() < 1e-9
    before, after = momentum(recording)[[0, -1], 0]
    np.testing.assert_allclose(after, before, atol=1e-8)


def test_the_torque_of_the_law_turns_the_body_and_is_no_more_than_a_tenth_of_a_newton_metre():
    recording, metrics = fly(ticks=200)
    torque = recording.channels["torque_B"]
    assert np.abs(torque).max() <= 0.1
    np.testing.assert_array_equal(recording.channels["applied"], torque)
    turned = quaternion.attitude_matrix(recording.channels["truth/state"][:-1, :, :4])
    impulse = TICK * np.cumsum(np.einsum("...ji,...j->...i", turned, torque[:-1]), axis=0)
    np.testing.assert_allclose(momentum(recording)[1:] - momentum(recording)[0], impulse, atol=3e-3)  # it turns by 0.02 rad in a tick
    assert found(metrics, "saturated_time_s", "all") == pytest.approx(2.0)


FAULTS = {
    "body-torque": {"kind": "body-torque", "axis": "y", "torque_nm": 0.025},
    "no-command": {"kind": "no-command"},
    "periodic-torque": {"kind": "periodic-torque", "amplitude_nm": 0.3, "pulsation_rad_s": 2.0},
    "uniform-torque": {"kind": "uniform-torque", "amplitude_nm": 0.4},
}


@pytest.mark.parametrize("kind", FAULTS)
def test_a_fault_does_what_it_says_while_it_lasts(kind: str):
    window = slice(10, 30)
    overrides = {"run.ticks": 40, "faults": [FAULTS[kind] | {"start_s": 0.1, "duration_s": 0.2}]}
    single = load("monolithic/fault-free", overrides).singles()["true-state"]
    system = build(single, np.arange(3))
    recording = run(system)
    asked, given = recording.channels["torque_B"], recording.channels["applied"]
    expected, push = asked.copy(), np.zeros_like(asked)
    time = TICK * np.arange(40)[window]
    match kind:
        case "body-torque":
            expected[window, :, 1] = 0.025
        case "no-command":
            expected[window] = 0.0
        case "periodic-torque":
            push[window] = 0.3 * np.stack([np.sin(2 * time), np.cos(2 * time), np.sin(4 * time)], axis=-1)[:, None]
        case "uniform-torque":
            push[window] = [system.effectors.faults.push(k) for k in range(10, 30)]
            assert 0.3 < np.abs(push).max() <= 0.4
            assert np.ptp(push[window].mean(axis=0), axis=0).min() > 1e-3  # every trial's own
            alone = build(single, np.array([2])).effectors.faults
            np.testing.assert_array_equal([alone.push(k)[0] for k in range(40)], push[:, 2])
    np.testing.assert_array_equal(given, expected)
    turned = quaternion.attitude_matrix(recording.channels["truth/state"][..., :4])
    impulse = TICK * np.cumsum(np.einsum("...ji,...j->...i", turned, given + push)[:-1], axis=0)
    np.testing.assert_allclose(momentum(recording)[1:] - momentum(recording)[0], impulse, atol=3e-3)


def test_another_inertia_keeps_the_rate_and_nobody_is_told():
    fault = [{"kind": "inertia", "inertia_kg_m2": [10, 10, 5, 0, 0, 0], "start_s": 0.2, "duration_s": 0.1}]
    recording, _ = fly(faults=fault)
    rate = recording.channels["truth/state"][:, 0, 4:]
    assert np.abs(np.diff(rate, axis=0)).max() < 0.02  # no jump
    changed = momentum(recording, tensor((10, 10, 5, 0, 0, 0)))[20:31, 0]
    np.testing.assert_allclose(changed, np.broadcast_to(changed[0], changed.shape), atol=0.02)
    whole = momentum(recording)[:, 0]
    assert np.abs(whole[20] - changed[0]).max() > 5.0


def test_there_is_no_rate_to_be_read_and_the_quaternion_has_noise_in_all_components():
    recording, _ = fly(ticks=2000, trials=range(4))
    reading, truth = recording.channels["reading"], recording.channels["truth/state"]
    assert np.isnan(reading[..., 4:]).all()
    noise = reading[..., :4] - truth[..., :4]
    np.testing.assert_allclose(np.linalg.norm(reading[..., :4], axis=-1), 1.0, atol=1e-14)
    across = noise - truth[..., :4] * np.sum(noise * truth[..., :4], axis=-1, keepdims=True)  # along q there is none on a unit quaternion
    np.testing.assert_allclose(np.sqrt(np.sum(across**2, axis=-1).mean() / 3.0), 1e-4, rtol=0.03)
    louder, _ = fly(
        ticks=2000, trials=range(4), faults=[{"kind": "noise", "sensor": "attitude", "factor": 3.0, "start_s": 0.0, "duration_s": 20.0}]
    )
    spread = np.std(louder.channels["reading"][..., :4] - louder.channels["truth/state"][..., :4])
    assert spread == pytest.approx(3.0 * np.std(noise), rel=0.01)


def test_a_late_reading_shows_the_past():
    recording, _ = fly(**{"sensors.latency_s": 0.15, "sensors.quaternion_noise": 0.0})
    truth = recording.channels["truth/state"][..., :4]
    np.testing.assert_allclose(recording.channels["reading"][15:, :, :4], truth[:-15], atol=1e-12)


@pytest.mark.parametrize("loop", FILTERS)
def test_a_trial_is_the_same_in_any_batch(loop: str):
    alone, among = (fly(loop, 60, trials)[0].channels for trials in ((2,), range(4)))
    for name, channel in alone.items():
        if not name.startswith("reference/"):
            np.testing.assert_array_equal(among[name][:, 2:3], channel, err_msg=name)


def test_a_particle_filter_draws_the_same_numbers_however_many_at_a_time(monkeypatch: pytest.MonkeyPatch):
    settings = ("pf", 3, np.array([0, 5]), 20, 7, True)
    many = ParticleDraws.of_a_filter(*settings)
    monkeypatch.setattr("sim.estimators.particle_draws.BLOCK_NUMBERS", 2000)
    few = ParticleDraws.of_a_filter(*settings)
    for _ in range(30):
        for one, other in zip(many.step(), few.step(), strict=True):
            np.testing.assert_array_equal(one, other)
    first = ParticleDraws.of_a_filter(*settings).step()
    assert first.normals.shape == first.jitter.shape == (2, 20, 7)
    assert first.uniforms.shape == (2, 20)
    assert not np.isin(first.normals, first.jitter).any()
    assert not np.isin(first.normals, ParticleDraws.of_a_filter("another", *settings[1:]).step().normals).any()


def test_a_particle_filter_is_the_same_in_a_loop_of_its_own_and_among_others():
    watched = {"loops.true-state.watching": ["pf-matched", "aukf-matched"]}
    alone = fly(ticks=50, **{"loops.true-state.watching": ["pf-matched"]})[0]
    among = fly(ticks=50, **watched)[0]
    for part in ("mean", "ess", "sigma"):
        np.testing.assert_array_equal(among.channels[f"pf-matched/{part}"], alone.channels[f"pf-matched/{part}"])
    assert (among.channels["aukf-matched/fading"] >= 1.0).all()


def test_the_printed_particle_filter_has_one_particle_and_the_matched_one_many():
    printed, matched = (fly(f"pf-{tuning}", 300, range(8)) for tuning in ("printed", "matched"))
    assert found(printed[1], "ess_median", "all").max() <= 1.5
    assert found(matched[1], "ess_median", "all").min() > 3.0  # while it still looks for the rate
    settled = fly("pf-matched", 300, range(8), **{"start.rate_rad_s": [0.0, 0.0, 0.0]})[1]
    assert found(settled, "ess_median", "all").min() > 30.0
    assert found(printed[1], "rms_attitude_error", "0-100").min() > 10 * found(matched[1], "rms_attitude_error", "0-100").max()


def test_the_printed_fading_factor_as_a_constant_leaves_no_memory():
    """From a slow body, so that the thesis' process noise and wrong inertia do not matter: 2 sqrt(2) 1e-4 / 0.01 s on each axis."""
    _, metrics = fly("aukf-constant", 1500, range(8), **{"start.rate_rad_s": [0.0, 0.0, 0.0]})
    assert found(metrics, "rms_rate_error", "0-100") == pytest.approx(0.028, rel=0.1)


def test_the_printed_formula_keeps_its_memory():
    """Its factor is 1 + 1e3 times the innovations' squared length, some 1e-5 to 1e-7: the unscented filter, nearly."""
    recording, metrics = fly("aukf-printed", 1500, range(8), **{"start.rate_rad_s": [0.0, 0.0, 0.0]})
    factor = recording.channels["aukf-printed/fading"]
    assert 1.0 < np.median(factor[500:]) < 1.001
    assert found(metrics, "rms_rate_error", "0-100").max() < 0.005


def test_both_matched_filters_follow_a_tumbling_body():
    for loop, bound in (("aukf-matched", 0.06), ("pf-matched", 0.7)):
        recording, metrics = fly(loop, 700, range(4))
        assert found(metrics, "rms_rate_error", "0-100").max() < bound
        error = recording.channels[f"{loop}/mean"][600:, :, 4:7] - recording.channels["truth/state"][600:, :, 4:7]
        assert np.sqrt(np.mean(error**2)) < 0.1
        assert not found(metrics, "lost", "all").any()


def test_metrics_of_windows_are_what_they_say():
    windows = {"phases": {"early": [0.0, 0.2], "late": [0.2, 0.4], "never": [50.0, 60.0]}}
    recording, metrics = fly("aukf-matched", **windows)
    truth, mean = recording.channels["truth/state"], recording.channels["aukf-matched/mean"]
    rate = (mean - truth)[20:, :, 4:]
    np.testing.assert_allclose(found(metrics, "rms_rate_error", "late"), np.sqrt(np.mean(rate**2, axis=(0, 2))))
    half = quaternion.error(mean[:20, :, :4], truth[:20, :, :4]) / 2.0  # of a small turn
    np.testing.assert_allclose(found(metrics, "rms_attitude_error", "early"), np.sqrt(np.mean(half**2, axis=(0, 2))), rtol=1e-4)
    np.testing.assert_allclose(found(metrics, "final_attitude", "all"), np.linalg.norm(truth[-1, :, :3], axis=-1))
    np.testing.assert_array_equal(found(metrics, "final_scalar", "all"), truth[-1, :, 3])
    np.testing.assert_allclose(found(metrics, "rate_least", "late"), np.linalg.norm(truth[20:, :, 4:], axis=-1).min(axis=0))
    assert np.isnan(found(metrics, "time_to_region_s", "state")).all()
    assert not {m.phase for m in metrics} & {"never"}

    recording.channels["truth/state"][25:, 1] = [9e-4, 0, 0, 1, 0, -4e-5, 0]
    recording.channels["aukf-matched/mean"][30:, 0] = -recording.channels["truth/state"][30:, 0] * [
        1,
        1,
        1,
        1,
        -1,
        -1,
        -1,
    ]  # of either sign
    recording.channels["aukf-matched/mean"][35:, 1] = [0.1, 0, 0, 1, 0, 0, 0]
    recording.channels["aukf-matched/mean"][:35, 1, 3] += 5.0
    single = load("monolithic/fault-free", windows).singles()["aukf-matched"]
    metrics = evaluate(recording, build(single, np.arange(1)).plant.assembly, "aukf-matched", single)
    np.testing.assert_allclose(found(metrics, "time_to_region_s", "state"), [np.nan, 0.25])
    assert found(metrics, "time_to_region_s", "estimate")[0] == pytest.approx(0.3)
    np.testing.assert_array_equal(found(metrics, "lost", "all"), [0.0, 1.0])


def test_claims_get_a_verdict_by_the_numbers():
    def row(subject: str, metric: str, phase: str, mean: float) -> Row:
        return Row(subject, metric, phase, "", mean, 0.0, mean, mean, 8)

    late = ("100-300", "300-500", "500-600")
    table = [row(f"{f}-matched", "rms_rate_error", phase, size) for f, size in (("pf", 2.0), ("aukf", 1.0)) for phase in late]
    table += [row(f"{f}-matched-noise", "rms_rate_error", "500-600", size) for f, size in (("pf", 0.1), ("aukf", 3.0))]
    table += [row("pf-matched", "final_attitude", "all", 0.1), row("aukf-matched", "time_to_region_s", "state", 480.0)]
    said = {claim.text: claim for claim in gyroless(table)}
    assert said["the particle filter estimates the rate better, matched"].verdict == "does not hold"
    assert "pf-matched 2, aukf-matched 1 rad/s" in said["the particle filter estimates the rate better, matched"].found
    assert said["the particle filter estimates the rate better, printed"].verdict == "not decided"
    assert said["with the particle filter the body is in the region 28 % earlier, matched"].verdict == "does not hold"
    assert said["with the particle filter the body is in the region 28 % earlier, matched"].found == "pf never, aukf 480 s"
    assert said["large noise: the particle filter is better"].verdict == "holds"
    assert said["small noise: the AUKF is better"].verdict == "not decided"


def test_the_testbed_flies_without_its_gyro():
    for loop in ("aukf-matched", "pf-matched"):
        single = load("nacs/gyroless", {"run.ticks": 150}).singles()[loop]
        system = build(single, np.arange(4))
        metrics = evaluate(run(system), system.plant.assembly, loop, single)
        assert found(metrics, "rms_rate_error", "10-100").max() < 4e-3
        assert not found(metrics, "lost", "all").any()


WRONG = [
    ("fault-free", "faults=[{kind='float',wheel='all',start_s=1,duration_s=1}]", ["faults.0 (float)", "no wheels"]),
    ("fault-free", "faults=[{kind='body-torque',axis='w',torque_nm=1,start_s=1,duration_s=1}]", ["faults.0.axis", "'x', 'y' or 'z'"]),
    ("fault-free", "faults=[{kind='periodic-torque',amplitude_nm=1,pulsation_rad_s=0,start_s=1,duration_s=1}]",
     ["pulsation_rad_s", "greater than 0"]),
    ("fault-free", "faults=[{kind='uniform-torque',amplitude_nm=-1,start_s=1,duration_s=1}]", ["faults.0.amplitude_nm", "negative"]),
    ("fault-free", "start.quaternion=[1,1,0,0]", ["start", "squares must add up to one"]),
    ("fault-free", "start.euler_313_deg=[1,1,0]", ["start", "either so or as euler_313_deg"]),
    ("fault-free", "start.rate_deg_s=[1,1,0]", ["start", "either so or as rate_deg_s"]),
    ("fault-free", "phases.all=[0,1]", ["phases", "'all' cannot"]),
    ("fault-free", "phases.late=[2,1]", ["phases", "start < end"]),
    ("fault-free", "observers.pf-matched.particles=1", ["observers.pf-matched.particles", "greater than or equal to 2"]),
    ("fault-free", "observers.pf-matched.proposal=best", ["observers.pf-matched.proposal", "'extended' or 'unscented'"]),
    ("fault-free", "observers.pf-matched={type='pf',tuning='matched',proposal='likelihood',likelihood={type='student-t'}}",
     ["observers.pf-matched.proposal", "its weights depend on what was drawn"]),
    ("fault-free", "observers.pf-matched={type='pf',tuning='matched',proposal='likelihood',measured='directions'}",
     ["observers.pf-matched.proposal", "directions say more than an attitude has components"]),
    ("fault-free", "observers.pf-matched.resample_every=-1", ["observers.pf-matched.resample_every", "greater than or equal to 0"]),
    ("fault-free", "observers.aukf-matched.coordinates=multiplicative", ["observers.aukf-matched.coordinates", "'additive'"]),
    ("fault-free", "observers.aukf-matched.fading={type='constant',factor=0.5}",
     ["observers.aukf-matched.fading", "greater than or equal to 1"]),
    ("fault-free", "plant.inertia_kg_m2=[30,10,15,0,0,0]", ["plant.inertia_kg_m2", "triangle inequality"]),
]  # fmt: skip


@pytest.mark.parametrize(("name", "setting", "wanted"), WRONG, ids=[s for _, s, _ in WRONG])
def test_a_wrong_setting_is_one_line_naming_file_and_key(nacs, name: str, setting: str, wanted: list[str]):
    result = nacs("run", f"monolithic/{name}", "--set", setting)
    assert result.code == 2
    assert result.err.startswith("error: ")
    assert result.err.count("\n") == 1
    for part in wanted:
        assert part in result.err


def test_a_body_torque_is_no_fault_of_a_wheeled_plant(nacs):
    fault = "faults=[{kind='body-torque',axis='x',torque_nm=1,start_s=1,duration_s=1}]"
    assert "turned by its wheels" in nacs("run", "nacs/fault-free", "--set", fault).err


def test_rows_can_be_written_as_json():
    """No metric of a window is an infinity or an object."""
    _, metrics = fly("pf-matched")
    json.dumps([row._asdict() for row in rows(metrics)], allow_nan=False)
