"""The cross-check: what it finds of the NACS, that it can find fault, and what a user can get wrong."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from rerun.chunk import RrdReader
from scipy.spatial.transform import Rotation

from models.attitude.quaternion import attitude_matrix
from models.plants.nacs import compile_nacs
from sim.cli.commands import crosscheck as command_crosscheck
from sim.crosscheck import attribution, model_variants
from sim.crosscheck.attribution import Attribution, present, size_deg
from sim.crosscheck.bench import Check
from sim.crosscheck.divergence import IDEAL, divergence, kinetic_energy, momentum_N, passes, thresholds
from sim.crosscheck.failure import Failure
from sim.crosscheck.kinds import physics_checks, printed_errors
from sim.crosscheck.kinds.nacs import NACS
from sim.crosscheck.kinds.physics_checks import NACS_CHECKS
from sim.crosscheck.kinds.printed_errors import NACS_FAILURES
from sim.crosscheck.model_variants import NACS_MODELS
from sim.crosscheck.open_loop import Change, Flight, fly, integrate, replay
from sim.crosscheck.register import FAMILIES, choose_model, family_of
from sim.crosscheck.study import CrossCheck, examine, metrics
from sim.plant.batch import SimulationFailed, diagnose
from sim.scenario.files import load
from sim.scenario.one_body import Scenario

QUICK = ("--trials", 1, "--set", "run.ticks=6", "--at", "0.5")
DOCUMENT = Path(__file__).parents[1] / "docs" / "crosscheck.md"


def quiet(*_: object) -> None:
    """No progress."""


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return load("nacs/fault-free", {"run.trials": 2, "run.ticks": 301})


@pytest.fixture(scope="module")
def found(scenario: Scenario) -> CrossCheck:
    return examine(scenario, NACS, NACS_MODELS["eq9-10"](scenario.plant), thresholds(scenario, []), (1.0, 10.0, 30.0), quiet)


@pytest.fixture(scope="module")
def flight(found: CrossCheck) -> Flight:
    return found.flight


# flying again -------------------------------------------------------------------------------------------------------------------


def test_a_replay_without_any_change_is_the_flight_to_the_bit(flight):
    np.testing.assert_array_equal(replay(flight, 101, Change()), flight.states[:101])


def test_faults_are_replayed_too():
    faults = [
        {"kind": "lock", "wheel": 2, "start_s": 1, "duration_s": 1},
        {"kind": "inertia", "inertia_kg_m2": [0.03, 0.025, 0.04, 0, 0, 0], "start_s": 1.5, "duration_s": 1},
        {"kind": "external-torque", "torque_nm": 0.005, "start_s": 0.5, "duration_s": 0.5},
    ]
    flown = fly(load("nacs/fault-free", {"run.ticks": 31, "faults": faults}), np.arange(2), NACS.rig)
    np.testing.assert_array_equal(replay(flown, 31, Change()), flown.states)
    spared = replay(flown, 31, Change(no_faults=True))
    np.testing.assert_array_equal(spared[:6], flown.states[:6])
    assert np.abs(spared[-1] - flown.states[-1]).max() > 0.01


def test_with_every_effect_off_the_plant_is_that_of_the_exact_equations(found):
    assert found.causes.bare.max() < 1e-6


def test_the_models_step_is_fine_enough_only_by_runge_kutta(found):
    assert size_deg(found.causes.contribution[-1, -1]) < 1e-6
    assert size_deg(found.causes.euler[-1]) > 0.01


# divergence ---------------------------------------------------------------------------------------------------------------------


def test_momentum_and_energy_of_states_are_those_of_mujoco(flight):
    channels, body = flight.recording.channels, flight.scenario.plant.process(coupled=True)
    told = diagnose(flight.system.plant.assembly, channels["truth/qpos"], channels["truth/qvel"])
    momentum = momentum_N(body, flight.states)
    np.testing.assert_allclose(momentum, told.momentum_N, atol=1e-4 * np.abs(momentum).max())  # the balance masses lag behind a little
    still = np.zeros_like(channels["truth/qvel"])
    height = diagnose(flight.system.plant.assembly, channels["truth/qpos"], still).energy
    kinetic = kinetic_energy(body, flight.states)
    np.testing.assert_allclose(kinetic, told.energy - height, atol=1e-3 * kinetic.max())


def test_a_model_that_is_the_plant_does_not_diverge(flight):
    apart = divergence(flight.scenario.plant.process(coupled=True), flight.states, flight.states)
    assert all(np.all(values < 1e-7) for values in apart.values())


def test_a_threshold_is_passed_at_the_first_tick_beyond_it():
    values = np.array([[0.0, 0.0, 2.0], [1.0, 0.0, 2.0], [3.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    np.testing.assert_array_equal(passes(values, 1.0, 0.5), [1.0, np.nan, 0.0])


def test_thresholds_are_the_sensors_noise_unless_given(scenario):
    limits = thresholds(scenario, ["energy=0.5"])
    assert limits["attitude"] == pytest.approx(np.degrees(scenario.sensors.attitude_noise_rad))
    assert limits["energy"] == 0.5
    assert thresholds(load("nacs/fault-free", {"sensors": {"set": "ideal"}}), [])["wheel"] == IDEAL["wheel"]


def test_a_model_leaves_the_plant_within_a_second_and_further_with_time(found):
    angle = found.apart["attitude"]
    assert np.all(passes(angle, found.thresholds["attitude"], 0.1) < 1.5)
    assert np.all(angle[300] > 10 * angle[30])


# attribution --------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("second", "within"), [(1, 0.001), (10, 0.01), (30, 0.05)])
def test_the_shares_sum_to_the_total(found, second, within):
    causes = found.causes
    assert abs(causes.shares(10 * second).sum() - 1) < within
    assert causes.rest(10 * second) < within
    assert abs(causes.shares_alone(10 * second).sum() - 1) < 0.2
    assert causes.superposes(10 * second)


def test_the_centre_of_mass_contributes_what_its_weight_does(found):
    causes, plant = found.causes, found.flight.scenario.plant
    weight = plant.mass_kg * plant.gravity_m_s2 * attitude_matrix(found.flight.states[0, :, :4]) @ [0.0, 0.0, 1.0]  # in B; N is down
    torque = np.cross(1e-6 * np.array(plant.centre_of_mass_um), weight)
    resisting = plant.inertia - plant.wheel_inertia_kg_m2 * plant.wheel_axes @ plant.wheel_axes.T
    turned = 0.5 * 0.5**2 * np.linalg.solve(resisting, torque.T).T  # of half a second
    alone = causes.alone[causes.names.index("centre of mass under gravity"), 5]
    np.testing.assert_allclose(np.linalg.norm(alone, axis=-1), np.linalg.norm(turned, axis=-1), rtol=0.03)  # the masses sag first


def test_viscous_friction_contributes_what_the_wheels_speeds_say(found):
    causes, plant = found.causes, found.flight.scenario.plant
    everything = Change()
    for effect in present(found.flight, NACS.effects):
        everything |= effect.off
    speed = replay(found.flight, 11, everything)[..., 7:]
    resisting = plant.inertia - plant.wheel_inertia_kg_m2 * plant.wheel_axes @ plant.wheel_axes.T
    gain = np.linalg.solve(resisting, plant.wheel_viscous_nms * plant.wheel_axes) @ speed[..., None]  # the wheels drag the body along
    rate = np.cumsum(0.05 * (gain[1:] + gain[:-1]), axis=0)
    turned = 0.1 * (rate[:-1].sum(axis=0) + 0.5 * rate[-1])[..., 0]
    alone = causes.alone[causes.names.index("wheel viscous friction"), 10]
    np.testing.assert_allclose(np.linalg.norm(alone, axis=-1), np.linalg.norm(turned, axis=-1), rtol=0.03)  # trapezia of 0.1 s


def made_up(alone: np.ndarray, missing: np.ndarray, total: np.ndarray) -> Attribution:
    """One tick and one trial."""
    shape = (len(alone), 1, 1, 3)
    none = np.zeros((1, 1, 3))
    return Attribution(("a", "b"), alone.reshape(shape), missing.reshape(shape), total.reshape(1, 1, 3), none, np.zeros((1, 1)))


def test_how_far_a_model_is_turned_is_said_in_inertial_axes():
    """SciPy turns bodies by vectors whose components are those along N."""
    random = np.random.default_rng(8)
    body, vector = Rotation.random(50, random_state=9), random.uniform(-0.6, 0.6, (50, 3))
    reference, state = np.zeros((2, 50, 11))
    reference[:, :4], state[:, :4] = body.as_quat(), (Rotation.from_rotvec(vector) * body).as_quat()
    np.testing.assert_allclose(attitude_matrix(reference[:, :4]), body.inv().as_matrix(), atol=1e-14)  # so that both mean the same
    np.testing.assert_allclose(attribution._turn(state, reference), vector, atol=1e-12)


def test_effects_that_interact_in_a_pair_share_what_they_do_together():
    a, b, both = np.eye(3)
    causes = made_up(np.stack([a, b]), np.stack([a + both, b + both]), a + b + both)
    assert causes.rest(0) == pytest.approx(0, abs=1e-12)
    np.testing.assert_allclose(causes.shares(0), [0.5, 0.5])
    assert causes.shares_alone(0).sum() == pytest.approx(2 / 3)


def test_effects_that_do_not_superpose_are_said_not_to():
    x, y, _ = np.eye(3)
    assert not made_up(np.stack([x, x]), np.stack([x, x]), x).superposes(0)  # twice the total
    assert not made_up(np.stack([x, y]), np.stack([x, y]), x).superposes(0)  # the right sum of shares, but not the vectors


def test_only_effects_that_the_plant_has_are_switched(scenario):
    names = {effect.name for effect in present(Flight(scenario, None, None, None), NACS.effects)}
    assert "wheel imbalance" not in names
    assert "the scenario's faults" not in names
    shaken = load("nacs/wheel-failure", {"plant.wheel_imbalance_um": 1, "plant.step_s": 5e-4, "plant.wheel_coulomb_nm": 0})
    names = {effect.name for effect in present(Flight(shaken, None, None, None), NACS.effects)}
    assert {"wheel imbalance", "the scenario's faults"} <= names
    assert "wheel dry friction" not in names


# physics checks -----------------------------------------------------------------------------------------------------------------


def test_the_plant_passes_its_physics_checks(found):
    assert len(found.checks) >= 12
    assert all(check.passed for check in found.checks), [check for check in found.checks if not check.passed]


SABOTAGE = {
    "an integrator of first order": (lambda m: setattr(m.opt, "integrator", mujoco.mjtIntegrator.mjINT_EULER), "conservation"),
    "an inertia one thousandth off": (lambda m: m.body_inertia.__imul__(1.001), "locked_wheel_inertia"),
    "a body that is not as asymmetric": (lambda m: m.body_inertia.__imul__(1.001), "torque_free_rotor"),
    "a gravity one thousandth off": (lambda m: m.opt.gravity.__imul__(1.001), "pendulum"),
    "friction one thousandth off": (lambda m: (m.dof_damping.__imul__(1.001), m.dof_frictionloss.__imul__(1.001)), "spin_down"),
    "a voltage one hundredth off": (lambda m: m.actuator_gainprm.__imul__(1.01), "back_emf"),
    "inertia of wheels as armature": (lambda m: m.body_inertia[2:6].__imul__(0.9), "gyroscopic_torque"),
}


@pytest.mark.parametrize(("spoil", "name"), SABOTAGE.values(), ids=SABOTAGE)
def test_a_physics_check_finds_fault_with(scenario, monkeypatch, spoil, name):
    def spoiled(parameters):
        made = compile_nacs(parameters)
        spoil(made.model)
        return made

    monkeypatch.setattr(physics_checks, "compile_nacs", spoiled)
    assert not all(check.passed for check in getattr(physics_checks, name)(scenario.plant))


def test_a_figure_that_is_no_number_fails():
    assert not Check("x", "y", np.nan, 1.0, "1").passed


def test_a_symmetric_body_has_no_jacobi_motion_and_the_published_one_is_taken():
    plant = load("nacs/fault-free", {"plant.inertia_kg_m2": [0.02, 0.02, 0.03, 0, 0, 0]}).plant
    assert all(check.passed for check in physics_checks.torque_free_rotor(plant))


# as printed ---------------------------------------------------------------------------------------------------------------------


def test_what_is_printed_fails_and_what_is_right_does_not(found):
    assert {failure.variant for failure in found.failures} == {name for name in NACS_MODELS if name.startswith("printed")}
    assert all(failure.fails for failure in found.failures)
    assert found.passed


def test_the_printed_inertia_is_refused_and_leaves_the_plant(found):
    refused, apart = (f for f in found.failures if f.variant == "printed-inertia")
    assert "refuses" in refused.remark
    assert refused.printed > 3.0
    assert apart.right < 1e-6
    assert apart.printed > 5.0
    assert apart.when < 0.5


@pytest.mark.parametrize("figures", [(0.1, 0.2), (2.0, 3.0), (np.nan, 3.0)], ids=["printed holds", "right fails", "right is lost"])
def test_a_printed_variant_that_does_not_fail_as_it_must_is_seen(figures):
    assert not Failure("x", "y", *figures, 1.0, "deg", np.nan, "").fails


def test_a_printed_variant_that_holds_is_seen(found, monkeypatch):
    monkeypatch.setattr(printed_errors, "printed_gyroscopic_sign", NACS_MODELS["exact"])
    assert not printed_errors.gyroscopic_sign(found.flight, found.flight.states)[0].fails


@pytest.mark.parametrize("name", NACS_MODELS)
def test_every_named_model_takes_leading_axes(scenario, name):
    state = np.random.default_rng(1).normal(0, 1, (3, 2, 11))
    rate = choose_model(NACS, name, scenario.plant).dynamics.derivative(state, np.zeros((3, 2, 4)))
    assert rate.shape == state.shape


# a model of one's own -----------------------------------------------------------------------------------------------------------


def written(folder: Path, text: str) -> Path:
    path = folder / "mine.py"
    path.write_text(text)
    return path


def documented() -> str:
    return re.findall(r"```python\n(.*?)```", DOCUMENT.read_text(encoding="utf-8"), re.DOTALL)[0]


def test_the_documented_model_is_the_twins_own_with_friction(tmp_path, scenario):
    mine = choose_model(NACS, str(written(tmp_path, documented())), scenario.plant)
    state = np.random.default_rng(2).normal(0, 1, (2, 5, 11))
    command = np.random.default_rng(3).normal(0, 1e-3, (2, 5, 4))
    theirs = scenario.plant.process(wheel_drag=True).derivative(state, command)
    np.testing.assert_allclose(mine.dynamics.derivative(state, command), theirs, rtol=1e-6, atol=1e-9)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine.py"]  # no byte code


def test_the_documented_model_comes_closer_to_the_plant(tmp_path, found):
    mine = choose_model(NACS, str(written(tmp_path, documented())), found.flight.scenario.plant)
    states = integrate(mine.dynamics, found.flight.states[0], found.flight.command, 0.1)
    angle = divergence(found.flight.scenario.plant.process(coupled=True), found.flight.states, states)["attitude"]
    assert np.all(angle[100] < found.apart["attitude"][100])


COPY = "import numpy as np\n\ndef derivative(state, command):\n    "
MODELS = [
    ("def derivat(state, command):\n    return state\n", ["mine.py", "no function derivative(state, command)"]),
    ("import numpy as np\n\n)\n", ["mine.py:3: ", "unmatched"]),
    ("import nothing_of_the_kind\n", ["mine.py:1: ModuleNotFoundError", "nothing_of_the_kind"]),
    (COPY + "return stat\n", ["mine.py:4: NameError", "'stat'"]),
    (COPY + "return np.zeros(11)\n", ["mine.py", "shape (11,)", "(2, 3, 11)"]),
    (COPY + "return state @ command\n", ["mine.py:4: ValueError"]),
    (COPY + "return 'nothing'\n", ["mine.py: ValueError"]),
    (COPY + "return np.nan * state\n", ["mine.py", "not finite"]),
    (COPY + "if np.any(command):\n        raise RuntimeError('so\\nfar')\n    return state\n", ["mine.py:5: RuntimeError: so far"]),
    ("raise SystemExit(0)\n", ["mine.py:1: SystemExit"]),
    ("def derivative(state):\n    return state\n", ["mine.py: TypeError", "positional"]),
]


@pytest.mark.parametrize(("text", "wanted"), MODELS, ids=[wanted[-1] for _, wanted in MODELS])
def test_a_wrong_model_is_one_line_and_writes_nothing(nacs, tmp_path, text, wanted):
    written(tmp_path, text)
    one_line(nacs("crosscheck", "--model", "mine.py", *QUICK), wanted)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.py"]


ARGUMENTS = [
    (["nacs/fault-fre"], ["no scenario 'nacs/fault-fre'", "did you mean nacs/fault-free?"]),
    (["--model", "mine.py"], ["--model mine.py", "no such file"]),
    (["--model", "exat"], ["--model exat", "did you mean exact?"]),
    (["--model", "x"], ["--model x", "eq9-10, exact, printed-inertia", ".py"]),
    (["--at", "0"], ["--at 0", "between 0.1 s", "99.9 s"]),
    (["--at", "1000"], ["--at 1000", "99.9 s"]),
    (["--at", "nan"], ["--at nan"]),
    (["--threshold", "angle=1"], ["--threshold angle=1", "attitude, rate, wheel, momentum, energy"]),
    (["--threshold", "attitude=much"], ["--threshold attitude=much", "no number"]),
    (["--threshold", "attitude=0"], ["--threshold attitude=0", "greater than 0"]),
    (["--threshold", "attitude"], ["--threshold attitude", "no number"]),
    (["--trials", "0"], ["run.trials", "greater than or equal to 1"]),
    (["--set", "run.ticks=1"], ["run.ticks", "two ticks"]),
    (["--set", "plant.inertia_kg_m2=printed"], ["plant.inertia_kg_m2", "triangle inequality"]),
    (["--out", "/proc/nowhere"], ["--out /proc/nowhere", "cannot be written"]),
]


@pytest.mark.parametrize(("arguments", "wanted"), ARGUMENTS, ids=[" ".join(a) for a, _ in ARGUMENTS])
def test_a_wrong_argument_is_one_line_and_writes_nothing(nacs, tmp_path, arguments, wanted):
    one_line(nacs("crosscheck", *arguments), wanted)
    assert not list(tmp_path.iterdir())


def one_line(result, wanted: list[str]) -> None:
    assert result.code == 2
    assert result.out == ""
    assert result.err.count("\n") == 1, result.err
    for part in wanted:
        assert part in result.err


def test_a_folder_with_results_is_not_overwritten_silently(nacs, tmp_path):
    (tmp_path / "it").mkdir()
    (tmp_path / "it" / "summary.json").write_text("precious")
    assert nacs("crosscheck", *QUICK, "--out", "it").code == 2
    assert (tmp_path / "it" / "summary.json").read_text() == "precious"


def test_a_plant_without_an_entry_has_the_standard_one(scenario, monkeypatch):
    assert family_of(scenario) is NACS
    monkeypatch.delitem(FAMILIES, "nacs")
    standard = family_of(scenario)
    assert standard is not NACS
    assert list(standard.models) == ["believed", "exact"]


def test_the_register_names_what_it_holds():
    assert FAMILIES["nacs"].models is NACS_MODELS
    assert FAMILIES["nacs"].checks is NACS_CHECKS
    assert FAMILIES["nacs"].failures is NACS_FAILURES
    assert len({effect.name for effect in NACS.effects}) == len(NACS.effects)


# the command --------------------------------------------------------------------------------------------------------------------


@pytest.fixture
def unchecked(monkeypatch):
    """The command without physics checks, which have been made above."""
    bare = replace(NACS, checks=(), failures=())
    monkeypatch.setattr(command_crosscheck, "family_of", lambda _: bare)


def test_the_command_leaves_picture_recording_and_summary(nacs, tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    result = nacs("crosscheck", *QUICK)
    assert result.code == 0, result.err
    assert max(len(line) for line in result.out.splitlines()) <= 100  # tables 80; the command that opens the recording may be longer
    for word in (
        "attitude angle",
        "air torque",
        "sum of the shares",
        "12 of 12 pass",
        "gyroscopic torque",
        "printed-control-sign",
        "fails",
    ):
        assert word in result.out
    folder = tmp_path / "runs" / "crosscheck" / "nacs" / "fault-free"
    assert {path.name for path in folder.iterdir()} == {"crosscheck.png", "crosscheck.rrd", "summary.json"}
    summary = json.loads((folder / "summary.json").read_text())
    assert (summary["scenario"], summary["model"], summary["passed"]) == ("nacs/fault-free", "eq9-10", True)
    rows = {(row["subject"], row["metric"], row["phase"]): row["mean"] for row in summary["rows"]}
    assert rows["all effects", "share", "0.5 s"] == pytest.approx(1, abs=1e-3)
    assert rows["pendulum", "passed", "period of 3.7073 s"] == 1
    assert {"subject", "metric", "phase", "unit", "mean", "std", "min", "max", "n"} == set(summary["rows"][0])


def test_rows_of_the_summary_are_told_apart(found):
    keys = [(m.subject, m.metric, m.phase) for m in metrics(found)]
    assert len(set(keys)) == len(keys)


def test_the_recording_shows_both_bodies(nacs, tmp_path, unchecked):
    assert nacs("crosscheck", *QUICK, "--model", "printed-inertia", "--out", "it").code == 0
    store = RrdReader(tmp_path / "it" / "crosscheck.rrd")
    paths = {str(chunk.entity_path) for chunk in store.stream().to_chunks()}
    for path in ("/world/bus", "/world/estimate/printed-inertia", "/world/magnified/printed-inertia", "/divergence/attitude", "/tables"):
        assert any(found == path or found.startswith(f"{path}/") for found in paths), path
    assert any(path.startswith("/causes/") for path in paths)


def test_a_failed_check_is_exit_code_1_and_is_written(nacs, tmp_path, monkeypatch):
    check = lambda _: [Check("pi", "three", 0.14, 0.1, "1")]  # noqa: E731
    wrong = replace(NACS, effects=NACS.effects[:1], checks=(check,), failures=())
    monkeypatch.setattr(command_crosscheck, "family_of", lambda _: wrong)
    result = nacs("crosscheck", *QUICK, "--out", "it")
    assert result.code == 1
    assert "FAIL" in result.out
    assert "a check fails" in result.err
    assert json.loads((tmp_path / "it" / "summary.json").read_text())["passed"] is False


def test_a_failed_simulation_is_exit_code_3_and_writes_nothing(nacs, tmp_path, monkeypatch, unchecked):
    def fails(*_: object) -> None:
        raise SimulationFailed(1, 2.0, "it broke")

    monkeypatch.setattr(command_crosscheck, "examine", fails)
    result = nacs("crosscheck", *QUICK)
    assert result.code == 3
    assert "trial 1 failed at t = 2.000 s: it broke" in result.err
    assert not list(tmp_path.iterdir())


def test_a_model_that_runs_away_is_named(nacs, tmp_path, unchecked):
    written(tmp_path, "def derivative(state, command):\n    return 1e200 * state**3\n")
    result = nacs("crosscheck", "--model", "mine.py", *QUICK)
    one_line(result, ["mine.py", "not finite"])


def test_variants_are_named_as_the_command_says():
    assert model_variants.NACS_MODELS is NACS.models
    assert next(iter(NACS.models)) == "eq9-10"
