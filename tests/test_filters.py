"""Filters against independent libraries, closed forms, and brute force; and each trial as if it were alone."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from scipy.linalg import expm
from scipy.stats import chi2, multivariate_normal
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.types.detection import Detection as StoneSoupReading
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import KalmanUpdater

from estimation.extended_kalman import ExtendedFilter, KalmanGain
from estimation.gaussian import Belief, Detection, Innovation, LostDefiniteness, innovate
from estimation.nis_switching import Fading, SwitchedGain, Windowed
from estimation.sliding_innovation import SlidingGain, sliding_gain
from estimation.stacking import stack
from estimation.state_space import Additive, Multiplicative
from models.attitude.quaternion import IDENTITY, angle, normalize, xi
from models.dynamics.process import Linearization, Prediction, predict, runge_kutta
from models.plants.nacs import NacsParameters

DT = 0.1
RNG = np.random.default_rng

# a linear world, where the Kalman filter is exact ------------------------------------------------------------------------------


class Linear:
    """dx/dt = A x + B u: an oscillator that drives a slow integrator, and a first-order lag."""

    A = np.array([[0.0, 1.0, 0.0, 0.0], [-4.0, -0.3, 0.0, 0.1], [0.2, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, -0.5]])
    B = np.array([[0.0], [1.0], [0.0], [0.5]])

    def derivative(self, state: np.ndarray, command: np.ndarray) -> np.ndarray:
        return (self.A @ state[..., None] + self.B @ command[..., None])[..., 0]

    def linearize(self, state: np.ndarray, command: np.ndarray) -> Linearization:
        return Linearization(self.derivative(state, command), np.broadcast_to(self.A, (*state.shape[:-1], 4, 4)))


class Flat(Additive):
    """Error coordinates of a state that is a plain vector, without quaternion."""

    attitude = "components"

    def difference(self, state, reference):
        return state - reference

    def displace(self, reference, error):
        return reference + error


_BLOCK = expm(DT * np.block([[Linear.A, Linear.B], [np.zeros((1, 5))]]))
PHI, GAMMA = _BLOCK[:4, :4], _BLOCK[:4, 4:]


def exactly(process: Linear, state: np.ndarray, command: np.ndarray, dt: float) -> Prediction:
    """Exact discretisation, by one matrix exponential."""
    return Prediction((PHI @ state[..., None] + GAMMA @ command[..., None])[..., 0], np.broadcast_to(PHI, (*state.shape[:-1], 4, 4)))


Q = np.diag([1e-8, 4e-6, 1e-9, 1e-6]) + 1e-9  # correlated a little
R = np.diag([1e-4, 4e-4, 1e-2, 1e-5])
R[0, 1] = R[1, 0] = 5e-5


def linear_filter(**changes) -> ExtendedFilter:
    settings = {"process": Linear(), "process_noise": Q, "measurement_noise": R, "prior": np.zeros(4), "prior_variance": np.ones(4)}
    return ExtendedFilter(**(settings | {"space": Flat(), "prediction": exactly} | changes))


def linear_run(steps: int, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Commands (steps, 1) and readings (steps, 4) of a system with the filter's own noise."""
    rng, truth = RNG(seed), np.array([1.0, 0.0, 0.0, 0.2])
    command, process, sensor = rng.normal(0, 1, (steps, 1)), *(rng.multivariate_normal(np.zeros(4), S, steps) for S in (Q, R))
    readings = np.empty((steps, 4))
    for k in range(steps):
        readings[k] = truth + sensor[k]
        truth = exactly(Linear(), truth, command[k], DT).state + process[k]
    return command, readings


def test_on_a_linear_model_the_extended_filter_is_filterpys_kalman_filter():
    command, readings = linear_run(500)
    ours, belief = linear_filter(), linear_filter().initial(readings[0])
    theirs = KalmanFilter(4, 4, 1)
    theirs.F, theirs.B, theirs.H, theirs.Q, theirs.R = PHI, GAMMA, np.eye(4), Q, R
    theirs.x, theirs.P = readings[0][:, None], R.copy()
    for k in range(1, 500):
        belief = ours.step(belief, command[k - 1], readings[k], DT)
        theirs.predict(command[k - 1][:, None])
        theirs.update(readings[k][:, None])
        np.testing.assert_allclose(belief.mean, theirs.x[:, 0], atol=1e-9)
        np.testing.assert_allclose(belief.covariance, theirs.P, atol=1e-13)  # of 1e-4
        np.testing.assert_allclose(belief.log_likelihood, theirs.log_likelihood, atol=1e-9)


