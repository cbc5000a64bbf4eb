"""Fading memory: the factors by hand, the filter that has them, and a body whose rate is only to be had from its attitude."""

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.stats import chi2

from estimation.adaptive_unscented import AdaptiveUnscentedFilter
from estimation.fading import ConstantFading, FadingLaw, GatedTracking, StrongTracking, Surprise, TraceFading
from estimation.gaussian import Belief
from estimation.proposals import ConstantNoise, MatchedNoise, ProcessNoise
from estimation.state_space import Euclidean, Signed
from estimation.unscented import UnscentedFilter
from models.attitude.quaternion import IDENTITY, angle
from models.chebyshev_network import ChebyshevNetwork
from models.dynamics.attitude_by_rodrigues import AttitudeByRodrigues
from models.dynamics.planar_agent import PlanarAgent, runge_kutta_of_motion
from models.dynamics.process import runge_kutta
from models.dynamics.rigid_body import RigidBody
from models.dynamics.vector_part_measurement import VectorPart
from models.plants.formation import FormationParameters
from sim.estimators.consensus import joint_filter
from sim.estimators.formation import agents_filter
from sim.estimators.learner_settings import TuningSettings, Unscented
from sim.estimators.rodrigues_settings import AukfSettings

INERTIA = np.array([[20.0, 1.2, 0.9], [1.2, 17.0, 1.4], [0.9, 1.4, 15.0]])  # of Rososhansky (2017); its filters believe the diagonal
BODY, MODEL = (RigidBody(inertia, np.eye(3), np.zeros((3, 0))) for inertia in (INERTIA, np.diag(np.diag(INERTIA))))
VECTOR = np.array([-0.6, 0.4, -0.2])
START = np.concatenate([VECTOR, [np.sqrt(1 - VECTOR @ VECTOR)], np.ones(3)])
SIGMA, TICK = 1e-4, 0.01
NOISE = np.diag([SIGMA**2] * 4 + [1.0] * 3)
PRINTED = ConstantNoise.of(1e-6 * np.eye(7))


def unscented(**settings) -> UnscentedFilter:
    at_rest = {"prior": np.concatenate([IDENTITY, np.zeros(3)]), "prior_variance": np.repeat([1.0, 1e-3], [4, 3])}
    return UnscentedFilter(**({"process": MODEL, "process_noise": np.zeros((7, 7)), "measurement_noise": NOISE} | at_rest | settings))


def adaptive(fading: FadingLaw, noise: ProcessNoise = PRINTED, **settings) -> AdaptiveUnscentedFilter:
    return AdaptiveUnscentedFilter(unscented(**settings), noise, fading)


def tumble(
    one, ticks: int, trials: int = 8, start: np.ndarray = START, body: RigidBody = BODY, seed: int = 6
) -> tuple[np.ndarray, list[Belief]]:
    """True states (ticks, 7) of a body without torque, and beliefs after readings of its attitude."""
    state, rng, path, beliefs = start, np.random.default_rng(seed), [], []
    for k in range(ticks):
        reading = np.full((trials, 7), np.nan)
        reading[:, :4] = state[:4] + SIGMA * rng.standard_normal((trials, 4))
        beliefs.append(one.initial(reading) if k == 0 else one.step(beliefs[-1], np.zeros((trials, 3)), reading, TICK))
        path.append(state)
        state = runge_kutta(body, state[None], np.zeros(3), TICK)[0]
    return np.array(path), beliefs


def rate_error(path: np.ndarray, beliefs: list[Belief], since: int) -> float:
    """Root mean square over ticks, trials and axes."""
    return float(np.sqrt(np.mean((np.array([b.mean[:, 4:] for b in beliefs]) - path[:, None, 4:])[since:] ** 2)))


