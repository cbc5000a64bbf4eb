"""The posterior Cramer-Rao bound: Kalman's covariance where all is linear, the printed recursion, and filters that come near it."""

import numpy as np
import pytest
from typer.testing import CliRunner

from estimation.posterior_bound import posterior_bound
from sim.cli.command import app
from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.metrics.bound import TRAJECTORIES, efficiency
from sim.scenario.files import load
from sim.sensors.distribution import GlintNoise, StudentNoise


def system(rng, steps: int, size: int, read: int):
    transition = rng.standard_normal((steps, size, size))
    root = rng.standard_normal((steps, size, size))
    sensitivity = rng.standard_normal((steps, read, size))
    return transition, root @ root.swapaxes(-1, -2), sensitivity, np.diag(rng.uniform(0.5, 2.0, read))


def test_of_a_linear_system_it_is_the_kalman_covariance():
    rng, steps = np.random.default_rng(1), 30
    transition, noise, sensitivity, reading = system(rng, steps, 4, 2)
    covariance, expected = np.eye(4), []
    for f, q, h in zip(transition, noise, sensitivity, strict=True):
        predicted = f @ covariance @ f.T + q
        gain = predicted @ h.T @ np.linalg.inv(h @ predicted @ h.T + reading)
        covariance = (np.eye(4) - gain @ h) @ predicted
        expected.append(covariance)
    known = sensitivity.swapaxes(-1, -2) @ np.linalg.inv(reading) @ sensitivity
    np.testing.assert_allclose(posterior_bound(transition, noise, known, np.eye(4)), expected, rtol=1e-8, atol=1e-10)


def test_it_is_the_recursion_as_printed():
    """J' = D22 - D21 (J + D11)^-1 D12, of several trajectories at once."""
    rng, steps = np.random.default_rng(2), 12
    transition, noise, sensitivity, reading = system(rng, steps, 3, 1)
    known = sensitivity.swapaxes(-1, -2) @ np.linalg.inv(reading) @ sensitivity
    turned = np.stack([transition, -0.5 * transition], axis=1)
    found = posterior_bound(turned, noise[:, None], known[:, None], np.eye(3))
    for which, factor in enumerate((1.0, -0.5)):
        information = np.eye(3)
        for k in range(steps):
            f, inverse = factor * transition[k], np.linalg.inv(noise[k])
            d11, d12, d22 = f.T @ inverse @ f, -f.T @ inverse, inverse + known[k]
            information = d22 - d12.T @ np.linalg.inv(information + d11) @ d12
            np.testing.assert_allclose(np.linalg.inv(found[k, which]), information, rtol=1e-6, atol=1e-8)


def test_without_process_noise_information_adds_up():
    """A constant read n times: R / n."""
    found = posterior_bound(np.ones((9, 1, 1)), np.zeros((1, 1)), np.full((9, 1, 1), 4.0), np.array([[0.25]]))
    np.testing.assert_allclose(found[:, 0, 0], 0.25 / np.arange(2, 11))


def test_the_multiplicative_filter_of_the_testbed_comes_near_it_and_not_below():
    scenario = load("nacs/fault-free", {"run.ticks": 300})
    found = {(row.observer, row.part): row for row in efficiency(scenario, run(build(scenario, np.arange(6))), 7.5)}
    for part in ("attitude", "rate"):
        assert 0.95 < found["mekf", part].error / found["mekf", part].bound < 1.5
        assert found["sif", part].error > 1.2 * found["mekf", part].error
        assert found["sif", part].bound == found["mekf", part].bound


def test_of_a_still_attitude_and_a_perfect_model_it_is_the_mean_of_the_readings():
    """A body at rest with the believed inertia, read for n ticks: the line's end point, (2 (2 n - 1)) / (n (n + 1)) R of a fitted line."""
    changes = {"run.ticks": 200, "run.tick_s": 0.1, "phases": {}, "start.rate_rad_s": [0.0, 0.0, 0.0],
               "start.quaternion": [0.0, 0.0, 0.0, 1.0], "plant.inertia_kg_m2": [20.0, 17.0, 15.0, 0.0, 0.0, 0.0]}  # fmt: skip
    single = load("monolithic/fault-free", changes).singles()["mekf"]
    row = next(r for r in efficiency(single, run(build(single, np.arange(2))), 19.9) if r.part == "attitude")
    n = 200
    assert row.bound == pytest.approx(2e-4 * np.sqrt(2 * (2 * n - 1) / (n * (n + 1))), rel=0.02)


@pytest.mark.parametrize(("noise", "information"), [
    (StudentNoise(type="student-t", dof=3.0), 1.0), (GlintNoise(type="glint", share=0.1, factor=10.0), 0.901)])  # fmt: skip
def test_a_reading_tells_no_more_than_if_its_size_were_known(noise, information):
    assert noise.information == pytest.approx(information)
    scales = noise.scales(np.random.default_rng(6).random(200_000))
    assert np.mean(scales**-2.0) == pytest.approx(information, rel=0.01)


def test_the_agents_steps_are_those_of_the_plant():
    """What the double integrator leaves out of agents that are pushed is far below what a reading can see."""
    scenario = load("consensus/fault-free", {"run.ticks": 200})
    recording = run(build(scenario, np.arange(2), loop="aukf"))
    found = {row.part: row for row in efficiency(scenario, recording, 1.0)}
    assert found["position"].bound < 1e-4
    assert found["position"].error > found["position"].bound
    one = load("formation/fault-free-open", {"run.ticks": 60, "phases": {}})
    flown = run(build(one, np.arange(1), loop="truth"))
    truth = flown.channels["truth/state"]
    seen = TRAJECTORIES["formation"](one, flown)
    assert np.abs(seen.predicted - truth[1:])[..., :3].max() < 1e-3


@pytest.mark.parametrize(("arguments", "said"), [
    (["nacs/fault-free", "--loop", "x"], "no such loop"),
    (["nacs/fault-free", "--from", "1e6"], "the run lasts from"),
    (["monolithic/sensor-noise", "--loop", "mekf", "--set", "run.ticks=20", "--set", "phases={}", "--set",
      "faults=[{kind='noise',sensor='attitude',factor=2.0,start_s=0.0,duration_s=0.1}]"], "changes them"),
    (["monolithic/fault-free", "--loop", "true-state", "--set", "run.ticks=20", "--set", "phases={}"], "no filter watches"),
])  # fmt: skip
def test_what_cannot_be_bounded_is_one_line(arguments, said):
    result = CliRunner().invoke(app, ["bound", *arguments, "--trials", "1"])
    assert said in str(result.exception) + result.output


def test_the_command_says_error_and_bound():
    result = CliRunner().invoke(app, ["bound", "nacs/fault-free", "--trials", "1", "--set", "run.ticks=40"])
    assert result.exit_code == 0
    assert "RMS / bound" in result.output
