"""The register of the cross-check: for each kind of plant its analytic models, effects, physics checks and printed errors."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from models.nacs import NacsParameters
from models.wheeled_body import WheeledBody
from sim.attribution import Effect
from sim.model_variants import NACS_MODELS, Model
from sim.open_loop import Change
from sim.physics_checks import NACS_CHECKS, CheckFunction
from sim.printed_errors import NACS_FAILURES, FailureFunction
from sim.scenario import BadInput, Scenario
from sim.user_model import load_user_model


@dataclass(frozen=True)
class PlantFamily:
    """What the cross-check must know of a kind of plant; a later kind is one more entry of `FAMILIES`.

    Attributes:
      models: by name, from the plant's parameters; the first is the default.
      exact: equations of the plant without any of its effects.
      effects: what the plant has beyond these, each with what switches it off.
      checks: of the plant against textbook physics.
      failures: of what is printed and cannot be right.
    """

    models: Mapping[str, Callable[[NacsParameters], Model]]
    exact: Callable[[NacsParameters], WheeledBody]
    effects: tuple[Effect, ...]
    checks: tuple[CheckFunction, ...]
    failures: tuple[FailureFunction, ...]


def _off(name: str, **parameters: float) -> Effect:
    return Effect(name, Change(tuple(parameters.items())))


NACS = PlantFamily(
    models=NACS_MODELS,
    exact=lambda parameters: parameters.process(coupled=True),
    effects=(
        _off("centre of mass under gravity", gravity_m_s2=0.0),
        _off("air torque", air_torque_nm=0.0),
        _off("wheel dry friction", wheel_coulomb_nm=0.0),
        _off("wheel viscous friction", wheel_viscous_nms=0.0),
        _off("drive torque noise", drive_torque_noise_nm=0.0),
        _off("set-point quantisation", command_bits=0),
        _off("drive limits", drive_current_a=1e4, supply_voltage_v=1e6),
        _off("bearing drag", bearing_viscous_nms=0.0),
        _off("wheel imbalance", wheel_imbalance_um=0.0),
        Effect("balance masses give way", Change(clamped=True)),
        Effect("the scenario's faults", Change(no_faults=True)),
    ),
    checks=NACS_CHECKS,
    failures=NACS_FAILURES,
)

FAMILIES: dict[str, PlantFamily] = {"nacs": NACS}


def family_of(scenario: Scenario) -> PlantFamily:
    """The register's entry for a scenario's plant."""
    if scenario.plant.type not in FAMILIES:
        raise BadInput(f"plant.type: there is no cross-check of {scenario.plant.type!r}; there is of {', '.join(FAMILIES)}")
    if scenario.control is None:
        raise BadInput("loops: the cross-check needs a scenario with one [control]")
    return FAMILIES[scenario.plant.type]


def choose_model(family: PlantFamily, name: str | None, parameters: NacsParameters) -> Model:
    """A model by its name, the default, or the user's from a file ending in .py; raises BadInput."""
    if name is None:
        name = next(iter(family.models))
    if name.endswith(".py"):
        return load_user_model(Path(name), parameters.wheel_axes.shape[1])
    if name not in family.models:
        near = difflib.get_close_matches(name, family.models, n=1)
        hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(family.models)}, or a file ending in .py"
        raise BadInput(f"--model {name}: no such model; {hint}")
    return family.models[name](parameters)