def test_factors_by_hand():
    residual = np.array([[3.0, np.nan], [1.0, 2.0], [np.nan, np.nan]])
    surprise = Surprise(residual, np.tile(np.diag([0.5, 2.0]), (3, 1, 1)), np.diag([0.25, 0.5]), np.diag([1.0, 4.0]))
    law, unknown = StrongTracking(forgetting=0.5, cap=100.0), np.full((3, 2), np.nan)
    factor, variance = law.factor(surprise, unknown)
    np.testing.assert_allclose(variance, [[9.0, np.nan], [1.0, 4.0], [np.nan, np.nan]])
    np.testing.assert_allclose(factor, [(9.0 - 0.25 - 1.0) / 0.5, 1.0, 1.0])  # the second has less surprise than expected
    factor, variance = law.factor(surprise._replace(residual=-residual), variance)
    np.testing.assert_allclose(variance[:2], [[9.0, np.nan], [1.0, 4.0]])
    later, variance = law.factor(surprise._replace(residual=np.array([[0.0, 10.0]] * 3)), variance)
    np.testing.assert_allclose(variance[0], [3.0, 100.0])
    np.testing.assert_allclose(later[0], ((3.0 - 1.25) + (100.0 - 4.5) / 4.0) / (0.5 + 2.0 / 4.0))
    assert StrongTracking(cap=7.0).factor(surprise, unknown)[0][0] == 7.0
    constant = ConstantFading(1.02).factor(surprise, unknown)
    np.testing.assert_array_equal(constant[0], [1.02] * 3)
    np.testing.assert_array_equal(constant[1], unknown)


def test_the_printed_factor_by_hand():
    """1 + 1000 (0.03^2 + 0.04^2) = 3.5; a missing component adds nothing, and nothing is remembered."""
    residual = np.array([[0.03, -0.04], [0.03, np.nan], [np.nan, np.nan]])
    surprise, unknown = Surprise(residual, np.eye(2), np.eye(2), np.eye(2)), np.full((3, 2), np.nan)
    factor, variance = TraceFading(1e3).factor(surprise, unknown)
    np.testing.assert_allclose(factor, [3.5, 1.9, 1.0], rtol=1e-14)
    np.testing.assert_array_equal(variance, unknown)
    np.testing.assert_allclose(TraceFading(1e-3).factor(surprise, unknown)[0], 1.0, atol=3e-6)  # 1e3 as a divisor: hardly fades at all


def test_the_printed_factor_of_a_constant_in_closed_form():
    """A constant that is read: 1 / P grows by 1 / R of information a step, and is divided by 1 + c nu^2 before."""
    rng, c, variance = np.random.default_rng(5), 40.0, 0.01
    readings = 2.0 + 0.1 * rng.standard_normal((60, 1))
    plain = UnscentedFilter(None, np.zeros((1, 1)), variance * np.eye(1), np.zeros(1), np.ones(1), Euclidean(), integrate=stay)
    one = AdaptiveUnscentedFilter(plain, ConstantNoise(np.zeros((1, 1))), TraceFading(c))
    mean, information, belief = readings[0, 0], 1.0 / variance, one.initial(readings[0])
    for (reading,) in readings[1:]:
        belief = one.step(belief, np.zeros(1), np.array([reading]), 1.0)
        factor = 1.0 + c * (reading - mean) ** 2
        faded = information / factor
        mean, information = (faded * mean + reading / variance) / (faded + 1.0 / variance), faded + 1.0 / variance
        assert belief.memory.fading == pytest.approx(factor, rel=1e-12)
        assert belief.mean[0] == pytest.approx(mean, rel=1e-12)
        assert 1.0 / belief.covariance[0, 0] == pytest.approx(information, rel=1e-10)


