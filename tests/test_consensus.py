"""Consensus tracking: the physics against an integrator, the loop against itself in other company, and the chapter's claims in short."""

import tomllib

import numpy as np
import pytest
from matplotlib.image import imread
from pydantic import ValidationError
from scipy.integrate import solve_ivp

from estimation.adaptive_unscented import AdaptiveUnscentedFilter
from estimation.fading import StrongTracking
from estimation.proposals import ConstantNoise
from estimation.state_space import Euclidean
from estimation.unscented import UnscentedFilter
from models.chebyshev_network import ChebyshevNetwork
from models.dynamics.measurement import PartOfState
from models.dynamics.planar_agent import PlanarAgent, runge_kutta_of_motion
from models.plants.agents import AgentsParameters, compile_agents
from sim.bad_input import BadInput
from sim.campaign.blocks import simulate
from sim.faults.timeline import schedule
from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.loop.consensus import UnknownForce
from sim.metrics.consensus import absolute_error, dynamics_error, relative_error
from sim.metrics.results import rows
from sim.plant.planar_agents import AgentsPlant
from sim.report.agents.learners import write_learners, write_weights
from sim.report.register import write_report
from sim.rerun.agents.consensus import curves, weight_curves
from sim.rerun.register import write_recording
from sim.scenario.catalogue import SCENARIOS
from sim.scenario.consensus import ConsensusScenario
from sim.scenario.files import load
from sim.scenario.graph import ConsensusGraph
from sim.series.consensus import occurrences
from sim.tables.register import tables_of
from sim.user_code.user_code import UserCode

FOLDER = SCENARIOS / "consensus"
NAMES = ("fault-free", "dynamics", "disturbance", "command-fault")


def scenario(name: str, ticks: int = 2000, only: tuple[str, ...] = (), **changes):
    data = tomllib.loads((FOLDER / f"{name}.toml").read_text())
    data["run"] |= {"ticks": ticks}
    data["loops"] = {k: v for k, v in data["loops"].items() if not only or k in only}
    return ConsensusScenario.model_validate(data | changes)


def flown(name: str, loop: str, ticks: int = 2000, trials: int = 1, **changes):
    settings = scenario(name, ticks, (loop,), **changes)
    return run(build(settings, np.arange(trials) + 70, loop=loop))


def between(values, start: float, end: float):
    return values[round(start / 0.01) : round(end / 0.01)]


def unknown_force(settings, motion, time):
    """What acts on agents at an instant, with the faults of the scenario."""
    laid = schedule([settings.faults], settings.parts, 1, np.arange(1), settings.run.ticks, 0.01)
    force = UnknownForce(settings.plant, settings.parts.disturbance, laid)
    return force.at(int(100.0 * time + 1e-6), motion, time).reshape(*motion.shape[:-1], 2)


# the plant --------------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("step_s", "most"), [(0.01, 2e-4), (0.002, 8e-6)])
def test_the_motion_is_that_of_an_integrator(step_s, most):
    settings = scenario("disturbance")

    def force(motion, time):
        return unknown_force(settings, motion, time) - 8.0 * motion[..., :2] - 3.0 * motion[..., 2:]

    def slope(time, state):
        motion = state.reshape(6, 4)
        return np.concatenate([motion[:, 2:], force(motion, time)], axis=-1).ravel()

    plant = AgentsPlant(compile_agents(AgentsParameters(step_s=step_s)), 1.0, 2)
    start = plant.motion()
    np.testing.assert_array_equal(start[1], AgentsParameters().start)
    plant.advance(np.zeros((1, 0)), force, round(2.0 / step_s))
    expected = solve_ivp(slope, (0.0, 2.0), start[0].ravel(), rtol=1e-11, atol=1e-12).y[:, -1].reshape(6, 4)
    assert np.abs(plant.motion() - expected).max() < most


