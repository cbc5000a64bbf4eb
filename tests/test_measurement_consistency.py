"""Filters of several sensors at rates of their own: consistency over Monte Carlo, and the filters of two blocks."""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import pytest

from estimation.consistency import average_test, normalized_squared
from estimation.extended_kalman import ExtendedFilter
from estimation.fading import StrongTracking
from estimation.joint_unscented import JointUnscentedFilter
from estimation.marginalised_unscented import MarginalisedUnscentedFilter
from estimation.particle import Draws, ParticleFilter
from estimation.proposals import ConstantNoise
from estimation.rao_blackwellised import BlockDraws, RaoBlackwellisedFilter
from estimation.state_space import Multiplicative
from estimation.unscented import UnscentedFilter
from models.attitude import quaternion
from models.attitude.quaternion import IDENTITY
from models.chebyshev_network import ChebyshevNetwork
from models.dynamics.direction_measurement import DirectionMeasurement
from models.dynamics.learned_torque import BodyWithLearnedTorque, TorqueBasis
from models.dynamics.measurement import MeasurementModel, PartOfState, WholeState
from models.dynamics.planar_agent import PlanarAgent, runge_kutta_of_motion
from models.dynamics.process import runge_kutta
from models.dynamics.rigid_body import RigidBody
from models.dynamics.stacked_measurement import StackedMeasurement
from models.dynamics.wheeled_body import WheeledBody
from models.plants.nacs import NacsParameters

Array = np.ndarray
PARAMETERS = NacsParameters()
SPACE = Multiplicative()

# attitude at 10 Hz, rates at 50 Hz, wheels at 25 Hz ------------------------------------------------------------------------------

TICK = 0.02


@dataclass(frozen=True, eq=False)
class Bench:
    """A body with some of the testbed's wheels, its sensors, and the noise of both.

    Particles are for few states: one wheel, and noise that keeps them apart.
    """

    wheels: int = 4
    loud: bool = False

    @property
    def process(self) -> WheeledBody:
        return replace(PARAMETERS.process(wheel_drag=True), wheel_axes=PARAMETERS.wheel_axes[:, : self.wheels])

    @property
    def deviations(self) -> Array:
        """Of the process noise in one tick, of the error coordinates."""
        return np.repeat([3e-4, 2e-3, 0.5] if self.loud else [3e-5, 6e-4, 0.1], [3, 3, self.wheels])

    def sensors(self, kind: str, gyro: float = 1.7e-3) -> StackedMeasurement:
        """An attitude sensor, or a sun sensor and a magnetometer; a gyro; wheel speeds."""
        size = 7 + self.wheels
        if kind == "tracker":
            parts: tuple[MeasurementModel, ...] = (PartOfState(range(4), size, (4e-4) ** 2 * np.eye(3), "rotation"),)
        else:
            sun, field = np.array([0.6, 0.0, 0.8]), np.array([1e-5, 4e-5, -1e-5])
            parts = DirectionMeasurement(sun, (1e-3) ** 2 * np.eye(3)), DirectionMeasurement(field, (1e-7) ** 2 * np.eye(3))
        wheels = PartOfState(range(7, size), size, 0.54**2 * np.eye(self.wheels))
        return StackedMeasurement((*parts, PartOfState(range(4, 7), size, gyro**2 * np.eye(3)), wheels))

    def flight(self, kind: str, ticks: int, trials: int, seed: int) -> tuple[Array, Array, Array]:
        """True states, readings with gaps, and commands, (ticks, trials, ...), of bodies with the filters' own noise."""
        rng, e = np.random.default_rng(seed), 6 + self.wheels
        attitude, others = quaternion.normalize(rng.standard_normal((trials, 4))), rng.standard_normal((trials, e - 3))
        state = np.concatenate([attitude, others * np.repeat([0.1, 100.0], [3, self.wheels])], axis=-1)
        truth, readings, command = [], [], 2e-3 * rng.standard_normal((ticks, trials, self.wheels))
        parts = self.sensors(kind).parts
        periods = [*([5] * (len(parts) - 2)), 1, 2]
        for k in range(ticks):
            truth.append(state)
            read = []
            for part, period in zip(parts, periods, strict=True):
                error, seen = rng.standard_normal((trials, part.noise.shape[-1])) @ np.linalg.cholesky(part.noise).T, part.predict(state)
                turned = isinstance(part, PartOfState) and part.attitude == "rotation"
                seen = quaternion.multiply(quaternion.from_rotation_vector(error), seen) if turned else seen + error
                read.append(seen if k % period == 0 else np.full(seen.shape, np.nan))
            readings.append(np.concatenate(read, axis=-1))
            state = SPACE.displace(runge_kutta(self.process, state, command[k], TICK), self.deviations * rng.standard_normal((trials, e)))
        return np.array(truth), np.array(readings), command

    def observer(self, filter_: str, model: MeasurementModel, prior: Array, variance: Array) -> Any:
        noise = np.diag(self.deviations**2)
        common: dict[str, Any] = {"process": self.process, "measurement_noise": None, "measurement": model, "space": SPACE}
        common |= {"prior": prior, "prior_variance": variance}
        if filter_ == "mekf":
            return ExtendedFilter(process_noise=noise, **common)
        if filter_ == "ukf":
            return UnscentedFilter(process_noise=noise, alpha=0.5, **common)
        return ParticleFilter(process_noise=ConstantNoise.of(noise), particles=8000, **common)