def by_the_textbook(move, mean, covariance, process_noise, sensitivity, noise, readings, c, alpha=0.1, beta=2.0, kappa=0.0):
    """Unscented filter with P- = (1 + c |nu|^2) M + Q of a plain vector, written out with weights and points; means after readings."""
    size, means = len(mean), []
    scale = alpha**2 * (size + kappa)
    first = np.full(2 * size + 1, 1.0 / (2.0 * scale))
    first[0] = 1.0 - size / scale
    second = first.copy()
    second[0] += 1.0 - alpha**2 + beta
    for reading in readings:
        root = np.sqrt(scale) * np.linalg.cholesky(covariance)
        points = move(np.vstack([mean, mean + root.T, mean - root.T]))
        mean = first @ points
        apart = points - mean
        innovation = reading - sensitivity @ mean
        before = (1.0 + c * innovation @ innovation) * (apart.T * second) @ apart + process_noise
        spread = sensitivity @ before @ sensitivity.T + noise
        gain = before @ sensitivity.T @ np.linalg.inv(spread)
        mean = mean + gain @ innovation
        covariance = before - gain @ spread @ gain.T
        means.append(mean)
    return np.array(means)


def test_the_printed_factor_in_a_formation_is_the_textbooks():
    plant, c, ticks = FormationParameters(), 1e3, 40
    settings = AukfSettings.model_validate({"type": "aukf", "fading": {"type": "trace", "coefficient": c}})
    one = agents_filter("it", settings, plant, 3, np.arange(1)).filter
    rng = np.random.default_rng(9)
    readings = 0.3 + 0.02 * np.cumsum(rng.standard_normal((ticks, 6, 3)), axis=0)  # jumps about, so that the factor matters
    torque = 0.1 * rng.standard_normal((6, 3))
    belief, means = one.initial(readings[None, 0]), []
    first = belief
    for reading in readings[1:]:
        belief = one.step(belief, torque[None], reading[None], TICK)
        means.append(belief.mean[0])
    assert belief.memory.fading.min() > 1.01
    for agent, own in enumerate(plant.believed_inertia):
        model = AttitudeByRodrigues(own)
        expected = by_the_textbook(
            lambda points, model=model, agent=agent: runge_kutta(model, points, torque[agent], TICK),
            first.mean[0, agent], first.covariance[0, agent], 1e-6 * np.eye(6), np.eye(3, 6), 1e-8 * np.eye(3), readings[1:, agent], c,
        )  # fmt: skip
        np.testing.assert_allclose(np.array(means)[:, agent], expected, atol=1e-7)


def test_the_printed_factor_of_agents_that_learn_is_the_textbooks():
    c, ticks = 1e3, 40
    process = PlanarAgent(ChebyshevNetwork(), 1.0)
    settings = Unscented.model_validate({"type": "unscented", "fading": {"type": "trace", "coefficient": c}})
    one, size = joint_filter(process, TuningSettings(), settings), process.size
    rng = np.random.default_rng(10)
    readings = 0.2 + 0.002 * np.cumsum(rng.standard_normal((ticks, 4)), axis=0)
    force = np.array([0.5, -0.2])
    belief = first = one.initial(readings[0])
    means = [(belief := one.step(belief, force, reading, TICK)).mean for reading in readings[1:]]
    expected = by_the_textbook(
        lambda points: runge_kutta_of_motion(process, points, force, TICK),
        first.mean, first.covariance, np.diag([1e-6] * 4 + [1e-4] * (size - 4)), np.eye(4, size), 1e-8 * np.eye(4), readings[1:], c,
    )  # fmt: skip
    np.testing.assert_allclose(means, expected, atol=1e-6)


@pytest.mark.parametrize(("section", "older", "newer"), [
    (AukfSettings, {}, {"type": "adaptive"}),
    (AukfSettings, {"fading": "strong-tracking", "cap": 7.0}, {"type": "adaptive", "cap": 7.0}),
    (AukfSettings, {"forgetting": 0.5}, {"type": "adaptive", "forgetting": 0.5}),
    (AukfSettings, {"fading": "constant"}, {"type": "constant", "factor": 1.0}),
    (AukfSettings, {"fading": "constant", "value": 1.5}, {"type": "constant", "factor": 1.5}),
    (Unscented, {}, {"type": "off"}),
    (Unscented, {"fading": 1.02}, {"type": "constant", "factor": 1.02}),
])  # fmt: skip
def test_older_spellings_are_still_read(section, older, newer):
    kind = {"type": "aukf" if section is AukfSettings else "unscented"}
    assert section.model_validate(kind | older).fading.law == section.model_validate(kind | {"fading": newer}).fading.law


