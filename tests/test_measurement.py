"""Measurement models: closed forms, Jacobians by differences, filters of a part of the state against independent libraries."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter
from scipy.linalg import expm
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from estimation.adaptive_unscented import AdaptiveUnscentedFilter
from estimation.extended_kalman import ExtendedFilter
from estimation.fading import StrongTracking
from estimation.interacting_multiple_model import InteractingMultipleModel
from estimation.nis_switching import SwitchedGain, Windowed
from estimation.observation import begin, observe_by_points
from estimation.particle import Draws, ParticleFilter
from estimation.proposals import PROPOSALS, ConstantNoise, Likelihood
from estimation.sigma_points import SigmaPoints
from estimation.sliding_innovation import SlidingGain, sliding_gain
from estimation.stacking import stack, stackable
from estimation.state_space import Additive, Euclidean, Multiplicative, Signed
from estimation.unscented import UnscentedFilter
from models.attitude import quaternion
from models.attitude.quaternion import IDENTITY
from models.dynamics.direction_measurement import DirectionMeasurement
from models.dynamics.measurement import MeasurementModel, PartOfState, WholeState
from models.dynamics.process import Prediction
from models.dynamics.stacked_measurement import PartOfReading, StackedMeasurement
from models.plants.nacs import NacsParameters

Array = np.ndarray
DT = 0.1
BODY = NacsParameters().process(wheel_drag=True)


def states(rng: np.random.Generator, *lead: int) -> Array:
    """Attitudes, rates and wheel speeds, (..., 11)."""
    attitude = quaternion.normalize(rng.standard_normal((*lead, 4)))
    return np.concatenate([attitude, 0.1 * rng.standard_normal((*lead, 3)), 100.0 * rng.standard_normal((*lead, 4))], axis=-1)


def tracker(kind: str = "rotation", sigma: float = 4e-4) -> PartOfState:
    """An attitude sensor."""
    noise = sigma**2 * np.eye(3) if kind == "rotation" else 0.25 * sigma**2 * np.eye(4)
    return PartOfState(range(4), 11, noise, kind)  # type: ignore[arg-type]


GYRO = PartOfState(range(4, 7), 11, 3e-6 * np.eye(3))
WHEELS = PartOfState(range(7, 11), 11, 0.29 * np.eye(4))
SUN = DirectionMeasurement(np.array([0.6, 0.0, 0.8]), 1e-6 * np.eye(3))
FIELD = DirectionMeasurement(np.array([2e-5, 1e-6, 4e-5]), 1e-16 * np.eye(3))

# the models --------------------------------------------------------------------------------------------------------------------

MODELS: dict[str, MeasurementModel] = {
    "whole, rotation": WholeState(np.eye(10), "rotation"),
    "whole, quaternion": WholeState(np.eye(11), "quaternion"),
    "whole, components": WholeState(np.eye(11)),
    "attitude, rotation": tracker(),
    "attitude, quaternion": tracker("quaternion"),
    "vector part": PartOfState([0, 1, 2], 11, np.eye(3)),
    "gyro": GYRO,
    "attitude and two wheels": PartOfState([0, 1, 2, 3, 9, 7], 11, np.eye(5), "rotation"),
    "sun": SUN,
    "field": FIELD,
    "all": StackedMeasurement((tracker(), GYRO, WHEELS, SUN, FIELD)),
    "of a longer reading": PartOfReading(StackedMeasurement((GYRO, SUN)), [8, 1, 2, 0, 4, 6]),
}
every_model = pytest.mark.parametrize("model", MODELS.values(), ids=MODELS.keys())
every_space = pytest.mark.parametrize("space", [Multiplicative(), Additive(), Signed()], ids=["multiplicative", "additive", "signed"])


@every_space
@every_model
def test_jacobians_are_what_finite_differences_say(model, space):
    """Along changes of the attitude that leave the quaternion's length alone, which is no attitude."""
    rng = np.random.default_rng(1)
    state = states(rng, 5)
    found = space.sensitivity(model.jacobian(state), state)
    size = found.shape[-1]
    scale = np.repeat([1e-5, 1e-5, 1e-2], [size - 7, 3, 4])
    steps = np.broadcast_to(np.diag(scale), (5, size, size)).copy()
    if size == 11:
        outer = state[:, :4, None] * state[:, None, :4]
        steps[:, :4, :4] = 1e-5 * (np.eye(4) - outer)
    ahead, behind = (model.predict(space.displace(state[:, None], sign * steps)) for sign in (1.0, -1.0))
    if isinstance(model, PartOfReading):  # its residual takes the longer reading
        model = model.measurement
    here = model.predict(state)[:, None]
    differences = 0.5 * (model.residual(ahead, here) - model.residual(behind, here))
    expected = steps @ found.swapaxes(-1, -2)
    np.testing.assert_allclose(differences, expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max())
    assert model.noise.shape[-1] == found.shape[-2]
    assert model.size == here.shape[-1]