def test_on_a_linear_model_the_extended_filter_is_stone_soups_kalman_filter():
    _, readings = linear_run(100)
    predictor = KalmanPredictor(LinearGaussianTimeInvariantTransitionModel(transition_matrix=PHI, covariance_matrix=Q))
    updater = KalmanUpdater(LinearGaussian(ndim_state=4, mapping=range(4), noise_covar=R))
    theirs = GaussianState(readings[0][:, None], R)
    ours, belief = linear_filter(), linear_filter().initial(readings[0])
    for reading in readings[1:]:
        belief = ours.step(belief, np.zeros(1), reading, DT)
        theirs = updater.update(SingleHypothesis(predictor.predict(theirs), StoneSoupReading(reading[:, None])))
        np.testing.assert_allclose(belief.mean, np.array(theirs.mean)[:, 0].astype(float), atol=1e-9)
        np.testing.assert_allclose(belief.covariance, np.array(theirs.covar), atol=1e-13)


def test_runge_kutta_predicts_a_linear_model_as_the_matrix_exponential_does():
    command, readings = linear_run(50)
    exact, stepped = linear_filter(), ExtendedFilter(Linear(), Q, R, np.zeros(4), np.ones(4), space=Flat())
    a, b = exact.initial(readings[0]), stepped.initial(readings[0])
    for k in range(1, 50):
        a, b = exact.step(a, command[k - 1], readings[k], DT), stepped.step(b, command[k - 1], readings[k], DT)
    np.testing.assert_allclose(b.mean, a.mean, atol=1e-4)  # (2 dt)^5 / 120: 3e-6 a step, which the filter forgets in twenty
    np.testing.assert_allclose(b.covariance, a.covariance, rtol=1e-3, atol=1e-8)


def test_the_log_likelihood_is_that_of_the_normal_distribution():
    rng = RNG(5)
    root = rng.standard_normal((4, 4))
    covariance, residual = root @ root.T, rng.standard_normal(4)
    got = innovate(covariance, residual, R)
    assert got.log_likelihood == pytest.approx(multivariate_normal(np.zeros(4), covariance + R).logpdf(residual), abs=1e-10)
    assert got.nis == pytest.approx(residual @ np.linalg.solve(covariance + R, residual), rel=1e-10)
    np.testing.assert_allclose(got.gain, covariance @ np.linalg.inv(covariance + R), atol=1e-10)
    seen = np.array([True, False, True, False])
    got = innovate(covariance, np.where(seen, residual, np.nan), R)
    rest = (covariance + R)[np.ix_(seen, seen)]
    assert got.log_likelihood == pytest.approx(multivariate_normal(np.zeros(2), rest).logpdf(residual[seen]), abs=1e-10)
    assert got.dof == 2


def test_a_far_outlier_has_a_finite_log_likelihood():
    assert np.isfinite(innovate(np.eye(4), np.full(4, 1e6), R).log_likelihood)


def test_in_a_world_of_its_own_noise_the_filter_is_consistent():
    """The sum of N chi-square numbers of 4 degrees of freedom lies in its own 99.9 % interval."""
    command, readings = linear_run(1000, seed=8)
    ours, belief, total = linear_filter(), linear_filter().initial(readings[0]), 0.0
    for k in range(1, 1000):
        belief = ours.step(belief, command[k - 1], readings[k], DT)
        total += belief.nis
    assert chi2.ppf(5e-4, 4 * 999) < total < chi2.isf(5e-4, 4 * 999)


# missing readings --------------------------------------------------------------------------------------------------------------


