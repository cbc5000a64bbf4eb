"""The register of plants: what each entry promises, campaigns of every body in batches, and a plant that nobody knew."""

from __future__ import annotations

import ast
import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from models.attitude.quaternion import from_rotation_vector
from models.dynamics.wheel_faults import WheelFault
from models.plants.register.entries import KINDS, kind_of
from sim.campaign.draws import draw
from sim.campaign.file import load as load_campaign
from sim.campaign.shard import Job, fly
from sim.loop.variants import Variants
from sim.plant.batch import Plant
from sim.plant.kinds import check_speeds, check_tilt
from sim.scenario.files import dumped
from sim.scenario.files import load as load_scenario

ROOT = Path(__file__).parents[1]
MADE_UP = ROOT / "tests" / "made_up"
BODIES = {name: kind for name, kind in KINDS.items() if kind.family == "body"}
SCENARIOS = {
    "nacs": "nacs/fault-free",
    "freeflyer": "wmap/pd-imm",
    "flexible": "antenna-mapping/panelsat",
    "monolithic": "monolithic/compare",
}


# limits -----------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["nacs", "freeflyer"])
def test_a_wheel_is_at_most_as_flat_as_a_disc_without_thickness(kind: str) -> None:
    """The moment about the axis of a plane figure is the sum of those across it."""
    make = KINDS[kind].parameters
    across = make().wheel_transverse_inertia_kg_m2
    assert make(wheel_inertia_kg_m2=2.0 * across).wheel_inertia_kg_m2 == 2.0 * across
    with pytest.raises(ValueError, match="twice wheel_transverse_inertia"):
        make(wheel_inertia_kg_m2=2.001 * across)


def test_a_start_may_be_at_a_limit_and_not_beyond_it() -> None:
    plant = KINDS["nacs"].parameters()
    top = plant.no_load_speed
    check_speeds(plant, (0.0, -top, 0.0, 0.0), "start")
    with pytest.raises(ValueError, match="beyond the no-load speed"):
        check_speeds(plant, (0.0, -1.0001 * top, 0.0, 0.0), "start")
    tilted = [from_rotation_vector(np.radians([0.0, angle, 0.0])) for angle in (29.99, 30.01)]
    check_tilt(plant, np.array(tilted[:1]), "start")
    with pytest.raises(ValueError, match=r"tilted by 30\.01 deg, and the stop is at 30 deg"):
        check_tilt(plant, np.array(tilted), "start")


# entries ----------------------------------------------------------------------------------------------------------------------


def test_the_register_is_in_the_order_of_modules_and_each_parameter_knows_its_entry():
    modules = [kind.parameters.__module__ for kind in KINDS.values()]
    assert [name.removesuffix("_parameters") for name in modules] == sorted(name.removesuffix("_parameters") for name in modules)
    assert all(kind_of(kind.parameters()) is kind and kind.type == name for name, kind in KINDS.items())
    assert {"nacs", "freeflyer", "flexible", "monolithic", "formation", "formation-nacs", "agents"} <= KINDS.keys()


@pytest.mark.parametrize("name", KINDS)
def test_an_entry_s_parts_fit_together(name):
    kind = KINDS[name]
    parameters = kind.parameters()
    layout, made = kind.layout(parameters), kind.compile(parameters)
    process = kind.believed(parameters, False, None)
    lead = () if layout.agents is None else (layout.agents,)
    state = np.zeros((2, *lead, layout.size))
    wheels = made.wheel_axes.shape[1]
    inputs = {"body": 2 * wheels or 3, "formation": 3, "consensus": 2}[kind.family]
    if "wheels" in layout.places:
        inputs = wheels
    assert process.derivative(state, np.zeros((2, *lead, inputs))).shape == state.shape
    assert all(made.model.actuator(actuator) for actuator in kind.holds(parameters))
    assert all(made.model.joint(joint) for joint in kind.joints(parameters))
    assert set(kind.dispersible) <= set(kind.parameters.model_fields)
    assert all(values.keys() <= kind.parameters.model_fields.keys() for values in kind.effects.values())
    assert kind.prepare(parameters).spec.joints
    assert kind.says


