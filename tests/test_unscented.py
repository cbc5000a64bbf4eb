"""The unscented filter against independent libraries, the textbook's sums, its own noise, and broken covariances."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter
from scipy.integrate import quad_vec
from scipy.linalg import expm
from scipy.stats import chi2

from estimation.extended_kalman import ExtendedFilter
from estimation.gaussian import Belief, LostDefiniteness
from estimation.sigma_points import SigmaPoints, factor, repair
from estimation.state_space import Additive, Euclidean, Multiplicative
from estimation.unscented import UnscentedFilter, euler
from models.attitude.quaternion import IDENTITY, angle
from models.dynamics.process import Prediction, runge_kutta
from models.dynamics.rigid_body import RigidBody
from models.plants.nacs import NacsParameters

DT = 0.1
RNG = np.random.default_rng

# a linear world, where the Kalman filter is exact ------------------------------------------------------------------------------

A = np.array([[0.0, 1.0, 0.0, 0.0], [-4.0, -0.3, 0.0, 0.1], [0.2, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, -0.5]])
B = np.array([[0.0], [1.0], [0.0], [0.5]])
_BLOCK = expm(DT * np.block([[A, B], [np.zeros((1, 5))]]))
PHI, GAMMA = _BLOCK[:4, :4], _BLOCK[:4, 4:]
Q = np.diag([1e-8, 4e-6, 1e-9, 1e-6]) + 1e-9
R = np.diag([1e-4, 4e-4, 1e-2, 1e-5])
R[0, 1] = R[1, 0] = 5e-5
LINEAR = {"process": None, "process_noise": Q, "measurement_noise": R, "prior": np.zeros(4), "prior_variance": np.ones(4)}


def exactly(process, state, command, dt):
    return (PHI @ state[..., None] + GAMMA @ command[..., None])[..., 0]


def with_transition(process, state, command, dt):
    return Prediction(exactly(process, state, command, dt), np.broadcast_to(PHI, (*state.shape[:-1], 4, 4)))


def linear_run(steps: int, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Commands (steps, 1) and readings (steps, 4) of a system with the filter's own noise."""
    rng, truth, readings = RNG(seed), np.array([1.0, 0.0, 0.0, 0.2]), np.empty((steps, 4))
    command, process, sensor = rng.normal(0, 1, (steps, 1)), *(rng.multivariate_normal(np.zeros(4), S, steps) for S in (Q, R))
    for k in range(steps):
        readings[k] = truth + sensor[k]
        truth = exactly(None, truth, command[k], DT) + process[k]
    return command, readings


@pytest.mark.parametrize(("alpha", "kappa"), [(1e-2, 0.0), (0.1, 0.0), (1.0, 0.0), (0.5, 3.0)])
def test_on_a_linear_model_it_is_the_kalman_filter(alpha, kappa):
    command, readings = linear_run(500)
    ours = UnscentedFilter(**LINEAR, space=Euclidean(), alpha=alpha, kappa=kappa, integrate=exactly)
    extended = ExtendedFilter(**LINEAR, space=Euclidean(), prediction=with_transition)
    theirs = KalmanFilter(4, 4, 1)
    theirs.F, theirs.B, theirs.H, theirs.Q, theirs.R = PHI, GAMMA, np.eye(4), Q, R
    theirs.x, theirs.P = readings[0][:, None], R.copy()
    belief, linearized = ours.initial(readings[0]), extended.initial(readings[0])
    for k in range(1, 500):
        belief = ours.step(belief, command[k - 1], readings[k], DT)
        linearized = extended.step(linearized, command[k - 1], readings[k], DT)
        theirs.predict(command[k - 1][:, None])
        theirs.update(readings[k][:, None])
        for mean, covariance in ((theirs.x[:, 0], theirs.P), (linearized.mean, linearized.covariance)):
            np.testing.assert_allclose(belief.mean, mean, atol=1e-9)
            np.testing.assert_allclose(belief.covariance, covariance, atol=1e-12)  # of 1e-4
        np.testing.assert_allclose(belief.log_likelihood, theirs.log_likelihood, atol=1e-7)
    assert belief.lost == 0


