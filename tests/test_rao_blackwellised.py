"""The Rao-Blackwellised filter against the exact posterior of linear-Gaussian problems, and against plain particles."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from estimation.marginalised_unscented import GivenMotion, GivenParameters, MarginalisedUnscentedFilter
from estimation.particle import Draws, ParticleFilter
from estimation.proposals import ConstantNoise
from estimation.rao_blackwellised import BlockBelief, BlockDraws, Joint, RaoBlackwellisedFilter
from estimation.sigma_points import SigmaPoints
from estimation.state_space import Euclidean
from models.chebyshev_network import ChebyshevNetwork
from models.dynamics.planar_agent import PlanarAgent, runge_kutta_of_motion

# an angle that is read, and the bias of the gyro that is integrated to it; the gyro's reading is the command ------------------------

DT, TICKS, TRIALS = 0.1, 20, 30
F = np.array([[1.0, -DT], [0.0, 0.999]])
Q, R, P0 = np.diag([2e-3, 1e-4]), np.array([[4e-3]]), np.diag([4e-3, 0.25])


@dataclass(frozen=True)
class GyroBias:
    """Angle a and bias b: a' = a + dt (u - b), b' = 0.999 b, each with noise; `sampled` says which of them the particles are of."""

    sampled: int

    def joint(self, sampled, mean, covariance, command, dt):
        s, c = self.sampled, 1 - self.sampled
        drive = np.array([dt, 0.0])
        after_s = F[s, s] * sampled + F[s, c] * mean + drive[s] * command
        after_c = F[c, c] * mean + F[c, s] * sampled + drive[c] * command
        spread = F[s, c] ** 2 * covariance + Q[s, s]
        return Joint(after_s, after_c, spread, F[c, c] * F[s, c] * covariance, F[c, c] ** 2 * covariance + Q[c, c])


def flights(seed: int):
    """Commands (ticks, trials, 1), readings (ticks, trials, 1), some of them missing, of the model with its own noise."""
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((TRIALS, 2)) @ np.sqrt(P0)
    command, reading = rng.standard_normal((TICKS, TRIALS, 1)), np.empty((TICKS, TRIALS, 1))
    for k in range(TICKS):
        x = x @ F.T + command[k] * [DT, 0.0] + rng.standard_normal((TRIALS, 2)) @ np.sqrt(Q)
        reading[k] = x[:, :1] + rng.standard_normal((TRIALS, 1)) @ np.sqrt(R)
    reading[7:10, ::3] = np.nan
    return command, reading


def exact(command, reading):
    """Means (ticks, trials, 2), covariances (ticks, trials, 2, 2) and log likelihoods (ticks, trials) by the Kalman filter."""
    mean, covariance = np.zeros((TRIALS, 2)), np.tile(P0, (TRIALS, 1, 1))
    means, covariances, logs = [], [], []
    for u, z in zip(command, reading, strict=True):
        mean, covariance = mean @ F.T + u * [DT, 0.0], F @ covariance @ F.T + Q
        seen = ~np.isnan(z[:, 0])
        s = covariance[:, 0, 0] + R[0, 0]
        residual = np.where(seen, z[:, 0] - mean[:, 0], 0.0)
        gain = covariance[:, :, 0] / s[:, None] * seen[:, None]
        mean, covariance = mean + gain * residual[:, None], covariance - gain[:, :, None] * covariance[:, None, 0, :]
        means.append(mean), covariances.append(covariance)
        logs.append(np.where(seen, -0.5 * (residual**2 / s + np.log(2 * np.pi * s)), 0.0))
    return np.array(means), np.array(covariances), np.array(logs)


def rao_blackwellised(sampled: int, proposal: str, particles: int, command, reading, seed: int):
    """Means (ticks, trials, 2) in the order of the state, variances of both, and log likelihoods."""
    one, other = (np.eye(1), None) if sampled == 0 else (np.zeros((1, 1)), np.eye(1))
    filter = RaoBlackwellisedFilter(GyroBias(sampled), one, other, R, particles, proposal)
    rng = np.random.default_rng(seed)

    def draws():
        return BlockDraws(rng.standard_normal((TRIALS, particles, 1)), rng.random((TRIALS, particles)))

    s, c = sampled, 1 - sampled
    zero = np.zeros((TRIALS, 1))
    belief = filter.initial(zero, P0[s : s + 1, s : s + 1], zero, P0[c : c + 1, c : c + 1], draws())
    means, variances, logs = [], [], []
    for u, z in zip(command, reading, strict=True):
        belief = filter.step(belief, u, z, DT, draws())
        both = [belief.sampled_mean[:, 0], belief.conditional_mean[:, 0]]
        spread = [belief.sampled_covariance[:, 0, 0], belief.conditional_covariance[:, 0, 0]]
        means.append(np.stack([both[s], both[c]], axis=-1))
        variances.append(np.stack([spread[s], spread[c]], axis=-1))
        logs.append(belief.log_likelihood)
    return np.array(means), np.array(variances), np.array(logs)


@pytest.mark.parametrize(
    ("sampled", "proposal"),
    [(0, "optimal"), (0, "prior"), (0, "likelihood"), (1, "optimal"), (1, "prior")],
    ids=lambda case: ("particles-on-the-angle", "particles-on-the-bias")[case] if isinstance(case, int) else case,
)
def test_the_exact_posterior_within_monte_carlo_error(sampled, proposal):
    command, reading = flights(1)
    mean, covariance, logs = exact(command, reading)
    deviation = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    off = {}
    for particles in (100, 900):
        means, variances, found = rao_blackwellised(sampled, proposal, particles, command, reading, 2)
        off[particles] = np.sqrt(np.mean(((means - mean) / deviation)[5:] ** 2))
        if particles == 900:
            assert np.abs(np.mean(variances[5:] / deviation[5:] ** 2) - 1.0) < 0.03
            assert abs(np.mean(found - logs)) < 0.01
            of_trials = np.mean(((means - mean) / deviation)[5:], axis=(0, 2))
            scatter = np.std(of_trials) / np.sqrt(TRIALS)  # the likelihood's is larger: here readings are worse than predictions
            assert abs(np.mean(of_trials)) < (4.0 * scatter if proposal == "likelihood" else 0.01)
    assert off[900] < 0.08  # of a standard deviation
    assert 0.2 < off[900] / off[100] < 0.5  # a third, as Monte Carlo error goes


# two components each, nothing symmetric: every particle's Gaussian against conditioning of the joint one ------------------------------

TURN = np.array([[0.9, 0.3, 0.1, -0.2], [-0.4, 0.8, 0.3, 0.1], [0.2, -0.1, 0.7, 0.5], [0.0, 0.3, -0.6, 0.8]])
SHAKE = 0.3 * np.array([[1.0, 0.8, -0.2, 0.5], [0.0, 0.6, 0.4, -0.3], [0.0, 0.0, 0.9, 0.7], [0.0, 0.0, 0.0, 0.7]])
DRIVE = np.array([1.0, -2.0, 0.5, 1.5])
SEEN = np.array([[1.0, 0.4, -0.7, 0.2], [0.3, -0.9, 0.1, 1.1], [-0.5, 0.2, 0.8, 0.6]])
ERROR = 0.4 * np.array([[1.0, 0.0, 0.0], [0.6, 0.9, 0.0], [-0.4, 0.3, 1.2]])


class TwoByTwo:
    """x' = F x + b u + w, of which the first two components are sampled, with full covariances."""

    def joint(self, sampled, mean, covariance, command, dt):
        after = np.concatenate([sampled, mean], axis=-1) @ TURN.T + dt * DRIVE * command
        spread = TURN[:, 2:] @ covariance @ TURN[:, 2:].T + SHAKE @ SHAKE.T
        return Joint(after[..., :2], after[..., 2:], spread[..., :2, :2], spread[..., 2:, :2], spread[..., 2:, 2:])