@pytest.mark.parametrize("name", [name for name, kind in BODIES.items() if kind.parameters().wheel_axes.shape[1]])
def test_a_fault_of_the_wheels_can_be_believed(name):
    kind = BODIES[name]
    parameters = kind.parameters()
    wheels = parameters.wheel_axes.shape[1]
    healthy, same = kind.believed(parameters, False, None), kind.believed(parameters, False, WheelFault.healthy(wheels))
    size = kind.layout(parameters).size
    state, command = np.full(size, 0.1), np.full(wheels if size > 7 else 2 * wheels, 0.01)
    np.testing.assert_allclose(same.derivative(state, command), healthy.derivative(state, command), rtol=1e-12)


def test_no_other_floor_asks_which_plant_it_has():
    names = {kind.parameters.__name__ for kind in KINDS.values()}
    asked = []
    for path in sorted((ROOT / "sim").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            tests = isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "isinstance"
            of = node.args[1:] if tests else [node.cls] if isinstance(node, ast.MatchClass) else []
            if {part.id for one in of for part in ast.walk(one) if isinstance(part, ast.Name)} & names:
                asked.append(f"{path.relative_to(ROOT)}:{node.lineno}")
    assert not asked


# dispersions ------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "key"), [(name, key) for name, kind in BODIES.items() for key in kind.dispersible])
def test_a_dispersed_parameter_is_that_of_a_plant_compiled_with_it(name, key):
    kind, scenario = BODIES[name], load_scenario(SCENARIOS[name])
    usual = scenario.plant
    value = np.array(usual.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]] if key == "inertia_kg_m2" else getattr(usual, key))
    other = 1.02 * value if value.any() else np.full_like(value, 1e-3)
    changed = kind.parameters.model_validate(usual.model_dump() | {key: other.tolist()})
    variants = Variants.alike(scenario, 2)._replace(plants=[usual, changed])
    dispersed, compiled = Plant(kind.compile(usual), 2), [Plant(kind.compile(one), 1) for one in (usual, changed)]
    dispersion = variants.dispersion(usual)
    assert dispersion is not None
    dispersed.disperse(dispersion)
    wheels = len(dispersed.assembly.wheel_joints)
    for plant, own in ((dispersed, [usual, changed]), (compiled[0], [usual]), (compiled[1], [changed])):
        plant.start(np.array([0.02, -0.03, 0.05, 0.998]) / np.linalg.norm([0.02, -0.03, 0.05, 0.998]), [0.1, -0.2, 0.3], 40.0)
        held = [kind.holds(one) for one in own]
        for actuator in held[0]:
            plant.hold(actuator, np.array([one[actuator] for one in held]))
        plant.advance(np.full((plant.trials, wheels), 1e-3), np.full((plant.trials, 3), 1e-4), 50)
    for trial, plant in enumerate(compiled):
        np.testing.assert_allclose(dispersed.truth().state[trial], plant.truth().state[0], rtol=1e-9, atol=1e-11)


LOOPS = """
title = "short"
scenario = "wmap/compare"
seed = 11
trials = 4
shard = 2
metrics = ["tracking_error_deg", "rmse_truth_*"]

[override]
"run.ticks" = 30
faults = []

[dispersion]
"plant.inertia_kg_m2.1" = { uniform = [360.0, 380.0] }
"plant.wheel_coulomb_nm" = { log_uniform = [1e-4, 1e-3] }
"""


def campaign_of(path: Path, text: str):
    path.write_text(text)
    return load_campaign(path)


def test_several_loops_meet_the_same_draws_in_one_batch(tmp_path, nacs):
    campaign = campaign_of(tmp_path / "c.toml", LOOPS)
    base = campaign.at(0)
    drawn = draw(campaign, base, np.arange(4))
    assert [plant.inertia[1, 1] for plant in drawn.variants.plants] == drawn.values[:, 0].tolist()
    jobs = [Job(campaign.model_dump_json(), json.dumps(dumped(base)), 0, *block) for block in ((0, 4), (0, 1), (1, 3), (3, 4))]
    whole, *parts = (fly(job).metrics.to_pylist() for job in jobs)
    assert [row for part in parts for row in part] == whole
    assert {row["subject"].split("/")[0] for row in whole} >= {"pd-ukf", "smc-imm"}
    alone = nacs("run", "c.toml", "--only-trial", 2, "--out", "one")
    assert alone.code == 0, alone.err
    key = ("subject", "metric", "phase", "value")
    once = {tuple(row[k] for k in key) for row in pq.read_table(tmp_path / "one" / "trials.parquet").to_pylist()}
    mine = {tuple(row[k] for k in key) for row in whole if row["trial"] == 2 and row["subject"] != "draw" and row["metric"] != "failed"}
    assert len(mine) > 10
    assert mine <= once