def test_a_partly_missing_reading_is_a_filter_that_has_no_such_row():
    command, readings = linear_run(60)
    ours, belief = linear_filter(), linear_filter().initial(readings[0])
    mean, covariance = belief.mean, belief.covariance
    rng = RNG(2)
    for k in range(1, 60):
        seen = rng.random(4) < 0.5
        belief = ours.step(belief, command[k - 1], np.where(seen, readings[k], np.nan), DT)
        mean, phi = exactly(Linear(), mean, command[k - 1], DT)  # brute force: textbook filter with the rows of H = I that are seen
        covariance, H = phi @ covariance @ phi.T + Q, np.eye(4)[seen]
        gain = covariance @ H.T @ np.linalg.inv(H @ covariance @ H.T + H @ R @ H.T) if seen.any() else np.zeros((4, 0))
        mean, covariance = mean + gain @ (readings[k][seen] - H @ mean), (np.eye(4) - gain @ H) @ covariance
        np.testing.assert_allclose(belief.mean, mean, atol=1e-9)
        np.testing.assert_allclose(belief.covariance, covariance, atol=1e-12)
        assert belief.dof == seen.sum()


def test_what_the_first_reading_misses_comes_from_the_prior():
    prior, variance = np.array([1.0, 2.0, 3.0, 4.0]), np.array([5.0, 6.0, 7.0, 8.0])
    ours = linear_filter(prior=prior, prior_variance=variance)
    wholly = ours.initial(np.full(4, np.nan))
    np.testing.assert_array_equal(wholly.mean, prior)
    np.testing.assert_array_equal(wholly.covariance, np.diag(variance))
    assert wholly.dof == 0
    partly = ours.initial(np.array([0.1, np.nan, np.nan, 0.4]))
    np.testing.assert_array_equal(partly.mean, [0.1, 2.0, 3.0, 0.4])
    np.testing.assert_array_equal(partly.covariance, np.diag([R[0, 0], 6.0, 7.0, R[3, 3]]))


# the testbed's filters ---------------------------------------------------------------------------------------------------------

BODY = NacsParameters().process(wheel_drag=True)
LAYER = np.repeat([4e-4, 8e-3, 2.0], [4, 3, 4])
LAWS = {
    "ekf": KalmanGain(),
    "sif": SlidingGain(LAYER),
    "windowed": SwitchedGain(LAYER, Windowed(45), 11.0),
    "fading": SwitchedGain(LAYER, Fading(0.965), 11.0),
}
NOISE, SENSOR = np.array([1e-10, 4e-7, 1.3e-2]), np.array([4e-8, 3e-6, 0.29])


def nacs_filter(law="ekf", multiplicative=False, sensor=SENSOR) -> ExtendedFilter:
    """As the twin builds them; a rotation vector is twice a quaternion's vector part."""
    counts, unit = ([3, 3, 4], np.array([4.0, 1, 1])) if multiplicative else ([4, 3, 4], np.ones(3))
    return ExtendedFilter(
        process=BODY,
        process_noise=np.diag(np.repeat(unit * NOISE, counts)),
        measurement_noise=np.diag(np.repeat(unit * sensor, counts)),
        prior=np.concatenate([IDENTITY, np.zeros(7)]),
        prior_variance=np.repeat([1.0, 1.0, 1e4], counts),
        gain=LAWS[law],
        space=Multiplicative() if multiplicative else Additive(),
    )


SPACE = Multiplicative()