@every_space
@every_model
def test_what_is_said_to_be_linear_is(model, space):
    """The residual of a displaced state is H times the error, however large; what is not said to be linear is not."""
    rng = np.random.default_rng(2)
    state = states(rng, 6)
    size = 10 if isinstance(space, Multiplicative) else 11
    error = rng.standard_normal((6, size))
    if isinstance(space, Multiplicative):
        moved = space.displace(state, error)
    else:
        moved = state + error
        if model.noise.shape[-1] > 3:  # the nearer of q and -q, as sigma points and particles are
            error[:, :4] *= 0.1
            moved = state + error
    inner = model.measurement if isinstance(model, PartOfReading) else model
    residual = inner.residual(inner.predict(moved), inner.predict(state))
    rows = model.linear(space.attitude)
    if rows is not None:
        np.testing.assert_allclose(residual, error @ rows.T, rtol=1e-9, atol=1e-9)
    else:
        linearised = (space.sensitivity(model.jacobian(state), state) @ error[..., None])[..., 0]
        assert np.abs(residual - linearised).max() > 1e-3 * np.abs(linearised).max()


def test_a_direction_is_seen_in_the_body():
    """A quarter of a turn about the third axis: what lay along the first axis of N lies along minus the second of B."""
    turned = np.concatenate([quaternion.from_rotation_vector(np.array([0.0, 0.0, np.pi / 2])), np.zeros(3)])
    seen = DirectionMeasurement(np.array([1.0, 0.0, 0.0]), np.eye(3)).predict(turned)
    np.testing.assert_allclose(seen, [0.0, -1.0, 0.0], atol=1e-15)


def test_residuals_are_blind_to_the_sign_of_a_quaternion_unless_they_go_by_components():
    state, other = states(np.random.default_rng(3), 4), states(np.random.default_rng(4), 4)
    for kind in ("rotation", "quaternion"):
        model = WholeState(np.eye(10 + (kind == "quaternion")), kind)  # type: ignore[arg-type]
        flipped = np.concatenate([-state[:, :4], state[:, 4:]], axis=-1)
        np.testing.assert_allclose(model.residual(flipped, other), model.residual(state, other), atol=1e-14)
    np.testing.assert_allclose(tracker().residual(-state[:, :4], state[:, :4]), 0.0, atol=1e-15)
    np.testing.assert_array_equal(PartOfState([0, 1, 2], 11, np.eye(3)).residual(-state[:, :3], state[:, :3]), -2.0 * state[:, :3])


def test_a_gap_stays_in_its_own_sensor():
    model, state = MODELS["all"], states(np.random.default_rng(5))
    reading = model.predict(state)
    assert reading.shape == (17,)
    reading[2], reading[8] = np.nan, np.nan  # a quaternion's component spoils the rotation, a wheel's itself
    gaps = np.isnan(model.residual(reading, model.predict(state)))
    np.testing.assert_array_equal(np.flatnonzero(gaps), [0, 1, 2, 7])
    assert model.noise.shape == (16, 16)
    np.testing.assert_array_equal(np.diag(model.noise)[[0, 3, 6, 10, 13]], [1.6e-7, 3e-6, 0.29, 1e-6, 1e-16])
    assert np.count_nonzero(model.noise - np.diag(np.diag(model.noise))) == 0


WRONG = {
    "twice": (lambda: PartOfState([4, 4], 11, np.eye(2)), "each once"),
    "beyond": (lambda: PartOfState([11], 11, np.eye(1)), "need one or more of 0 to 10"),
    "none": (lambda: PartOfState([], 11, np.eye(0)), "need one or more"),
    "half an attitude": (lambda: PartOfState([0, 1, 2], 11, np.eye(2), "rotation"), "needs 0, 1, 2, 3 first"),
    "noise": (lambda: PartOfState(range(4), 11, np.eye(4), "rotation"), "does not fit"),
    "both": (lambda: body_filter(GYRO, measurement_noise=np.eye(10)), "one of the two"),
    "neither": (lambda: body_filter(None), "one of the two"),
}


@pytest.mark.parametrize(("make", "message"), WRONG.values(), ids=WRONG.keys())
def test_bad_settings_give_one_clear_line(make, message):
    with pytest.raises(ValueError, match=message):
        make()


# a linear world, where the Kalman filter is exact ------------------------------------------------------------------------------

A = np.array([[0.0, 1.0, 0.0, 0.0], [-4.0, -0.3, 0.0, 0.1], [0.2, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, -0.5]])
B = np.array([[0.0], [1.0], [0.0], [0.5]])
_BLOCK = expm(DT * np.block([[A, B], [np.zeros((1, 5))]]))
PHI, GAMMA = _BLOCK[:4, :4], _BLOCK[:4, 4:]
Q = np.diag([1e-6, 4e-6, 1e-6, 1e-6]) + 1e-7
R = np.array([[1e-2, 5e-4], [5e-4, 4e-4]])
MIXED = np.array([[1.0, 0.0, -2.0, 0.5], [0.0, 0.3, 1.0, 0.0]])


@dataclass(frozen=True, eq=False)
class Sums:
    """z = H x, which may be kept from a filter, so that it goes the way of functions that are not linear."""

    matrix: Array
    noise: Array
    said: bool = False

    @property
    def size(self) -> int:
        return len(self.matrix)

    def predict(self, state):
        return (self.matrix @ state[..., None])[..., 0]

    def residual(self, reading, predicted):
        return reading - predicted

    def jacobian(self, state):
        return np.broadcast_to(self.matrix, (*state.shape[:-1], *self.matrix.shape))

    def linear(self, errors):
        return self.matrix if self.said else None


def exactly(process, state, command, dt):
    return (PHI @ state[..., None] + GAMMA @ command[..., None])[..., 0]


def with_transition(process, state, command, dt):
    return Prediction(exactly(process, state, command, dt), np.broadcast_to(PHI, (*state.shape[:-1], 4, 4)))


