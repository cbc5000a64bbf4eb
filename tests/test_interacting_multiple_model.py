"""The interacting multiple model filter against filterpy, closed forms, and wheels that fail."""

from dataclasses import replace

import numpy as np
import pytest
from filterpy.kalman import IMMEstimator, KalmanFilter
from scipy.linalg import expm
from scipy.special import logsumexp

from estimation.extended_kalman import ExtendedFilter
from estimation.gaussian import Belief, LostDefiniteness
from estimation.interacting_multiple_model import InteractingMultipleModel, mix
from estimation.modes import join
from estimation.sliding_innovation import SlidingGain
from estimation.state_space import Additive, Euclidean, Multiplicative
from estimation.unscented import UnscentedFilter
from models.attitude.quaternion import IDENTITY, angle
from models.dynamics.process import Linearization, Prediction, runge_kutta
from models.dynamics.rigid_body import RigidBody
from models.dynamics.wheel_faults import WheelFault
from models.plants.nacs import NacsParameters

DT = 0.1
RNG = np.random.default_rng

# a linear world that switches ----------------------------------------------------------------------------------------------------


class Linear:
    """dx/dt = A x + b u, an oscillator with its own damping and input gain."""

    def __init__(self, damping: float, gain: float) -> None:
        self.A, self.b = np.array([[0.0, 1.0], [-4.0, -damping]]), np.array([[0.0], [gain]])
        block = expm(DT * np.block([[self.A, self.b], [np.zeros((1, 3))]]))
        self.phi, self.gamma = block[:2, :2], block[:2, 2:]

    def derivative(self, state, command):
        return (self.A @ state[..., None] + self.b @ command[..., None])[..., 0]

    def linearize(self, state, command):
        return Linearization(self.derivative(state, command), np.broadcast_to(self.A, (*state.shape[:-1], 2, 2)))


def exactly(process, state, command, dt):
    return (process.phi @ state[..., None] + process.gamma @ command[..., None])[..., 0]


def with_transition(process, state, command, dt):
    return Prediction(exactly(process, state, command, dt), np.broadcast_to(process.phi, (*state.shape[:-1], 2, 2)))


MODES = (Linear(0.3, 1.0), Linear(0.3, 0.0), Linear(3.0, 1.0))
NOISES = (np.diag([1e-6, 1e-4]), np.diag([1e-6, 1e-4]), np.diag([2e-6, 5e-4]))
R = np.array([[4e-4, 1e-5], [1e-5, 1e-3]])
CHAIN = np.array([[0.95, 0.03, 0.02], [0.05, 0.9, 0.05], [0.01, 0.04, 0.95]])
START = np.array([0.6, 0.3, 0.1])


def linear_members(kind=ExtendedFilter):
    how = {"prediction": with_transition} if kind is ExtendedFilter else {"integrate": exactly}
    return tuple(
        kind(process, noise, R, np.zeros(2), np.ones(2), space=Euclidean(), **how) for process, noise in zip(MODES, NOISES, strict=True)
    )


def alone(imm: InteractingMultipleModel) -> InteractingMultipleModel:
    """The same filter with its members stepped one by one."""
    copy = replace(imm)
    copy.__dict__["_stacked"] = None
    return copy


