"""The register of the cross-check: entries of plants of which more is known than of any, and the choice of what is to be checked."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from models.plants.register.entries import kind_of
from models.plants.register.parameters import BodyParameters
from sim.bad_input import BadInput
from sim.crosscheck.family import PlantFamily
from sim.crosscheck.kinds.flexible import FLEXIBLE
from sim.crosscheck.kinds.freeflyer import FREEFLYER
from sim.crosscheck.kinds.monolithic import MONOLITHIC
from sim.crosscheck.kinds.nacs import NACS
from sim.crosscheck.kinds.standard import standard_family
from sim.crosscheck.model_variants import Model
from sim.crosscheck.user_model import load_user_model
from sim.scenario.one_body import Scenario

FAMILIES: dict[str, PlantFamily[Any]] = {"nacs": NACS, "freeflyer": FREEFLYER, "monolithic": MONOLITHIC, "flexible": FLEXIBLE}


def family_of(scenario: Scenario) -> PlantFamily[Any]:
    """The register's entry for a scenario's plant, or the standard one of a plant without."""
    return FAMILIES.get(scenario.plant.type) or standard_family(kind_of(scenario.plant))


def choose_loop(scenario: Scenario, name: str | None) -> Scenario:
    """The scenario with one loop alone: the first, or that of the given name; raises BadInput."""
    loops = scenario.singles()
    if name is None:
        return next(iter(loops.values()))
    if scenario.control is not None:
        raise BadInput(f"--loop {name}: the scenario has a single loop, without a name; leave the option out")
    if name not in loops:
        raise BadInput(f"--loop {name}: no such loop; {_hint(name, loops)}")
    return loops[name]


def choose_model(family: PlantFamily[Any], name: str | None, parameters: BodyParameters) -> Model:
    """A model by its name, the default, or the user's from a file ending in .py; raises BadInput."""
    if name is None:
        name = next(iter(family.models))
    if name.endswith(".py"):
        return load_user_model(Path(name), parameters.wheel_axes.shape[1])
    if name not in family.models:
        raise BadInput(f"--model {name}: no such model; {_hint(name, family.models, ', or a file ending in .py')}")
    return family.models[name](parameters)


def _hint(name: str, known: Iterable[str], also: str = "") -> str:
    near = difflib.get_close_matches(name, list(known), n=1)
    return f"did you mean {near[0]}?" if near else f"there are {', '.join(known)}{also}"