@pytest.mark.parametrize("family", [ExtendedFilter, UnscentedFilter])
def test_noise_before_the_step_goes_through_the_model(family):
    """Half before, half after: Phi (P + Q/2) Phi' + Q/2, which for rates and angles is right up to the third order of the time."""
    how = {"prediction": with_transition} if family is ExtendedFilter else {"integrate": exactly}
    ours = family(**LINEAR | {"process_noise": 0.5 * Q, "process_noise_before": 0.5 * Q}, space=Euclidean(), **how)
    before = ours.initial(np.array([1.0, 0.0, 0.0, 0.2]))
    ahead = ours.step(before, np.zeros(1), np.full(4, np.nan), DT).covariance
    np.testing.assert_allclose(ahead, PHI @ (R + 0.5 * Q) @ PHI.T + 0.5 * Q, rtol=1e-9, atol=1e-16)
    exact = quad_vec(lambda t: expm(A * t) @ (Q / DT) @ expm(A * t).T, 0.0, DT)[0]  # white noise of density Q / DT
    spread = ahead - PHI @ R @ PHI.T
    assert spread[0, 1] == pytest.approx(exact[0, 1], rel=0.04)  # the square of frequency times step
    assert Q[0, 1] < 0.1 * exact[0, 1]  # what a Q at the end alone knows of it


def test_on_a_linear_model_it_is_filterpys_unscented_filter():
    command, readings = linear_run(200)
    ours = UnscentedFilter(**LINEAR, space=Euclidean(), integrate=exactly)
    follow_filterpy(ours, readings, command, lambda x, dt, u: exactly(None, x, u, dt), 1e-9)


def follow_filterpy(ours: UnscentedFilter, readings, command, move, tolerance: float) -> None:
    """Step both; filterpy redraws its points with Q in them and sums with a negative central weight."""
    n, points = readings.shape[-1], MerweScaledSigmaPoints(readings.shape[-1], ours.alpha, ours.beta, ours.kappa)
    theirs = UnscentedKalmanFilter(n, n, DT, hx=lambda x: x, fx=move, points=points)
    belief = ours.initial(readings[0])
    theirs.x, theirs.P, theirs.Q, theirs.R = belief.mean.copy(), belief.covariance.copy(), ours.process_noise, ours.measurement_noise
    for k in range(1, len(readings)):
        belief = ours.step(belief, command[k - 1], readings[k], DT)
        theirs.predict(u=command[k - 1])
        theirs.update(readings[k])
        np.testing.assert_allclose(belief.mean, theirs.x, atol=tolerance)
        np.testing.assert_allclose(belief.covariance, theirs.P, atol=tolerance * np.abs(theirs.P).max())


class Pendulum:
    """Three states, strongly nonlinear: angle, rate and gravity."""

    def derivative(self, state, command):
        return np.stack([state[..., 1], -state[..., 2] * np.sin(state[..., 0]) + command[..., 0], np.zeros(state.shape[:-1])], axis=-1)


def test_on_a_nonlinear_model_it_is_filterpys_unscented_filter():
    rng = RNG(3)
    readings, command = rng.normal([1.0, 0.0, 9.8], [1.0, 1.0, 0.5], (60, 3)), rng.normal(0, 1, (60, 1))
    ours = UnscentedFilter(
        Pendulum(), np.diag([1e-3, 1e-2, 1e-3]), np.diag([1.0, 1.0, 0.3]), np.zeros(3), np.ones(3), space=Euclidean(), alpha=0.7
    )
    follow_filterpy(ours, readings, command, lambda x, dt, u: runge_kutta(Pendulum(), x, u, dt), 1e-9)