def linear_run(steps: int, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Commands and readings while the mode changes every 40 steps."""
    rng, truth = RNG(seed), np.array([1.0, 0.0])
    command, readings = rng.normal(0, 2, (steps, 1)), np.empty((steps, 2))
    for k in range(steps):
        readings[k] = truth + rng.multivariate_normal(np.zeros(2), R)
        mode = (k // 40) % 3
        truth = exactly(MODES[mode], truth, command[k], DT) + rng.multivariate_normal(np.zeros(2), NOISES[mode])
    return command, readings


@pytest.mark.parametrize("one_by_one", [False, True])
@pytest.mark.parametrize("kind", [ExtendedFilter, UnscentedFilter])
def test_on_a_linear_model_it_is_filterpys(kind, one_by_one):
    command, readings = linear_run(400)
    ours = InteractingMultipleModel(linear_members(kind), CHAIN, START)
    assert ours._stacked is not None
    if one_by_one:
        ours = alone(ours)
    members = []
    for process, noise in zip(MODES, NOISES, strict=True):
        one = KalmanFilter(2, 2, 1)
        one.F, one.B, one.H, one.Q, one.R = process.phi, process.gamma, np.eye(2), noise, R
        one.x, one.P = readings[0][:, None], R.copy()
        members.append(one)
    theirs = IMMEstimator(members, START, CHAIN)
    belief = ours.initial(readings[0])
    winners = set()
    for k in range(1, 400):
        belief = ours.step(belief, command[k - 1], readings[k], DT)
        theirs.predict(command[k - 1][:, None])
        before = theirs.cbar.copy()
        theirs.update(readings[k][:, None])
        np.testing.assert_allclose(belief.modes.probabilities, theirs.mu, atol=1e-9)
        np.testing.assert_allclose(belief.mean, theirs.x[:, 0], atol=1e-9)
        np.testing.assert_allclose(belief.covariance, theirs.P, atol=1e-9 * np.abs(theirs.P).max())
        np.testing.assert_allclose(belief.modes.members.mean, [one.x[:, 0] for one in members], atol=1e-9)
        logs = np.array([one.log_likelihood for one in members])
        np.testing.assert_allclose(belief.log_likelihood, logsumexp(logs, b=before), atol=1e-7)
        np.testing.assert_allclose(belief.nis, members[np.argmax(before)].mahalanobis ** 2, rtol=1e-6)
        winners.add(int(np.argmax(theirs.mu)))
    assert winners == {0, 1, 2}  # the comparison went through every mode


def test_a_missing_reading_leaves_the_probabilities_to_the_chain():
    command, _ = linear_run(10)
    ours = InteractingMultipleModel(linear_members(), CHAIN, START)
    belief = ours.initial(np.full(2, np.nan))
    expected = START
    for k in range(1, 10):
        belief = ours.step(belief, command[k - 1], np.full(2, np.nan), DT)
        expected = expected @ CHAIN
        np.testing.assert_allclose(belief.modes.probabilities, expected, rtol=1e-13)
        assert (belief.nis, belief.dof) == (0.0, 0.0)
        assert belief.log_likelihood == pytest.approx(0.0, abs=1e-14)


def test_readings_a_million_deviations_off_leave_probabilities_finite():
    ours = InteractingMultipleModel(linear_members(), CHAIN, START)
    belief = ours.initial(np.zeros(2))
    for far in (1e6, -1e6, 0.0, 0.0):
        belief = ours.step(belief, np.zeros(1), np.full(2, far), DT)
        assert np.isfinite(belief.log_likelihood)
        np.testing.assert_allclose(belief.modes.probabilities.sum(), 1.0, rtol=1e-12)
        assert np.isfinite(belief.mean).all()


def test_a_mode_that_the_chain_forbids_stays_impossible_and_one_with_a_floor_does_not():
    command, readings = linear_run(30)
    forbidden = np.array([[1.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.0, 0.0, 1.0]])
    start = np.array([0.5, 0.5, 0.0])
    plain = InteractingMultipleModel(linear_members(UnscentedFilter), forbidden, start)
    floored = replace(plain, transition=np.eye(3), floor=1e-6)
    one, other = plain.initial(readings[0]), floored.initial(readings[0])
    for k in range(1, 30):
        one, other = plain.step(one, command[k - 1], readings[k], DT), floored.step(other, command[k - 1], readings[k], DT)
        assert one.modes.probabilities[2] == 0.0
        assert one.lost == 0  # a mode that mixes with none keeps its covariance
        assert other.modes.probabilities.min() > 0.99e-6
        np.testing.assert_allclose(other.modes.probabilities.sum(), 1.0, rtol=1e-14)
    assert np.isfinite(one.mean).all()


def test_a_fault_is_declared_above_one_probability_and_withdrawn_below_another():
    command, readings = linear_run(400)
    ours = InteractingMultipleModel(linear_members(), CHAIN, START, declare_above=0.9, withdraw_below=0.3)
    belief, declared, changes = ours.initial(readings[0]), False, 0
    for k in range(1, 400):
        belief = ours.step(belief, command[k - 1], readings[k], DT)
        fault = belief.modes.probabilities[1:].sum()
        assert belief.detection.statistic == pytest.approx(fault, abs=1e-15)
        before, declared = declared, bool(fault > 0.9 or (declared and fault >= 0.3))
        changes += before != declared
        assert belief.detection.declared == declared
    assert changes >= 4


PAIR = linear_members()[:2]
EVEN = np.array([0.5, 0.5])
OTHER = ExtendedFilter(MODES[0], NOISES[0], R, np.zeros(2), np.ones(2), space=Additive())
WRONG = {
    "row": ({"transition": np.array([[0.9, 0.1], [0.2, 0.7]])}, r"transition: row 2 sums to 0\.9, must be one: \[0\.2, 0\.7\]"),
    "negative": ({"transition": np.array([[1.1, -0.1], [0.2, 0.8]])}, r"transition: row 1 has a negative"),
    "nan": ({"transition": np.array([[np.nan, 0.5], [0.2, 0.8]])}, r"transition: row 1 has a negative or missing"),
    "shape": ({"transition": np.eye(3)}, r"transition has shape \(3, 3\), 2 filters need \(2, 2\)"),
    "start": ({"initial_probabilities": np.array([0.5, 0.4])}, r"initial_probabilities sums to 0\.9, must be one"),
    "start shape": ({"initial_probabilities": START}, r"initial_probabilities has shape \(3,\), 2 filters need \(2,\)"),
    "one": ({"filters": PAIR[:1]}, r"filters: 1 given"),
    "spaces": ({"filters": (PAIR[0], OTHER)}, r"filters have different state spaces, Additive of 2 states and Euclidean of 2 states"),
    "floor": ({"floor": 0.5}, r"floor = 0\.5: 2 modes need 0 <= floor < 0\.5"),
    "hysteresis": ({"declare_above": 0.4}, r"withdraw_below = 0\.5, declare_above = 0\.4: need"),
}


@pytest.mark.parametrize(("changes", "message"), WRONG.values(), ids=WRONG.keys())
def test_bad_settings_give_one_clear_line(changes, message):
    with pytest.raises(ValueError, match=message) as failure:
        InteractingMultipleModel(**({"filters": PAIR, "transition": CHAIN[:2, :2] * 0 + 0.5, "initial_probabilities": EVEN} | changes))
    assert "\n" not in str(failure.value)


# wheels that fail ----------------------------------------------------------------------------------------------------------------

NACS = NacsParameters()
AXES = NACS.wheel_axes
SPACE = Multiplicative()
NOISE, SENSOR = np.array([1e-10, 1e-7]), np.array([1e-7, 3e-6])


def body(*failed: int) -> RigidBody:
    """The testbed with some wheels without power."""
    return RigidBody(NACS.inertia, WheelFault.floating(4, *failed).on_body(AXES).torque_map, AXES * NACS.wheel_inertia_kg_m2)


def member(process, kind=UnscentedFilter, multiplicative=False, lead=(), **settings):
    counts, unit = ([3, 3], np.array([4.0, 1.0])) if multiplicative else ([4, 3], np.ones(2))
    return kind(
        process=process,
        process_noise=np.diag(np.repeat(unit * NOISE, counts)),
        measurement_noise=np.diag(np.repeat(unit * SENSOR, counts)).reshape(*lead, sum(counts), sum(counts)),
        prior=np.concatenate([IDENTITY, np.zeros(3)]),
        prior_variance=np.repeat([1.0, 1.0], counts),
        space=SPACE if multiplicative else Additive(),
        **settings,
    )


def wheel_imm(modes: int, stay: float = 0.98, **settings) -> InteractingMultipleModel:
    """Mode 0 healthy, mode i with wheel i floating."""
    chain = np.full((modes, modes), (1.0 - stay) / (modes - 1))
    np.fill_diagonal(chain, stay)
    processes = [body()] + [body(i) for i in range(1, modes)]
    return InteractingMultipleModel(tuple(member(one, **settings) for one in processes), chain, np.full(modes, 1.0 / modes))


def flight(trials: int, steps: int, failing: np.ndarray, at: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Truth and readings (steps, trials, 7), commands (steps, trials, 8); wheel failing[i] of trial i (0: none) floats from step `at`."""
    rng, sigma = RNG(seed), [np.sqrt(np.repeat([4.0, 1.0] * v, 3)) for v in (NOISE, SENSOR)]
    level = np.broadcast_to(np.concatenate([IDENTITY, np.zeros(3)]), (trials, 7))
    state = SPACE.displace(level, rng.normal(0, np.repeat([0.5, 0.1], 3), (trials, 6)))
    speed = np.broadcast_to(rng.normal(0, 50.0, (trials, 4)), (steps, trials, 4))
    command = np.concatenate([rng.normal(0, 2e-3, (steps, trials, 4)), speed], axis=-1)
    works = np.arange(1, 5) != failing[:, None]
    truth, readings = np.empty((2, steps, trials, 7))
    for k in range(steps):
        truth[k], readings[k] = state, SPACE.displace(state, sigma[1] * rng.standard_normal((trials, 6)))
        applied = command[k].copy()
        applied[:, :4] *= np.where(k >= at, works, 1.0)
        state = SPACE.displace(runge_kutta(body(), state, applied, DT), sigma[0] * rng.standard_normal((trials, 6)))
    return truth, readings, command


def watch(observer, readings, command) -> list[Belief]:
    beliefs = [observer.initial(readings[0])]
    for k in range(1, len(readings)):
        beliefs.append(observer.step(beliefs[-1], command[k - 1], readings[k], DT))
    return beliefs


def of(belief: Belief, which) -> list[np.ndarray]:
    """Every array of a belief, for some of its trials."""
    own = [part[which] for part in (*belief[:6], belief.detection.statistic, belief.detection.declared)]
    members = belief.modes.members
    return [*own, belief.modes.probabilities[which], *(part[which] for part in members[:6])]


def same(left: list[np.ndarray], right: list[np.ndarray]) -> bool:
    return len(left) == len(right) and all(np.array_equal(a, b, equal_nan=True) for a, b in zip(left, right, strict=True))


KINDS = {
    "unscented": {},
    "multiplicative": {"multiplicative": True},
    "extended": {"kind": ExtendedFilter},
    "multiplicative extended": {"kind": ExtendedFilter, "multiplicative": True},
}
every_kind = pytest.mark.parametrize("settings", KINDS.values(), ids=KINDS.keys())


@every_kind
def test_five_modes_tell_which_wheel_has_failed(settings):
    failing = np.repeat(np.arange(5), 4)
    truth, readings, command = flight(20, 100, failing, at=30)
    beliefs = watch(wheel_imm(5, **settings), readings, command)
    np.testing.assert_array_equal(np.argmax(beliefs[30].modes.probabilities, axis=-1), 0)
    np.testing.assert_array_equal(np.argmax(beliefs[-1].modes.probabilities, axis=-1), failing)
    np.testing.assert_array_equal(beliefs[-1].detection.declared, failing > 0)
    assert np.degrees(angle(beliefs[-1].mean[:, :4], truth[-1, :, :4])).max() < 0.2


@every_kind
def test_members_stepped_as_one_and_one_by_one_agree(settings):
    _, readings, command = flight(5, 40, np.array([0, 1, 0, 1, 1]), at=15)
    readings[0, 4], readings[20, 1], readings[25:, 3, 4:] = np.nan, np.nan, np.nan
    ours = wheel_imm(2, **settings)
    assert ours._stacked is not None
    for a, b in zip(watch(ours, readings, command), watch(alone(ours), readings, command), strict=True):
        assert same(of(a, ()), of(b, ()))


def test_unlike_filters_may_be_mixed():
    _, readings, command = flight(3, 60, np.array([0, 1, 1]), at=20)
    chain = np.array([[0.98, 0.02], [0.02, 0.98]])
    layer = np.repeat([4e-4, 8e-3], [4, 3])
    for partner in (member(body(1), ExtendedFilter), member(body(1), ExtendedFilter, gain=SlidingGain(layer)), member(body(1), alpha=1.0)):
        ours = InteractingMultipleModel((member(body()), partner), chain, EVEN)
        assert ours._stacked is None
        last = watch(ours, readings, command)[-1]
        np.testing.assert_array_equal(last.detection.declared, [False, True, True])
        np.testing.assert_array_equal(last.lost, 0.0)


def test_filters_that_share_their_model_and_differ_in_noise_are_stepped_as_one():
    _, readings, command = flight(3, 20, np.zeros(3), at=0)
    one = member(body())
    ours = InteractingMultipleModel((one, replace(one, measurement_noise=9 * one.measurement_noise)), np.full((2, 2), 0.5), EVEN)
    assert ours._stacked is not None
    for a, b in zip(watch(ours, readings, command), watch(alone(ours), readings, command), strict=True):
        assert same(of(a, ()), of(b, ()))


@every_kind
def test_a_trial_is_the_same_to_the_bit_in_any_batch(settings):
    _, readings, command = flight(64, 20, np.arange(64) % 3, at=8)
    readings[5, 7], readings[8:, 3, 4:] = np.nan, np.nan
    ours = wheel_imm(3, **settings)
    among = watch(ours, readings, command)
    for company in ([3], [1, 3, 7], list(range(10))):
        few = watch(ours, readings[:, company], command[:, company])
        assert all(same(of(a, company), of(b, slice(None))) for a, b in zip(among, few, strict=True))


def test_noise_with_a_leading_axis_makes_beliefs_with_that_axis():
    """As the loop wants them: one member of a bank, (1, trials, ...)."""
    _, readings, command = flight(4, 20, np.array([0, 1, 0, 1]), at=8)
    plain, banked = watch(wheel_imm(2), readings, command), watch(wheel_imm(2, lead=(1, 1)), readings, command)
    for a, b in zip(plain, banked, strict=True):
        assert b.mean.shape == (1, 4, 7)
        assert b.modes.members.covariance.shape == (1, 4, 2, 7, 7)
        assert same(of(a, ()), of(b, 0))


def test_a_wholly_missing_reading_is_missing_in_its_trial_alone():
    _, readings, command = flight(6, 12, np.zeros(6), at=0)
    silent, others = readings.copy(), np.arange(6) != 2
    silent[8, 2] = np.nan
    ours = wheel_imm(2)
    before, missed = watch(ours, readings, command)[7:], watch(ours, silent, command)[7:]
    assert all(same(of(a, others), of(b, others)) for a, b in zip(before, missed, strict=True))
    expected = before[0].modes.probabilities[2] @ ours.transition
    np.testing.assert_allclose(missed[1].modes.probabilities[2], expected, rtol=1e-13)
    assert (missed[1].nis[2], missed[1].dof[2]) == (0.0, 0.0)


@every_kind
def test_a_quaternion_reading_of_either_sign_says_the_same(settings):
    _, readings, command = flight(3, 30, np.array([0, 1, 1]), at=10)
    flipped = readings.copy()
    flipped[1::2, :, :4] *= -1
    one, other = (watch(wheel_imm(2, **settings), these, command)[-1] for these in (readings, flipped))
    np.testing.assert_allclose(other.modes.probabilities, one.modes.probabilities, atol=1e-9)
    assert angle(one.mean[:, :4], other.mean[:, :4]).max() < 1e-10


# mixing attitudes ----------------------------------------------------------------------------------------------------------------


def mixture(space, means: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mixture of point masses (modes, 7)."""
    size = 6 if isinstance(space, Multiplicative) else 7
    observer = replace(member(body(), multiplicative=isinstance(space, Multiplicative)), space=space)
    members = join([observer.initial(mean)._replace(covariance=np.zeros((size, size))) for mean in means])
    mean, covariance = mix(space, weights[None], weights, members)
    return mean[0], covariance[0]


@pytest.mark.parametrize("space", [Additive(), Multiplicative()])
def test_modes_with_q_and_minus_q_are_one_attitude(space):
    state = SPACE.displace(np.concatenate([IDENTITY, np.zeros(3)]), RNG(1).normal(size=6))
    flipped = state * np.repeat([-1.0, 1.0], [4, 3])
    for weights in (np.array([0.5, 0.5]), np.array([0.2, 0.8])):
        mean, covariance = mixture(space, np.stack([state, flipped]), weights)
        assert angle(mean[:4], state[:4]) < 1e-14
        np.testing.assert_allclose(mean[4:], state[4:], rtol=1e-14)
        np.testing.assert_allclose(covariance, 0.0, atol=1e-15)


def test_the_mean_of_two_attitudes_is_between_them_and_their_distance_is_uncertainty():
    turn = np.array([0.3, -0.2, 0.5, 0.0, 0.0, 0.0])
    first = SPACE.displace(np.concatenate([IDENTITY, np.zeros(3)]), np.array([1.0, 2.0, -1.0, 0.1, 0.2, 0.3]))
    second = SPACE.displace(first, turn)
    for weight in (0.25, 0.5, 0.75):
        mean, covariance = mixture(SPACE, np.stack([first, second]), np.array([1 - weight, weight]))
        np.testing.assert_allclose(SPACE.difference(mean, first), weight * turn, atol=1e-14)
        np.testing.assert_allclose(covariance, weight * (1 - weight) * np.outer(turn, turn), atol=1e-14)


def test_mixtures_hardly_depend_on_which_mode_is_the_reference():
    rng, apart = RNG(2), []
    first = SPACE.displace(np.concatenate([IDENTITY, np.zeros(3)]), rng.normal(size=6))
    errors = rng.normal(size=(3, 6))
    for size in (0.2, 0.1, 0.05):
        means = SPACE.displace(np.broadcast_to(first, (3, 7)), size * errors)
        apart.append(np.linalg.norm(SPACE.difference(mix_about(means, np.full(3, 1 / 3), 2), mix_about(means, np.full(3, 1 / 3), 0))))
    assert (np.diff(np.log2(apart)) < -2.5).all()  # half as far apart: an eighth of the difference


def mix_about(means: np.ndarray, weights: np.ndarray, reference: int) -> np.ndarray:
    """Mean with a chosen mode as the most probable one."""
    observer = member(body(), multiplicative=True)
    members = join([observer.initial(mean) for mean in means])
    return mix(SPACE, weights[None], np.eye(len(means))[reference], members)[0][0]


# broken covariances --------------------------------------------------------------------------------------------------------------


def test_repairs_of_all_modes_are_counted_in_their_trial():
    _, readings, command = flight(4, 4, np.zeros(4), at=0)
    for ours in (wheel_imm(2, stay=1.0), alone(wheel_imm(2, stay=1.0))):
        belief = ours.initial(readings[0])
        belief.modes.members.covariance[2] *= -1.0
        after = ours.step(belief, command[0], readings[1], DT)
        np.testing.assert_array_equal(after.lost, [0, 0, 2, 0])
        np.testing.assert_array_equal(ours.step(after, command[1], readings[2], DT).lost, [0, 0, 2, 0])


def test_a_lost_innovation_names_the_trial_and_not_the_mode():
    _, readings, command = flight(4, 3, np.zeros(4), at=0)
    for ours in (wheel_imm(2, lead=(1, 1)), alone(wheel_imm(2, lead=(1, 1)))):
        belief = ours.initial(readings[0])
        belief.modes.members.covariance[0, 3, 1, 0, 0] = np.nan
        with pytest.raises(LostDefiniteness) as failure:
            ours.step(belief, command[0], readings[1], DT)
        assert failure.value.where == (0, 3)


def test_no_covariance_is_lost_in_a_long_run():
    """Eight trials, half of them with a failed wheel, a jump every 250 steps."""
    _, readings, command = flight(8, 250, np.arange(8) % 2, at=100)
    ours = wheel_imm(2)
    belief = ours.initial(readings[0])
    for k in range(1, 1500):
        belief = ours.step(belief, command[(k - 1) % 250], readings[k % 250], DT)
    np.testing.assert_array_equal(belief.lost, 0.0)
    np.testing.assert_array_equal(belief.covariance, belief.covariance.swapaxes(-1, -2))
    assert np.linalg.eigvalsh(belief.covariance).min() > 0


def test_a_belief_of_another_filter_is_refused():
    _, readings, command = flight(2, 2, np.zeros(2), at=0)
    with pytest.raises(ValueError, match="belief has no modes"):
        wheel_imm(2).step(member(body()).initial(readings[0]), command[0], readings[1], DT)