def given(mean, covariance, known, value):
    """Mean and covariance of the other components of a Gaussian once those of `known` have a value."""
    rest = np.setdiff1d(np.arange(len(mean)), known)
    gain = covariance[np.ix_(rest, known)] @ np.linalg.inv(covariance[np.ix_(known, known)])
    left = covariance[np.ix_(rest, rest)] - gain @ covariance[np.ix_(known, rest)]
    return mean[rest] + gain @ (value - mean[known]), left


@pytest.mark.parametrize("lost", [[], [1]], ids=["all-read", "one-missing"])
@pytest.mark.parametrize("proposal", ["optimal", "prior"])
def test_a_particles_gaussian_and_weight_are_those_of_the_joint_distribution(proposal, lost):
    """The joint Gaussian of both blocks and the reading, 2 + 2 + 3 components, conditioned at once on what was drawn and read."""
    particles, rng = 5, np.random.default_rng(21)
    filter = RaoBlackwellisedFilter(TwoByTwo(), SEEN[:, :2], SEEN[:, 2:], ERROR @ ERROR.T, particles, proposal, threshold=0.0)
    root = rng.standard_normal((1, particles, 2, 2))
    weights = rng.dirichlet(np.ones(particles))
    before = BlockBelief(
        *rng.standard_normal((2, 1, particles, 2)),
        root @ root.swapaxes(-1, -2),
        np.log(weights)[None],
        np.array([5.0]),
        np.zeros(1),
        np.zeros(1, int),
    )
    command, reading, draws = (
        np.array([[0.7]]),
        rng.standard_normal((1, 3)),
        BlockDraws(rng.standard_normal((1, particles, 2)), np.zeros(1)),
    )
    reading[:, lost] = np.nan
    after = filter.step(before, command, reading, DT, draws)
    read = np.setdiff1d(np.arange(3), lost)
    everything, error = np.concatenate([np.eye(4), SEEN[read]]), ERROR @ ERROR.T
    likelihood = np.empty(particles)
    for i in range(particles):
        x = np.concatenate([before.sampled[0, i], before.mean[0, i]])
        spread = TURN[:, 2:] @ before.covariance[0, i] @ TURN[:, 2:].T + SHAKE @ SHAKE.T
        mean, joint = everything @ (TURN @ x + DT * DRIVE * 0.7), everything @ spread @ everything.T
        joint[4:, 4:] += error[np.ix_(read, read)]
        z, seen = reading[0, read], np.arange(4, 4 + len(read))
        if proposal == "optimal":
            centre, wide = given(mean, joint, seen, z)
            likelihood[i] = multivariate_normal(mean[4:], joint[4:, 4:]).pdf(z)
        else:
            centre, wide = mean, joint
        drawn = centre[:2] + np.linalg.cholesky(wide[:2, :2]) @ draws.normals[0, i]
        if proposal == "prior":
            expected, uncertain = given(mean, joint, np.arange(2), drawn)
            likelihood[i] = multivariate_normal(expected[2:], uncertain[2:, 2:]).pdf(z)
        np.testing.assert_allclose(after.sampled[0, i], drawn, rtol=1e-10)
        left, narrow = given(mean, joint, np.concatenate([[0, 1], seen]), np.concatenate([drawn, z]))
        np.testing.assert_allclose(after.mean[0, i], left, rtol=1e-9)
        np.testing.assert_allclose(after.covariance[0, i], narrow, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(after.log_likelihood, np.log(np.sum(weights * likelihood)), rtol=1e-10)
    np.testing.assert_allclose(np.exp(after.log_weights[0]), weights * likelihood / np.sum(weights * likelihood), rtol=1e-10)


@pytest.mark.parametrize("lost", [[], [1]], ids=["all-read", "one-missing"])
def test_the_likelihood_draws_what_is_read_from_the_reading_and_weighs_it_by_the_model(lost):
    """Two components of the sampled block are read; one particle's density and weight, by conditioning of the joint Gaussian."""
    particles, rows, error = 4, SEEN[:2, :2], (ERROR @ ERROR.T)[:2, :2]
    filter = RaoBlackwellisedFilter(TwoByTwo(), rows, None, error, particles, "likelihood", threshold=0.0)
    rng = np.random.default_rng(22)
    root = rng.standard_normal((1, particles, 2, 2))
    spreads = root @ root.swapaxes(-1, -2)
    even = np.full((1, particles), -np.log(particles))
    before = BlockBelief(*rng.standard_normal((2, 1, particles, 2)), spreads, even, np.array([4.0]), np.zeros(1), np.zeros(1, int))
    reading, normals = rng.standard_normal((1, 2)), rng.standard_normal((1, particles, 2))
    reading[:, lost] = np.nan
    read = np.setdiff1d(np.arange(2), lost)
    after = filter.step(before, np.zeros((1, 1)), reading, DT, BlockDraws(normals, np.zeros(1)))
    weights = np.empty(particles)
    for i in range(particles):
        mean = TURN @ np.concatenate([before.sampled[0, i], before.mean[0, i]])
        spread = TURN[:, 2:] @ before.covariance[0, i] @ TURN[:, 2:].T + SHAKE @ SHAKE.T
        own, seen = spread[:2, :2], rows[read]
        gain = own @ seen.T @ np.linalg.inv(seen @ own @ seen.T)
        centre = mean[:2] + gain @ (reading[0, read] - seen @ mean[:2])
        wide = own - gain @ seen @ own + gain @ error[np.ix_(read, read)] @ gain.T  # of y = H s drawn from N(z, R), and of s given y
        np.testing.assert_allclose(after.sampled[0, i], centre + np.linalg.cholesky(wide) @ normals[0, i], rtol=1e-8)
        weights[i] = multivariate_normal(seen @ mean[:2], seen @ own @ seen.T).pdf(seen @ after.sampled[0, i])
    np.testing.assert_allclose(np.exp(after.log_weights[0]), weights / weights.sum(), rtol=1e-8)


def test_particles_of_two_blocks_are_resampled_by_a_schedule_and_the_likelihood_is_refused_where_nothing_is_read():
    filter = RaoBlackwellisedFilter(TwoByTwo(), SEEN[:, :2], SEEN[:, 2:], ERROR @ ERROR.T, 30, threshold=1.0, every=2)
    rng, few = np.random.default_rng(23), []
    belief = filter.initial(
        np.zeros((1, 2)), np.eye(2), np.zeros((1, 2)), np.eye(2), BlockDraws(rng.standard_normal((1, 30, 2)), np.zeros(1))
    )
    for k in range(5):
        reading = np.full((1, 3), 0.3 if k == 0 else np.nan)
        belief = filter.step(belief, np.zeros((1, 1)), reading, DT, BlockDraws(rng.standard_normal((1, 30, 2)), rng.random((1, 30))))
        few.append(bool(belief.ess[0] < 29.0))
    assert few == [True, True, False, False, False]
    with pytest.raises(ValueError, match="a reading of the sampled block alone"):
        RaoBlackwellisedFilter(TwoByTwo(), SEEN[:, :2], SEEN[:, 2:], ERROR @ ERROR.T, 30, "likelihood")


def test_the_first_particles_have_the_covariance_that_is_given():
    spread = np.array([[2.0, 1.2], [1.2, 1.0]])
    normals = np.random.default_rng(5).standard_normal((1, 4000, 2))
    filter = RaoBlackwellisedFilter(TwoByTwo(), SEEN[:, :2], SEEN[:, 2:], ERROR @ ERROR.T, 4000)
    first = filter.initial(np.array([[3.0, -1.0]]), spread, np.zeros((1, 2)), np.eye(2), BlockDraws(normals, np.zeros((1, 4000))))
    np.testing.assert_allclose(np.sum(np.exp(first.log_weights)), 1.0, rtol=1e-12)
    np.testing.assert_allclose(first.sampled_mean[0], [3.0, -1.0], atol=4 * (2.0 / 4000) ** 0.5)
    np.testing.assert_allclose(first.sampled_covariance[0], spread, atol=0.15)


class Plain:
    """The same system, discrete, for the plain particle filter."""

    def derivative(self, state, command):  # pragma: no cover  # the filter's integrator does not ask for it
        raise NotImplementedError


def discrete(process, state, command, dt):
    return state @ F.T + command * [dt, 0.0]


def test_less_variance_than_plain_particles_that_are_ten_times_as_many():
    command, reading = flights(3)
    mean, covariance, _ = exact(command, reading)
    blocks = rao_blackwellised(0, "optimal", 100, command, reading, 4)[0]
    rng = np.random.default_rng(5)

    def draws():
        return Draws(rng.standard_normal((TRIALS, 1000, 2)), rng.random((TRIALS, 1000)))

    plain = ParticleFilter(
        Plain(), ConstantNoise.of(Q), np.diag([R[0, 0], 1.0]), np.zeros(2), np.diag(P0), 1000, space=Euclidean(), integrate=discrete
    )
    belief = plain.initial(np.full((TRIALS, 2), np.nan), draws())
    means = []
    for u, z in zip(command, reading, strict=True):
        belief = plain.step(belief, u, np.concatenate([z, np.full((TRIALS, 1), np.nan)], axis=-1), DT, draws())
        means.append(belief.mean)
    variance = [np.mean(((m - mean)[5:, :, 1] ** 2) / covariance[5:, :, 1, 1]) for m in (blocks, np.array(means))]
    assert variance[0] < 0.7 * variance[1]  # of the bias, which is what is marginalised


# the marginalised unscented particle filter ---------------------------------------------------------------------------------------

AGENT = PlanarAgent(ChebyshevNetwork())


def marginalised(sampled: str, particles: int = 20, proposal: str = "optimal") -> MarginalisedUnscentedFilter:
    return MarginalisedUnscentedFilter(
        process=AGENT,
        motion_noise=1e-6 * np.eye(4),
        parameter_noise=np.full(26, 1e-4),
        measurement_noise=1e-8 * np.eye(4),
        parameter_variance=np.full(26, 0.01),
        sampled=sampled,
        particles=particles,
        proposal=proposal,
        integrate=runge_kutta_of_motion,
    )


def particles_of(trials: int, agents: int, size: int, seed: int = 0) -> BlockDraws:
    rng = np.random.default_rng(seed)
    return BlockDraws(rng.standard_normal((trials, agents, 20, size)), rng.random((trials, agents, 20)))


def test_the_products_are_the_unscented_transform_of_the_weights():
    """Sigma points on the 26 weights through the same held acceleration give the same joint Gaussian."""
    rng = np.random.default_rng(6)
    motion, mean, command = rng.uniform(-1, 1, (3, 5, 4)), rng.standard_normal((3, 5, 26)), rng.standard_normal((3, 1, 2))
    root = 0.2 * rng.standard_normal((3, 5, 26, 26))
    covariance = root @ root.swapaxes(-1, -2)
    noise = 1e-6 * np.eye(4)
    joint = GivenMotion(AGENT, noise, np.full(26, 1e-4)).joint(motion, mean, covariance, command, 0.01)

    points = SigmaPoints()
    weights = mean[..., None, :] + points.offsets(np.linalg.cholesky(covariance + 1e-12 * np.eye(26)))
    now = AGENT.acceleration(motion, mean, command)
    middle = motion + 0.005 * np.concatenate([motion[..., 2:], now], axis=-1)
    held = AGENT.acceleration(middle[..., None, :], weights, command[..., None, :])
    place, speed = motion[..., None, :2], motion[..., None, 2:]
    after = np.concatenate([place + 0.01 * speed + 0.5e-4 * held, speed + 0.01 * held, weights], axis=-1)
    errors = after[..., 1:, :] - after[..., :1, :]
    weight = 0.5 / (points.alpha**2 * 26)  # of every point but the central one; the mean does not move
    spread = weight * errors.swapaxes(-1, -2) @ errors
    np.testing.assert_allclose(weight * errors.sum(axis=-2), 0.0, atol=1e-9)
    np.testing.assert_allclose(joint.sampled, after[..., 0, :4], atol=1e-12)
    np.testing.assert_allclose(joint.spread - noise, spread[..., :4, :4], atol=1e-8)
    np.testing.assert_allclose(joint.cross, spread[..., 4:, :4], atol=1e-8)


def test_given_its_parameters_the_motion_is_an_unscented_filter():
    rng = np.random.default_rng(7)
    weights, mean, command = rng.standard_normal((2, 5, 26)), rng.uniform(-1, 1, (2, 5, 4)), rng.standard_normal((2, 1, 2))
    model = GivenParameters(AGENT, 1e-6 * np.eye(4), np.full(26, 1e-4), integrate=runge_kutta_of_motion)
    joint = model.joint(weights, mean, np.tile(1e-4 * np.eye(4), (2, 5, 1, 1)), command, 0.01)
    state = np.concatenate([mean, weights], axis=-1)
    np.testing.assert_allclose(joint.conditional, runge_kutta_of_motion(AGENT, state, command, 0.01)[..., :4], atol=1e-4)
    linear = np.eye(4) + 0.01 * AGENT.linearize(state, command).jacobian[..., :4, :4]
    expected = 1e-4 * linear @ linear.swapaxes(-1, -2)
    towards = 0.01 * AGENT.by_weights(mean)
    np.testing.assert_allclose(joint.covariance[..., :2, :2], expected[..., :2, :2] + 1e-6 * np.eye(2), atol=1e-6)
    np.testing.assert_allclose(joint.cross[..., 2:, :], 1e-4 * towards, rtol=1e-12)
    np.testing.assert_allclose(joint.cross[..., :2, :], 1e-4 * 0.005 * towards, rtol=1e-12)  # held for a tick of 0.01 s


@pytest.mark.parametrize("proposal", ["optimal", "prior"])
@pytest.mark.parametrize("sampled", ["state", "parameters"])
def test_a_trial_is_the_same_to_the_bit_in_any_batch(sampled, proposal):
    filter, rng = marginalised(sampled, proposal=proposal), np.random.default_rng(9)
    reading, command = 0.3 * rng.standard_normal((6, 10, 2, 4)), rng.standard_normal((6, 10, 2, 2))
    numbers = [particles_of(10, 2, filter.size, k) for k in range(7)]

    def last(trials):
        some = [BlockDraws(*(part[trials] for part in each)) for each in numbers]
        belief = filter.initial(reading[0, trials], some[6])
        for k in range(1, 6):
            belief = filter.step(belief, command[k, trials], reading[k, trials], 0.01, some[k])
        return belief

    everyone, alone = last(np.arange(10)), last(np.array([4]))
    assert (everyone.ess < 16).any()  # some are resampled
    for one, part in zip(alone, everyone, strict=True):
        np.testing.assert_array_equal(one[0], part[4])


def test_a_missing_reading_weighs_nothing():
    filter = marginalised("state")
    belief = filter.initial(np.zeros((1, 1, 4)), particles_of(1, 1, 4))
    after = filter.step(belief, np.ones((1, 1, 2)), np.full((1, 1, 4), np.nan), 0.01, particles_of(1, 1, 4, 1))
    np.testing.assert_allclose(after.log_weights, belief.log_weights, atol=1e-12)
    np.testing.assert_allclose(filter.motion(after)[0, 0, 2:], 0.01, atol=2e-3)  # u for a tick, within process noise


def test_impossible_settings_are_refused():
    with pytest.raises(ValueError, match="particles = 1"):
        RaoBlackwellisedFilter(GyroBias(0), np.eye(1), None, R, particles=1)