@pytest.mark.parametrize(
    "older", [{"fading": "constant", "value": 0.5}, {"fading": "constant", "cap": 2.0}, {"fading": "strong"}, {"fading": True}]
)
def test_a_fading_that_is_none_is_refused(older):
    with pytest.raises(ValidationError):
        AukfSettings.model_validate({"type": "aukf"} | older)


def test_without_fading_it_is_the_unscented_filter():
    plain = unscented(process_noise=np.diag([1e-10] * 4 + [4e-6] * 3))
    _, one = tumble(adaptive(ConstantFading(), ConstantNoise.of(plain.process_noise)), 30)
    _, other = tumble(plain, 30)
    for mine, theirs in zip(one, other, strict=True):
        np.testing.assert_allclose(mine.mean, theirs.mean, atol=1e-14)
        np.testing.assert_allclose(mine.covariance, theirs.covariance, atol=1e-18)


def test_the_printed_factor_as_a_constant_leaves_no_memory():
    """What is left is the difference of the last two readings: 2 sqrt(2) sigma / dt = 0.028 rad/s on each axis, whatever the noise."""
    for noise in (PRINTED, ConstantNoise.of(np.diag([1e-10] * 4 + [4e-6] * 3))):
        path, beliefs = tumble(adaptive(ConstantFading(1e3), noise), 400)
        assert rate_error(path, beliefs, 100) == pytest.approx(2 * np.sqrt(2) * SIGMA / TICK, rel=0.1)


def test_a_constant_near_one_forgets_slowly():
    """The slope of a line with weights that fade by 1 / lambda has an error that grows as (lambda - 1)^(3/2)."""
    noise, still = ConstantNoise.of(1e-18 * np.eye(7)), START * np.repeat([1.0, 1e-3], [4, 3])
    found = [rate_error(*tumble(adaptive(ConstantFading(value), noise), 500, start=still), 250) for value in (1.02, 1.06)]
    assert found[1] / found[0] == pytest.approx(3**1.5, rel=0.25)
    assert found[0] < 1e-3


def test_strong_tracking_forgets_where_the_model_fails_and_nowhere_else():
    """A rate that jumps, and one that does not, with process noise that expects neither."""
    noise, still = ConstantNoise.of(np.diag([1e-12] * 4 + [1e-10] * 3)), START * np.repeat([1.0, 0.1], [4, 3])

    def jump(fading: FadingLaw) -> tuple[np.ndarray, list[Belief]]:
        one = adaptive(fading, noise)
        path, beliefs = tumble(one, 300, start=still)
        state, rng = path[-1] + np.repeat([0.0, 0.02], [4, 3]), np.random.default_rng(8)
        after = [state := runge_kutta(BODY, state[None], np.zeros(3), TICK)[0] for _ in range(100)]
        for state in after:
            reading = np.full((8, 7), np.nan)
            reading[:, :4] = state[:4] + SIGMA * rng.standard_normal((8, 4))
            beliefs.append(one.step(beliefs[-1], np.zeros((8, 3)), reading, TICK))
        return np.concatenate([path, after]), beliefs

    rigid, tracking = jump(ConstantFading()), jump(StrongTracking())
    factor = np.array([b.memory.fading for b in tracking[1]])
    assert np.median(factor[150:300]) == 1.0
    assert factor[300:330].max(axis=0).min() > 3.0
    assert rate_error(*tracking, 370) < 0.5 * rate_error(*rigid, 370)


def stay(process: None, state: np.ndarray, command: np.ndarray, dt: float) -> np.ndarray:
    return state


