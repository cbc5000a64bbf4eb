"""Noise that is not normal, an attitude unknown at first and one that is read twofold: the sensors, and the filters that are told."""

import numpy as np
import pytest
from pydantic import TypeAdapter
from scipy import stats

from estimation.gaussian import Belief
from estimation.particle import Draws, ParticleFilter
from estimation.proposals import Bootstrap, ConstantNoise, Optimal
from estimation.scale_mixture import ScaleMixture
from estimation.state_space import Additive, Euclidean, Multiplicative, Signed
from estimation.unscented import UnscentedFilter
from models.attitude import quaternion
from models.dynamics.direction_measurement import DirectionsOfAttitude
from models.dynamics.vector_part_measurement import VectorPart
from sim.faults.parts import Parts
from sim.faults.timeline import schedule
from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.metrics.evaluation import evaluate
from sim.metrics.results import rows
from sim.randomness import RandomStream, Stream
from sim.scenario.files import load
from sim.sensors.agents import AgentsSensors
from sim.sensors.distribution import GlintNoise, NoiseDistribution, NormalNoise, StudentNoise
from sim.tables.windows import windows

STUDENT, GLINT = StudentNoise(type="student-t", dof=3.0), GlintNoise(type="glint", share=0.1, factor=20.0)
GLINT_CDF = lambda x: 0.9 * stats.norm.cdf(x) + 0.1 * stats.norm.cdf(x / 20.0)  # noqa: E731


def stay(process: None, state: np.ndarray, command: np.ndarray, dt: float) -> np.ndarray:
    return state


@pytest.mark.parametrize(("noise", "expected"), [(STUDENT, stats.t(3.0).cdf), (GLINT, GLINT_CDF), (NormalNoise(), stats.norm.cdf)])
def test_noise_is_distributed_as_it_says(noise, expected):
    rng = np.random.default_rng(4)
    drawn = rng.standard_normal(20_000) * noise.scales(rng.random(20_000))
    assert stats.kstest(drawn, expected).pvalue > 0.01


@pytest.mark.parametrize(("noise", "variance"), [(STUDENT, 3.0), (GLINT, 0.9 + 0.1 * 400.0), (NormalNoise(), 1.0)])
def test_variance_of_the_noise(noise, variance):
    assert noise.variance == pytest.approx(variance)
    if noise.mixture is not None:
        assert noise.mixture.probabilities.sum() == pytest.approx(1.0)
        assert noise.mixture.probabilities @ noise.mixture.scales**2 == pytest.approx(1.0)


def test_the_mixture_of_sizes_has_the_density_of_students_t():
    mixture, places = StudentNoise(type="student-t", dof=5.0).mixture, np.linspace(-8.0, 8.0, 81)
    sizes = mixture.scales * np.sqrt(5.0 / 3.0)
    found = (mixture.probabilities * stats.norm.pdf(places[:, None] / sizes) / sizes).sum(axis=-1)
    np.testing.assert_allclose(np.log(found), stats.t(5.0).logpdf(places), atol=0.15)


@pytest.mark.parametrize("distribution", ['{type="student-t",dof=3.0}', '{type="glint",share=0.1,factor=20.0}'])
def test_all_families_read_with_that_noise(distribution):
    """Shares of readings beyond three deviations, against the distribution's own."""
    kind = TypeAdapter(NoiseDistribution).validate_python({"type": "student-t", "dof": 3.0} if "student" in distribution else {
        "type": "glint", "share": 0.1, "factor": 20.0})  # fmt: skip
    expected = 2.0 * (stats.t(3.0).sf(3.0) if "student" in distribution else 1.0 - GLINT_CDF(3.0))
    body = load("nacs/fault-free", {"run.ticks": 400, "sensors.set": "tracker", "sensors.distribution": kind.model_dump()})
    system = build(body, np.arange(8))
    scale = system.sensors.noise.scale
    assert np.mean(np.abs(system.sensors.noise.quaternion[..., 0] * scale[..., 0]) > 3.0) == pytest.approx(expected, rel=0.25)
    still = np.zeros((8, 6, 4))
    laid = schedule([()] * 8, Parts("consensus", {"position": 2, "speed": 2}, 6), 1, np.arange(8), 100, 0.01)
    normal, uniform = (RandomStream(1, np.arange(8), s, (6, n), uniform=u) for s, n, u in (
        (Stream.AGENTS_READING, 4, False), (Stream.AGENTS_TAILS, 2, True)))  # fmt: skip
    sensors = AgentsSensors(0.5, normal, np.array([2, 2]), laid, kind, uniform)
    truth = type("Truth", (), {"state": still})
    read = np.array([sensors.read(tick, truth, still) for tick in range(100)])
    assert np.mean(np.abs(read) > 1.5) == pytest.approx(expected, rel=0.25)
    both = np.abs(read[..., :2]) > 1.5  # x and y of a position are one sensor's, so that they are far off together
    assert np.mean(both.all(axis=-1)) > 3.0 * expected**2