def test_faults_change_what_moves_the_agents():
    settings, motion = scenario("dynamics"), np.random.default_rng(1).standard_normal((3, 6, 4))
    still = settings.model_copy(update={"disturbance": (0.0, 0.5)})
    before, then, late, last = (unknown_force(still, motion, t) for t in (1.0, 3.0, 12.0, 16.0))
    np.testing.assert_allclose(then, 3.0 * before)
    np.testing.assert_allclose(late, before * [1.25, -1.0])
    np.testing.assert_array_equal(last, before)
    pushed = unknown_force(scenario("disturbance"), np.zeros((6, 4)), 7.0)
    np.testing.assert_allclose(pushed[:, 0], 8.0 * np.sin(0.5 * 7.0 * np.arange(1, 7)), atol=1e-12)
    np.testing.assert_allclose(pushed[:, 1], 8.0 * np.cos(0.5 * 7.0 * np.arange(1, 7)), atol=1e-12)


def test_agents_are_as_many_as_asked_for():
    parameters = AgentsParameters(agents=8, h1=(0.6, -0.2), h2=(0.3,), position_m=((1.0, 0.0), (0.0, 2.0), (1.0, 1.0)))
    np.testing.assert_allclose(parameters.start[:2], [[1, 0, 0, 0], [0, 2, 0, 0]])
    np.testing.assert_allclose(parameters.start[[3, 7], :2], [[np.cos(1), np.sin(1)], [-2 * np.sin(2), 2 * np.cos(2)]])
    state = np.array([1.0, 2.0, 0.5, -0.3]) * np.ones((8, 1))
    force = parameters.unknown_force(state, np.ones(2))
    np.testing.assert_allclose(force[5], [8.0 * np.sin(np.pi / 4 - 0.2 * 0.5 / 2), 4.0 * np.cos(0.3 * -0.3 / 2)])
    plant = AgentsPlant(compile_agents(parameters), 1.0, 2)
    np.testing.assert_allclose(plant.motion()[1], parameters.start)


def test_a_graph_of_other_size_is_as_published_where_nothing_is_said():
    six, nine, two = (ConsensusGraph().build(agents) for agents in (6, 9, 2))
    np.testing.assert_array_equal(np.diagonal(six.weights, 1), [0.7, 0.6, 0.7, 0.8, 0.9])
    np.testing.assert_array_equal(six.leader, [0.8, 0, 0, 0, 0, 0.9])
    np.testing.assert_array_equal(np.diagonal(nine.weights, 1), [0.7, 0.6, 0.7, 0.8, 0.9, 0.7, 0.6, 0.7])
    np.testing.assert_array_equal(nine.leader, [0.8, *[0] * 7, 0.9])
    np.testing.assert_array_equal(two.weights, [[0, 0.7], [0.7, 0]])
    np.testing.assert_array_equal(ConsensusGraph().build(1).leader, [0.8])


def test_a_users_filter_closes_the_loop_that_names_it(tmp_path):
    """It believes every agent to be 0.1 m further along x than is read: that is where the agents then stay apart from the leader."""
    (tmp_path / "mine.py").write_text(
        "import numpy as np\nfrom typing import NamedTuple\n\nclass Belief(NamedTuple):\n    mean: np.ndarray\n\n"
        "class Shifted:\n    def __init__(self, setting): pass\n"
        "    def initial(self, measurement): return Belief(measurement + [0.1, 0, 0, 0])\n"
        "    def step(self, belief, command, measurement, dt): return self.initial(measurement)\n"
    )
    mine = UserCode((f"{tmp_path / 'mine.py'}:Shifted",))
    loops = {"exact": {"type": "exact", "feedback": "shifted"}, "usual": {"type": "exact"}, "seen": {"type": "exact", "feedback": "truth"}}
    described = load("consensus/fault-free", {"loops": loops, "run.ticks": 1000}, mine.names)
    late = {}
    for name in loops:
        recording = run(build(described, np.arange(1), mine, loop=name))
        place, leader = recording.channels["truth/state"][-300:, 0, :, :2], recording.channels["reference/leader"][-300:, None]
        late[name] = np.mean(place - leader, axis=0)
        believed = "shifted/mean" if name == "exact" else "truth/state" if name == "seen" else "usual/mean"
        np.testing.assert_array_equal(recording.channels["estimate"], recording.channels[believed])
    np.testing.assert_allclose(late["exact"] - late["usual"], [[-0.1, 0.0]] * 6, atol=0.02)
    with pytest.raises(BadInput, match=r"loops.exact.feedback: there is no filter 'shifted'; there are truth"):
        load("consensus/fault-free", {"loops": loops})


