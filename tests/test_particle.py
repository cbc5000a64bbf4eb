"""The particle filter against the Kalman filter, against itself in other company, and on a body without rate gyro."""

import numpy as np
import pytest

from estimation.extended_kalman import ExtendedFilter
from estimation.particle import Draws, ParticleBelief, ParticleFilter, moments
from estimation.proposals import PROPOSALS, Bootstrap, ConstantNoise, MatchedNoise, Optimal
from estimation.resampling import SCHEMES, multinomial
from estimation.scale_mixture import ScaleMixture
from estimation.state_space import Additive, Euclidean, Multiplicative, Signed
from models.attitude.quaternion import IDENTITY, angle
from models.dynamics.process import Linearization, runge_kutta
from models.dynamics.rigid_body import RigidBody
from models.dynamics.vector_part_measurement import VectorPart

# extended and unscented are the optimal one where a reading is linear, which tests/test_measurement.py holds
DENSITIES = {name: PROPOSALS[name] for name in ("bootstrap", "optimal", "likelihood")}
every_proposal = pytest.mark.parametrize("proposal", DENSITIES.values(), ids=DENSITIES.keys())

# a linear system whose Kalman filter is exact -------------------------------------------------------------------------------------

A, B = np.array([[0.0, 1.0, 0.0], [-2.0, -0.3, 1.0], [0.0, 0.0, -0.5]]), np.array([[0.0], [1.0], [0.5]])
Q = np.array([[0.02, 0.005, 0.0], [0.005, 0.05, 0.01], [0.0, 0.01, 0.03]])
R = np.array([[0.04, 0.01, 0.0], [0.01, 0.09, 0.0], [0.0, 0.0, 0.06]])


class Linear:
    """dx/dt = A x + B u."""

    def derivative(self, state, command):
        return (A @ state[..., None] + B @ command[..., None])[..., 0]

    def linearize(self, state, command):
        return Linearization(self.derivative(state, command), np.broadcast_to(A, (*state.shape, 3)))


def draws(trials: int, particles: int, size: int, seed: int = 0):
    """Random numbers of one step after another."""
    rng = np.random.default_rng(seed)
    while True:
        shape = trials, particles, size
        yield Draws(rng.standard_normal(shape), rng.random(shape[:2]), rng.standard_normal(shape))