@pytest.mark.parametrize("name", ["formation/fault-free", "consensus/fault-free"])
def test_agents_fly_with_it(name):
    key = "reading_distribution" if "formation" in name else "sensors.distribution"
    scenario = load(name, {"run.ticks": 5, "phases": {}, key: GLINT.model_dump()} if "formation" in name else {
        "run.ticks": 5, key: GLINT.model_dump()})  # fmt: skip
    system = build(scenario, np.arange(2), loop=next(iter(scenario.loops)))
    assert system.sensors.distribution == GLINT
    assert system.sensors.uniforms is not None


# the particle filter's likelihood ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("proposal", [Bootstrap(), Optimal()])
@pytest.mark.parametrize("reading", [0.4, 6.0])
def test_the_mixture_gives_the_posterior_of_a_grid(proposal, reading):
    mixture = ScaleMixture(np.array([0.9, 0.1]), np.array([0.5, 2.782]))
    root, noise, rng, count = np.array([[0.8]]), np.array([[1.3]]), np.random.default_rng(3), 400_000
    normals, choices = rng.standard_normal((count, 1)), rng.random(count)
    drawn, gained = mixture.propose(proposal, np.zeros((count, 1)), np.array([reading]), root, noise, normals, None, choices)
    grid = np.linspace(-8.0, 12.0, 20_001)
    likelihood = sum(
        p * stats.norm.pdf(reading, grid, s * np.sqrt(1.3)) for p, s in zip(mixture.probabilities, mixture.scales, strict=True)
    )
    posterior = stats.norm.pdf(grid, 0.0, 0.8) * likelihood
    evidence = posterior.sum() * (grid[1] - grid[0])
    weights = np.exp(gained)
    assert weights.mean() == pytest.approx(evidence, rel=0.02)
    mean = (weights * drawn[:, 0]).sum() / weights.sum()
    expected = (posterior * grid).sum() / posterior.sum()
    assert mean == pytest.approx(expected, abs=0.02)
    variance = (weights * (drawn[:, 0] - mean) ** 2).sum() / weights.sum()
    assert variance == pytest.approx((posterior * (grid - expected) ** 2).sum() / posterior.sum(), rel=0.03)


def test_a_mixture_needs_numbers_and_a_reading_it_can_weigh():
    made = {"process": None, "process_noise": ConstantNoise(np.eye(1)), "measurement_noise": np.eye(1), "prior": np.zeros(1),
            "prior_variance": np.ones(1), "space": Euclidean(), "integrate": stay, "mixture": GLINT.mixture, "particles": 5}  # fmt: skip
    one, draws = ParticleFilter(**made), Draws(np.zeros((5, 1)), np.zeros(5))
    with pytest.raises(ValueError, match=r"Draws\.choices"):
        one.step(one.initial(np.zeros(1), draws), np.zeros(1), np.zeros(1), 1.0, draws)
    seven = {"prior": np.zeros(7), "prior_variance": np.ones(7), "process_noise": ConstantNoise(np.eye(7)), "measurement_noise": None}
    with pytest.raises(ValueError, match="bootstrap"):
        ParticleFilter(**made | seven | {"space": Additive(), "measurement": DirectionsOfAttitude(np.eye(3), np.eye(3))})


# readings of directions, outliers, starts -----------------------------------------------------------------------------------------------


def test_directions_of_an_attitude():
    rng = np.random.default_rng(7)
    model = DirectionsOfAttitude(np.array([[1.0, 0.0, 0.0], [0.0, 0.6, 0.8]]), 0.01 * np.eye(3))
    state = np.concatenate([quaternion.normalize(rng.standard_normal(4)), rng.standard_normal(3)])
    other = np.concatenate([quaternion.normalize(rng.standard_normal(4)), np.full(3, np.nan)])
    seen = [quaternion.attitude_matrix(other[:4]) @ d - quaternion.attitude_matrix(state[:4]) @ d for d in model.directions_N]
    np.testing.assert_allclose(model.residual(other, model.predict(state)), np.concatenate(seen), atol=1e-14)
    np.testing.assert_allclose(model.residual(-state, model.predict(state)), 0.0, atol=1e-14)  # q and -q are one attitude
    assert model.noise.shape == (6, 6)
    turned = np.array([
        model.residual(Multiplicative().displace(state, step), model.predict(state)) / 1e-6 for step in 1e-6 * np.eye(6)
    ])  # fmt: skip
    np.testing.assert_allclose(Multiplicative().sensitivity(model.jacobian(state), state), turned.T, atol=1e-5)


def test_an_outlier_is_not_believed():
    def track(tail: float, last: float) -> Belief:
        one = UnscentedFilter(None, 0.1 * np.eye(1), np.eye(1), np.zeros(1), np.ones(1), Euclidean(), integrate=stay, outlier_tail=tail)
        belief = one.initial(np.zeros(1))
        for reading in (0.3, -0.2, last):
            belief = one.step(belief, np.zeros(1), np.array([reading]), 1.0)
        return belief

    plain, gated, missing = track(0.0, 9.0), track(1e-3, 9.0), track(1e-3, np.nan)
    np.testing.assert_array_equal(gated.mean, missing.mean)
    np.testing.assert_array_equal(gated.covariance, missing.covariance)
    assert gated.nis == plain.nis  # what it was surprised by is still said
    np.testing.assert_array_equal(track(1e-3, 0.5).mean, track(0.0, 0.5).mean)


