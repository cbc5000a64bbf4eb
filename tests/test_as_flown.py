"""The inference of the testbed's disturbance from printed tables: its parts against closed forms, and its flights against the loop's."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import approx_fprime
from scipy.signal import lfilter
from scipy.stats import multivariate_normal

from docs.as_flown import causes, flights
from docs.as_flown.elliptical_slice import effective, sample
from docs.as_flown.emulator import Emulator, Prediction, _of_ten, _plane, emulate, predict, printed
from docs.as_flown.gaussian_process import Hyperparameters, condition, fit, objective
from docs.as_flown.posterior import log_likelihood
from docs.as_flown.score import pairs_in_order
from sim.loop.build import assembly_of, build
from sim.loop.closed_loop import run
from sim.metrics import one_body
from sim.scenario.files import load
from sim.scenario.one_body import Scenario, StartSettings
from sim.units import RPM

Array = NDArray[np.floating]

RNG = np.random.default_rng(5)
POINTS = RNG.uniform(-1.0, 1.0, (30, 2))
CURVE = np.stack([np.sin(2.0 * POINTS[:, 0]) + POINTS[:, 1], POINTS[:, 0] - 3.0 * POINTS[:, 1]], axis=-1)
KERNEL = Hyperparameters(np.array([0.8, 2.0]), 1.1, 0.6, 0.2)


def test_a_process_is_that_of_the_normal_distribution_of_all_values():
    """Mean and variance at a new point against conditioning a joint normal distribution by hand."""
    process, new = condition(POINTS, CURVE, KERNEL), np.array([[0.3, -0.2]])
    every = np.concatenate([POINTS, new])
    apart = (every[:, None] - every) / KERNEL.lengths
    kernel = 1.1**2 * np.exp(-0.5 * np.sum(apart**2, axis=-1)) + 0.36 * (1.0 + every @ every.T)
    known = kernel[:30, :30] + 0.04 * np.eye(30)
    scale = CURVE.std(axis=0)
    mean = CURVE.mean(axis=0) + scale * (kernel[30, :30] @ np.linalg.solve(known, (CURVE - CURVE.mean(axis=0)) / scale))
    variance = kernel[30, 30] - kernel[30, :30] @ np.linalg.solve(known, kernel[:30, 30])
    found = process.at(new)
    np.testing.assert_allclose(found[0][0], mean, rtol=1e-9)
    np.testing.assert_allclose(found[1][0], scale**2 * variance, rtol=1e-6)


def test_what_is_left_out_is_predicted_by_all_others():
    """The formula of one matrix against conditioning 30 times on 29 points, with the offset and scale of all."""
    errors, deviations = condition(POINTS, CURVE, KERNEL).left_out()
    mean, scale = CURVE.mean(axis=0), CURVE.std(axis=0)
    for i in (0, 7, 29):
        rest = np.arange(30) != i
        others = condition(POINTS[rest], CURVE[rest], KERNEL)
        standard = (CURVE[rest] - mean) / scale
        own = others._replace(mean=mean, scale=scale, weights=np.linalg.solve(others.factor @ others.factor.T, standard))
        predicted, variance = own.at(POINTS[i : i + 1])
        np.testing.assert_allclose(errors[i], predicted[0] - CURVE[i], rtol=1e-6)
        np.testing.assert_allclose(deviations[i] ** 2, variance[0] + (0.2 * scale) ** 2, rtol=1e-6)


def test_the_gradient_of_the_evidence():
    logs = np.log(np.r_[KERNEL.lengths, KERNEL[1:]])
    standard = (CURVE - CURVE.mean(axis=0)) / CURVE.std(axis=0)
    slope = approx_fprime(logs, lambda one: objective(one, POINTS, standard)[0], 1e-6)
    np.testing.assert_allclose(objective(logs, POINTS, standard)[1], slope, rtol=1e-4, atol=1e-3)


def test_a_fitted_process_predicts_what_it_has_not_seen():
    """A smooth function to 1 % of its range; a linear one, with noise, whose noise is found."""
    process = fit(POINTS, CURVE)
    new = RNG.uniform(-0.9, 0.9, (50, 2))
    truth = np.stack([np.sin(2.0 * new[:, 0]) + new[:, 1], new[:, 0] - 3.0 * new[:, 1]], axis=-1)
    assert np.max(np.abs(process.at(new)[0] - truth)) < 0.04
    many = RNG.uniform(-1.0, 1.0, (200, 2))
    noisy = fit(many, many @ np.array([[1.0], [2.0]]) + 0.3 * RNG.standard_normal((200, 1)))
    assert 0.25 < noisy.hyperparameters.noise * noisy.scale[0] < 0.35


def test_elliptical_slices_sample_a_product_of_normal_densities():
    """Prior N(0, I) and a likelihood N(m, S) have the posterior of mean (I + S^-1)^-1 S^-1 m; half of the plane is forbidden."""
    spread, middle = np.array([[0.5, 0.3], [0.3, 0.4]]), np.array([2.0, -1.0])
    density = multivariate_normal(middle, spread)
    path, _ = sample(lambda x: np.atleast_1d(density.logpdf(x)), RNG.normal(size=(100, 2)), 150, np.random.default_rng(2))
    flat, covariance = path[30:].reshape(-1, 2), np.linalg.inv(np.eye(2) + np.linalg.inv(spread))
    np.testing.assert_allclose(flat.mean(axis=0), covariance @ np.linalg.solve(spread, middle), atol=0.03)
    np.testing.assert_allclose(np.cov(flat.T), covariance, atol=0.03)
    half, _ = sample(lambda x: np.where(x[:, 0] > 0.0, 0.0, -np.inf), np.ones((100, 2)), 100, np.random.default_rng(3))
    assert np.all(half[..., 0] > 0.0)
    assert half[20:, :, 0].mean() == pytest.approx(np.sqrt(2.0 / np.pi), abs=0.03)


def test_samples_that_remember_are_worth_less():
    """An autoregression x' = 0.8 x + e, whose autocorrelation time is 1.8 / 0.2 = 9; independent samples; walkers that never move."""
    walkers = np.stack([lfilter([1.0], [1.0, -0.8], RNG.standard_normal((4000, 10)), axis=0), RNG.standard_normal((4000, 10))], axis=-1)
    np.testing.assert_allclose(effective(walkers), [40_000 / 9.0, 40_000], rtol=0.2)
    assert effective(np.tile(RNG.standard_normal((1, 10, 1)), (500, 1, 1)))[0] < 12.0