# sigma points ------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("alpha", "beta", "kappa"), [(0.1, 2.0, 0.0), (1.0, 0.0, 0.0), (1e-2, 2.0, 0.0), (0.7, 1.0, 3.0)])
def test_moments_about_the_central_point_are_the_textbooks_weighted_sums(alpha, beta, kappa):
    rng, n = RNG(1), 7
    errors = rng.normal(size=(5, 2 * n, n))
    mean, covariance = SigmaPoints(alpha, beta, kappa).moments(errors)
    spread = alpha**2 * (n + kappa)
    weights = np.full(2 * n + 1, 0.5 / spread)
    weights[0] = 1.0 - n / spread
    points = np.concatenate([np.zeros((5, 1, n)), errors], axis=1)
    expected = np.einsum("k,...ki->...i", weights, points)
    weights[0] += 1.0 - alpha**2 + beta
    apart = points - expected[:, None]
    np.testing.assert_allclose(mean, expected, rtol=1e-9, atol=1e-9 / alpha**2)
    np.testing.assert_allclose(covariance, np.einsum("k,...ki,...kj->...ij", weights, apart, apart), rtol=1e-9, atol=1e-9 / alpha**4)
    assert (np.linalg.eigvalsh(covariance)[:, 0] > -1e-12 * np.linalg.eigvalsh(covariance)[:, -1]).all()  # however far it is from linear


@pytest.mark.parametrize("points", [SigmaPoints(), SigmaPoints(1.0, 2.0, 1.0)])
def test_points_have_the_moments_that_they_were_drawn_from(points):
    root = np.linalg.cholesky(np.cov(RNG(2).normal(size=(7, 30))))
    offsets = points.offsets(root)
    np.testing.assert_array_equal(offsets[0], 0.0)
    mean, covariance = points.moments(offsets[1:])
    np.testing.assert_allclose(mean, 0.0, atol=1e-14)
    np.testing.assert_allclose(covariance, root @ root.T, rtol=1e-12, atol=1e-14)


def test_the_mean_of_a_square_is_exact():
    """E x^2 = m^2 + P, for which the linearised mean m^2 is wrong by P."""
    root = np.linalg.cholesky(np.diag([4.0, 0.25]))
    points = np.array([3.0, -1.0]) + SigmaPoints().offsets(root)
    mean, _ = SigmaPoints().moments((points**2 - points[0] ** 2)[1:])
    np.testing.assert_allclose(points[0] ** 2 + mean, [13.0, 1.25], rtol=1e-12)


@pytest.mark.parametrize("settings", [{"alpha": 0.0}, {"beta": -1.0}, {"kappa": -4.0}, {"alpha": np.nan}])
def test_settings_that_can_turn_a_covariance_negative_are_refused(settings):
    with pytest.raises(ValueError, match="need alpha > 0, beta >= 0, kappa >= 0"):
        UnscentedFilter(**LINEAR, **settings)


# attitude ----------------------------------------------------------------------------------------------------------------------

NACS = NacsParameters()
AXES = NACS.wheel_axes
BODY = RigidBody(NACS.inertia, -AXES, AXES * NACS.wheel_inertia_kg_m2)
SPACE = Multiplicative()
NOISE, SENSOR = np.array([1e-8, 1e-6]), np.array([2.5e-4, 1e-4])  # per quaternion component and rate: a reading is 1.8 deg off


def attitude_filter(kind=UnscentedFilter, multiplicative=True, noise=NOISE, sensor=SENSOR, process=BODY, **settings):
    """A rotation vector is twice a quaternion's vector part."""
    counts, unit = ([3, 3], np.array([4.0, 1.0])) if multiplicative else ([4, 3], np.ones(2))
    return kind(
        process=process,
        process_noise=np.diag(np.repeat(unit * noise, counts)),
        measurement_noise=np.diag(np.repeat(unit * sensor, counts)),
        prior=np.concatenate([IDENTITY, np.zeros(3)]),
        prior_variance=np.repeat([1.0, 0.3], counts),
        space=SPACE if multiplicative else Additive(),
        **settings,
    )