class FilterStep(NamedTuple):
    """What a filter made of a flight, (ticks - 1, trials, ...)."""

    nees: Array
    nis: Array
    dof: Array
    error: Array
    covariance: Array


def watch(
    bench: Bench, filter_: str, kind: str, ticks: int, trials: int, spread: Array, gyro: float = 1.7e-3, seed: int = 21
) -> FilterStep:
    """A filter over a flight; of directions, which tell the attitude only near one that is known, from a prior with deviations `spread`."""
    truth, readings, command = bench.flight(kind, ticks, trials, seed)
    rng, e = np.random.default_rng(seed + 1), 6 + bench.wheels
    prior, deviation = np.concatenate([IDENTITY, np.zeros(e - 3)]), np.repeat([3.0, 1.0, 300.0], [3, 3, bench.wheels])
    if kind == "directions":
        deviation = np.repeat(spread, [3, 3, bench.wheels])
        prior = SPACE.displace(truth[0], deviation * rng.standard_normal((trials, e)))
    ours = bench.observer(filter_, bench.sensors(kind, gyro), prior, deviation**2)

    def numbers() -> tuple[Draws, ...]:
        if not isinstance(ours, ParticleFilter):
            return ()
        return (Draws(rng.standard_normal((trials, ours.particles, e)), rng.random((trials, ours.particles))),)

    belief = ours.initial(readings[0], *numbers())
    kept = []
    for k in range(1, ticks):
        belief = ours.step(belief, command[k - 1], readings[k], TICK, *numbers())
        error = SPACE.difference(truth[k], belief.mean)
        kept.append((normalized_squared(error, belief.covariance), belief.nis, belief.dof, error, belief.covariance))
    return FilterStep(*(np.array(part) for part in zip(*kept, strict=True)))


CASES = {"mekf": (Bench(), 101, 200), "ukf": (Bench(), 101, 200), "pf": (Bench(1, True), 16, 24)}


@pytest.mark.parametrize("kind", ["tracker", "directions"])
@pytest.mark.parametrize("filter_", CASES.keys())
def test_nees_and_nis_are_inside_their_bounds(filter_, kind):
    """Mean NEES over trials at every tick, and NIS over everything, whose values are independent of each other."""
    bench, ticks, trials = CASES[filter_]
    seen = watch(bench, filter_, kind, ticks, trials, np.array([2e-3, 1e-2, 1.0] if bench.loud else [0.02, 0.1, 5.0]))
    slow = 3 if kind == "tracker" else 6
    assert {int(value) for value in np.unique(seen.dof)} == {3, 3 + bench.wheels, 3 + slow, 3 + bench.wheels + slow}
    e = 6.0 + bench.wheels
    assert average_test(seen.nees, e, axis=1).fraction_inside > 0.8  # of ticks, which are not independent; 0.95 is expected
    assert average_test(seen.nees[-1], e, probability=0.999).inside
    assert average_test(seen.nis, seen.dof, axis=(0, 1), probability=0.999).inside


def test_a_filter_that_is_told_too_little_noise_is_caught():
    """The bounds above can be left: by a gyro that is half again as noisy as is believed."""
    seen = watch(Bench(), "mekf", "tracker", 101, 200, np.zeros(3), gyro=1.7e-3 / 1.5)
    assert not average_test(seen.nis, seen.dof, axis=(0, 1), probability=0.999).inside
    assert average_test(seen.nees, 10.0, axis=1).fraction_inside < 0.5


@pytest.mark.parametrize("filter_", ["mekf", "ukf"])
def test_two_directions_and_a_gyro_find_the_attitude(filter_):
    """From a tenth of a radian off to what the sensors' noise allows: 1 mrad of the sun, 2 mrad of the field, over some readings."""
    seen = watch(Bench(), filter_, "directions", 101, 50, np.array([0.1, 0.1, 5.0]), seed=23)
    off, deviation = seen.error[-1, :, :3], np.sqrt(np.diagonal(seen.covariance[-1], axis1=-2, axis2=-1)[:, :3])
    assert np.sqrt(np.mean(off**2)) < 2e-3
    assert np.sqrt(np.mean((off / deviation) ** 2)) == pytest.approx(1.0, abs=0.25)