def honest(law: FadingLaw, size: int, process_noise: float, runs: int = 100, ticks: int = 800) -> tuple[np.ndarray, float]:
    """A random walk that is read, with the true Q, R = 1 and P0: factors (ticks, runs) after 300 steps, and RMS error over Kalman's."""
    rng, eye = np.random.default_rng(11), np.eye(size)
    settings = {"prior": np.zeros(size), "prior_variance": np.ones(size), "integrate": stay}
    plain = UnscentedFilter(**settings, process=None, process_noise=process_noise * eye, measurement_noise=eye, space=Euclidean())
    filters = {"it": AdaptiveUnscentedFilter(plain, ConstantNoise.of(process_noise * eye), law), "kalman": plain}
    state, beliefs, errors, factors = rng.standard_normal((runs, size)), {}, {"it": [], "kalman": []}, []
    for k in range(ticks):
        reading = state + rng.standard_normal((runs, size))
        for name, one in filters.items():
            beliefs[name] = one.initial(reading) if k == 0 else one.step(beliefs[name], np.zeros((runs, 1)), reading, 1.0)
            errors[name].append(beliefs[name].mean - state)
        factors.append(beliefs["it"].memory.fading)
        state = state + np.sqrt(process_noise) * rng.standard_normal((runs, size))
    rms = {name: np.sqrt(np.mean(np.square(each[300:]))) for name, each in errors.items()}
    return np.array(factors)[300:], rms["it"] / rms["kalman"]


# components, Q / R: mean factor and RMS error over the Kalman filter's of strong tracking, found with code of its own, 200 runs
HONEST = {(1, 0.01): (2.32, 2.09), (3, 0.01): (1.75, 1.70), (7, 1e-4): (None, 4.26)}


@pytest.mark.parametrize(("size", "process_noise"), HONEST)
def test_strong_tracking_of_an_honest_model_forgets_for_nothing_and_the_gated_one_does_not(size: int, process_noise: float):
    mean, cost = HONEST[size, process_noise]
    factor, ratio = honest(StrongTracking(), size, process_noise)
    assert 0.30 < np.mean(factor > 1.0) < 0.45
    assert np.median(factor) == 1.0
    assert ratio == pytest.approx(cost, rel=0.05)
    if mean is not None:
        assert np.mean(factor) == pytest.approx(mean, rel=0.05)
    factor, ratio = honest(GatedTracking(), size, process_noise)
    assert np.mean(factor > 1.0) < 1e-3
    assert 0.999 < ratio < 1.01


def test_the_gated_factor_by_hand():
    """Two components, S = diag(4, 4): M = 2, Q = 1, R = 1. NIS of (6, 2) is 10, over two 5; r = 0.8 + 0.2 5 = 1.8, then 2.44."""
    surprise = Surprise(np.array([[6.0, 2.0]]), np.diag([2.0, 2.0])[None], np.eye(2), np.eye(2))
    law = GatedTracking(forgetting=0.8, tail=0.02)
    factor, mean = law.factor(surprise, np.full((1, 2), np.nan))
    np.testing.assert_allclose(mean, [[1.8, 1.8]])
    assert chi2.isf(0.02, 18.0) / 18.0 == pytest.approx(1.802, abs=0.03)  # nine readings of two components
    factor, mean = law.factor(surprise, mean)
    np.testing.assert_allclose(mean, [[2.44, 2.44]])
    np.testing.assert_allclose(factor, (2.44 * 4.0 - 1.0 - 1.0) / 2.0)
    _, same = law.factor(surprise._replace(residual=np.full((1, 2), np.nan)), mean)
    np.testing.assert_array_equal(same, mean)
    one, mean = law.factor(surprise._replace(residual=np.array([[0.0, np.nan]])), np.ones((1, 2)))
    np.testing.assert_allclose(mean, 0.8)
    np.testing.assert_array_equal(one, 1.0)
    assert GatedTracking(cap=3.0).factor(surprise, np.full((1, 2), 50.0))[0][0] == 3.0