def flight(trials: int, steps: int, seed: int = 0, size: float = 1.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """True states and readings (steps, trials, 7), inputs with wheel speeds (steps, trials, 8), `size` times the filter's noise."""
    rng, sigma = RNG(seed), [size * np.sqrt(np.repeat([4.0, 1.0] * v, 3)) for v in (NOISE, SENSOR)]
    level = np.broadcast_to(np.concatenate([IDENTITY, np.zeros(3)]), (trials, 7))
    state = SPACE.displace(level, rng.normal(0, np.repeat([1.0, 0.5], 3), (trials, 6)))
    speed = np.broadcast_to(rng.normal(0, 100.0, (trials, 4)), (steps, trials, 4))
    command = np.concatenate([rng.normal(0, 2e-3, (steps, trials, 4)), speed], axis=-1)
    truth, readings = np.empty((2, steps, trials, 7))
    for k in range(steps):
        truth[k], readings[k] = state, SPACE.displace(state, sigma[1] * rng.standard_normal((trials, 6)))
        state = SPACE.displace(runge_kutta(BODY, state, command[k], DT), sigma[0] * rng.standard_normal((trials, 6)))
    return truth, readings, command


def watch(observer, readings, command) -> list[Belief]:
    beliefs = [observer.initial(readings[0])]
    for k in range(1, len(readings)):
        beliefs.append(observer.step(beliefs[-1], command[k - 1], readings[k], DT))
    return beliefs


def of(belief: Belief, which) -> list[np.ndarray]:
    return [part[which] for part in (*belief[:6], belief.detection.statistic, belief.detection.declared, belief.lost)]


def same(left: list[np.ndarray], right: list[np.ndarray]) -> bool:
    return len(left) == len(right) and all(np.array_equal(a, b, equal_nan=True) for a, b in zip(left, right, strict=True))


KINDS = {
    "additive": attitude_filter(multiplicative=False),
    "multiplicative": attitude_filter(),
    "euler": attitude_filter(integrate=euler),
}
every_kind = pytest.mark.parametrize("observer", KINDS.values(), ids=KINDS.keys())


@pytest.mark.parametrize("alpha", [0.1, 1.0])
@pytest.mark.parametrize("seen", [7, 4], ids=["all measured", "rates never measured"])
def test_the_multiplicative_filter_is_consistent_in_a_world_of_its_own_noise(alpha, seen):
    """Sums of chi-square numbers lie in their own 99.9 % interval: innovations in time, errors across trials."""
    trials, steps = 100, 60
    truth, readings, command = flight(trials, steps)
    rng = RNG(9)
    readings[..., seen:] = np.nan
    observer = attitude_filter(alpha=alpha)
    belief = observer.initial(readings[0])
    if seen < 7:  # the prior of the rates is true, too
        belief.mean[:, 4:] = truth[0, :, 4:] + rng.normal(0, np.sqrt(0.3), (trials, 3))
    nis, early = 0.0, []
    for k in range(1, steps):
        belief = observer.step(belief, command[k - 1], readings[k], DT)
        nis += belief.nis.sum()
        error = SPACE.difference(truth[k], belief.mean)
        early.append(np.einsum("ti,ti->", error, np.linalg.solve(belief.covariance, error[..., None])[..., 0]))
    dof = 6 * trials
    assert chi2.ppf(5e-4, dof) < early[-1] < chi2.isf(5e-4, dof)
    read = (3 if seen == 4 else 6) * trials * (steps - 1)
    assert chi2.ppf(5e-4, read) < nis < chi2.isf(5e-4, read)
    np.testing.assert_array_equal(belief.lost, 0.0)


def test_all_filters_of_attitude_agree_to_second_order_in_the_noise():
    apart = []
    for size in (2e-2, 1e-2, 5e-3):
        _, readings, command = flight(4, 30, seed=5, size=size)
        noise = {"noise": size**2 * NOISE, "sensor": size**2 * SENSOR}
        reference = watch(attitude_filter(ExtendedFilter, **noise), readings, command)[-1].mean
        others = (attitude_filter(multiplicative=flag, **noise) for flag in (True, False))
        apart.append([np.abs(SPACE.difference(watch(one, readings, command)[-1].mean, reference)).max() for one in others])
    assert np.max(apart[0]) < 2e-6  # of readings that are 6e-4 off
    assert (np.diff(np.log2(apart), axis=0) < -1.7).all()  # half the noise: a quarter of the distance


def test_far_from_linear_the_unscented_prediction_is_nearer_to_the_truth():
    """Brute force: a hundred thousand samples; an uncertain rate turns the attitude for 2 s."""
    rng = RNG(4)
    spread = np.repeat([0.1, 0.3], 3)
    mean = np.concatenate([IDENTITY, [0.5, -0.4, 0.6]])
    samples = SPACE.displace(np.broadcast_to(mean, (100_000, 7)), rng.normal(0, spread, (100_000, 6)))
    command, still = np.zeros(8), np.full(7, np.nan)
    for _ in range(20):
        samples = runge_kutta(BODY, samples, command, DT)
    wrong = {}
    for kind in (ExtendedFilter, UnscentedFilter):
        observer = attitude_filter(kind, noise=np.zeros(2))
        belief = observer.initial(mean)._replace(covariance=np.diag(spread**2))
        for _ in range(20):
            belief = observer.step(belief, command, still, DT)
        errors = SPACE.difference(samples, belief.mean)
        wrong[kind] = np.linalg.norm(errors.mean(axis=0)), np.linalg.norm(belief.covariance - np.cov(errors.T))
    assert wrong[UnscentedFilter][0] < 0.5 * wrong[ExtendedFilter][0]
    assert wrong[UnscentedFilter][1] < wrong[ExtendedFilter][1]


@every_kind
def test_a_trial_is_the_same_to_the_bit_in_any_batch(observer):
    _, readings, command = flight(64, 20)
    readings[5, 7], readings[8:, 3, 4:] = np.nan, np.nan
    among = watch(observer, readings, command)
    for company in ([3], [1, 3, 7], list(range(10))):
        alone = watch(observer, readings[:, company], command[:, company])
        assert all(same(of(a, company), of(b, slice(None))) for a, b in zip(among, alone, strict=True))
    single = watch(observer, readings[:, 3], command[:, 3])  # no batch axis at all
    np.testing.assert_array_equal(single[-1].mean, among[-1].mean[3])


@every_kind
def test_a_wholly_missing_reading_only_predicts_and_only_in_that_trial(observer):
    _, readings, command = flight(6, 12)
    silent, others = readings.copy(), np.arange(6) != 2
    silent[8, 2] = np.nan
    before, missed = watch(observer, readings, command)[7:], watch(observer, silent, command)[7:]
    assert all(same(of(a, others), of(b, others)) for a, b in zip(before, missed, strict=True))
    assert (missed[1].nis[2], missed[1].dof[2], missed[1].log_likelihood[2]) == (0.0, 0.0, 0.0)
    ahead = observer.integrate(BODY, before[0].mean[2], command[7, 2], DT)
    assert angle(missed[1].mean[2, :4], ahead[:4]) < 1e-3  # second order in 1 deg of uncertainty
    assert (np.diag(missed[1].covariance[2]) > np.diag(before[1].covariance[2])).all()


def test_rates_that_are_never_measured_are_found():
    truth, readings, command = flight(8, 100)
    readings[..., 4:] = np.nan
    for observer in (KINDS["additive"], KINDS["multiplicative"]):
        beliefs = watch(observer, readings, command)
        wrong = np.abs(beliefs[-1].mean[:, 4:] - truth[-1, :, 4:]).max()
        assert wrong < 5 * np.sqrt(beliefs[-1].covariance[:, -3:, -3:].diagonal(axis1=-2, axis2=-1).max())
        assert wrong < 0.1  # from 0.5 rad/s
        np.testing.assert_array_equal(beliefs[-1].innovation[:, -3:], 0.0)


@every_kind
def test_a_quaternion_reading_of_either_sign_says_the_same(observer):
    _, readings, command = flight(3, 20)
    flipped = readings.copy()
    flipped[1::2, :, :4] *= -1
    one, other = watch(observer, readings, command)[-1], watch(observer, flipped, command)[-1]
    assert angle(one.mean[:, :4], other.mean[:, :4]).max() < 1e-12
    np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-9)