# state and parameters ------------------------------------------------------------------------------------------------------------


STRONG = {"fading": StrongTracking()}


def learner(**how: Any) -> JointUnscentedFilter:
    axes = PARAMETERS.wheel_axes
    model = BodyWithLearnedTorque(RigidBody(PARAMETERS.inertia, -axes, PARAMETERS.wheel_inertia_kg_m2 * axes), TorqueBasis(()))
    return JointUnscentedFilter(
        model, np.diag([1e-9] * 3 + [1e-7] * 3), np.full(3, 1e-12), how.pop("noise", None), np.concatenate([IDENTITY, np.zeros(3)]),
        np.repeat([1.0, 1.0], 3), np.full(3, 1e-7), alpha=0.5, **how,
    )  # fmt: skip


def run(ours: Any, readings: Array) -> list[Any]:
    command = np.concatenate([np.full((len(readings), 3, 4), 1e-3), np.full((len(readings), 3, 4), 100.0)], axis=-1)
    beliefs = [ours.initial(readings[0])]
    for k in range(1, len(readings)):
        beliefs.append(ours.step(beliefs[-1], command[k - 1], readings[k], 0.1))
    return beliefs


def motions(ticks: int) -> Array:
    """Readings of [q, omega] of three bodies that turn slowly, (ticks, 3, 7)."""
    rng = np.random.default_rng(25)
    first = quaternion.normalize(rng.standard_normal((3, 4)))
    turn = quaternion.from_rotation_vector(0.01 * np.arange(ticks)[:, None, None] + 1e-3 * rng.standard_normal((ticks, 3, 3)))
    return np.concatenate([quaternion.multiply(turn, first), 0.1 + 2e-3 * rng.standard_normal((ticks, 3, 3))], axis=-1)


def test_the_joint_filter_reads_a_part_as_the_whole_with_gaps_and_the_whole_bit_for_bit():
    noise, readings = np.diag([1e-6] * 3 + [4e-6] * 3), motions(30)
    readings[10, 1], readings[12, 2, :4] = np.nan, np.nan
    for one, other in zip(
        run(learner(noise=noise, **STRONG), readings),
        run(learner(measurement=WholeState(noise, "rotation"), **STRONG), readings),
        strict=True,
    ):
        np.testing.assert_array_equal(one.mean, other.mean)
        np.testing.assert_array_equal(one.covariance, other.covariance)
    part = PartOfState(range(4), 7, noise[:3, :3], "rotation")
    gaps = np.concatenate([readings[..., :4], np.full((30, 3, 3), np.nan)], axis=-1)
    for one, other in zip(
        run(learner(noise=noise, **STRONG), gaps), run(learner(measurement=part, **STRONG), readings[..., :4]), strict=True
    ):
        np.testing.assert_allclose(SPACE.difference(other.mean, one.mean), 0.0, atol=1e-10)  # q and -q are the same
        np.testing.assert_allclose(other.covariance, one.covariance, rtol=1e-6, atol=1e-14)
        np.testing.assert_allclose(other.nis, one.nis, rtol=1e-6)


def test_the_joint_filter_learns_from_directions_as_from_the_attitude():
    """Three directions of N, read as well as an attitude would be, say the same of attitude, rate and torque."""
    readings = motions(60)
    axes = StackedMeasurement(tuple(DirectionMeasurement(axis, 2e-6 * np.eye(3)) for axis in np.eye(3)))  # two of them see each turn
    directions = axes.predict(readings)
    attitude = learner(measurement=PartOfState(range(4), 7, 1e-6 * np.eye(3), "rotation"))
    start = np.concatenate([readings[0, :, :4], np.zeros((3, 3))], axis=-1)
    one = run(attitude, readings[..., :4])[-1]
    other = run(replace(learner(measurement=axes), prior=start, prior_variance=np.repeat([1e-4, 1.0], 3)), directions)[-1]
    deviation = np.sqrt(np.diagonal(one.covariance, axis1=-2, axis2=-1))
    apart = np.concatenate([SPACE.difference(other.mean[:, :7], one.mean[:, :7]), other.mean[:, 7:] - one.mean[:, 7:]], axis=-1)
    assert np.abs(apart / deviation).max() < 0.1
    np.testing.assert_allclose(np.sqrt(np.diagonal(other.covariance, axis1=-2, axis2=-1)), deviation, rtol=0.05)


AGENT = PlanarAgent(ChebyshevNetwork(order=1))


def marginalised(sampled: str, proposal: str, **how: Any) -> MarginalisedUnscentedFilter:
    return MarginalisedUnscentedFilter(
        AGENT, 1e-4 * np.eye(4), np.full(10, 1e-4), how.pop("noise", None), np.full(10, 0.1), sampled, 40, proposal,  # type: ignore[arg-type]
        integrate=runge_kutta_of_motion, prior=np.array([0.3, 0.2, 0.0, 0.0]), prior_variance=np.full(4, 0.01), **how,
    )  # fmt: skip


