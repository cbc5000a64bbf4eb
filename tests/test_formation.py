"""A formation of spacecraft: plant, graph, law, filters, faults of links, scenarios and what is written of them."""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from control.communication_graph import CommunicationGraph, lumped_error
from control.formation_law import FormationLaw, Gains
from estimation.leader_acceleration import LeaderAccelerationFilter
from models.attitude import modified_rodrigues
from models.attitude.quaternion import attitude_matrix
from models.dynamics.process import runge_kutta
from models.plants.assembly import ImpossibleInertia
from models.plants.formation import BELIEVED, PHYSICAL, PRINTED, SCALED, FormationParameters, compile_formation, prepare_formation
from models.plants.inertia import tensor, why_impossible
from sim.campaign.blocks import simulate
from sim.estimators.formation import agents_filter
from sim.faults.effects import INERTIA
from sim.faults.timeline import schedule
from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.loop.formation import apart_squared, formation_angle
from sim.metrics.formation import settling_time
from sim.metrics.results import rows
from sim.network.messages import Network
from sim.plant.formation import FormationPlant
from sim.randomness import RandomStream
from sim.report.register import write_report
from sim.rerun.register import write_recording
from sim.scenario.catalogue import SCENARIOS
from sim.scenario.formation import STARTS, FormationScenario
from sim.scenario.graph import FormationGraph
from sim.tables.register import tables_of

FILES = sorted((SCENARIOS / "formation").glob("*.toml"))
TRUTH = {"truth": {"feedback": "truth"}}
OBSERVERS = {
    "aukf": {"type": "aukf"},
    "pf": {"type": "pf", "particles": 20},
    "poor": {"type": "pf", "particles": 20, "proposal": "bootstrap"},
}


def scenario(ticks=100, trials=1, inertia="physical", **more) -> FormationScenario:
    data = {
        "title": "t",
        "source": "s",
        "run": {"ticks": ticks, "tick_s": 0.01, "trials": trials, "seed": 5},
        "plant": {"type": "formation", "inertia_kg_m2": inertia},
        "loops": TRUTH,
    }
    return FormationScenario.model_validate(data | more)


def flown(described, loop="truth", trials=1, recorded=1):
    return run(build(described, np.arange(trials), loop=loop), recorded=np.arange(recorded))


# the plant ------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("agent", range(6))
def test_mujoco_refuses_every_printed_tensor(agent):
    alone = FormationParameters(inertia_kg_m2=(PRINTED[agent],), believed_inertia_kg_m2=(BELIEVED[agent],))
    with pytest.raises(ValueError, match="A \\+ B >= C"):
        prepare_formation(alone).spec.compile()
    with pytest.raises(ImpossibleInertia, match="agent 1: no rigid body has it"):
        compile_formation(alone)


def test_printed_tensors_break_the_triangle_inequality_and_no_more():
    missing = []
    for row in PRINTED:
        low, middle, high = np.linalg.eigvalsh(tensor(row))
        assert low > 0.0
        missing.append(high - low - middle)
    assert (min(missing), max(missing)) == pytest.approx((0.102, 0.715), abs=2e-3)
    assert [why_impossible(tensor(row)) for row in PHYSICAL] == [None] * 6


@pytest.mark.parametrize("name", ["physical", "printed"])
def test_the_compiled_bodies_have_the_tensors(name):
    parameters = FormationParameters(inertia_kg_m2=name)
    model = compile_formation(parameters).model
    to_body = attitude_matrix(model.body_iquat[1:, [1, 2, 3, 0]]).swapaxes(-1, -2)
    there = to_body * model.body_inertia[1:, None, :] @ to_body.swapaxes(-1, -2)
    np.testing.assert_allclose(there, parameters.inertia, rtol=0, atol=1e-12)


def analytic(described, ticks):
    """SKAE and FKAE of the model in modified Rodrigues parameters under the same law, by the Runge-Kutta method alone."""
    graph, law = described.communication(), described.loops["truth"].law
    faults = schedule([described.faults], described.parts, 5, np.arange(1), ticks, 0.01)
    controller = FormationLaw(described.plant.believed_inertia, law.gains)
    leader = described.leader.motion(0.01 * np.arange(ticks))
    state, p, out = np.concatenate([described.starts, np.zeros((6, 3))], axis=-1), np.zeros((6, 3)), np.zeros((ticks, 2))
    for k in range(ticks):
        out[k] = np.linalg.norm(state[:, :3] - leader[k, :3]), np.sqrt(apart_squared(state[:, :3]))
        said = np.concatenate([leader[k][None], np.concatenate([state, p], axis=-1)])[None]
        torque = controller.step(state, said[..., :6], graph.listening, p)
        pushed, added = faults.push(k), faults.at(INERTIA, k)
        torque = torque if pushed is None else torque + pushed[0]
        body = type(described.plant.process())(described.plant.inertia if added is None else described.plant.inertia + added[0])
        state = runge_kutta(body, state, torque, 0.01)
        p = LeaderAccelerationFilter().step(p, said[..., 6:], graph.listening, 0.01)
    return out