def flight(trials: int, steps: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """True states and readings (steps, trials, 11) and wheel torques (steps, trials, 4) of a body with the filter's own noise."""
    rng, sigma = RNG(seed), [np.sqrt(np.repeat([4.0, 1.0, 1.0] * v, [3, 3, 4])) for v in (NOISE, SENSOR)]
    level = np.broadcast_to(np.concatenate([IDENTITY, np.zeros(7)]), (trials, 11))
    state = SPACE.displace(level, rng.normal(0, np.repeat([0.2, 0.02, 30.0], [3, 3, 4]), (trials, 10)))
    command = rng.normal(0, 5e-4, (steps, trials, 4))
    truth, readings = np.empty((2, steps, trials, 11))
    for k in range(steps):
        truth[k], readings[k] = state, SPACE.displace(state, sigma[1] * rng.standard_normal((trials, 10)))
        state = SPACE.displace(runge_kutta(BODY, state, command[k], DT), sigma[0] * rng.standard_normal((trials, 10)))
    return truth, readings, command


def watch(observer: ExtendedFilter, readings: np.ndarray, command: np.ndarray) -> list[Belief]:
    beliefs = [observer.initial(readings[0])]
    for k in range(1, len(readings)):
        beliefs.append(observer.step(beliefs[-1], command[k - 1], readings[k], DT))
    return beliefs


def of(belief: Belief, which) -> list[np.ndarray]:
    """Every array of a belief, for some of its trials."""
    return [part[which] for part in (*belief[:6], belief.detection.statistic, belief.detection.declared, *belief.detection.history)]


def same(left: list[np.ndarray], right: list[np.ndarray]) -> bool:
    return len(left) == len(right) and all(np.array_equal(a, b, equal_nan=True) for a, b in zip(left, right, strict=True))


def pushed(readings: np.ndarray, after: int) -> np.ndarray:
    """Readings with a rate that is off, in every third trial, so that some trials declare a fault and others do not."""
    out = readings.copy()
    out[after:, ::3, 4:7] += 0.01
    return out


KINDS = {name: nacs_filter(name) for name in LAWS} | {"mekf": nacs_filter(multiplicative=True)}
every_kind = pytest.mark.parametrize("observer", KINDS.values(), ids=KINDS.keys())


def test_the_multiplicative_filter_is_consistent_in_a_world_of_its_own_noise():
    """Sums of chi-square numbers of 10 degrees of freedom lie in their own 99.9 % interval: innovations in time, errors across trials."""
    truth, readings, command = flight(40, 100)
    beliefs = watch(KINDS["mekf"], readings, command)
    nis = sum(belief.nis.sum() for belief in beliefs[1:])
    error = SPACE.difference(truth[-1], beliefs[-1].mean)
    nees = np.einsum("ti,ti->", error, np.linalg.solve(beliefs[-1].covariance, error[..., None])[..., 0])
    assert chi2.ppf(5e-4, 10 * 40 * 99) < nis < chi2.isf(5e-4, 10 * 40 * 99)
    assert chi2.ppf(5e-4, 10 * 40) < nees < chi2.isf(5e-4, 10 * 40)


def test_the_additive_and_the_multiplicative_filter_agree_to_second_order():
    rng = RNG(3)
    root = rng.standard_normal((10, 10)) * np.repeat([1e-3, 1e-2, 1.0], [3, 3, 4])
    mean = SPACE.displace(np.concatenate([IDENTITY, np.zeros(7)]), rng.normal(0, 0.2, 10))
    spread = np.zeros((11, 10))
    spread[:4, :3], spread[4:, 3:] = 0.5 * xi(mean[:4]), np.eye(7)
    multiplicative = KINDS["mekf"].initial(mean)._replace(covariance=root.T @ root)
    radial = 1e-8 * np.outer(np.append(mean[:4], np.zeros(7)), np.append(mean[:4], np.zeros(7)))
    additive = KINDS["ekf"].initial(mean)._replace(covariance=spread @ root.T @ root @ spread.T + radial)
    ahead, direction = predict(BODY, mean, np.zeros(4), DT).state, rng.normal(0, np.repeat([1.0, 0.1, 10.0], [3, 3, 4]))
    apart = []
    for size in (0.0, 0.02, 0.04, 0.08):
        reading = SPACE.displace(ahead, size * direction)
        a, m = KINDS["ekf"].step(additive, np.zeros(4), reading, DT), KINDS["mekf"].step(multiplicative, np.zeros(4), reading, DT)
        apart.append(np.linalg.norm(SPACE.difference(a.mean, m.mean) / np.repeat([1.0, 0.1, 10.0], [3, 3, 4])))
        np.testing.assert_allclose(Additive().reduce(a.mean, a.covariance), m.covariance, atol=(1e-9 + size) * np.abs(m.covariance).max())
    assert apart[0] < 1e-9
    assert (np.diff(np.log2(apart[1:])) > 1.9).all()  # twice the innovation: at least four times as far apart
    assert apart[1] < 1e-3  # of an innovation of 2e-2


def test_a_quaternion_reading_of_either_sign_says_the_same():
    _, readings, command = flight(3, 10)
    flipped = readings.copy()
    flipped[1::2, :, :4] *= -1
    for observer in KINDS.values():
        np.testing.assert_allclose(watch(observer, flipped, command)[-1].mean, watch(observer, readings, command)[-1].mean, atol=1e-14)


@every_kind
def test_a_wholly_missing_reading_only_predicts_and_only_in_that_trial(observer):
    _, readings, command = flight(10, 30)
    readings = pushed(readings, 10)
    silent, others = readings.copy(), np.arange(10) != 3
    silent[20, 3] = np.nan
    before, missed = (belief[19:] for belief in (watch(observer, readings, command), watch(observer, silent, command)))
    assert all(same(of(a, others), of(b, others)) for a, b in zip(before, missed, strict=True))
    mean, transition = predict(BODY, before[0].mean[3], command[19, 3], DT)
    reduced = observer.space.transition(transition, before[0].mean[3], mean)
    assert angle(missed[1].mean[3, :4], normalize(mean[:4])) < 1e-15
    np.testing.assert_array_equal(missed[1].mean[3, 4:], mean[4:])
    np.testing.assert_allclose(missed[1].covariance[3], reduced @ before[0].covariance[3] @ reduced.T + observer.process_noise, rtol=1e-12)
    assert (missed[1].nis[3], missed[1].dof[3], missed[1].log_likelihood[3]) == (0.0, 0.0, 0.0)
    np.testing.assert_array_equal(missed[1].innovation[3], 0.0)


@every_kind
def test_a_run_that_begins_without_readings_starts_from_the_prior_and_then_finds_the_truth(observer):
    truth, readings, command = flight(4, 40)
    readings[:3, 1] = np.nan
    beliefs = watch(observer, readings, command)
    np.testing.assert_array_equal(beliefs[0].mean[1], observer.prior)
    np.testing.assert_array_equal(np.diag(beliefs[0].covariance[1]), observer.prior_variance)
    assert np.degrees(angle(beliefs[-1].mean[1, :4], truth[-1, 1, :4])) < 0.2  # ten deviations of a reading


@every_kind
def test_without_wheel_readings_attitude_and_rate_are_still_corrected(observer):
    truth, readings, command = flight(4, 40)
    readings[5:, :, 7:] = np.nan
    last = watch(observer, readings, command)[-1]
    np.testing.assert_array_equal(last.dof, 6)  # three of attitude, whatever the coordinates, and three of rate
    assert np.degrees(angle(last.mean[:, :4], truth[-1, :, :4])).max() < 0.2
    np.testing.assert_array_equal(last.innovation[:, -4:], 0.0)


@pytest.mark.parametrize("observer", [stack([KINDS[name] for name in LAWS]), KINDS["mekf"]], ids=["additive", "multiplicative"])
def test_the_covariance_stays_symmetric_and_positive_definite_over_ten_thousand_steps(observer):
    _, readings, command = flight(1, 200)
    belief = observer.initial(readings[0])
    for k in range(1, 10_000):
        belief = observer.step(belief, command[(k - 1) % 200], readings[k % 200], DT)  # every 200th step is a jump, too
        if k % 100 == 0:
            np.testing.assert_array_equal(belief.covariance, belief.covariance.swapaxes(-1, -2))
            assert np.linalg.eigvalsh(belief.covariance).min() > 0
    np.testing.assert_allclose(np.linalg.norm(belief.mean[..., :4], axis=-1), 1.0, rtol=1e-14)


# gain laws ---------------------------------------------------------------------------------------------------------------------


def test_the_sliding_gain_grows_with_the_innovation_and_ends_at_one():
    layer = np.array([1.0, 2.0, 4.0])
    np.testing.assert_array_equal(sliding_gain(np.array([0.25, -1.0, 0.0]), layer), np.diag([0.25, 0.5, 0.0]))
    np.testing.assert_array_equal(sliding_gain(np.array([1.0, -7.0, 1e9]), layer), np.eye(3))


def test_outside_the_boundary_layer_the_sliding_filter_believes_the_reading():
    _, readings, command = flight(5, 3)
    far = readings.copy()
    far[1] = SPACE.displace(readings[1], np.repeat([0.3, 0.5, 50.0], [3, 3, 4]))
    observer = KINDS["sif"]
    first = observer.initial(far[0])
    after = observer.step(first, command[0], far[1], DT)
    outside = np.abs(after.innovation) > LAYER
    assert outside[:, :3].all()
    assert outside[:, 4:].all()
    np.testing.assert_allclose(after.mean[:, 4:], far[1, :, 4:], rtol=1e-12)
    assert angle(after.mean[:, :4], far[1, :, :4]).max() < 2 * LAYER[0]  # the fourth component may be inside its layer


def test_inside_the_boundary_layer_the_sliding_filter_corrects_by_the_square():
    mean = np.concatenate([IDENTITY, np.zeros(7)])
    wheel = np.append(np.zeros(10), 0.5)
    belief = KINDS["sif"].initial(mean)
    after = KINDS["sif"].step(belief, np.zeros(4), mean + wheel, DT)
    np.testing.assert_allclose(after.mean[10], 0.5 * 0.5 / LAYER[10], rtol=1e-12)


@pytest.mark.parametrize(("smoothing", "weight"), [(Windowed(45), 45.0), (Fading(0.965), 1 / 0.035)])
def test_the_thresholds_are_quantiles_of_chi_square(smoothing, weight):
    on, off = SwitchedGain(LAYER, smoothing, 11.0, 0.001, 0.05).thresholds
    assert chi2.sf(on, 11 * weight) == pytest.approx(0.001, rel=1e-6)
    assert chi2.sf(off, 11 * weight) == pytest.approx(0.05, rel=1e-6)
    assert off < on


def judged(law: SwitchedGain, nis: np.ndarray, dof: float = 11.0) -> list[Detection]:
    """Detections of a sequence (readings, trials) of normalised innovations squared."""
    detection, out = law.start(nis.shape[1:]), []
    gain = np.full((*nis.shape[1:], 11, 11), 0.123)
    for value in nis:
        residual = np.full((*nis.shape[1:], 11), 1e9)  # so that the sliding gain is one
        chosen, detection = law.gain(Innovation(residual, gain, value, value, np.full(value.shape, dof)), detection)
        np.testing.assert_array_equal(chosen, np.where(detection.declared[..., None, None], np.eye(11), 0.123))  # of the same reading
        out.append(detection)
    return out


def test_the_windowed_sum_is_that_of_the_last_readings():
    nis = RNG(4).chisquare(11, (200, 3))
    padded = np.concatenate([np.full((45, 3), 11.0), nis])  # a past in which all was as expected
    for k, detection in enumerate(judged(LAWS["windowed"], nis)):
        np.testing.assert_allclose(detection.statistic, padded[k + 1 : k + 46].sum(axis=0), rtol=1e-13)


def test_the_fading_sum_follows_its_recursion():
    nis = RNG(4).chisquare(11, (200, 3))
    total = np.full(3, 11.0 / 0.035)
    for value, detection in zip(nis, judged(LAWS["fading"], nis), strict=True):
        total = 0.965 * total + value
        np.testing.assert_allclose(detection.statistic, total, rtol=1e-13)


@pytest.mark.parametrize("kind", ["windowed", "fading"])
def test_a_fault_is_declared_above_one_threshold_and_withdrawn_below_the_other_in_each_trial_by_itself(kind):
    law = LAWS[kind]
    nis = np.full((300, 4), 11.0)
    nis[50:60, 1] = 40.0  # a fault
    nis[100, 2] = 1e4  # a single wild reading
    nis[:, 3] += 0.9  # a mean between the thresholds alone declares nothing
    history = judged(law, nis)
    statistic, declared = np.array([d.statistic for d in history]), np.array([d.declared for d in history])
    on, off = law.thresholds
    expected = np.zeros(4, dtype=bool)
    for k in range(300):
        expected = np.where(expected, statistic[k] > off, statistic[k] > on)
        np.testing.assert_array_equal(declared[k], expected)
    between = (statistic > off) & (statistic < on)
    assert not declared[:, 0].any()
    assert declared[50:60, 1].any()
    assert not declared[-1].any()
    assert (declared & between).any()  # hysteresis: still declared where it would not be declared anew
    assert (~declared & between).any()
    assert declared[100, 2]
    assert not declared[:, 3].any()


@pytest.mark.parametrize("kind", ["windowed", "fading"])
def test_silence_neither_alarms_nor_reassures(kind):
    law = LAWS[kind]
    quiet = judged(law, np.zeros((100, 1)), dof=0.0)
    np.testing.assert_allclose([d.statistic for d in quiet], 11 * law.smoothing.weight, rtol=1e-12)


def test_thresholds_the_wrong_way_round_are_refused():
    with pytest.raises(ValueError, match="need 0 < on < off < 1"):
        SwitchedGain(LAYER, Windowed(45), 11.0, tail_on=0.05, tail_off=0.001)


def test_a_switched_filter_in_health_is_the_kalman_filter_and_in_fault_the_sliding_one():
    _, readings, command = flight(9, 60)
    readings = pushed(readings, 30)
    kalman, switched = (watch(KINDS[kind], readings, command) for kind in ("ekf", "fading"))
    healthy = switched[29]
    np.testing.assert_array_equal(healthy.detection.declared, False)
    np.testing.assert_array_equal(healthy.mean, kalman[29].mean)
    last = switched[-1]
    np.testing.assert_array_equal(last.detection.declared[1::3], False)
    assert last.detection.declared[::3].all()
    before, observer = switched[-2], KINDS["sif"]
    sliding = observer.step(before._replace(detection=observer.gain.start((9,))), command[-2], readings[-1], DT)
    np.testing.assert_array_equal(last.mean[::3], sliding.mean[::3])


# breakdown ---------------------------------------------------------------------------------------------------------------------


def lost(matrix: np.ndarray) -> tuple[int, ...]:
    """Where `innovate` says that definiteness is lost in a (2, 3) batch with `matrix` at (1, 2)."""
    covariance = np.broadcast_to(np.eye(len(matrix)), (2, 3, *matrix.shape)).copy()
    covariance[1, 2] = matrix
    with pytest.raises(LostDefiniteness, match=r"\(1, 2\)") as failure:
        innovate(covariance, np.zeros((2, 3, len(matrix))), np.zeros_like(matrix))
    return failure.value.where


def test_a_matrix_that_lost_definiteness_is_named_by_its_index():
    assert lost(np.diag([1.0, 1.0, -1.0, 1.0])) == (1, 2)


def test_a_matrix_with_a_nan_is_named_by_its_index():
    sick = np.diag(np.full(4, 1e4))
    sick[2, 1] = sick[1, 2] = np.nan
    assert lost(sick) == (1, 2)


def test_a_matrix_that_is_indefinite_by_rounding_alone_is_named_by_its_index():
    for seed in range(1000):
        root = RNG(seed).standard_normal((6, 5))
        singular = root @ root.T
        try:
            np.linalg.cholesky(singular)
        except np.linalg.LinAlgError:
            if np.linalg.eigvalsh(singular)[0] > 0:  # the factorisation and the eigenvalues disagree
                assert lost(singular) == (1, 2)
                return
    pytest.fail("no such matrix found")


# company -----------------------------------------------------------------------------------------------------------------------


@every_kind
@pytest.mark.parametrize("size", [1, 3, 10, 64])
def test_a_trial_in_a_batch_is_bit_equal_to_the_trial_in_any_other_company(observer, size):
    _, readings, command = flight(65, 25)
    readings = pushed(readings, 5)
    readings[12, ::7, :4] = np.nan
    readings[15, 4] = np.nan
    everyone, some = watch(observer, readings, command), slice(1, 1 + size)
    company = watch(observer, readings[:, some], command[:, some])
    assert all(same(of(a, some), of(b, slice(None))) for a, b in zip(everyone, company, strict=True))
    if isinstance(observer.gain, SwitchedGain):
        assert 0 < everyone[-1].detection.declared.sum() < 65  # both branches flew


@every_kind
def test_a_trial_without_any_batch_axis_is_bit_equal_too(observer):
    _, readings, command = flight(5, 10)
    alone, everyone = watch(observer, readings[:, 2], command[:, 2]), watch(observer, readings, command)
    assert all(same(of(a, 2), of(b, ())) for a, b in zip(everyone, alone, strict=True))


def test_stacked_filters_are_bit_equal_to_single_ones():
    _, readings, command = flight(10, 40)
    readings = pushed(readings, 15)
    readings[20, 4] = np.nan
    singles = [KINDS[name] for name in LAWS] + [nacs_filter("fading", sensor=2 * SENSOR)]
    stacked = watch(stack(singles), readings, command)
    for i, single in enumerate(singles):
        for together, apart in zip(stacked, watch(single, readings, command), strict=True):
            assert same([part[i] for part in together[:6]], list(apart[:6]))
            assert np.array_equal(together.detection.declared[i], apart.detection.declared)
            assert np.array_equal(together.detection.statistic[i], apart.detection.statistic)
            assert np.array_equal(together.detection.history[i], apart.detection.history[0])