def linear_world(model: MeasurementModel | None, **changes: Any) -> dict[str, Any]:
    start = {"prior": np.array([1.0, 0.0, 0.0, 0.2]), "prior_variance": np.full(4, 0.5)}
    return start | {"process": None, "process_noise": Q, "measurement_noise": None, "measurement": model, "space": Euclidean()} | changes


def linear_run(model: Any, steps: int, trials: int = 3, seed: int = 1, process: Array = Q, spread: float = 0.5) -> tuple[Array, Array]:
    """Commands (steps, trials, 1) and readings (steps, trials, 2) with gaps of one component and of both."""
    rng = np.random.default_rng(seed)
    truth = np.array([1.0, 0.0, 0.0, 0.2]) + np.sqrt(spread) * rng.standard_normal((trials, 4))
    command, readings = rng.standard_normal((steps, trials, 1)), np.empty((steps, trials, 2))
    for k in range(steps):
        readings[k] = model.predict(truth) + rng.multivariate_normal(np.zeros(2), model.noise, trials)
        truth = exactly(None, truth, command[k], DT) + rng.multivariate_normal(np.zeros(4), process, trials)
    gaps = rng.random((steps, trials, 2)) < 0.2
    gaps[0] = False
    return command, np.where(gaps, np.nan, readings)


LINEAR = {
    "part": PartOfState([2, 0], 4, R),
    "sums, said": Sums(MIXED, R, True),
    "sums": Sums(MIXED, R),
    "two sensors": StackedMeasurement((PartOfState([3], 4, R[:1, :1]), Sums(MIXED[:1], R[1:, 1:]))),
}


@pytest.mark.parametrize("kind", ["extended", "unscented", "adaptive"])
@pytest.mark.parametrize("model", LINEAR.values(), ids=LINEAR.keys())
def test_on_a_linear_model_they_are_filterpys_kalman_filter(model, kind):
    command, readings = linear_run(model, 150)
    if kind == "extended":
        ours: Any = ExtendedFilter(**linear_world(model), prediction=with_transition)
    else:
        ours = UnscentedFilter(**linear_world(model), alpha=0.7, integrate=exactly)
        ours = AdaptiveUnscentedFilter(ours, ConstantNoise.of(Q)) if kind == "adaptive" else ours
    belief = ours.initial(readings[0])
    H = model.jacobian(np.zeros(4))
    for trial in range(3):
        theirs = KalmanFilter(4, 2, 1)
        theirs.F, theirs.B, theirs.Q = PHI, GAMMA, Q
        theirs.x, theirs.P = belief.mean[trial][:, None], belief.covariance[trial]
        one = readings[:, trial]
        mine = type(belief)(*(part[trial] if isinstance(part, np.ndarray) else part for part in belief))
        mine = mine._replace(detection=type(mine.detection)(*mine.detection[:2], (np.zeros(0),)))
        if kind == "adaptive":
            mine = mine._replace(memory=type(belief.memory)(*(part[trial] for part in belief.memory)))
        for k in range(1, len(one)):
            mine = ours.step(mine, command[k - 1, trial], one[k], DT)
            theirs.predict(command[k - 1, trial][:, None])
            seen = ~np.isnan(one[k])
            expected = 0.0
            if seen.any():
                theirs.update(one[k][seen][:, None], R=model.noise[np.ix_(seen, seen)], H=H[seen])
                expected = theirs.log_likelihood
            np.testing.assert_allclose(mine.mean, theirs.x[:, 0], atol=1e-9)
            np.testing.assert_allclose(mine.covariance, theirs.P, atol=1e-11)
            np.testing.assert_allclose(mine.log_likelihood, expected, atol=1e-8)
            assert mine.dof == seen.sum()


def test_the_first_belief_of_a_part_is_that_part_with_its_noise_and_the_prior():
    belief = begin(LINEAR["part"], Euclidean(), np.array([[7.0, -1.0], [np.nan, 3.0]]), np.array([1.0, 2.0, 3.0, 4.0]), np.full(4, 0.5))
    np.testing.assert_allclose(belief.mean, [[-1.0, 2.0, 7.0, 4.0], [3.0, 2.0, 3.0, 4.0]])
    np.testing.assert_allclose(np.diagonal(belief.covariance, axis1=-2, axis2=-1), [[4e-4, 0.5, 1e-2, 0.5], [4e-4, 0.5, 0.5, 0.5]])
    np.testing.assert_allclose([one[0, 2] for one in belief.covariance], [5e-4, 0.0])
    np.testing.assert_array_equal(belief.dof, [2.0, 1.0])


def test_two_sensors_of_one_component_are_counted_twice_and_the_prior_once():
    twice = StackedMeasurement((PartOfState([0], 4, np.array([[0.04]])), PartOfState([0, 3], 4, np.diag([0.01, 0.02]))))
    belief = begin(twice, Euclidean(), np.array([2.0, 1.0, np.nan]), np.zeros(4), np.full(4, 0.5))
    information = 1 / 0.04 + 1 / 0.01 + 1 / 0.5
    assert belief.covariance[0, 0] == pytest.approx(1 / information)
    assert belief.mean[0] == pytest.approx((2.0 / 0.04 + 1.0 / 0.01) / information)
    np.testing.assert_allclose(np.diag(belief.covariance)[1:], 0.5)