@pytest.mark.parametrize("name", ["physical", "printed"])
def test_mujoco_flies_as_the_analytic_model_does(name):
    described = scenario(ticks=400, inertia=name)
    figures, expected = flown(described).figures, analytic(described, 400)
    assert (figures["skae"][0, 0], figures["fkae"][0, 0]) == pytest.approx((5.373, 12.718), abs=1e-3)
    np.testing.assert_allclose(np.stack([figures["skae"][:, 0], figures["fkae"][:, 0]], axis=-1), expected, rtol=0, atol=1e-9)


def test_mujoco_flies_as_the_analytic_model_does_through_changes_of_inertia_and_disturbances():
    heavier = {"kind": "inertia", "start_s": 1.0, "end_s": 2.0, "add_kg_m2": [2.0, 3.0, 4.0]}
    pushed = {"kind": "disturbance", "start_s": 0.5, "end_s": 2.5, "size_nm": 0.25}
    described = scenario(ticks=300, faults=[heavier, pushed])
    figures, expected = flown(described).figures, analytic(described, 300)
    np.testing.assert_allclose(figures["fkae"][:, 0], expected[:, 1], rtol=0, atol=1e-7)
    unchanged = analytic(scenario(ticks=300), 300)
    assert np.abs(unchanged - expected).max() > 0.05


def test_products_of_inertia_are_scaled_to_a_little_less_than_a_body_can_have():
    """Of all mass, the second moments tr(J)/2 1 - J = D - s O are positive: up to s = 1 / the greatest eigenvalue of D^-1/2 O D^-1/2."""
    for printed, scale in zip(PRINTED[1:], SCALED[1:], strict=True):
        whole = tensor(printed)
        root = 1.0 / np.sqrt(np.trace(whole) / 2.0 - np.diag(whole))
        greatest = 1.0 / np.linalg.eigvalsh(root[:, None] * (whole - np.diag(np.diag(whole))) * root)[-1]
        assert 0.96 < scale / greatest < 0.985


def test_inertias_are_set_body_by_body():
    parameters = FormationParameters()
    plant = FormationPlant(compile_formation(parameters), 2)
    plant.set_inertias(parameters.inertia + np.diag([2.0, 3.0, 4.0]))
    plant.advance(np.zeros((2, 0)), np.array([0.1, 0.0, 0.0]), 1)
    expected = np.linalg.solve(parameters.inertia + np.diag([2.0, 3.0, 4.0]), [0.001, 0.0, 0.0])
    np.testing.assert_allclose(plant.truth().omega_BN_B, np.tile(expected, (2, 1, 1)), atol=1e-9)


# graph, law, filter ---------------------------------------------------------------------------------------------------------


def published():
    return scenario().communication()


def test_a_lumped_error_is_the_graph_s_laplacian():
    graph, random = published(), np.random.default_rng(1)
    own, leader = random.normal(size=(2, 6, 3)), random.normal(size=3)
    heard = np.concatenate([np.broadcast_to(leader, (2, 1, 3)), own], axis=1)[:, None]
    laplacian = np.diag(graph.weights.sum(axis=1) + graph.leader) - graph.weights
    np.testing.assert_allclose(lumped_error(own, heard, graph.listening), laplacian @ own - graph.leader[:, None] * leader, atol=1e-12)


@pytest.mark.parametrize(
    ("links", "leader", "complaint"),
    [
        ([(1, 2, 0.5)], [(1, 0.5)], "no path leads from the leader to 3"),
        ([(1, 2, 0.5), (2, 3, 0.5)], [], "to 1, 2, 3"),
        ([(1, 1, 0.5), (1, 2, 1.0), (2, 3, 1.0)], [(1, 0.5)], "agent 1 is linked to itself"),
        ([(1, 2, -0.5), (2, 3, 0.5)], [(1, 0.5)], "negative"),
    ],
)
def test_a_graph_is_checked(links, leader, complaint):
    with pytest.raises(ValueError, match=complaint):
        CommunicationGraph.of(3, links, leader)