def agents(ours: MarginalisedUnscentedFilter, readings: Array) -> list[Any]:
    rng = np.random.default_rng(26)

    def draws() -> BlockDraws:
        return BlockDraws(rng.standard_normal((3, 40, ours.size)), rng.random((3, 40)))

    beliefs = [ours.initial(readings[0], draws())]
    for reading in readings[1:]:
        beliefs.append(ours.step(beliefs[-1], np.full((3, 2), 0.1), reading, 0.01, draws()))
    return beliefs


@dataclass(frozen=True, eq=False)
class Silent:
    """A linear model of the first components that does not say that it is."""

    part: PartOfState

    def __getattr__(self, name: str) -> Any:
        return getattr(self.part, name)

    def linear(self, errors):
        return None


every_variant = pytest.mark.parametrize("sampled", ["state", "parameters"])
every_density = pytest.mark.parametrize("proposal", ["optimal", "prior"])


@every_variant
@every_density
def test_the_marginalised_filter_reads_a_part_as_the_whole_with_gaps(sampled, proposal):
    rng = np.random.default_rng(27)
    readings = np.array([0.3, 0.2, 0.0, 0.0]) + 0.02 * rng.standard_normal((15, 3, 4))
    noise = 1e-4 * np.eye(4)
    gaps = readings.copy()
    gaps[1:, :, 2:] = np.nan
    gaps[5, 1], gaps[7, 2, 0] = np.nan, np.nan
    whole = agents(marginalised(sampled, proposal, noise=noise), gaps)
    for model in (PartOfState([0, 1], 4, noise[:2, :2]), Silent(PartOfState([0, 1], 4, noise[:2, :2]))):
        ours = marginalised(sampled, proposal, measurement=model)
        rng, belief = np.random.default_rng(26), whole[0]
        rng.standard_normal((3, 40, ours.size)), rng.random((3, 40))  # of the first reading, which was whole
        for k in range(1, 15):
            draws = BlockDraws(rng.standard_normal((3, 40, ours.size)), rng.random((3, 40)))
            belief = ours.step(belief, np.full((3, 2), 0.1), gaps[k, :, :2], 0.01, draws)
            for name in ("sampled", "mean", "log_weights", "log_likelihood"):
                np.testing.assert_allclose(getattr(belief, name), getattr(whole[k], name), rtol=1e-6, atol=1e-7)


@every_variant
@every_density
def test_the_marginalised_filter_reads_distances(sampled, proposal):
    """From two places; the motion comes to where the distances cross."""

    class Distances:
        places = np.array([[1.0, 0.0], [0.0, 1.5]])
        noise = 1e-6 * np.eye(2)
        size = 2

        def predict(self, state):
            return np.linalg.norm(state[..., None, :2] - self.places, axis=-1)

        def residual(self, reading, predicted):
            return reading - predicted

        def jacobian(self, state):
            out = np.zeros((*state.shape[:-1], 2, 4))
            out[..., :2] = (state[..., None, :2] - self.places) / self.predict(state)[..., None]
            return out

        def linear(self, errors):
            return None

    rng = np.random.default_rng(28)
    truth = np.array([0.25, 0.3, 0.0, 0.0])
    readings = Distances().predict(truth) + 1e-3 * rng.standard_normal((60, 3, 2))
    readings[10, 1, 0], readings[20] = np.nan, np.nan
    ours = marginalised(sampled, proposal, measurement=Distances())
    beliefs = agents(ours, readings)
    off = ours.motion(beliefs[-1])[:, :2] - truth[:2]
    assert np.abs(off).max() < (0.02 if proposal == "prior" else 0.01)
    assert np.abs(ours.motion(beliefs[0])[:, :2] - np.array([0.3, 0.2])).max() > 0.02  # which is not where it was


def test_blocks_need_one_way_to_be_read():
    model: Any = None
    for settings in ({"by_sampled": np.eye(1), "measurement_noise": None}, {"by_sampled": None, "measurement_noise": None}):
        with pytest.raises(ValueError, match="one of the two"):
            RaoBlackwellisedFilter(model, by_conditional=None, **settings)
    with pytest.raises(ValueError, match="one of the two"):
        RaoBlackwellisedFilter(model, np.eye(1), None, np.eye(1), measurement=PartOfState([0], 1, np.eye(1)))
    with pytest.raises(ValueError, match="needs prior"):
        MarginalisedUnscentedFilter(AGENT, np.eye(4), np.ones(10), None, np.ones(10), measurement=PartOfState([0, 1], 4, np.eye(2)))
