"""How often particles are copied: the expected counts of the textbook, their variances, and the same copies whatever the batch."""

import numpy as np
import pytest

from estimation.gaussian import LostDefiniteness
from estimation.resampling import SCHEMES, effective_sample_size, multinomial, normalize, pick, residual, stratified, systematic

every_scheme = pytest.mark.parametrize("scheme", SCHEMES.values(), ids=SCHEMES.keys())
SKEWED = np.array([0.31, 0.02, 0.0, 0.17, 0.05, 0.0, 0.25, 0.2])  # two of them can never be drawn


def counts(scheme, weights: np.ndarray, repeats: int = 40_000, seed: int = 3) -> np.ndarray:
    """How often each of the particles (P,) was copied in independent trials, (repeats, P)."""
    uniforms = np.random.default_rng(seed).random((repeats, len(weights)))
    chosen = scheme(np.broadcast_to(weights, uniforms.shape), uniforms)
    return np.sum(chosen[..., None] == np.arange(len(weights)), axis=1)


@every_scheme
def test_on_the_average_copies_are_as_many_as_the_weights_say(scheme):
    found = counts(scheme, SKEWED)
    assert (found.sum(axis=1) == len(SKEWED)).all()
    mean, error = found.mean(axis=0), found.std(axis=0) / np.sqrt(len(found))
    assert (np.abs(mean - len(SKEWED) * SKEWED) <= 4.5 * error + 1e-12).all()  # one test in 1e4 fails by chance; the seed is fixed
    assert not found[:, SKEWED == 0.0].any()


def test_multinomial_copies_have_the_binomial_variance():
    variance = counts(multinomial, SKEWED).var(axis=0)
    np.testing.assert_allclose(variance, len(SKEWED) * SKEWED * (1 - SKEWED), rtol=0.05, atol=1e-12)


def test_the_schemes_scatter_less_and_less():
    """Douc, Cappe & Moulines (2005, sec. 3): residual and stratified below multinomial; systematic within one of P w."""
    weights = np.random.default_rng(8).dirichlet(np.ones(20))
    total = {name: counts(scheme, weights).var(axis=0).sum() for name, scheme in SCHEMES.items()}
    assert total["systematic"] < total["stratified"] < 0.95 * total["residual"] < 0.95 * 0.95 * total["multinomial"]


def test_systematic_copies_are_within_one_of_what_the_weights_say():
    weights = np.random.default_rng(9).dirichlet(np.ones(30))
    found = counts(systematic, weights, 2000)
    assert (np.abs(found - 30 * weights) < 1.0).all()
    assert (np.abs(counts(stratified, weights, 2000) - 30 * weights) < 2.0).all()


def test_residual_copies_whole_parts_for_certain():
    found = counts(residual, SKEWED, 2000)
    assert (found >= np.floor(len(SKEWED) * SKEWED)).all()


@every_scheme
def test_equal_weights_and_a_single_heavy_particle_leave_no_choice(scheme):
    uniforms = np.random.default_rng(4).random((50, 8))
    single = np.zeros((50, 8))
    single[:, 5] = 1.0
    assert (scheme(single, uniforms) == 5).all()
    if scheme is not multinomial:
        np.testing.assert_array_equal(np.sort(scheme(np.full((50, 8), 0.125), uniforms)), np.tile(np.arange(8), (50, 1)))


@every_scheme
@pytest.mark.parametrize("size", [1, 3, 10, 64])
def test_a_trial_keeps_the_same_particles_in_any_batch(scheme, size):
    rng = np.random.default_rng(11)
    weights, uniforms = rng.dirichlet(np.full(101, 0.1), 1000), rng.random((1000, 101))
    everyone = scheme(weights, uniforms)
    for first in (0, 500, 1000 - size):
        np.testing.assert_array_equal(scheme(weights[first : first + size], uniforms[first : first + size]), everyone[first : first + size])
    np.testing.assert_array_equal(scheme(weights.reshape(4, 250, 101), uniforms.reshape(4, 250, 101)).reshape(1000, 101), everyone)


def test_places_are_looked_up_in_the_cumulated_weights():
    rng = np.random.default_rng(12)
    weights, places = rng.dirichlet(np.ones(40), 30), rng.random((30, 40))
    plain = [np.searchsorted(np.cumsum(w), p, side="right") for w, p in zip(weights, places, strict=True)]
    np.testing.assert_array_equal(pick(weights, places), plain)
    np.testing.assert_array_equal(pick(7.0 * weights, places), plain)
    ends = pick(np.tile([0.0, 0.5, 0.5, 0.0], (1, 1)), np.array([[0.0, 0.5, 1.0 - 2.0**-53, 0.25]]))
    np.testing.assert_array_equal(ends, [[1, 2, 2, 1]])


def test_the_effective_number_of_particles():
    np.testing.assert_allclose(effective_sample_size(np.log(np.full((2, 10), 0.1))), 10.0)
    np.testing.assert_allclose(effective_sample_size(np.array([0.0, -np.inf, -np.inf])), 1.0)
    np.testing.assert_allclose(effective_sample_size(np.log([0.5, 0.25, 0.25])), 1 / (0.25 + 0.125))


def test_log_weights_far_below_what_a_float_can_hold_are_normalised():
    log_weights, total = normalize(np.array([[-2000.0, -2000.0 + np.log(3.0)], [1000.0, 1000.0]]))
    np.testing.assert_allclose(np.exp(log_weights), [[0.25, 0.75], [0.5, 0.5]])
    np.testing.assert_allclose(total, [-2000.0 + np.log(4.0), 1000.0 + np.log(2.0)], rtol=1e-14)


@pytest.mark.parametrize("height", [-1e300, -3e16, -1e12, 0.0, 1e12, 3e16, 1e300])
def test_however_far_down_all_weights_are_equal_ones_are_one_in_fifty(height):
    log_weights, total = normalize(np.full((2, 50), height))
    np.testing.assert_allclose(np.exp(log_weights).sum(axis=-1), 1.0, rtol=1e-14)
    np.testing.assert_allclose(effective_sample_size(log_weights), 50.0, rtol=1e-14)
    np.testing.assert_allclose(total, height + np.log(50.0), rtol=1e-15)
    unequal, _ = normalize(height + np.array([0.0, -4.0]) * max(1.0, abs(height) * 1e-15))
    assert 1.0 <= effective_sample_size(unequal) <= 2.0


@pytest.mark.parametrize("worthless", [-np.inf, np.nan])
def test_particles_that_no_reading_can_come_from_are_no_belief(worthless):
    weights = np.zeros((3, 4, 5))
    weights[1, 2] = worthless
    with pytest.raises(LostDefiniteness, match="particles' weights") as lost:
        normalize(weights)
    assert lost.value.where == (1, 2)
    weights[1, 2, 0] = 0.0
    if np.isinf(worthless):
        assert effective_sample_size(normalize(weights)[0])[1, 2] == 1.0