def test_a_graph_can_be_directed():
    graph = CommunicationGraph.of(3, [(1, 2, 0.4)], [(1, 0.5)], [(3, 2, 0.3)])
    np.testing.assert_array_equal(graph.weights, [[0, 0.4, 0], [0.4, 0, 0], [0, 0.3, 0]])
    with pytest.raises(ValueError, match="no path leads from the leader to 3"):
        CommunicationGraph.of(3, [(1, 2, 0.4)], [(1, 0.5)], [(2, 3, 0.3)])


@pytest.mark.parametrize(("sign", "settles"), [(-1.0, True), (1.0, False)])
def test_only_with_the_minus_is_the_leader_s_acceleration_found(sign, settles):
    graph, leader = published(), np.array([0.008, -0.004, 0.001])
    estimate, within = np.zeros((6, 3)), 0.0
    for k in range(2000):
        heard = np.concatenate([leader[None], estimate])[None]
        estimate = LeaderAccelerationFilter(10.0, sign).step(estimate, heard, graph.listening, 0.01)
        if k == 99:
            within = np.abs(estimate).max()
        if np.abs(estimate).max() > 1e9:
            break
    assert (np.abs(estimate - leader).max() < 1e-9) == settles
    assert (within > 1e6) != settles


def test_the_law_cancels_what_it_knows_and_is_cut_off():
    parameters, random = FormationParameters(), np.random.default_rng(2)
    state = random.normal(scale=0.3, size=(6, 6))
    heard = np.concatenate([state[:1], state])[None]
    law = FormationLaw(parameters.believed_inertia, Gains(), limit=1e3)
    alone, p = np.zeros((6, 7)), random.normal(size=(6, 3))
    torque = law.step(state, heard, alone, p, 0.1)
    moved = parameters.process(believed=True).derivative(state, torque)[:, 3:]
    np.testing.assert_allclose(moved, p - 10.0 * 2.0**2 * 0.1, atol=1e-12)
    near = replace(law, limit=0.1).step(state, heard, published().listening, p)
    assert np.abs(near).max() == 0.1


# what goes wrong with messages ----------------------------------------------------------------------------------------------


def network(fault, skip=False):
    described = scenario(ticks=10, faults=[{"start_s": 0.0, "end_s": 0.1} | fault])
    graph = described.communication()
    faults = schedule([described.faults] * 2, described.parts, 5, np.arange(2), 10, 0.01)
    return graph, Network(graph, faults, RandomStream(5, np.arange(2), 2001, (len(graph.ways),), uniform=True), skip)


def say(k):
    return np.full((2, 7, 9), float(k))


def test_a_lost_message_leaves_the_one_before_or_nothing():
    graph, holding = network({"kind": "message-loss", "probability": 0.5})
    _, skipping = network({"kind": "message-loss", "probability": 0.5}, skip=True)
    receiver, sender = graph.ways.T
    age = []
    for k in range(10):
        held, skipped = holding.carry(k, say(k)), skipping.carry(k, say(k))
        np.testing.assert_array_equal(held.received, skipped.received)
        np.testing.assert_array_equal(held.listening[:, receiver, sender], np.broadcast_to(graph.listening[receiver, sender], (2, 14)))
        np.testing.assert_array_equal(skipped.listening[:, receiver, sender] > 0.0, held.received)
        age.append(k - held.messages[:, receiver, sender, 0])
        np.testing.assert_array_equal(age[-1] == 0, held.received | (k == 0))
    assert 1 <= np.max(age) < 10
    assert 0.3 < np.mean([a == 0 for a in age[1:]]) < 0.7


def test_messages_come_late():
    _, late = network({"kind": "delay", "delay_s": 0.03})
    assert [float(late.carry(k, say(k)).messages[0, 0, 2, 0]) for k in range(6)] == [0.0, 0.0, 0.0, 0.0, 1.0, 2.0]


def test_a_cut_link_counts_nothing_in_both_directions():
    graph, cut = network({"kind": "cut", "links": [[1, 2], [0, 6]]})
    gone = np.argwhere((graph.listening > 0.0) & (cut.carry(0, say(0)).listening[0] == 0.0))
    assert {tuple(map(int, way)) for way in gone} == {(0, 2), (1, 1), (5, 0)}


# loops ----------------------------------------------------------------------------------------------------------------------


