"""The cross-check of the other plants of one body: what it finds, that it can find fault, and whose loop is flown."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest

from models.attitude.quaternion import IDENTITY, to_rotation_vector
from models.plants.panelled_body import PanelledBody
from sim.bad_input import BadInput
from sim.cli.commands import crosscheck as command_crosscheck
from sim.crosscheck.attribution import HELD, MODEL_STEP
from sim.crosscheck.divergence import divergence, momentum_N, thresholds
from sim.crosscheck.kinds import conic as crosscheck_conic
from sim.crosscheck.kinds import free_body
from sim.crosscheck.kinds import freeflyer as crosscheck_freeflyer
from sim.crosscheck.kinds import panels as crosscheck_panels
from sim.crosscheck.kinds.flexible import FLEXIBLE, panelled_body
from sim.crosscheck.kinds.freeflyer import FREEFLYER
from sim.crosscheck.kinds.monolithic import MONOLITHIC
from sim.crosscheck.open_loop import Change, Flight, fly, replay
from sim.crosscheck.register import FAMILIES, choose_loop, choose_model, family_of
from sim.crosscheck.study import CrossCheck, examine, metrics
from sim.scenario.files import load
from sim.scenario.one_body import Scenario

FLOAT = {"kind": "float", "wheel": 1, "start_s": 3.0, "duration_s": 3.0}
SHORT = {  # scenario, what is changed, instants
    "freeflyer": ("wmap/compare", {"run.ticks": 61, "faults": [FLOAT]}, (2.0, 6.0)),
    "monolithic": ("monolithic/fault-free", {"run.ticks": 101}, (0.3, 1.0)),
    "flexible": (
        "antenna-mapping/panelsat",
        {"run.ticks": 151, "start.rate_deg_s": [0.5, 0.2, 0.3], "plant.wheel_viscous_nms": 1e-8},
        (1.0, 3.0),
    ),
}
KINDS = tuple(SHORT)
every_kind = pytest.mark.parametrize("kind", KINDS)


def scenario_of(kind: str) -> Scenario:
    name, changes, _ = SHORT[kind]
    return choose_loop(load(name, {"run.trials": 2, **changes}), None)


@cache
def found_of(kind: str) -> CrossCheck:
    """Without physics checks, which are made below."""
    scenario, family = scenario_of(kind), replace(FAMILIES[kind], checks=())
    return examine(scenario, family, choose_model(family, None, scenario.plant), thresholds(scenario, []), SHORT[kind][2], lambda *_: None)


# every kind ---------------------------------------------------------------------------------------------------------------------


@every_kind
def test_the_exact_equations_are_those_of_the_plant_without_its_effects(kind):
    assert found_of(kind).causes.bare.max() < 1e-8


@every_kind
def test_a_replay_without_any_change_is_the_flight_to_the_bit(kind):
    flight = found_of(kind).flight
    np.testing.assert_array_equal(replay(flight, 41, Change()), flight.states[:41])


@every_kind
def test_the_shares_sum_to_the_total(kind):
    causes = found_of(kind).causes
    for tick in found_of(kind).ticks:
        assert causes.total[tick].any()
        assert causes.shares(tick).sum() == pytest.approx(1, abs=2e-3)
        assert causes.rest(tick) < 5e-3


@every_kind
def test_what_is_printed_fails_and_rows_are_told_apart(kind):
    found = found_of(kind)
    assert found.passed
    assert bool(found.failures) == (kind != "monolithic")
    keys = [(m.subject, m.metric, m.phase) for m in metrics(found)]
    assert len(set(keys)) == len(keys)


@every_kind
def test_every_named_model_takes_leading_axes(kind):
    parameters, family = scenario_of(kind).plant, FAMILIES[kind]
    wheels = parameters.wheel_axes.shape[1]
    for name in family.models:
        model = choose_model(family, name, parameters)
        size = 7 + model.hidden + (0 if model.reads_wheels else wheels)
        state = np.random.default_rng(1).normal(0, 1, (3, 2, size))
        inputs = np.zeros((3, 2, 2 * wheels if model.reads_wheels else wheels or 3))
        assert model.dynamics.derivative(state, inputs).shape == state.shape
    assert len({effect.name for effect in family.effects}) == len(family.effects)


@every_kind
def test_equations_that_are_not_the_plants_are_seen(kind):
    family = replace(FAMILIES[kind], checks=(), failures=())
    wrong = {
        "freeflyer": lambda p: p.full_process(),  # without rate coupling
        "monolithic": lambda p: p.process(believed=True),
        "flexible": lambda p: replace(family.exact(p), coupled=False),
    }
    scenario = scenario_of(kind)
    model, at = choose_model(family, None, scenario.plant), SHORT[kind][2][:1]
    seen = examine(scenario, replace(family, exact=wrong[kind]), model, thresholds(scenario, []), at, lambda *_: None)
    assert not seen.passed


# physics checks -----------------------------------------------------------------------------------------------------------------

BENCHES = {"freeflyer": crosscheck_freeflyer.BENCH, "monolithic": None, "flexible": crosscheck_panels.BENCH}


@every_kind
def test_the_plant_passes_its_physics_checks(kind):
    checks = [check for make in FAMILIES[kind].checks for check in make(scenario_of(kind).plant)]
    assert len(checks) >= 7
    assert all(check.passed for check in checks), [check for check in checks if not check.passed]


def inertia_off(model):
    model.body_inertia *= 1.001


def first_order(model):
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER


def lighter_wheels(model):
    model.body_inertia[2:6] *= 0.9


def friction_off(model):
    model.dof_damping *= 1.001
    model.dof_frictionloss *= 1.001


def stiffer(model):
    model.jnt_stiffness *= 1.001


SABOTAGE = [
    ("freeflyer", inertia_off, free_body.locked_inertia),
    ("freeflyer", inertia_off, free_body.torque_free_rotor),
    ("freeflyer", inertia_off, free_body.constant_torque),
    ("freeflyer", inertia_off, free_body.wheel_reaction),
    ("freeflyer", first_order, free_body.conservation),
    ("freeflyer", lighter_wheels, free_body.gyroscopic_torque),
    ("freeflyer", friction_off, free_body.friction),
    ("flexible", stiffer, crosscheck_panels.modes),
    ("flexible", stiffer, crosscheck_panels.held_torque),
    ("flexible", first_order, crosscheck_panels.ringing_keeps),
    ("flexible", inertia_off, free_body.wheel_reaction),
]


@pytest.mark.parametrize(("kind", "spoil", "check"), SABOTAGE, ids=[f"{s.__name__}-{c.__name__}" for _, s, c in SABOTAGE])
def test_a_physics_check_finds_fault_with(kind, spoil, check):
    def spoiled(parameters):
        made = BENCHES[kind].compile(parameters)
        spoil(made.model)
        return made

    figures = check(replace(BENCHES[kind], compile=spoiled), scenario_of(kind).plant)
    assert not all(figure.passed for figure in figures)


def test_a_symmetric_free_flyer_is_tried_with_three_moments(monkeypatch):
    tried = []
    bench = replace(BENCHES["freeflyer"], compile=lambda p: tried.append(p.inertia_kg_m2) or BENCHES["freeflyer"].compile(p))
    free_body.torque_free_rotor(bench, scenario_of("freeflyer").plant)
    assert tried[-1] == BENCHES["freeflyer"].asymmetric["inertia_kg_m2"]


# as printed ---------------------------------------------------------------------------------------------------------------------


def test_a_printed_rate_of_the_error_that_holds_is_seen(monkeypatch):
    flight = found_of("freeflyer").flight
    aligned = np.broadcast_to(np.eye(3), (599, 3, 3))
    monkeypatch.setattr(crosscheck_freeflyer.quaternion, "attitude_matrix", lambda _: aligned)  # as if the frames were one
    assert not any(failure.fails for failure in crosscheck_freeflyer.error_kinematics(flight, flight.states))


def test_conics_with_other_signs_than_the_norms_are_seen(monkeypatch):
    class Mirrored(crosscheck_conic.Specification):
        def tests(self, evidence):
            return -super().tests(evidence)

    spec = crosscheck_conic.SPECIFICATION
    monkeypatch.setattr(crosscheck_conic, "SPECIFICATION", Mirrored(spec.zero, spec.error_bound, spec.effort_bound, spec.tick))
    assert not any(failure.fails for failure in crosscheck_conic.conic_signs(found_of("flexible").flight, None))


# models that read the wheels ----------------------------------------------------------------------------------------------------


def test_a_model_that_reads_the_wheels_has_no_opinion_of_their_speed():
    found = found_of("freeflyer")
    assert "wheel" not in found.apart
    np.testing.assert_array_equal(found.states[..., 7:], found.flight.states[..., 7:])
    assert found.causes.names == ("the scenario's faults", "J_w / J left out (eq. 4)", HELD, MODEL_STEP)


def test_readings_that_change_evenly_within_a_tick_leave_only_what_the_model_leaves_out():
    flight = fly(choose_loop(load("wmap/compare", {"run.trials": 1, "run.ticks": 1001, "faults": []}), None), np.arange(1))
    believed, uncoupled = (FREEFLYER.models[name](flight.scenario.plant) for name in ("believed", "uncoupled"))
    even, held = (believed.predict(flight, 1001, 2, held=held) for held in (False, True))
    other, whole = uncoupled.predict(flight, 1001), FREEFLYER.whole(flight.scenario.plant)
    assert divergence(whole, other, even)["attitude"][-1] < 0.1 * divergence(whole, other, held)["attitude"][-1]


# a body without wheels ----------------------------------------------------------------------------------------------------------


def test_without_wheels_there_is_no_wheel_speed_and_momentum_counts_from_the_start():
    found = found_of("monolithic")
    assert [quantity.name for quantity in found.quantities] == ["attitude", "rate", "momentum", "energy"]
    assert "wheel" not in found.thresholds
    body, states = MONOLITHIC.whole(found.flight.scenario.plant), found.flight.states
    apart = np.linalg.norm(momentum_N(body, found.states) - momentum_N(body, states), axis=-1)
    at_start = np.linalg.norm(found.flight.scenario.plant.inertia @ states[0, 0, 4:7])
    np.testing.assert_allclose(found.apart["momentum"][:, 0], apart[:, 0] / at_start, rtol=1e-12)


def test_from_rest_momentum_is_relative_to_the_greatest():
    states = np.tile(np.concatenate([IDENTITY, np.zeros(3)]), (3, 1, 1))
    states[2, 0, 4] = 0.1
    other = states.copy()
    other[2, 0, 4] = 0.2
    assert divergence(MONOLITHIC.whole(scenario_of("monolithic").plant), states, other)["momentum"][2, 0] == pytest.approx(1)


def test_a_threshold_of_wheels_that_are_not_there_is_refused():
    with pytest.raises(BadInput, match=r"--threshold wheel=1: .* attitude, rate, momentum, energy"):
        thresholds(scenario_of("monolithic"), ["wheel=1"])


def test_a_users_model_takes_torques_on_the_body(tmp_path):
    (tmp_path / "mine.py").write_text(
        "import numpy as np\n\ndef derivative(state, command):\n    return np.concatenate([0 * state[..., :4], command / 17], axis=-1)\n"
    )
    mine = choose_model(MONOLITHIC, str(tmp_path / "mine.py"), scenario_of("monolithic").plant)
    assert mine.predict(found_of("monolithic").flight, 11).shape == (11, 2, 7)


# panels -------------------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def bending() -> Flight:
    return fly(choose_loop(load("antenna-mapping/panelsat", {"run.trials": 1, "run.ticks": 1301}), None), np.arange(1))


def test_small_deflections_of_the_panels_explain_what_the_rigid_body_does_not(bending):
    rigid, panels = (
        np.degrees(to_rotation_vector(FLEXIBLE.models[name](bending.scenario.plant).predict(bending, 1301)[..., :4]))
        for name in ("rigid", "panels")
    )
    truth = np.degrees(to_rotation_vector(bending.states[..., :4]))
    assert np.abs(rigid - truth).max() > 1e-2
    assert np.abs(panels - truth).max() < 1e-5


def test_without_the_change_of_inertia_the_held_axis_goes_astray(bending, monkeypatch):
    monkeypatch.setattr(PanelledBody, "_bent", np.zeros((3, 3)))
    panels = FLEXIBLE.models["panels"](bending.scenario.plant).predict(bending, 1301)
    assert np.abs(np.degrees(to_rotation_vector(panels[..., :4]) - to_rotation_vector(bending.states[..., :4])))[..., 1].max() > 1e-4


def test_panels_that_do_not_bend_make_a_rigid_body(bending):
    plant = bending.scenario.plant
    stiff = panelled_body(plant.model_copy(update={"panel_spring_nm_rad": 1e9}))
    state = np.concatenate([bending.states[700], np.zeros((1, 2))], axis=-1)
    command = bending.command[700]
    held = np.concatenate([state[..., :11], np.zeros((1, 2))], axis=-1)
    pull = state[:, 5] * state[:, 6] - FLEXIBLE.exact(plant).derivative(state[..., :11], command)[:, 4]
    held[:, 11] = stiff.panels.mass[0, 1] * pull / stiff.panels.stiffness[1, 1]  # where the springs make them move with the hub
    rate = stiff.derivative(held, command)
    np.testing.assert_allclose(rate[:, :11], FLEXIBLE.exact(plant).derivative(state[..., :11], command), rtol=1e-6, atol=1e-12)
    assert np.abs(rate[:, 12]).max() < 1e-6


# the command --------------------------------------------------------------------------------------------------------------------


def test_a_loop_is_chosen_by_name():
    compare = load("wmap/compare")
    assert choose_loop(compare, None).law == compare.loops["pd-ukf"].control
    assert choose_loop(compare, "smc-imm").law == compare.loops["smc-imm"].control
    assert not choose_loop(compare, "pd-imm-no-fault").faults


LOOPS = [
    (["wmap/compare", "--loop", "pd-imn"], ["--loop pd-imn", "did you mean pd-imm?"]),
    (["wmap/compare", "--loop", "x"], ["--loop x", "there are pd-ukf, pd-imm"]),
    (["nacs/fault-free", "--loop", "pd"], ["--loop pd", "a single loop"]),
    (["monolithic/fault-free", "--model", "beleived"], ["--model beleived", "did you mean believed?"]),
    (["formation/fault-free", "--loop", "x"], ["--loop x", "there are truth, aukf"]),
]


@pytest.mark.parametrize(("arguments", "wanted"), LOOPS, ids=[" ".join(a) for a, _ in LOOPS])
def test_a_wrong_name_is_one_line_and_writes_nothing(nacs, tmp_path, arguments, wanted):
    result = nacs("crosscheck", *arguments)
    assert (result.code, result.out, result.err.count("\n")) == (2, "", 1), result.err
    assert all(part in result.err for part in wanted), result.err
    assert not list(tmp_path.iterdir())


OTHER_LOOPS = {"freeflyer": "smc-imm-realloc", "monolithic": "true-state", "flexible": "nominal"}


@every_kind
def test_the_command_leaves_picture_recording_and_summary(nacs, tmp_path, monkeypatch, kind):
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr(command_crosscheck, "family_of", lambda s: replace(family_of(s), checks=()))
    moving = {"freeflyer": ("--set", "faults=[]"), "flexible": ("--set", "start.rate_deg_s=[0.5,0.2,0.3]")}.get(kind, ())
    what = ("--loop", OTHER_LOOPS[kind], "--trials", 1, "--set", "run.ticks=6", *moving)
    result = nacs("crosscheck", SHORT[kind][0], *what, "--out", "it")
    assert result.code == 0, result.err
    assert max(len(line) for line in result.out.splitlines()) <= 100  # tables 80; the command that opens the recording may be longer
    assert "…" not in result.out
    assert {path.name for path in (tmp_path / "it").iterdir()} == {"crosscheck.png", "crosscheck.rrd", "summary.json"}
    summary = json.loads((tmp_path / "it" / "summary.json").read_text())
    assert (summary["model"], summary["passed"]) == ("believed", True)
