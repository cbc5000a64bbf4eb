"""FMUs of the plant: valid, the twin to the bit, set back to a state, with parameters that can be changed."""

from __future__ import annotations

import json
import runpy
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import nacs
from sim.bad_input import BadInput
from sim.cli.command import app
from sim.fmu import fmu_file
from sim.fmu.co_simulated_plant import CoSimulatedPlant
from sim.loop.open_loop import OpenLoop
from sim.scenario import files

fmpy = pytest.importorskip("fmpy")
from fmpy.fmi2 import FMU2Slave  # noqa: E402
from fmpy.fmi3 import FMU3Slave  # noqa: E402
from fmpy.validation import validate_fmu  # noqa: E402

TICKS = 60
FAULTS = [
    {"kind": "friction", "wheel": 2, "torque_nm": 2e-3, "start_s": 1.0, "duration_s": 3.0},
    {"kind": "inertia", "add_kg_m2": [0.01, 0.01, 0.01], "start_s": 2.0, "duration_s": 2.0},
    {"kind": "external-torque", "torque_nm": 0.01, "direction": "planar", "start_s": 1.5, "duration_s": 1.0},
]
CHANGES = {
    "run.ticks": TICKS,
    "run.trials": 1,
    "phases": {},
    "faults": FAULTS,
    "sensors.latency_s": 0.25,
    "sensors.dropout_probability": 0.1,
}


def law(reading: np.ndarray) -> np.ndarray:
    return np.nan_to_num(-0.05 * reading[:3] - 0.2 * reading[4:7])


class Flown:
    """An FMU in FMPy, of either version of the standard."""

    def __init__(self, path: Path, version: str, folder: Path) -> None:
        assert validate_fmu(str(path)) == []
        about = fmpy.read_model_description(str(path))
        self.references = {one.name: one.valueReference for one in about.modelVariables}
        told = {"guid": about.guid if version == "2" else about.instantiationToken, "modelIdentifier": about.coSimulation.modelIdentifier}
        kind = FMU2Slave if version == "2" else FMU3Slave
        self.unit = kind(unzipDirectory=fmpy.extract(str(path), str(folder)), instanceName="plant", **told)
        self.read, self.write, self.save, self.back, self.pack, self.unpack = (
            getattr(self.unit, name)
            for name in (
                ("getReal", "setReal", "getFMUstate", "setFMUstate", "serializeFMUstate", "deSerializeFMUstate")
                if version == "2"
                else ("getFloat64", "setFloat64", "getFMUState", "setFMUState", "serializeFMUState", "deserializeFMUState")
            )
        )
        self.unit.instantiate()
        if version == "2":
            self.unit.setupExperiment(startTime=0.0)
        self.unit.enterInitializationMode()

    def get(self, beginning: str) -> np.ndarray:
        return np.array(self.read([vr for name, vr in self.references.items() if name.startswith(beginning)]))

    def fly(self, start: int, stop: int) -> None:
        """The closed loop from one tick to another."""
        for tick in range(start, stop):
            self.write([self.references[f"torque_B[{i}]"] for i in (1, 2, 3)], law(self.get("reading.")).tolist())
            self.unit.doStep(currentCommunicationPoint=0.1 * tick, communicationStepSize=0.1)


@pytest.mark.parametrize("version", fmu_file.STANDARDS)
def test_flown_by_another_simulator_it_is_the_twin_to_the_bit_and_comes_back(version: str, tmp_path: Path) -> None:
    path = tmp_path / "plant.fmu"
    asked = [
        text for key in ("run.ticks", "sensors.latency_s", "sensors.dropout_probability") for text in ("--set", f"{key}={CHANGES[key]}")
    ]
    ran = CliRunner().invoke(app, ["export-fmu", "nacs/fault-free", "--out", str(path), "--fmi", version, *asked])
    assert ran.exit_code == 0, ran.output
    flown = Flown(path, version, tmp_path / "unpacked")
    flown.unit.exitInitializationMode()
    twin = nacs.Twin("nacs/fault-free", trials=1, set=CHANGES | {"faults": []})
    for tick in range(20):
        np.testing.assert_array_equal(flown.get("reading."), twin.read()[0])
        np.testing.assert_array_equal(flown.get("truth."), twin.truth[0])
        flown.fly(tick, tick + 1)
        twin.step(law(twin.read()[0]))
    kept = flown.save()
    flown.fly(20, 30)
    first = np.concatenate([flown.get("reading."), flown.get("truth.")])
    flown.back(kept)
    flown.fly(20, 30)
    np.testing.assert_array_equal(np.concatenate([flown.get("reading."), flown.get("truth.")]), first)
    flown.back(flown.unpack(flown.pack(kept)))
    flown.fly(20, 30)
    np.testing.assert_array_equal(np.concatenate([flown.get("reading."), flown.get("truth.")]), first)
    with pytest.raises(Exception, match=r"DoStep failed with status [34] \((error|fatal)\)"):
        flown.unit.doStep(currentCommunicationPoint=3.0, communicationStepSize=0.05)


def test_without_filters_and_law_it_is_the_twin_to_the_bit_with_every_kind_of_fault_and_set_back_too() -> None:
    scenario = nacs.load("nacs/fault-free", set=CHANGES, trials=2)
    twin, loop = nacs.Twin(scenario), OpenLoop(scenario, np.arange(2))
    torques, flown, kept = 0.01 * np.random.default_rng(1).normal(size=(TICKS, 2, 3)), [], {}
    for tick, torque in enumerate(torques):
        np.testing.assert_array_equal(loop.reading, twin.read())
        np.testing.assert_array_equal(loop.truth.state, twin.truth)
        kept[tick] = loop.instant
        twin.step(torque)
        loop.act(torque)
        flown.append(loop.truth.state)
    with pytest.raises(IndexError, match="60 ticks is over"):
        loop.act()
    for tick in (5, 45, 15):  # backward over both faults of the plant, forward, between them
        loop.instant = kept[tick]
        for torque, state in zip(torques[tick : tick + 10], flown[tick:], strict=False):
            loop.act(torque)
            np.testing.assert_array_equal(loop.truth.state, state)