def test_the_likelihood_of_a_table_is_a_normal_density():
    """Against scipy's multivariate normal of each group of three, up to the constant of the normal distribution."""
    observed = np.exp(RNG.normal(size=(4, 6)))
    prediction = Prediction(RNG.normal(size=(2, 4, 6)), RNG.uniform(0.01, 0.1, (2, 4, 6)))
    wrong = np.array([[0.2, 0.1], [0.05, 0.3]])
    expected = [
        sum(
            multivariate_normal(
                prediction.mean[n, f, g], np.diag(prediction.variance[n, f, g] + wrong[n, 1] ** 2) + wrong[n, 0] ** 2
            ).logpdf(np.log(observed)[f, g])
            for f in range(4)
            for g in (slice(0, 3), slice(3, 6))
        )
        for n in range(2)
    ]
    found = log_likelihood(observed, prediction, wrong) - 12.0 * np.log(2.0 * np.pi)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_the_mean_of_ten_lognormal_trials():
    """Their logarithm's mean and variance from those of the mean of two, by drawing them; and the scatter that pairs tell."""
    drawn = np.exp(0.3 * RNG.standard_normal((100_000, 12)))
    two, ten = np.log(drawn[:, :2].mean(axis=1)), np.log(drawn[:, 2:].mean(axis=1))
    found = _of_ten(np.array(two.mean()), np.array(0.0), np.array(0.09))
    assert found.mean == pytest.approx(ten.mean(), abs=2e-3)
    assert found.variance == pytest.approx(ten.var(), rel=0.06)
    plane = _plane(np.zeros((100_000, 1)), drawn[:, :2, None])
    assert np.exp(plane[0]) == pytest.approx(0.09, rel=0.03)


def test_an_emulator_finds_the_scale_of_the_table():
    """Made-up flights whose residuals are those printed, times a power of two causes."""
    shares = RNG.random((40, len(causes.NAMES)))
    factor = np.exp(0.5 * (shares[:, 0] - 0.5) - 0.3 * (shares[:, 5] - 0.5))
    scatter = np.exp(0.02 * RNG.standard_normal((40, 2, 4, 7)))
    emulator: Emulator = emulate(3, shares, printed()[3] * factor[:, None, None, None] * scatter)
    middle = np.full((2, len(causes.NAMES)), 0.5)
    middle[1, 0] = 0.9
    found = predict(emulator, middle).mean
    np.testing.assert_allclose(found[0], np.log(printed()[3][:, [0, 1, 2, 4, 5, 6]]), atol=0.03)
    np.testing.assert_allclose(found[1] - found[0], 0.2, atol=0.03)