def test_agents_that_only_hear_forwards_still_track():
    """A chain from the leader on, each agent hearing the one before: errors die out one after the other."""
    graph = {"links": [], "one_way": [[2, 1, 0.7], [3, 2, 0.6], [4, 3, 0.8]], "leader": [[1, 0.8]]}
    described = load("consensus/fault-free", {"plant.agents": 4, "graph": graph, "loops": {"exact": {"type": "exact"}}, "run.ticks": 1500})
    assert described.communication().ways.tolist() == [[0, 0], [1, 1], [2, 2], [3, 3]]
    recording = run(build(described, np.arange(1), loop="exact"))
    apart = np.linalg.norm(recording.channels["truth/state"][:, 0, :, :2] - recording.channels["reference/leader"][:, None], axis=-1)
    assert (apart[0] > 0.7).all()
    assert (apart[-300:] < 0.03).all()


# the loop ---------------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("ticks", "companies"), [(15, (np.array([4, 5, 6]), np.arange(10))), (4, (np.arange(64),))])
def test_a_trial_is_the_same_to_the_bit_in_any_batch(ticks, companies):
    settings = scenario("command-fault", ticks, faults=[{"kind": "command", "start_s": 0.01, "end_s": 0.1 if ticks > 10 else 0.03}])
    block = simulate(settings, np.array([5]), np.array([5]))
    alone, kept = block.metrics, block.recordings
    for trials in companies:
        block = simulate(settings, trials, np.array([5]))
        together, other = block.metrics, block.recordings
        place = int(np.flatnonzero(trials == 5)[0])
        for one, many in zip(alone, together, strict=True):
            np.testing.assert_array_equal(one.values[0], many.values[place], err_msg=f"{one.subject} {one.metric}")
        for loop, what in kept.items():
            for key, values in what.channels.items():
                np.testing.assert_array_equal(values, other[loop].channels[key], err_msg=f"{loop} {key}")


def test_the_recorded_weights_are_those_of_what_was_learned():
    """W phi of the recorded W and motion, by NumPy's Chebyshev polynomials, is what the loop took for f + d."""
    settings = scenario("fault-free", 12, ("exact", "none", "adtl", "aukf", "mupf-b"))
    kept = simulate(settings, np.arange(2), np.arange(2)).recordings
    assert {loop for loop, one in kept.items() if "weights" in one.channels} == {"adtl", "aukf", "mupf-b"}
    for loop in ("adtl", "aukf", "mupf-b"):
        weights, motion = kept[loop].channels["weights"], kept[loop].channels["estimate"]
        assert weights.shape == (12, 2, 6, 26)
        powers = np.polynomial.chebyshev.chebvander(motion, 3)  # (..., inputs, 1 + 3)
        basis = np.concatenate([np.ones((*motion.shape[:-1], 1)), powers[..., 1:].reshape(*motion.shape[:-1], 12)], axis=-1)
        learned = np.stack([np.sum(weights[..., :13] * basis, axis=-1), np.sum(weights[..., 13:] * basis, axis=-1)], axis=-1)
        np.testing.assert_allclose(learned, kept[loop].channels["learned"], rtol=1e-5, atol=1e-5)
        assert np.abs(weights[-1]).max() > 0.01


def test_a_trial_that_is_lost_drifts_away_and_fails_nothing():
    wild = {"type": "marginalised", "sampled": "weights", "proposal": "prior", "particles": 10, "first_weight_std": 3.0}
    settings = scenario("fault-free", 600, loops={"wild": wild})
    block = simulate(settings, np.arange(2), np.arange(2))
    metrics, kept = block.metrics, block.recordings
    lost = next(m for m in metrics if m.metric == "lost_s").values
    assert np.isfinite(lost).all()
    for trial, since in enumerate(np.round(lost / 0.01).astype(int)):
        truth, learned = (kept["wild"].channels[key][:, trial] for key in ("truth/state", "learned"))
        assert np.isnan(learned[since:]).all()
        assert np.isfinite(learned[:since]).all()
        np.testing.assert_array_equal(truth[since + 1 :, :, 2:], np.broadcast_to(truth[-1, :, 2:], truth[since + 1 :, :, 2:].shape))
        assert absolute_error(kept["wild"])[-1, trial] > 100.0