def linear_readings(ticks: int, trials: int, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Commands (ticks, trials, 1) and readings (ticks, trials, 3) of the system with its own noise; some are missing."""
    rng = np.random.default_rng(seed)
    state, command, reading = rng.standard_normal((trials, 3)), rng.standard_normal((ticks, trials, 1)), np.empty((ticks, trials, 3))
    for k in range(ticks):
        if k:
            state = runge_kutta(Linear(), state, command[k - 1], 0.1) + rng.standard_normal((trials, 3)) @ np.linalg.cholesky(Q).T
        reading[k] = state + rng.standard_normal((trials, 3)) @ np.linalg.cholesky(R).T
    reading[4, ::2] = np.nan
    reading[3:9, 1, 2] = np.nan
    return command, reading


def against_kalman(proposal, particles: int, trials: int = 24, ticks: int = 12, **settings):
    """Deviations of means (ticks, trials, 3) in Kalman's sigma, of covariances in its variances, of the total log-likelihood and of NIS.

    The last is the effective number of particles, (ticks, trials).
    """
    common = {"process": Linear(), "measurement_noise": R, "prior": np.zeros(3), "prior_variance": np.ones(3), "space": Euclidean()}
    kalman = ExtendedFilter(process_noise=Q, **common)
    cloud = ParticleFilter(process_noise=ConstantNoise.of(Q), particles=particles, proposal=proposal, **common, **settings)
    command, reading = linear_readings(ticks, trials)
    numbers = draws(trials, particles, 3)
    exact, belief = kalman.initial(reading[0]), cloud.initial(reading[0], next(numbers))
    mean, variance, surplus, nis, effective = [], [], np.zeros(trials), [], []
    for k in range(1, ticks):
        exact = kalman.step(exact, command[k - 1], reading[k], 0.1)
        belief = cloud.step(belief, command[k - 1], reading[k], 0.1, next(numbers))
        sigma = np.sqrt(np.diagonal(exact.covariance, axis1=-2, axis2=-1))
        mean.append((belief.mean - exact.mean) / sigma)
        variance.append((belief.covariance - exact.covariance) / (sigma[..., :, None] * sigma[..., None, :]))
        surplus += belief.log_likelihood - exact.log_likelihood
        nis.append(belief.nis - exact.nis)
        effective.append(belief.ess)
        np.testing.assert_array_equal(belief.dof, exact.dof)
    return np.array(mean), np.array(variance), surplus, np.array(nis), np.array(effective)


@every_proposal
def test_weights_sum_to_one_from_the_first_belief_on(proposal):
    filter_ = body_filter(proposal=proposal)
    for belief in tumble(filter_, 4, 3)[1]:
        np.testing.assert_allclose(np.sum(np.exp(belief.log_weights), axis=-1), 1.0, rtol=1e-12)
        np.testing.assert_allclose(belief.ess, 1.0 / np.sum(np.exp(2.0 * belief.log_weights), axis=-1), rtol=1e-9)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@every_proposal
def test_many_particles_are_kalmans_filter(proposal):
    mean, covariance, surplus, nis, effective = against_kalman(proposal, 10_000)
    scale = np.sqrt(effective)[..., None]  # errors in units of what the effective number alone would leave; resampling adds its own
    assert 0.8 < rms(mean * scale) < 1.7
    assert rms(covariance * scale[..., None]) < 1.5
    assert abs(mean.mean()) < 3 * rms(mean) / np.sqrt(24)  # no bias, were only the 24 trials independent
    assert rms(surplus) < 0.3
    assert rms(nis) < 0.12


@pytest.mark.parametrize("proposal", [Bootstrap(), Optimal()], ids=["bootstrap", "optimal"])  # here readings are worse than predictions
def test_errors_shrink_with_the_root_of_the_number_of_particles(proposal):
    few, many = against_kalman(proposal, 100), against_kalman(proposal, 6400)
    assert rms(few[0]) / rms(many[0]) == pytest.approx(8.0, rel=0.2)
    assert rms(few[1]) / rms(many[1]) == pytest.approx(8.0, rel=0.25)


def test_the_optimal_density_needs_fewer_particles():
    assert rms(against_kalman(Optimal(), 400)[0]) < 0.75 * rms(against_kalman(Bootstrap(), 400)[0])


@pytest.mark.parametrize("resampling", SCHEMES.values(), ids=SCHEMES.keys())
def test_every_scheme_keeps_the_belief(resampling):
    assert rms(against_kalman(Optimal(), 4000, resampling=resampling, threshold=1.0)[0]) < 0.05


def test_without_resampling_hardly_a_particle_counts_in_the_end():
    assert rms(against_kalman(Bootstrap(), 400, threshold=0.0)[0]) > 3 * rms(against_kalman(Bootstrap(), 400)[0])


def test_a_step_by_hand():
    """Two particles, one coordinate: weights, estimate and draws of the optimal density from Doucet et al. (2000, eq. 9-11)."""
    q, r, z = 0.5, 0.25, 1.0
    errors, normals = np.array([[0.2], [1.4]]), np.array([[0.3], [-1.0]])
    one = Optimal().propose(errors, np.array([z]), np.array([[np.sqrt(q)]]), np.array([[r]]), normals)
    spread = 1 / (1 / q + 1 / r)
    np.testing.assert_allclose(one[0], spread * (errors / q + z / r) + np.sqrt(spread) * normals)
    np.testing.assert_allclose(one[1], -0.5 * ((z - errors[:, 0]) ** 2 / (q + r) + np.log(2 * np.pi * (q + r))))
    two = Bootstrap().propose(errors, np.array([z]), np.array([[np.sqrt(q)]]), np.array([[r]]), normals)
    np.testing.assert_allclose(two[0], errors + np.sqrt(q) * normals)
    np.testing.assert_allclose(two[1], -0.5 * ((z - two[0][:, 0]) ** 2 / r + np.log(2 * np.pi * r)))


def test_weighted_moments():
    rng = np.random.default_rng(2)
    weights, errors = rng.dirichlet(np.ones(50), 4), rng.standard_normal((4, 50, 3))
    mean, covariance = moments(weights, errors)
    np.testing.assert_allclose(covariance[2], np.cov(errors[2].T, aweights=weights[2], ddof=0), rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(mean[2], np.average(errors[2], axis=0, weights=weights[2]), rtol=1e-12, atol=1e-15)


# a rigid body whose attitude alone is read ----------------------------------------------------------------------------------------

INERTIA = np.array([[20.0, 1.2, 0.9], [1.2, 17.0, 1.4], [0.9, 1.4, 15.0]])  # of the thesis; its filters believe the diagonal
BODY, MODEL = (RigidBody(inertia, np.eye(3), np.zeros((3, 0))) for inertia in (INERTIA, np.diag(np.diag(INERTIA))))
VECTOR = np.array([-0.6, 0.4, -0.2])
START = np.concatenate([VECTOR, [np.sqrt(1 - VECTOR @ VECTOR)], np.ones(3)])
PRINTED = ConstantNoise.of(1e-6 * np.eye(7))
NOISE = np.diag([1e-8] * 4 + [1.0] * 3)  # the rates are never read
TICK = 0.01
VECTOR = {"measurement_noise": None, "measurement": VectorPart(NOISE), "space": Signed()}


def body_filter(**settings) -> ParticleFilter:
    at_rest = {"prior": np.concatenate([IDENTITY, np.zeros(3)]), "prior_variance": np.repeat([1.0, 1e-6], [4, 3])}
    return ParticleFilter(**({"process": MODEL, "process_noise": PRINTED, "measurement_noise": NOISE} | at_rest | settings))


def tumble(filter_: ParticleFilter, ticks: int, trials: int, body=MODEL) -> tuple[np.ndarray, list[ParticleBelief]]:
    """True states (ticks, 7) of a body without torque from the thesis' start, and beliefs after readings of its attitude."""
    state, numbers, rng, path, beliefs = START, draws(trials, filter_.particles, filter_.size), np.random.default_rng(6), [], []
    for k in range(ticks):
        reading = np.full((trials, 7), np.nan)
        reading[:, :4] = state[:4] + 1e-4 * rng.standard_normal((trials, 4))
        reading[rng.random(trials) < 0.5] *= 1.0 if isinstance(filter_.space, Signed) else -1.0  # the same attitude
        if k == 0:
            beliefs.append(filter_.initial(reading, next(numbers)))
        else:
            beliefs.append(filter_.step(beliefs[-1], np.zeros((trials, 3)), reading, TICK, next(numbers)))
        path.append(state)
        state = runge_kutta(body, state[None], np.zeros(3), TICK)[0]
    return np.array(path), beliefs


def test_the_printed_bootstrap_leaves_one_particle_alive():
    """Deviations of 1e-3 in Q and 1e-4 in R (Rososhansky 2017, sec. 3.3): one particle in 1e4 is near the reading; the model is true."""
    truth, beliefs = tumble(body_filter(proposal=Bootstrap(), resampling=multinomial), 300, 8)
    assert np.median([b.ess for b in beliefs[1:]]) < 1.05
    assert np.median(angle(beliefs[-1].mean[:, :4], truth[-1, :4])) > 100 * 1e-4


def test_the_optimal_density_keeps_half_of_them_with_the_same_numbers():
    truth, beliefs = tumble(body_filter(resampling=multinomial), 300, 8)
    assert np.median([b.ess for b in beliefs[1:]]) > 40
    error = angle(np.array([b.mean[:, :4] for b in beliefs[100:]]), truth[100:, None, :4])
    assert rms(error) < 1e-3


def test_matched_noise_finds_the_rate_of_a_tumbling_body_in_spite_of_a_wrong_inertia():
    truth, beliefs = tumble(body_filter(process_noise=MatchedNoise()), 1500, 4, body=BODY)
    mean = np.array([b.mean for b in beliefs])
    rate = np.linalg.norm(mean[..., 4:] - truth[:, None, 4:], axis=-1)
    assert rms(rate[0]) > 1.7
    assert rms(rate[1000:]) < 0.06
    assert rms(angle(mean[1000:, :, :4], truth[1000:, None, :4])) < 6e-4
    np.testing.assert_allclose(np.linalg.norm(mean[1:, :, :4], axis=-1), 1.0, atol=1e-14)


def test_the_vector_part_alone_may_lock_onto_a_mirror_image():
    """With the fourth component unread half a radian and more of error explains the readings; with it read, none does."""
    truth, vector = tumble(body_filter(resampling=multinomial, **VECTOR), 600, 8)
    far = angle(vector[-1].mean[:, :4], truth[-1, :4])
    assert np.median(far) > 0.5
    assert vector[-1].dof.tolist() == [3.0] * 8
    truth, whole = tumble(body_filter(resampling=multinomial), 600, 8)
    assert angle(whole[-1].mean[:, :4], truth[-1, :4]).max() < 2e-3
    assert whole[-1].dof.tolist() == [3.0] * 8  # a unit quaternion's length says nothing


def test_a_missing_reading_only_predicts():
    filter_ = body_filter(threshold=0.0)
    _, beliefs = tumble(filter_, 20, 3)
    before, numbers = beliefs[-1], next(draws(3, 100, 7, seed=5))
    after = filter_.step(before, np.ones((3, 3)), np.full((3, 7), np.nan), TICK, numbers)
    moved = runge_kutta(MODEL, before.particles, np.ones(3), TICK)
    np.testing.assert_allclose(after.log_weights, before.log_weights, atol=1e-13)
    np.testing.assert_array_equal([after.dof, after.nis, after.innovation.sum(-1)], np.zeros((3, 3)))
    np.testing.assert_allclose(after.log_likelihood, 0.0, atol=1e-13)
    np.testing.assert_allclose(after.particles[..., 4:], (moved + 1e-3 * numbers.normals)[..., 4:], atol=1e-13)
    np.testing.assert_allclose(after.elapsed, 20 * TICK)
    spread = moments(np.exp(before.log_weights), (moved + 1e-3 * numbers.normals)[..., 4:])[1]
    np.testing.assert_allclose(after.covariance[:, 4:, 4:], spread, rtol=1e-9)


def test_matched_noise():
    mean = np.zeros((3, 7))
    mean[1, 4:], mean[2, 4:] = 1.0, [0.5, 0.0, 0.0]
    root = MatchedNoise(attitude=3e-5).root(mean, np.array([0.0, 50.0, 2.0]))
    np.testing.assert_allclose(np.diagonal(root, axis1=-2, axis2=-1)[:, [0, 4]], [[3e-5, np.hypot(2e-3, s)] for s in (1e-2, 3e-2, 2.5e-3)])
    np.testing.assert_array_equal(root, root * np.eye(7))


def test_a_singular_process_noise_has_a_root():
    covariance = np.diag([0.0, 0.0, 4.0]) + np.ones((3, 3))
    root = ConstantNoise.of(covariance).root(np.zeros(3), np.zeros(()))
    np.testing.assert_allclose(root @ root.T, covariance, atol=1e-14)


def test_roughening_moves_copies_apart_and_in_the_resampled_trials_alone():
    settings = {"threshold": 0.9, "process_noise": ConstantNoise(np.zeros((7, 7))), "proposal": Bootstrap()}
    plain, rough = body_filter(**settings), body_filter(roughening=0.2, **settings)
    belief = tumble(plain, 1, 2)[1][-1]
    heavy = np.log(np.concatenate([np.full(10, 0.0999), np.full(90, 0.001 / 90)]))
    belief = belief._replace(log_weights=np.stack([heavy, belief.log_weights[1]]), ess=np.array([10.0, 100.0]))
    numbers, nothing = next(draws(2, 100, 7, seed=9)), np.full((2, 7), np.nan)
    copies, jittered = (f.step(belief, np.zeros((2, 3)), nothing, TICK, numbers).particles for f in (plain, rough))
    assert len(np.unique(copies[0, :, 4])) < 15
    assert len(np.unique(jittered[0, :, 4])) == 100
    np.testing.assert_array_equal(jittered[1], copies[1])
    jitter = np.sort(np.ptp(copies[0, :, 4:], axis=0)) * 0.2 * 100 ** (-1 / 7)
    np.testing.assert_allclose(np.sort((jittered - copies)[0, :, 4:].std(axis=0)), jitter, rtol=0.3)
    with pytest.raises(ValueError, match=r"Draws\.jitter"):
        rough.step(belief, np.zeros((2, 3)), nothing, TICK, numbers._replace(jitter=None))


@pytest.mark.parametrize("size", [1, 3, 10])
@pytest.mark.parametrize(
    "settings",
    [
        {"resampling": SCHEMES["multinomial"], "proposal": Bootstrap()},
        {"resampling": SCHEMES["residual"], "roughening": 0.1},
        {"resampling": SCHEMES["stratified"], "process_noise": MatchedNoise(), "particles": 333},
        {"resampling": SCHEMES["systematic"]} | VECTOR,
        {"space": Multiplicative(), "process_noise": ConstantNoise(1e-3 * np.eye(6)), "measurement_noise": np.diag([4e-8] * 3 + [1.0] * 3)},
    ],
    ids=["multinomial", "residual", "stratified", "systematic", "multiplicative"],
)
def test_a_trial_has_the_same_bits_in_any_batch(settings, size):
    if isinstance(settings.get("space"), Multiplicative):
        settings = settings | {"prior_variance": np.repeat([1.0, 1e-6], 3)}
    filter_, rng, trials = body_filter(**settings), np.random.default_rng(13), 64
    reading = np.full((12, trials, 7), np.nan)
    reading[..., :4] = START[:4] + 1e-3 * rng.standard_normal((12, trials, 4))
    reading[5, ::3] = np.nan
    reading[7, ::4, 5] = 1.0
    numbers = [n for n, _ in zip(draws(trials, filter_.particles, filter_.size, seed=14), range(12), strict=False)]

    def fly(some: slice, lead: tuple[int, ...] = ()) -> ParticleBelief:
        own = [Draws(*(None if part is None else part[some] for part in n)) for n in numbers]
        belief = filter_.initial(reading[0, some].reshape(*lead, -1, 7), own[0])
        for k in range(1, 12):
            belief = filter_.step(belief, np.full((*lead, 1, 3), 0.1), reading[k, some].reshape(*lead, -1, 7), TICK, own[k])
        return belief

    everyone = fly(slice(None))
    assert not np.isnan(everyone.mean).any()
    for first in (0, 37, trials - size):
        some = slice(first, first + size)
        alone = fly(some, (1,))  # as the only member of a bank
        for part in ("mean", "covariance", "particles", "log_weights", "ess", "nis", "log_likelihood"):
            np.testing.assert_array_equal(getattr(alone, part)[0], getattr(everyone, part)[some], err_msg=part)


@pytest.mark.parametrize("wrong", [{"particles": 1}, {"threshold": 1.5}, {"roughening": -0.1}, VECTOR | {"space": Multiplicative()}])
def test_settings_that_cannot_work_are_refused(wrong):
    with pytest.raises(ValueError, match="need"):
        body_filter(**wrong)
    assert isinstance(body_filter().space, Additive)


def test_a_deterministic_schedule_resamples_every_so_many_steps_whatever_the_weights():
    """Every third step: nothing is read but at first, so that weights stay what they are until they are made equal."""
    settings = {"process": Linear(), "measurement_noise": R, "prior": np.zeros(3), "prior_variance": np.ones(3), "space": Euclidean()}
    common = {"process_noise": ConstantNoise.of(Q), "particles": 50, "proposal": Bootstrap(), "threshold": 1.0}
    filter_, numbers = ParticleFilter(**settings, **common, every=3), draws(2, 50, 3)
    nothing = np.full((2, 3), np.nan)
    belief = filter_.initial(np.zeros((2, 3)), next(numbers))
    few = []
    for k in range(1, 8):
        belief = filter_.step(belief, np.zeros((2, 1)), np.full((2, 3), 0.5) if k in (1, 5) else nothing, 0.1, next(numbers))
        few.append(bool((belief.ess < 49.0).all()))
    assert few == [True, True, True, False, True, True, False]
    np.testing.assert_array_equal(belief.steps, 7)
    with pytest.raises(ValueError, match="every = -1"):
        ParticleFilter(**settings, **common, every=-1)


def test_a_mixture_is_not_drawn_by_a_density_whose_weights_depend_on_what_was_drawn():
    settings = {"process": Linear(), "measurement_noise": R, "prior": np.zeros(3), "prior_variance": np.ones(3), "space": Euclidean()}
    mixture = ScaleMixture(np.array([0.9, 0.1]), np.array([0.5, 2.0]))
    with pytest.raises(ValueError, match="its weights depend on what was drawn"):
        ParticleFilter(**settings, process_noise=ConstantNoise.of(Q), proposal=PROPOSALS["likelihood"], mixture=mixture)