def test_causes_are_uniform_in_their_coordinate():
    """A quarter and three quarters of the range by hand; the inverse; the priors' ends."""
    gyro, share = causes.CAUSES[0], causes.CAUSES[14]
    assert gyro.of_share(np.array(0.5)) == pytest.approx(np.sqrt(2.0 * 14.0))
    assert share.of_share(np.array(0.25)) == pytest.approx(0.725)
    for cause in causes.CAUSES:
        places = np.array([0.0, 0.3, 1.0])
        np.testing.assert_allclose(cause.of_share(places)[[0, 2]], [cause.low, cause.high])
        np.testing.assert_allclose(cause.share_of(cause.of_share(places)), places, atol=1e-12)


def test_a_point_of_the_design_is_flown_as_a_scenario_would_be(monkeypatch: pytest.MonkeyPatch) -> None:
    """References and voltages that differ within a batch: bit for bit what each point's own scenario gives."""
    chosen = flights.scenario_at

    def short(table: int, share: Array) -> Scenario:
        """Two seconds, wheels of 1500 rpm at most that already run at 1400."""
        start = StartSettings(wheel_speed_rad_s=(1400 * RPM,) * 4)
        one = chosen(table, share)
        return one.model_copy(update={"run": one.run.model_copy(update={"ticks": 20}), "faults": (), "start": start})

    monkeypatch.setattr(flights, "scenario_at", short)
    shares = flights.sobol(2)[:2]
    shares[1, causes.NAMES.index("top speed of the wheels")] = 0.0
    found = flights.fly(0, shares, 8, 2)
    for point, numbers in enumerate((np.array([8, 9]), np.array([10, 11]))):
        scenario = short(0, shares[point])
        rows = {(m.subject, m.metric): m.values for m in one_body.evaluate(run(build(scenario, numbers)), assembly_of(scenario))}
        for f, name in enumerate(flights.FILTERS):
            for s, state in enumerate(flights.STATES):
                np.testing.assert_array_equal(found[point, :, f, s], rows[name, f"rmse_residual_{state}"])


def test_the_scenarios_fly_what_is_listed():
    """Every key that a cause stands for, to the two digits that docs/as-flown.toml gives; the covariance is one."""
    listed = tomllib.loads((Path(__file__).parents[1] / "docs" / "as-flown.toml").read_text(encoding="utf-8"))
    values = {one["name"]: one["scenarios"] for one in listed["parameters"]}
    assert tuple(values) == causes.NAMES
    for table, case in enumerate(causes.TABLES):
        flown, wanted = (load(f"nacs/as-flown/{case}", keys) for keys in ({}, causes.settings(table, values)))
        assert isinstance(flown, Scenario)
        assert isinstance(wanted, Scenario)
        for section in ("plant", "sensors", "reference"):
            compare(getattr(flown, section).model_dump(), getattr(wanted, section).model_dump())
        for one, other in zip(flown.faults, wanted.faults, strict=True):
            compare(one.model_dump(), other.model_dump())
    covariance = np.array(listed["covariance"]["places"])
    np.testing.assert_allclose(covariance, covariance.T, atol=1e-9)
    assert np.all(np.linalg.eigvalsh(covariance) > -1e-4)


def compare(one: Any, other: Any) -> None:
    """Numbers to 2 %, all else the same."""
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for key, value in one.items():
            compare(value, other[key])
    elif isinstance(one, list | tuple):
        for value, wanted in zip(one, other, strict=True):
            compare(value, wanted)
    else:
        assert one == (pytest.approx(other, rel=0.02) if isinstance(one, float) else other)


def test_pairs_of_filters_in_the_order_of_print():
    """Of six pairs five differ by more than 6 %; the last two of the sums are the wrong way round."""
    assert pairs_in_order(np.array([1.0, 2.0, 4.0, 3.0]), np.array([1.0, 1.05, 2.0, 3.0])) == (4, 5, ["nis-windowed < nis-fading"])