def test_a_trial_is_the_same_to_the_bit_in_any_batch():
    loops = {"aukf": {"feedback": "aukf", "watching": ["pf", "poor"]}}
    lossy = [{"kind": "message-loss", "start_s": 0.0, "end_s": 1.0, "probability": 0.3}]
    described = scenario(ticks=40, trials=10, observers=OBSERVERS, loops=loops, faults=lossy)
    together = run(build(described, np.arange(10), loop="aukf"), recorded=np.array([7]))
    for trials in (np.array([7]), np.array([2, 7, 9])):
        alone = run(build(described, trials, loop="aukf"), recorded=np.array([7]))
        place = int(np.flatnonzero(trials == 7)[0])
        for name, values in alone.figures.items():
            np.testing.assert_array_equal(values[:, place], together.figures[name][:, 7], err_msg=name)
        for name, values in alone.channels.items():
            np.testing.assert_array_equal(values, together.channels[name], err_msg=name)


def test_rates_are_found_from_attitudes_alone_and_no_torque_exceeds_its_limit():
    described = scenario(ticks=400, observers=OBSERVERS, loops={"aukf": {"feedback": "aukf", "watching": ["pf"]}})
    found = flown(described, "aukf")
    speed = np.sqrt(np.mean(found.channels["truth/state"][200:, 0, :, 3:] ** 2) * 3)
    for name, share in (("aukf", 0.3), ("pf", 0.5)):
        assert np.sqrt(np.mean(found.figures[f"{name}/velocity_squared"][200:])) < share * speed
    assert found.figures["peak_torque"].max() == 0.1


def test_faults_of_commands_and_readings_happen_to_whom_they_should():
    faults = [
        {"kind": "command", "start_s": 0.1, "end_s": 0.2, "agents": [1, 3], "torque_nm": [0.01, 0.02, 0.03]},
        {"kind": "readings", "start_s": 0.2, "end_s": 0.3, "bias": 0.4, "deviation": 0.0},
        {"kind": "gains", "start_s": 0.0, "end_s": 0.1, "agents": [2], "k1": 0.0},
    ]
    channels = flown(scenario(ticks=40, faults=faults)).channels
    given = (channels["applied"][:, 0] == [0.01, 0.02, 0.03]).all(axis=-1)
    assert np.argwhere(given).tolist() == [[k, agent] for k in range(10, 20) for agent in (0, 2)]
    bias = channels["reading"][:, 0] - channels["truth/state"][:, 0, :, :3]
    np.testing.assert_allclose(bias[20:30], 0.4, atol=1e-12)
    assert 0.0 < np.abs(bias[30:]).max() < 1e-3
    assert np.abs(channels["applied"][5, 0, 1]).max() < 0.01 < np.abs(channels["applied"][15, 0, 1]).max()


def test_a_lost_filter_begins_anew_and_is_counted():
    described = scenario(observers=OBSERVERS)
    watching = agents_filter("aukf", described.observers["aukf"], described.plant, 5, np.arange(2))
    reading = np.broadcast_to(described.starts, (2, 6, 3))
    first = watching.initial(reading)
    far = first.belief.mean.copy()
    far[1, 4, 3:] = 1e6
    after = watching.step(first._replace(belief=first.belief._replace(mean=far)), np.zeros((2, 6, 3)), reading, 0.01)
    assert np.argwhere(after.lost).tolist() == [[1, 4]]
    np.testing.assert_array_equal(after.belief.mean[1, 4], [*reading[1, 4], 0.0, 0.0, 0.0])
    np.testing.assert_array_equal(after.belief.mean[1, :4], after.belief.mean[0, :4])
    assert not first.lost.any()


def test_in_the_shorter_set_nobody_goes_the_long_way():
    described = scenario(ticks=300, loops=TRUTH | {"short": {"feedback": "truth", "shadow": True}})
    long, short = (flown(described, name).channels["truth/state"][..., :3] for name in ("truth", "short"))
    assert np.linalg.norm(long[0], axis=-1).max() == pytest.approx(3.0)
    assert np.linalg.norm(short[0], axis=-1).max() <= 1.0
    same = modified_rodrigues.shorter(long[0]) - short[0]
    np.testing.assert_allclose(same, 0.0, atol=1e-12)


def test_sixty_agents_fly_by_the_file_alone():
    described = FormationScenario.model_validate(tomllib.loads((SCENARIOS / "formation" / "sixty.toml").read_text()))
    described = described.model_copy(update={"run": described.run.model_copy(update={"ticks": 20})})
    found = flown(described, "aukf")
    assert found.channels["truth/state"].shape == (20, 1, 60, 6)
    assert np.isfinite(found.figures["fkae"]).all()


# figures of merit -----------------------------------------------------------------------------------------------------------