def particles(start: str, space=None, **settings) -> ParticleFilter:
    made = {"process": None, "process_noise": ConstantNoise(1e-3 * np.eye(7)), "measurement_noise": 1e-4 * np.eye(7)} | settings
    return ParticleFilter(prior=np.concatenate([quaternion.IDENTITY, np.zeros(3)]), prior_variance=np.full(7, 0.04), particles=4000,
                          space=space or Additive(), integrate=stay, start=start, proposal=Bootstrap(), **made)  # fmt: skip


def some_draws() -> Draws:
    rng = np.random.default_rng(2)
    return Draws(rng.standard_normal((4000, 7)), rng.random(4000))


def test_particles_begin_anywhere():
    reading = np.concatenate([quaternion.IDENTITY, np.full(3, np.nan)])
    q = particles("anywhere").initial(reading, some_draws()).particles[:, :4]
    np.testing.assert_allclose(np.linalg.norm(q, axis=-1), 1.0)
    np.testing.assert_allclose(q.T @ q / 4000, np.eye(4) / 4, atol=0.02)  # even on the sphere
    assert stats.kstest(q[:, 0] ** 2, stats.beta(0.5, 1.5).cdf).pvalue > 0.01
    with pytest.raises(ValueError, match="by components"):
        particles("anywhere", Multiplicative(), process_noise=ConstantNoise(np.eye(6)), measurement_noise=np.eye(6))


def test_particles_begin_at_both_attitudes_that_a_vector_part_leaves():
    reading = np.concatenate([quaternion.normalize(np.array([0.3, 0.2, -0.1, 0.8])), np.full(3, np.nan)])
    made = {"measurement_noise": None, "measurement": VectorPart(1e-8 * np.eye(7))}
    q = particles("mirrored", Signed(), **made).initial(reading, some_draws()).particles[:, :4]
    assert np.mean(q[:, 3] > 0.0) == pytest.approx(0.5, abs=0.03)
    np.testing.assert_allclose(np.abs(q), np.tile(np.abs(reading[:4]), (4000, 1)), atol=1e-3)


def test_annealing_takes_the_reading_for_noisier_at_first():
    """Twice as noisy before the first step, geometrically less, and as it is from its end on."""
    reading = np.concatenate([quaternion.IDENTITY, np.full(3, np.nan)])
    annealed, draws = particles("reading", annealing=2.0, annealing_s=4.0), some_draws()
    first = annealed.initial(reading, draws)
    for elapsed, factor in ((0.0, 2.0), (1.0, 2.0**0.75), (4.0, 1.0), (9.0, 1.0)):
        plain = particles("reading", measurement_noise=factor**2 * 1e-4 * np.eye(7))
        belief = first._replace(elapsed=np.array(elapsed))
        one, other = (f.step(belief, np.zeros(3), reading, 1.0, draws) for f in (annealed, plain))
        np.testing.assert_allclose(one.log_weights, other.log_weights, rtol=1e-12)


# the scenarios -------------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["unknown-attitude", "outliers", "heavy-tails", "ambiguous"])
def test_the_scenarios_show_every_filter_that_watches(name):
    scenario = load(f"monolithic/{name}", {"run.ticks": 4, "phases": {"all of it": [0.0, 0.4]}, "run.trials": 2})
    single = scenario.singles()["true-state"]
    system = build(single, np.arange(2))
    found = rows(evaluate(scenario, "true-state", system, run(system)))
    errors = windows(found, scenario, 2)[0]
    assert list(errors.columns[0].cells) == [f"true-state/{watching}" for watching in scenario.loops["true-state"].watching]
    assert all(float(cell) > 0.0 for cell in errors.columns[1].cells)


def test_half_of_the_particles_at_the_other_attitude_find_it():
    """The body is at q4 < 0, where no filter begins that takes the fourth component to be positive; half of the trials find it."""
    turned = [-0.3, -0.2, 0.1, -np.sqrt(1 - 0.14)]
    changes = {"run.ticks": 200, "phases": {"late": [15.0, 20.0]}, "loops.true-state.watching": ["ukf", "pf-mirrored"],
               "start.attitude_error_deg": 0.0, "start.quaternion": turned}  # fmt: skip
    scenario = load("monolithic/ambiguous", changes)
    system = build(scenario.singles()["true-state"], np.arange(3))
    found = {(m.subject, m.metric): m.values for m in evaluate(scenario, "true-state", system, run(system))}
    assert found["true-state/ukf", "lost"].min() == 1.0
    assert found["true-state/pf-mirrored", "rms_attitude_error"].min() < 1e-3