class Swing:
    """A strongly nonlinear reading of [angle, rate, gravity]: the bob's height, the power, and the tension."""

    noise = np.diag([0.02, 0.3, 0.5])
    size = 3

    def predict(self, state):
        angle, rate, gravity = (state[..., i] for i in range(3))
        return np.stack([1.0 - np.cos(angle), rate * gravity * np.sin(angle), rate**2 + gravity * np.cos(angle)], axis=-1)

    def residual(self, reading, predicted):
        return reading - predicted

    def jacobian(self, state):
        raise NotImplementedError

    def linear(self, errors):
        return None


def test_a_nonlinear_reading_goes_through_sigma_points_as_in_filterpy():
    """Mean and covariance of one correction after another; filterpy sums with a negative central weight."""
    rng = np.random.default_rng(6)
    noise, points = np.diag([0.02, 0.05, 0.01]), SigmaPoints(0.8, 2.0, 0.5)

    def moved(process, state, command, dt):
        return np.stack([state[..., 0] + dt * state[..., 1], state[..., 1] - dt * np.sin(state[..., 0]), state[..., 2]], axis=-1)

    common = {"process": None, "process_noise": noise, "prior": np.array([0.5, 0.1, 9.8]), "prior_variance": np.full(3, 0.2)}
    ours = UnscentedFilter(**common, measurement_noise=None, measurement=Swing(), space=Euclidean(), alpha=0.8, kappa=0.5, integrate=moved)
    theirs = UnscentedKalmanFilter(
        3, 3, DT, hx=Swing().predict, fx=lambda x, dt: moved(None, x, None, dt), points=MerweScaledSigmaPoints(3, 0.8, 2.0, 0.5)
    )
    assert points == ours.points
    belief = UnscentedFilter(**common, measurement_noise=np.eye(3), space=Euclidean()).initial(np.array([0.6, 0.2, 9.6]))
    belief = belief._replace(innovation=np.zeros(3))
    theirs.x, theirs.P, theirs.Q, theirs.R = belief.mean, belief.covariance, noise, Swing.noise
    state = np.array([0.7, 0.3, 9.7])
    for _ in range(40):
        state = moved(None, state, None, DT) + rng.multivariate_normal(np.zeros(3), noise)
        reading = Swing().predict(state) + rng.multivariate_normal(np.zeros(3), Swing.noise)
        belief = ours.step(belief, np.zeros(1), reading, DT)
        theirs.predict()
        theirs.update(reading)
        np.testing.assert_allclose(belief.mean, theirs.x, rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(belief.covariance, theirs.P, rtol=1e-7, atol=1e-8)
        np.testing.assert_allclose(belief.log_likelihood, theirs.log_likelihood, rtol=1e-7, atol=1e-7)
        assert np.linalg.eigvalsh(belief.covariance)[0] > 0.0


@pytest.mark.parametrize("alpha", [1e-2, 1.0])
def test_sigma_points_through_a_linear_function_leave_nothing_over(alpha):
    rng = np.random.default_rng(7)
    factors = rng.standard_normal((4, 4, 4))
    covariance, state, reading = factors @ factors.swapaxes(-1, -2), rng.standard_normal((4, 4)), rng.standard_normal((4, 2))
    seen, lost = observe_by_points(SigmaPoints(alpha), Sums(MIXED, R), Euclidean(), reading, state, covariance)
    np.testing.assert_allclose(seen.residual, reading - Sums(MIXED, R).predict(state), atol=1e-9)
    np.testing.assert_allclose(seen.sensitivity, np.broadcast_to(MIXED, (4, 2, 4)), atol=1e-9)
    np.testing.assert_allclose(seen.noise, np.broadcast_to(R, (4, 2, 2)), atol=1e-9)
    np.testing.assert_array_equal(lost, 0.0)


# particles ---------------------------------------------------------------------------------------------------------------------

# extended and unscented are the optimal one where a reading is linear: see below
DENSITIES = {name: PROPOSALS[name] for name in ("bootstrap", "optimal", "likelihood")}
every_proposal = pytest.mark.parametrize("proposal", DENSITIES.values(), ids=DENSITIES.keys())


LOUD = 1e3 * Q  # so that what is not read is not told from the first particles alone
LOUD_LINEAR = {"part": PartOfState([2, 0], 4, 10.0 * R), "sums": Sums(MIXED, 10.0 * R)}
SHARP_LINEAR = {
    "part": PartOfState([2, 0], 4, 0.1 * R),
    "sums": Sums(MIXED, 0.1 * R),
}  # better than predictions


def cloud(model: Any, particles: int, proposal: Any) -> ParticleFilter:
    settings = linear_world(model, process_noise=ConstantNoise.of(LOUD), prior_variance=np.full(4, 0.02))
    return ParticleFilter(**settings, particles=particles, proposal=proposal, integrate=exactly)


def draws(rng: np.random.Generator, lead: tuple[int, ...], particles: int, size: int) -> Draws:
    return Draws(rng.standard_normal((*lead, particles, size)), rng.random((*lead, particles)))


def off_kalman(model: Any, proposal: Any, particles: int, trials: int = 64, ticks: int = 7) -> Array:
    """Deviations of means from the Kalman filter's, in its sigma, (ticks, trials, 4)."""
    command, readings = linear_run(model, ticks, trials, 8, LOUD, 0.02)
    kalman = ExtendedFilter(**linear_world(model, process_noise=LOUD, prior_variance=np.full(4, 0.02)), prediction=with_transition)
    ours = cloud(model, particles, proposal)
    rng = np.random.default_rng(9)
    exact, belief = kalman.initial(readings[0]), ours.initial(readings[0], draws(rng, (trials,), particles, 4))
    apart = []
    for k in range(1, ticks):
        exact = kalman.step(exact, command[k - 1], readings[k], DT)
        belief = ours.step(belief, command[k - 1], readings[k], DT, draws(rng, (trials,), particles, 4))
        apart.append((belief.mean - exact.mean) / np.sqrt(np.diagonal(exact.covariance, axis1=-2, axis2=-1)))
        np.testing.assert_array_equal(belief.dof, exact.dof)
    return np.array(apart)


@every_proposal
@pytest.mark.parametrize("name", ["part", "sums"])
def test_particles_come_to_the_kalman_filter_with_the_root_of_their_number(proposal, name):
    model = (SHARP_LINEAR if isinstance(proposal, Likelihood) else LOUD_LINEAR)[name]
    few, many = (np.sqrt(np.mean(off_kalman(model, proposal, particles) ** 2)) for particles in (200, 12_800))
    assert many < 0.1
    assert few / many == pytest.approx(8.0, rel=0.35)


@pytest.mark.parametrize("proposal", PROPOSALS.values(), ids=PROPOSALS.keys())
def test_a_linear_function_weighs_alike_whether_it_is_said_to_be_linear_or_not(proposal):
    """The ratio of densities of the linearised proposals is p(z_k | x_k-1) exactly where h is linear."""
    command, readings = linear_run(LINEAR["sums"], 12)
    beliefs = []
    for said in (True, False):
        rng, ours = np.random.default_rng(10), cloud(Sums(MIXED, R, said), 60, proposal)
        belief = ours.initial(readings[0], draws(rng, (3,), 60, 4))
        for k in range(1, 12):
            belief = ours.step(belief, command[k - 1], readings[k], DT, draws(rng, (3,), 60, 4))
        beliefs.append(belief)
    for name in ("particles", "log_weights", "nis", "log_likelihood", "covariance"):
        np.testing.assert_allclose(getattr(beliefs[0], name), getattr(beliefs[1], name), atol=1e-8)


def test_a_nonlinear_reading_leaves_the_posterior_that_a_grid_has():
    """One correction of a Gaussian by a cubic: what the linearised density misjudges is made up for by the weights."""

    class Cubic(Sums):
        def predict(self, state):
            return state + 0.3 * state**3

        def jacobian(self, state):
            return 1.0 + 0.9 * state[..., None] ** 2

    q, r, particles = 0.8, 0.3, 200_000
    model = Cubic(np.eye(1), np.array([[r]]))
    grid = np.linspace(-6.0, 6.0, 6001)
    density = np.exp(-0.5 * (grid - 0.4) ** 2 / (q + 0.2) - 0.5 * (2.0 - grid - 0.3 * grid**3) ** 2 / r)
    density /= density.sum()
    mean, square = density @ grid, density @ grid**2
    for proposal in PROPOSALS.values():
        ours = ParticleFilter(
            process=None, process_noise=ConstantNoise(np.array([[np.sqrt(q)]])), measurement_noise=None, prior=np.array([0.4]),
            prior_variance=np.array([0.2]), particles=particles, proposal=proposal, space=Euclidean(), measurement=model,
            integrate=lambda process, state, command, dt: state,
        )  # fmt: skip
        rng = np.random.default_rng(11)
        belief = ours.initial(np.array([np.nan]), draws(rng, (), particles, 1))
        belief = ours.step(belief, np.zeros(1), np.array([2.0]), DT, draws(rng, (), particles, 1))
        noise = 4.0 * np.sqrt(1.0 / belief.ess)
        assert belief.mean[0] == pytest.approx(mean, abs=noise * np.sqrt(square - mean**2))
        assert belief.covariance[0, 0] == pytest.approx(square - mean**2, abs=2.0 * noise)


@pytest.mark.parametrize("name", ["extended", "unscented"])
def test_a_filter_for_every_particle_is_the_optimal_density_where_the_reading_is_linear(name):
    """van der Merwe et al. against Doucet et al. (both 2000): a Kalman filter's step from a known state is p(x_k | x_k-1, z_k)."""
    command, readings = linear_run(LINEAR["sums"], 8)
    beliefs = []
    for model, proposal in ((Sums(MIXED, R, True), "optimal"), (Sums(MIXED, R), name)):
        rng, ours = np.random.default_rng(10), cloud(model, 60, PROPOSALS[proposal])
        belief = ours.initial(readings[0], draws(rng, (3,), 60, 4))
        for k in range(1, 8):
            belief = ours.step(belief, command[k - 1], readings[k], DT, draws(rng, (3,), 60, 4))
        beliefs.append(belief)
    np.testing.assert_allclose(beliefs[1].particles, beliefs[0].particles, atol=1e-9)
    np.testing.assert_allclose(beliefs[1].log_weights, beliefs[0].log_weights, atol=1e-8)


def test_the_likelihood_proposal_draws_what_is_read_and_weighs_it_by_the_model():
    """Of many particles H x is N(z, R), one component of z missing; weights are N(H x; H f, H Q H'), by SciPy."""
    rng = np.random.default_rng(21)
    ours, many = cloud(Sums(MIXED, R, True), 40_000, PROPOSALS["likelihood"]), 40_000
    before = ours.initial(np.array([0.3, -0.2]), draws(rng, (), many, 4))
    for reading in (np.array([0.4, -0.1]), np.array([0.4, np.nan])):
        seen = ~np.isnan(reading)
        belief = ours.step(before, np.zeros(1), reading, DT, draws(rng, (), many, 4))
        rows = MIXED[seen]
        read = belief.particles @ rows.T
        np.testing.assert_allclose(read.mean(axis=0), reading[seen], atol=5.0 * np.sqrt(R.max() / many))
        np.testing.assert_allclose(np.atleast_2d(np.cov(read.T)), R[np.ix_(seen, seen)], atol=0.05 * R.max())
        expected = exactly(None, before.particles, np.zeros(1), DT) @ rows.T
        wanted = multivariate_normal(np.zeros(seen.sum()), rows @ LOUD @ rows.T).logpdf(read - expected)
        np.testing.assert_allclose(belief.log_weights, wanted - logsumexp(wanted), atol=1e-8)


class Range:
    """Distance of a point in the plane from the origin, as of a radar: it bends within the spread of the particles."""

    noise, size = np.array([[1e-4]]), 1

    def predict(self, state):
        return np.linalg.norm(state, axis=-1, keepdims=True)

    def residual(self, reading, predicted):
        return reading - predicted

    def jacobian(self, state):
        return (state / np.linalg.norm(state, axis=-1, keepdims=True))[..., None, :]

    def linear(self, errors):
        return None


def test_of_particles_that_lie_apart_more_count_if_each_looks_its_own_way():
    """Particles all round the origin, 1 m from it, read to 1 cm: linearised at one of them, the reading misleads most."""
    effective, spread, sigma = {}, 0.05, 0.01
    for name in ("bootstrap", "optimal", "extended", "unscented"):
        ours = ParticleFilter(
            process=None, process_noise=ConstantNoise(spread * np.eye(2)), measurement_noise=None, prior=np.array([1.0, 0.0]),
            prior_variance=np.ones(2), particles=400, proposal=PROPOSALS[name], space=Euclidean(), measurement=Range(),
            integrate=lambda process, state, command, dt: state,
        )  # fmt: skip
        rng = np.random.default_rng(22)
        around = rng.standard_normal((20, 400, 2))
        first = ours.initial(np.full((20, 1), np.nan), draws(rng, (20,), 400, 2))
        first = first._replace(particles=around / np.linalg.norm(around, axis=-1, keepdims=True))
        effective[name] = ours.step(first, np.zeros((20, 1)), np.full((20, 1), 1.0), DT, draws(rng, (20,), 400, 2)).ess.mean()
    ahead = spread**2 + sigma**2  # of readings minus prediction: 1 / sum w^2 of particles spread by the noise alone, in closed form
    few = 400.0 * sigma * np.sqrt(sigma**2 + 2.0 * spread**2) / ahead
    assert effective["bootstrap"] == pytest.approx(few, rel=0.05)
    assert effective["optimal"] < few
    assert 3.0 * few < effective["extended"] < effective["unscented"]


# the testbed's body ------------------------------------------------------------------------------------------------------------


def body_settings(model: MeasurementModel | None, multiplicative: bool = True, **changes: Any) -> dict[str, Any]:
    counts, unit = ([3, 3, 4], np.array([4.0, 1, 1])) if multiplicative else ([4, 3, 4], np.ones(3))
    return {
        "process": BODY,
        "process_noise": np.diag(np.repeat(unit * [1e-9, 4e-7, 1.3e-2], counts)),
        "measurement_noise": None,
        "measurement": model,
        "prior": np.concatenate([IDENTITY, np.zeros(7)]),
        "prior_variance": np.repeat([10.0, 1.0, 1e4], counts),
        "space": Multiplicative() if multiplicative else Additive(),
    } | changes


def body_filter(model: MeasurementModel | None, multiplicative: bool = True, kind: Any = ExtendedFilter, **changes: Any) -> Any:
    return kind(**body_settings(model, multiplicative, **changes))


def imm(model: MeasurementModel | None, kind: Any = ExtendedFilter, apart: bool = False, **changes: Any) -> InteractingMultipleModel:
    """Two modes, one without friction; `apart`: stepped one by one."""
    one = body_filter(model, kind=kind, **changes)
    other = replace(one, process=NacsParameters().process(wheel_drag=False), measurement=replace(model) if apart else model)
    return InteractingMultipleModel((one, other), np.array([[0.98, 0.02], [0.05, 0.95]]), np.array([0.5, 0.5]))


def body_particles(model: MeasurementModel | None, particles: int = 50, proposal: str = "optimal", **changes: Any) -> ParticleFilter:
    settings = body_settings(model, **changes)
    settings["process_noise"] = ConstantNoise.of(settings["process_noise"])
    return ParticleFilter(**settings, particles=particles, proposal=PROPOSALS[proposal])


def flight(model: MeasurementModel, ticks: int, trials: int, seed: int = 12) -> tuple[Array, Array]:
    """Readings (ticks, trials, m) of bodies that the wheels drive, and their commands."""
    rng = np.random.default_rng(seed)
    truth, command, readings = states(rng, trials), 1e-3 * rng.standard_normal((ticks, trials, 4)), []
    for k in range(ticks):
        readings.append(model.predict(truth))
        truth = BODY_STEP(truth, command[k])
    return np.array(readings), command


def BODY_STEP(state: Array, command: Array, dt: float = DT) -> Array:
    one = body_filter(GYRO, kind=UnscentedFilter)
    moved = one.integrate(BODY, state, command, dt)
    return np.concatenate([quaternion.normalize(moved[..., :4]), moved[..., 4:]], axis=-1)


def watch(ours: Any, readings: Array, command: Array, seed: int = 13) -> list[Any]:
    """Beliefs of a filter, of any kind."""
    rng = np.random.default_rng(seed)
    lead = readings.shape[1:-1]

    def numbers() -> tuple[Draws, ...]:
        return (draws(rng, lead, ours.particles, 10),) if isinstance(ours, ParticleFilter) else ()

    beliefs = [ours.initial(readings[0], *numbers())]
    for k in range(1, len(readings)):
        beliefs.append(ours.step(beliefs[-1], command[k - 1], readings[k], DT, *numbers()))
    return beliefs


LAYER = np.repeat([8e-4, 8e-3, 2.0], [3, 3, 4])
FILTERS: dict[str, Any] = {
    "mekf": body_filter,
    "ukf": lambda model, **noise: body_filter(model, kind=UnscentedFilter, **noise),
    "aukf": lambda model, **noise: AdaptiveUnscentedFilter(
        body_filter(model, kind=UnscentedFilter, **noise), ConstantNoise.of(body_settings(model)["process_noise"]), StrongTracking()
    ),
    "sif": lambda model, layer=LAYER, **noise: body_filter(model, gain=SlidingGain(layer), **noise),
    "switched": lambda model, layer=LAYER, **noise: body_filter(model, gain=SwitchedGain(layer, Windowed(5), len(layer)), **noise),
    "imm of mekf": imm,
    "imm of ukf": lambda model, **noise: imm(model, UnscentedFilter, **noise),
    "pf, optimal": body_particles,
    "pf, extended": lambda model, **noise: body_particles(model, proposal="extended", **noise),
    "pf, unscented": lambda model, **noise: body_particles(model, proposal="unscented", **noise),
    "pf, bootstrap": lambda model, **noise: body_particles(model, proposal="bootstrap", **noise),
}
every_filter = pytest.mark.parametrize("kind", FILTERS.keys())


def layered(kind: str, layer: Array) -> dict[str, Any]:
    return {"layer": layer} if kind in {"sif", "switched"} else {}


@every_filter
def test_a_model_of_the_whole_state_is_what_a_filter_has_without_one(kind):
    """Bit for bit, gaps included; also as a part of a longer reading."""
    noise = np.diag(np.repeat([1.6e-7, 3e-6, 0.29], [3, 3, 4]))
    whole = WholeState(noise, "rotation")
    readings, command = flight(whole, 12, 4)
    readings[4, 1, :4], readings[6, 2], readings[7, 0, 8] = np.nan, np.nan, np.nan
    longer = np.concatenate([readings, np.full((12, 4, 2), 7.0)], axis=-1)
    plain = watch(FILTERS[kind](None, measurement_noise=noise), readings, command)
    for model, shown in ((whole, readings), (PartOfReading(whole, slice(0, 11)), longer)):
        for one, other in zip(plain, watch(FILTERS[kind](model), shown, command), strict=True):
            for name in ("mean", "covariance", "innovation", "nis", "log_likelihood", "dof"):
                np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


@every_filter
def test_a_part_of_the_state_is_the_whole_with_the_rest_missing(kind):
    """Attitude and rate without wheel speeds, read from the second tick on; the first is whole, so that wheels are known a little."""
    variances = np.repeat([1.6e-7, 3e-6, 0.29], [3, 3, 4])
    whole, part = WholeState(np.diag(variances), "rotation"), PartOfState(range(7), 11, np.diag(variances[:6]), "rotation")
    readings, command = flight(whole, 12, 4)
    readings[:, :, 7:] = np.nan
    readings[4, 1, :4], readings[6, 2] = np.nan, np.nan
    start = {"prior_variance": np.repeat([10.0, 1.0, 1.0], [3, 3, 4])}
    every, some = (FILTERS[kind](one, **start, **layered(kind, LAYER[: one.noise.shape[-1]])) for one in (whole, part))
    if kind == "switched":  # of another number of components: thresholds of its own
        every = replace(every, gain=replace(every.gain, dof=6.0))
        readings[4, 1, :4], readings[6, 2] = readings[3, 1, :4], readings[5, 2]  # every gap counts as its expectation
    pairs = zip(watch(every, readings, command), watch(some, readings[..., :7], command), strict=True)
    for k, (one, other) in enumerate(pairs):
        np.testing.assert_allclose(Multiplicative().difference(other.mean, one.mean), 0.0, atol=1e-7)
        np.testing.assert_allclose(other.covariance, one.covariance, rtol=1e-6, atol=1e-9)
        np.testing.assert_array_equal(other.dof, one.dof)
        np.testing.assert_allclose(other.innovation, one.innovation[..., :6], atol=1e-7)
        if k:
            np.testing.assert_allclose(other.nis, one.nis, rtol=1e-6, atol=1e-6)
            np.testing.assert_allclose(other.log_likelihood, one.log_likelihood, rtol=1e-6, atol=1e-6)


@every_filter
def test_what_never_reads_might_as_well_not_be_there(kind):
    """A sun sensor and a tracker in the dark beside others, whose readings come at their own rates."""
    most = StackedMeasurement((SUN, FIELD, GYRO, WHEELS))
    every = StackedMeasurement((SUN, tracker(), FIELD, GYRO, WHEELS))
    readings, command = flight(most, 12, 4)
    readings[1::2, :, 9:], readings[3, 1, :3], readings[5, 2] = np.nan, np.nan, np.nan
    dark = np.concatenate([readings[..., :3], np.full((12, 4, 4), np.nan), readings[..., 3:]], axis=-1)
    start = {"prior_variance": np.repeat([1e-4, 1.0, 1e4], [3, 3, 4]), "prior": None}
    truth = states(np.random.default_rng(12), 4)
    start["prior"] = np.concatenate([truth[:, :4], np.zeros((4, 7))], axis=-1)
    if kind.startswith("imm"):
        start["prior"] = start["prior"][0]
        readings, dark, command = readings[:, :1], dark[:, :1], command[:, :1]
    layer = {
        id(most): np.repeat([8e-4, 1e-8, 8e-3, 2.0], [3, 3, 3, 4]),
        id(every): np.repeat([8e-4, 1.0, 1e-8, 8e-3, 2.0], [3, 3, 3, 3, 4]),
    }
    less, more = (FILTERS[kind](one, **start, **layered(kind, layer[id(one)])) for one in (most, every))
    if kind == "switched":
        more = replace(more, gain=replace(more.gain, dof=less.gain.dof))
        less = replace(less, gain=replace(less.gain, smoothing=Windowed(1), tail_on=1e-300, tail_off=1e-299))
        more = replace(more, gain=replace(more.gain, smoothing=Windowed(1), tail_on=1e-300, tail_off=1e-299))
    for k, (one, other) in enumerate(zip(watch(less, readings, command), watch(more, dark, command), strict=True)):
        np.testing.assert_allclose(Multiplicative().difference(other.mean, one.mean), 0.0, atol=1e-6)
        np.testing.assert_allclose(other.covariance, one.covariance, rtol=1e-5, atol=1e-9)
        np.testing.assert_array_equal(other.dof, one.dof)
        if k:
            np.testing.assert_allclose(other.log_likelihood, one.log_likelihood, rtol=1e-6, atol=1e-5)


@every_filter
@pytest.mark.parametrize("size", [1, 3, 10])
def test_a_trial_is_the_same_to_the_bit_in_any_batch(kind, size):
    model = StackedMeasurement((tracker(), SUN, GYRO, WHEELS))
    readings, command = flight(model, 6, 64)
    readings[1::2, :, :4], readings[3, ::2, 4:7], readings[4, 5] = np.nan, np.nan, np.nan
    layer = layered(kind, np.repeat([8e-4, 8e-4, 8e-3, 2.0], [3, 3, 3, 4]))
    ours = FILTERS[kind](model, **layer)
    if isinstance(ours, ParticleFilter):
        rng = np.random.default_rng(14)
        numbers = [draws(rng, (64,), ours.particles, 10) for _ in range(6)]
    outcomes = []
    for trials in (64, size):
        belief = None
        for k in range(6):
            extra = (Draws(*(part[:trials] for part in numbers[k][:2])),) if isinstance(ours, ParticleFilter) else ()
            if belief is None:
                belief = ours.initial(readings[k, :trials], *extra)
            else:
                belief = ours.step(belief, command[k - 1, :trials], readings[k, :trials], DT, *extra)
        outcomes.append(belief)
    for name in ("mean", "covariance", "nis", "log_likelihood"):
        np.testing.assert_array_equal(getattr(outcomes[0], name)[:size], getattr(outcomes[1], name))


def test_modes_stepped_as_one_and_one_by_one_agree():
    model = StackedMeasurement((tracker(), GYRO))
    readings, command = flight(model, 15, 3)
    for kind in (ExtendedFilter, UnscentedFilter):
        one, other = watch(imm(model, kind), readings, command)[-1], watch(imm(model, kind, apart=True), readings, command)[-1]
        np.testing.assert_allclose(one.mean, other.mean, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(one.modes.probabilities, other.modes.probabilities, atol=1e-9)


def test_filters_are_stacked_only_if_they_read_the_same():
    one, other = body_filter(GYRO), body_filter(WHEELS)
    assert not stackable(one, other)
    assert not stackable(one, body_filter(None, measurement_noise=np.eye(10)))
    sliding = replace(one, gain=SlidingGain(np.full(3, 8e-3)))
    assert stackable(one, sliding)
    readings, command = flight(GYRO, 8, 3)
    both = stack([one, sliding])
    belief = both.initial(readings[0])
    for k in range(1, 8):
        belief = both.step(belief, command[k - 1], readings[k], DT)
    for i, single in enumerate((one, sliding)):
        np.testing.assert_array_equal(np.broadcast_to(belief.mean, (2, 3, 11))[i], watch(single, readings, command)[-1].mean)


def test_the_sliding_gain_of_a_part_is_that_part_of_the_whole():
    rng = np.random.default_rng(15)
    residual, layer = rng.standard_normal((5, 4)), np.array([0.5, 1.0, 2.0, 4.0])
    whole = sliding_gain(residual, layer)
    np.testing.assert_allclose(sliding_gain(residual[:, [2, 0]], layer[[2, 0]], np.eye(4)[[2, 0]]), whole[:, :, [2, 0]], atol=1e-15)
    two = np.array([[1.0, 0.0], [1.0, 0.0]])  # of two sensors of one component each corrects half, one alone all
    np.testing.assert_allclose(sliding_gain(np.array([9.0, 9.0]), np.ones(2), two), [[0.5, 0.5], [0.0, 0.0]], atol=1e-15)
    np.testing.assert_allclose(sliding_gain(np.array([9.0, 0.0]), np.ones(2), two * [[1.0], [0.0]]), [[1.0, 0.0], [0.0, 0.0]], atol=1e-15)