def test_the_filter_of_what_is_read_is_the_filter_of_the_whole_state():
    """With weights that are never read, a part of the state is the whole with gaps, at less cost."""
    agent, rng = PlanarAgent(ChebyshevNetwork(order=1)), np.random.default_rng(2)
    process, first = np.diag([1e-6] * 4 + [1e-4] * 10), np.array([1e-8] * 4 + [1.0] * 10)

    def adaptive(noise, measurement=None):
        common = {"integrate": runge_kutta_of_motion, "measurement": measurement}
        unscented = UnscentedFilter(agent, process, noise, np.zeros(14), first, Euclidean(), **common)
        return AdaptiveUnscentedFilter(unscented, ConstantNoise(np.sqrt(process)), StrongTracking())

    part = adaptive(None, PartOfState(range(4), 14, 1e-8 * np.eye(4)))
    whole = adaptive(np.diag([1e-8] * 4 + [1.0] * 10))
    reading = 0.3 + 0.01 * rng.standard_normal((8, 3, 4)).cumsum(axis=0)
    reading[4, 1], reading[5, 2, 2:] = np.nan, np.nan
    padded = np.concatenate([reading, np.full((8, 3, 10), np.nan)], axis=-1)
    one, other = part.initial(reading[0]), whole.initial(padded[0])
    for k in range(1, 8):
        command = rng.standard_normal((3, 2))
        one, other = part.step(one, command, reading[k], 0.01), whole.step(other, command, padded[k], 0.01)
        np.testing.assert_allclose(one.mean, other.mean, rtol=1e-7, atol=1e-9)
        np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-6, atol=1e-10)
        np.testing.assert_allclose([one.nis, one.log_likelihood, one.dof], [other.nis, other.log_likelihood, other.dof], rtol=1e-6)


# what the chapter says --------------------------------------------------------------------------------------------------------------


def test_errors_at_the_start_are_those_of_figure_5_6():
    start = flown("fault-free", "exact", ticks=1)
    assert absolute_error(start)[0, 0] == pytest.approx(3.626, abs=5e-4)
    assert relative_error(start)[0, 0] == pytest.approx(8.868, abs=1e-3)


def test_exact_dynamics_leave_what_the_law_leaves():
    found = absolute_error(flown("fault-free", "exact", ticks=1500))
    assert between(found, 5.0, 15.0).mean() == pytest.approx(0.020, abs=0.002)


@pytest.mark.parametrize("name", NAMES)
def test_without_learning_the_agents_diverge(name):
    assert absolute_error(flown(name, "none"))[-1, 0] > 10.0


def test_the_joint_filter_learns_and_beats_the_adaptive_law():
    first = [{"kind": "dynamics", "start_s": 2.0, "gain": [3.0, 3.0]}]
    joint, adaptive = (flown("dynamics", name, ticks=800, faults=first) for name in ("aukf", "adtl"))
    aem = [absolute_error(loop) for loop in (joint, adaptive)]
    assert between(aem[0], 3.0, 8.0).max() < 0.1
    assert between(aem[1], 2.0, 8.0).mean() > 3.0 * between(aem[0], 2.0, 8.0).mean()
    wrong = [np.sqrt(between(dynamics_error(loop), 2.0, 8.0).mean()) for loop in (joint, adaptive)]
    assert wrong[1] > 2.0 * wrong[0]


def test_the_marginalised_filter_is_no_better_than_the_joint_one():
    """Particles on the state: within 10 % of the joint filter's errors while agents come in."""
    joint, particles = (absolute_error(flown("fault-free", name, ticks=260)) for name in ("aukf", "mupf-b"))
    assert between(particles, 0.0, 2.6).mean() == pytest.approx(between(joint, 0.0, 2.6).mean(), rel=0.1)
    assert particles[-1, 0] < 0.1