def plant(**changes: object) -> CoSimulatedPlant:
    return CoSimulatedPlant(
        files.dumped(nacs.load("nacs/fault-free", set={"run.ticks": 30, "sensors.set": "ideal", "phases": {}, **changes}))
    )


def test_a_parameter_that_is_set_is_the_scenario_s() -> None:
    set_later, said = plant(), plant(**{"plant.centre_of_mass_um": [40.0, -0.4, 1.0]})
    variables = {one.name: one for one in set_later.variables}
    assert variables["plant.centre_of_mass_um[1]"].role == "tunable"
    assert variables["run.seed"].role == "fixed"
    variables["plant.centre_of_mass_um[1]"].set(40.0)
    for one in (set_later, said):
        one.step(0.3)
    np.testing.assert_array_equal(set_later.loop.truth.state, said.loop.truth.state)
    variables["plant.centre_of_mass_um[1]"].set(0.5)  # in flight: the state stays, the torque of gravity goes
    for one in (set_later, said):
        one.step(0.1)
    change = (said.loop.truth.omega_BN_B - set_later.loop.truth.omega_BN_B)[0]
    assert abs(change[1]) == pytest.approx(3.2 * 9.80665 * 39.5e-6 * 0.1 / 0.0172994, rel=0.02)  # m g x dt / J_yy


def test_a_state_brings_its_parameters_along() -> None:
    """Also to an FMU whose readings were not late: what they look back on comes with the state."""
    late, other = plant(), plant()
    names = {one.name: one for one in late.variables}
    names["sensors.latency_s"].set(0.25)
    names["torque_B[1]"].set(0.01)
    for one in (late, other):
        one.step(0.5)
    with pytest.raises(BadInput, match=r"sensors.latency_s: is fixed, set it before the first step"):
        names["sensors.latency_s"].set(0.0)
    other.return_to(json.loads(json.dumps(late.state())))
    for one in (late, other):
        one.step(0.3)
    np.testing.assert_array_equal(other.loop.reading, late.loop.reading)
    assert other.time == late.time == pytest.approx(0.8)
    assert late.loop.reading[0, 4] < 0.8 * late.loop.truth.omega_BN_B[0, 0]


def test_wheel_torques_and_a_body_torque_are_the_same_thing() -> None:
    one, other = plant(), plant()
    axes = nacs.load("nacs/fault-free").plant.wheel_axes
    torque = np.array([2e-3, -1e-3, 3e-3])
    values = {f"torque_B[{i + 1}]": part for i, part in enumerate(torque)}
    for variable in one.variables:
        if variable.name in values:
            variable.set(values[variable.name])
    wheel = {f"torque_wheel[{i + 1}]": part for i, part in enumerate(-np.linalg.pinv(axes) @ torque)}
    for variable in other.variables:
        if variable.name in wheel:
            variable.set(wheel[variable.name])
    for each in (one, other):
        each.step(0.5)
    np.testing.assert_allclose(one.loop.truth.state, other.loop.truth.state, rtol=0, atol=1e-12)
    assert np.linalg.norm(one.loop.truth.omega_BN_B) > 0.01


@pytest.mark.parametrize(
    ("size", "said"),
    [(0.05, "whole number of ticks of 0.1 s"), (3.1, "30 ticks of 0.1 s is over"), (0.0, "whole number"), (-0.1, "whole number")],
)
def test_steps_that_cannot_be_taken(size: float, said: str) -> None:
    with pytest.raises(BadInput, match=said):
        plant().step(size)


def test_a_torque_that_is_no_number() -> None:
    one = plant()
    one.variables[0].set(float("nan"))
    with pytest.raises(BadInput, match="torque is not finite"):
        one.step(0.1)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["formation/fault-free"], "several agents"),
        (["nacs/fault-free", "--fmi", "1"], "--fmi 1: there is no such version; there are 3, 2"),
        (["nacs/fault-free", "--out", "."], "is a folder"),
        (["nacs/fault-free", "--out", __file__], "is there already"),
    ],
)
def test_what_cannot_be_written(arguments: list[str], said: str) -> None:
    wrong = CliRunner().invoke(app, ["export-fmu", *arguments]).exception
    assert isinstance(wrong, BadInput)
    assert said in str(wrong)


def test_from_python_it_is_one_line_too(tmp_path: Path) -> None:
    (tmp_path / "plant.fmu").write_bytes(b"")
    for file, said in (("plant.fmu", "is there already"), (".", "is there already")):
        with pytest.raises(nacs.NacsError, match=said):
            nacs.export_fmu("nacs/fault-free", tmp_path / file)
    assert (tmp_path / "plant.fmu").read_bytes() == b""


def test_a_package_that_is_not_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fmu_file, "find_spec", lambda _: None)
    with pytest.raises(BadInput, match=r"needs pythonfmu3: pip install 'nacs-twin\[fmi\]'"):
        fmu_file.check(nacs.load("nacs/fault-free"), "3")


def test_the_example_closes_the_loop_in_another_simulator() -> None:
    """The reading's error is small after five seconds: the law holds the testbed on its reference."""
    example = Path(__file__).parents[1] / "docs" / "examples" / "closed_loop_with_an_fmu.py"
    error = runpy.run_path(str(example))["error"]
    assert np.max(np.abs(error)) < 0.005