def test_the_gated_factor_forgets_where_the_model_fails():
    noise, still = ConstantNoise.of(np.diag([1e-12] * 4 + [1e-10] * 3)), START * np.repeat([1.0, 0.1], [4, 3])
    path, beliefs = tumble(adaptive(GatedTracking(), noise), 300, start=still)
    one, rigid = adaptive(GatedTracking(), noise), adaptive(ConstantFading(), noise)
    state, rng = path[-1] + np.repeat([0.0, 0.02], [4, 3]), np.random.default_rng(8)
    after, both = [], {one: [beliefs[-1]], rigid: [tumble(rigid, 300, start=still)[1][-1]]}
    for _ in range(100):
        state = runge_kutta(BODY, state[None], np.zeros(3), TICK)[0]
        after.append(state)
        reading = np.full((8, 7), np.nan)
        reading[:, :4] = state[:4] + SIGMA * rng.standard_normal((8, 4))
        for each, kept in both.items():
            kept.append(each.step(kept[-1], np.zeros((8, 3)), reading, TICK))
    factor = np.array([b.memory.fading for b in beliefs[150:]])
    assert np.mean(factor > 1.0) < 0.02
    assert max(np.max(b.memory.fading) for b in both[one][1:31]) > 3.0
    found, rigidly = (rate_error(np.array(after), kept[1:], 70) for kept in (both[one], both[rigid]))
    assert found < 0.5 * rigidly


def test_matched_noise_finds_the_rate_of_a_tumbling_body_in_spite_of_a_wrong_inertia():
    path, beliefs = tumble(adaptive(StrongTracking(), MatchedNoise()), 500)
    assert rate_error(path, beliefs, 0) > 0.04  # nobody told it
    assert rate_error(path, beliefs, 100) < 0.03
    assert angle(beliefs[-1].mean[:, :4], path[-1, :4]).max() < 1e-3


def test_the_vector_part_alone_may_lock_onto_a_mirror_image():
    """At half a turn the fourth component changes its sign, which is not read: q and its mirror (q_1:3, -q_4) look alike."""
    turned = np.concatenate([[np.sqrt(1 - 0.02**2), 0.0, 0.0, 0.02], [0.5, 0.0, 0.0]])  # soon beyond half a turn
    lost = {}
    vector = {"measurement_noise": None, "measurement": VectorPart(NOISE), "space": Signed()}
    for measured, settings in (("quaternion", {}), ("vector", vector)):
        path, beliefs = tumble(adaptive(StrongTracking(), MatchedNoise(), **settings), 300, start=turned)
        lost[measured] = angle(beliefs[-1].mean[:, :4], path[-1, :4])
        assert beliefs[-1].dof.tolist() == [3.0] * 8
    assert lost["quaternion"].max() < 1e-3
    assert np.median(lost["vector"]) > 0.5


@pytest.mark.parametrize("size", [1, 3, 10])
def test_a_trial_has_the_same_bits_in_any_batch(size):
    one, rng, trials = adaptive(StrongTracking(), MatchedNoise()), np.random.default_rng(13), 64
    reading = np.full((12, trials, 7), np.nan)
    reading[..., :4] = START[:4] + 1e-3 * rng.standard_normal((12, trials, 4))
    reading[5, ::3] = np.nan
    reading[7, ::4, 5] = 1.0

    def fly(some: slice, lead: tuple[int, ...] = ()) -> Belief:
        belief = one.initial(reading[0, some].reshape(*lead, -1, 7))
        for k in range(1, 12):
            belief = one.step(belief, np.full((*lead, 1, 3), 0.1), reading[k, some].reshape(*lead, -1, 7), TICK)
        return belief

    everyone = fly(slice(None))
    for first in (0, 37, trials - size):
        some = slice(first, first + size)
        alone = fly(some, (1,))
        for part in ("mean", "covariance", "nis", "log_likelihood", "dof"):
            np.testing.assert_array_equal(getattr(alone, part)[0], getattr(everyone, part)[some], err_msg=part)
        np.testing.assert_array_equal(alone.memory.fading[0], everyone.memory.fading[some])