# what a person writes and sees ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_the_files_of_the_chapter_are_complete(name):
    settings = scenario(name)
    adaptive = {"aukf-adaptive"} if name == "fault-free" else set()  # under changing dynamics it flies off
    assert set(settings.loops) == {"exact", "none", "adtl", "aukf", "aukf-printed", "mupf-a", "mupf-a-prior", "mupf-b"} | adaptive
    laid = schedule([settings.faults], settings.parts, 1, np.arange(1), settings.run.ticks, 0.01).occurrences
    assert [(one.start_tick, one.end_tick) for one in laid] == {
        "fault-free": [],
        "dynamics": [(200, 1000), (1000, 1500), (1500, 2000)],
        "disturbance": [(500, 1000), (1000, 1500), (1500, 2000)],
        "command-fault": [(200, 600)],
    }[name]
    assert bool(settings.faults) == (name != "fault-free")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"loops": {}}, "no loop to fly"),
        ({"loops": {"truth": {"type": "exact"}}}, "cannot be a loop's name"),
        ({"loops": {"a": {"type": "adaptive-law", "tick_s": 0.003}}}, "not a whole number"),
        ({"loops": {"a": {"type": "marginalised", "resampling": "none"}}}, "no resampling 'none'"),
        (
            {"loops": {"a": {"type": "marginalised", "sampled": "weights", "proposal": "likelihood"}}},
            "no reading is of the weights themselves; 'likelihood' needs sampled = 'state'",
        ),
        ({"plant": {"type": "agents", "step_s": 0.004}}, "not a whole number"),
        ({"faults": [{"kind": "dynamics", "start_s": 21.0, "gain": [1, 1]}]}, "faults.0"),
        ({"faults": [{"kind": "command", "start_s": 3.0, "end_s": 2.0}]}, "faults.0"),
        ({"graph": {"links": [[1, 2, 0.7]]}}, "no path leads from the leader"),
        ({"graph": {"links": [[1, 7, 0.7]]}}, "no agent 7"),
        ({"graph": {"one_way": [[1, 1, 0.7]]}}, "agent 1 is linked to itself"),
    ],
)
def test_what_cannot_be_flown_is_refused(change, said):
    with pytest.raises(ValidationError, match=said):
        scenario("fault-free", **change)


def test_pictures_and_tables_are_written(tmp_path):
    settings = scenario("command-fault", 60, ("exact", "none", "aukf"), faults=[{"kind": "command", "start_s": 0.1, "end_s": 0.2}])
    block = simulate(settings, np.arange(2), np.arange(2))
    metrics, kept = block.metrics, block.recordings
    assert [(one.start_tick, one.text) for one in occurrences(kept)] == [(10, "no sliding terms in the command")]
    tables = tables_of(rows(metrics), settings, 2, (), None)
    assert [table.row_count for table in tables] == [3, 3]
    write_report(tmp_path / "report.png", "consensus/command-fault", settings, kept)
    write_recording(tmp_path / "recording.rrd", "consensus/command-fault", settings, kept, settings.model_dump(mode="json"))
    assert all((tmp_path / name).stat().st_size > 10_000 for name in ("report.png", "recording.rrd"))
    first = {loop: one.select(np.array([0])) for loop, one in kept.items()}
    drawn = {curve.path for curve in (*curves(settings, first), *weight_curves(settings, first))}
    for agent in range(1, 7):
        assert {f"learners/{what}/{axis}/agent_{agent}" for what in ("dynamics", "command", "error") for axis in "xy"} <= drawn
        assert {path for path in drawn if path.startswith("weights/") and path.endswith(f"_{agent}")} == {f"weights/aukf/agent_{agent}"}
    assert settings.warnings() == []
    assert "mupf-b" in scenario("fault-free").warnings()[0]


def test_every_loop_and_all_weights_are_drawn(tmp_path):
    settings = scenario("fault-free", 20, ("none", "aukf"), plant={"type": "agents", "agents": 2})
    kept = simulate(settings, np.arange(1), np.arange(1)).recordings
    write_learners(tmp_path / "learners.png", "consensus/fault-free", settings, kept)
    write_weights(tmp_path / "weights.png", "consensus/fault-free", settings, kept)
    write_weights(tmp_path / "none.png", "consensus/fault-free", settings, {"none": kept["none"]})  # nothing learns: nothing fails
    ink = [float((imread(tmp_path / f"{name}.png")[..., :3].mean(axis=-1) < 0.9).mean()) for name in ("learners", "weights", "none")]
    assert min(ink[:2]) > 0.01
    assert 0.001 < ink[2] < ink[1]