def test_errors_between_all_pairs_are_what_their_definitions_say():
    sigma = np.array(STARTS)
    pairs = [(i, j) for i in range(6) for j in range(i + 1, 6)]
    assert apart_squared(sigma) == pytest.approx(sum(np.sum((sigma[i] - sigma[j]) ** 2) for i, j in pairs), rel=1e-12)
    q = modified_rodrigues.to_quaternion(sigma)
    square = [(2.0 * np.arccos(min(1.0, abs(float(q[i] @ q[j]))))) ** 2 for i, j in pairs]
    assert formation_angle(q) == pytest.approx(np.sqrt(np.mean(square)), rel=1e-12)


def test_settling_is_for_good():
    fkae = np.array([[1.0, 0.05, 0.2, 0.05, 0.05], [0.05] * 5, [0.05, 0.05, 0.05, 0.05, 0.2], [0.05, np.nan, 0.05, 0.05, 0.05]])
    np.testing.assert_array_equal(settling_time(fkae, 0.5), [1.5, 0.0, np.nan, 1.0])


# files ----------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_scenario_is_valid_and_names_its_source(path: Path):
    described = FormationScenario.model_validate(tomllib.loads(path.read_text()))
    assert described.source
    assert described.plant.agents == len(described.starts)
    described.warnings()


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"loops": {}}, "no loop is flown"),
        ({"loops": {"a": {"feedback": "ukf"}}}, "no observer 'ukf'"),
        ({"graph": {"links": [[1, 9, 0.5]]}}, "there is no agent 9; there are 6"),
        ({"graph": {"links": [[1, 2, 0.5]]}}, "no path leads from the leader"),
        ({"phases": {"late": [5.0, 6.0]}}, "not inside the run of 1 s"),
        ({"faults": [{"kind": "cut", "start_s": 0.0, "end_s": 1.0, "links": [[1, 3]]}]}, "there is no link 1-3"),
        ({"faults": [{"kind": "delay", "start_s": 2.0, "end_s": 1.0, "delay_s": 1.0}]}, "is not after start_s"),
        ({"faults": [{"kind": "command", "start_s": 0.0, "end_s": 1.0, "agents": [8], "torque_nm": [0, 0, 0]}]}, "there is no agent 8"),
        ({"faults": [{"kind": "inertia", "start_s": 0.0, "end_s": 1.0, "add_kg_m2": [9.0, 0.0, 0.0]}]}, "no rigid body has the inertia"),
        ({"observers": {"truth": {"type": "aukf"}}}, "means something else"),
        ({"observers": {"a": {"type": "pf", "proposal": "likelihood", "likelihood": {"type": "student-t"}}}}, "depend on what was drawn"),
        ({"plant": {"type": "formation", "believed_inertia_kg_m2": [[1, 1, 1, 0, 0, 0]]}}, "6 agents, but 1 believed"),
        ({"run": {"ticks": 5, "tick_s": 0.015, "trials": 1, "seed": 1}}, "whole number of physics steps"),
    ],
)
def test_bad_files_are_refused(change, complaint):
    with pytest.raises(ValidationError, match=complaint):
        scenario(**change)


def test_the_published_graph_is_the_default():
    graph = FormationGraph().build(6)
    ring = [(0, 1, 0.4), (0, 5, 0.6), (1, 2, 0.6), (2, 3, 0.6), (3, 4, 0.8), (4, 5, 0.6)]  # Rososhansky 2017, sec. 4.3
    assert [(i, j, graph.weights[i, j]) for i, j in np.argwhere(np.triu(graph.weights))] == ring
    assert graph.weights[4, 3] == 0.8
    assert graph.leader.tolist() == [0.5, 0.0, 0.0, 0.0, 0.0, 0.5]


def test_a_run_is_told_drawn_and_recorded(tmp_path):
    loops = {"truth": {"feedback": "truth"}, "aukf": {"feedback": "aukf"}}
    lossy = [{"kind": "message-loss", "start_s": 0.1, "end_s": 0.3, "probability": 0.5}]
    described = scenario(ticks=60, trials=2, observers=OBSERVERS, loops=loops, faults=lossy, phases={"lossy": [0.1, 0.3]})
    ticks = []
    block = simulate(described, np.arange(2), np.array([1]), on_tick=lambda *tick: ticks.append(tick))
    metrics, found = block.metrics, block.recordings
    assert len(ticks) == 120
    assert {m.subject for m in metrics} == {"truth", "aukf"}
    assert all(m.values.shape == (2,) for m in metrics)
    assert len(tables_of(rows(metrics), described, 2, (), None)) == 2
    write_report(tmp_path / "report.png", "formation/t", described, found)
    write_recording(tmp_path / "recording.rrd", "formation/t", described, found, {"a": 1})
    assert (tmp_path / "report.png").stat().st_size > 50_000
    assert (tmp_path / "recording.rrd").stat().st_size > 20_000