def test_a_key_of_an_observer_differs_beside_the_plant_and_filters_still_believe_the_scenario_s(tmp_path):
    text = LOOPS.replace("wmap/compare", "nacs/fault-free").replace("[360.0, 380.0]", "[0.016, 0.018]")
    more = '"observers.ekf.initial_rate_rad_s" = { uniform = [0.5, 2.0] }\n'
    campaign = campaign_of(tmp_path / "c.toml", text + more)
    base = campaign.at(0)
    assert draw(campaign, base, np.arange(4)).variants is not None
    jobs = [Job(campaign.model_dump_json(), json.dumps(dumped(base)), 0, *block) for block in ((0, 3), (0, 1), (1, 3))]
    whole, *parts = (fly(job).metrics.to_pylist() for job in jobs)
    assert [row for part in parts for row in part] == whole
    drawn = [row["value"] for row in whole if row["metric"] == "observers.ekf.initial_rate_rad_s"]
    assert len(set(drawn)) == 3


# a plant that nobody knew -------------------------------------------------------------------------------------------------------

SCRIPT = """
import sys
import models.plants

models.plants.__path__.append({folder!r})  # as if its files lay there, in worker processes too
if __name__ == "__main__":
    from sim.cli import main

    codes = []
    for line in {lines!r}:
        sys.argv = ["nacs", *line.split()]
        try:
            main.main()
        except SystemExit as stop:
            codes.append(int(stop.code or 0))
        else:
            codes.append(0)
    print("codes", codes)
"""
CAMPAIGN = """
title = "A dumbbell that is not quite as drawn"
scenario = "dumbbell.toml"
seed = 3
trials = 5
shard = 2

[override]
"run.ticks" = 20

[dispersion]
"plant.inertia_kg_m2.1" = { uniform = [0.48, 0.52] }
"plant.wheel_coulomb_nm" = { log_uniform = [1e-5, 1e-3] }
"sensors.gyro_noise_rad_s" = { log_uniform = [1e-4, 3e-3] }
"""
COMMANDS = (
    "run dumbbell.toml --out run --export-log",
    "replay run/log.parquet --out again",
    "crosscheck dumbbell.toml --out check --trials 2",
    "campaign c.toml --out one --workers 1",
    "campaign c.toml --out two --workers 2 --shard 5",
    "run c.toml --only-trial 3 --out trial",
    "run dumbbell.toml --out never --set plant.type=dumbell",
)


def test_a_plant_of_four_files_has_all_that_the_testbed_has(tmp_path):
    shutil.copy(MADE_UP / "dumbbell.toml", tmp_path)
    (tmp_path / "c.toml").write_text(CAMPAIGN)
    (tmp_path / "nacs.py").write_text(SCRIPT.format(folder=str(MADE_UP), lines=list(COMMANDS)))
    command = [sys.executable, "-W", "error", "nacs.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert "codes [0, 0, 0, 0, 0, 0, 2]" in done.stdout, done.stdout + done.stderr
    assert "no type is called 'dumbell'; did you mean dumbbell?" in done.stderr
    found = {(row["subject"], row["metric"]): row["mean"] for row in json.loads((tmp_path / "run" / "summary.json").read_text())["rows"]}
    assert all(found[name, "nees_mean"] < 10.0 for name in ("ekf", "mekf", "ukf"))
    assert ("pf", "nees_mean") in found
    rows = json.loads((tmp_path / "check" / "summary.json").read_text())["rows"]
    passed = [row["mean"] for row in rows if row["metric"] == "passed"]
    assert len(passed) == 9
    assert all(passed)
    one, two = (pq.read_table(tmp_path / name / "trials.parquet") for name in ("one", "two"))
    assert one.equals(two)
    key = ("subject", "metric", "phase", "value")
    alone = {tuple(row[k] for k in key) for row in pq.read_table(tmp_path / "trial" / "trials.parquet").to_pylist()}
    mine = [row for row in one.to_pylist() if row["trial"] == 3 and row["subject"] != "draw" and row["metric"] != "failed"]
    assert {tuple(row[k] for k in key) for row in mine} <= alone
    assert len(mine) > 10