# broken covariances ------------------------------------------------------------------------------------------------------------


@every_kind
def test_a_lost_covariance_is_repaired_in_its_trial_alone_and_counted(observer):
    _, readings, command = flight(5, 10)
    healthy = watch(observer, readings[:4], command[:4])[-1]
    broken = healthy._replace(covariance=healthy.covariance.copy())
    values, vectors = np.linalg.eigh(broken.covariance[2])
    broken.covariance[2] = (vectors * np.append(-0.1 * values[-1], values[1:])) @ vectors.T
    others = np.arange(5) != 2
    for k in range(4, 10):
        healthy, broken = (observer.step(belief, command[k - 1], readings[k], DT) for belief in (healthy, broken))
        np.testing.assert_array_equal(broken.lost, [0, 0, 1, 0, 0])
        assert same(of(healthy, others), of(broken, others))
        assert np.linalg.eigvalsh(broken.covariance).min() > 0
    np.testing.assert_array_equal(healthy.lost, 0.0)


def test_a_repair_moves_a_covariance_no_more_than_it_must_in_any_units():
    rng = RNG(7)
    root = rng.normal(size=(6, 6))
    values, vectors = np.linalg.eigh(root @ root.T)
    for least in (-1e-3, -1e-9, 0.0):
        bad = (vectors * np.append(least, values[1:])) @ vectors.T
        for units in (np.ones(6), np.repeat([1e-6, 1e3], 3)):
            scaled = units[:, None] * bad * units
            mended = repair(scaled)
            np.linalg.cholesky(mended)
            np.testing.assert_allclose(mended / np.outer(units, units), bad, atol=5 * abs(least) + 1e-10)
    np.linalg.cholesky(repair(np.zeros((3, 3))))
    wild = rng.normal(size=(50, 6, 6)) + 1e-14 * np.eye(6)
    wild[:, range(6), range(6)] *= 1e-9  # correlations of a thousand million
    np.linalg.cholesky(repair(wild + wild.swapaxes(-1, -2)))


def test_a_covariance_that_is_fine_is_left_alone():
    fine = np.diag([1e-12, 1.0, 1e8])[None] * np.ones((3, 1, 1))
    lost = fine.copy()
    lost[1, 0, 0] = -1e-13
    root, repaired = factor(lost)
    np.testing.assert_array_equal(repaired, [0, 1, 0])
    np.testing.assert_array_equal(root[[0, 2]], np.linalg.cholesky(fine[[0, 2]]))


def test_what_cannot_be_repaired_ends_the_run():
    _, readings, command = flight(4, 3)
    observer = KINDS["multiplicative"]
    belief = observer.initial(readings[0])
    belief.covariance[2, 0, 0] = np.nan
    with pytest.raises(LostDefiniteness, match=r"covariance \(2,\) is not positive definite"):
        observer.step(belief, command[0], readings[1], DT)
    negative = attitude_filter(sensor=-SENSOR)
    with pytest.raises(LostDefiniteness, match="innovation covariance"):
        negative.step(observer.initial(readings[0]), command[0], readings[1], DT)
