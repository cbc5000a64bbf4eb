"""No setting is without effect: whichever is changed, something that is built from its section differs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import partial
from types import FunctionType
from typing import Any, get_args

import numpy as np
import pytest
from pydantic import BaseModel, ValidationError

from estimation.resampling import SCHEMES
from models.chebyshev_network import ChebyshevNetwork
from models.dynamics.planar_agent import PlanarAgent
from models.plants.nacs import NacsParameters, compile_nacs
from sim.controllers.settings import OutputFeedbackSettings, PdSettings, SlidingModeSettings, UnfalsifiedSettings
from sim.estimators.believed import Models
from sim.estimators.consensus import learner
from sim.estimators.formation import agents_filter
from sim.estimators.learner_settings import Adaptive, Marginalised, TuningSettings, Unscented
from sim.estimators.observer import Place
from sim.estimators.rodrigues_settings import AukfSettings, PfSettings
from sim.estimators.settings import Aukf, Ekf, Imm, Mekf, NisSwitched, Pf, Sif, Ukf
from sim.scenario.files import load
from sim.sensors.sensors import SensorSettings


def seen(thing: Any, above: tuple[int, ...] = ()) -> Any:
    """What a built thing is made of, all the way down, as something that can be compared."""
    if isinstance(thing, np.ndarray):
        return thing.shape, thing.tolist()
    if isinstance(thing, dict):
        return [(key, seen(value, above)) for key, value in thing.items()]
    if isinstance(thing, list | tuple):
        return [type(thing).__name__, *(seen(part, above) for part in thing)]
    if isinstance(thing, partial):
        return seen((thing.func, thing.args, thing.keywords), above)
    if isinstance(thing, FunctionType | type) or id(thing) in above:
        return getattr(thing, "__qualname__", "again")
    inside = {f.name: getattr(thing, f.name) for f in fields(thing)} if is_dataclass(thing) else getattr(thing, "__dict__", None)
    return repr(thing) if inside is None else [type(thing).__name__, *(seen(part, (*above, id(thing))) for part in inside.items())]


def others(section: Any, name: str) -> list[Any]:
    """Values that a setting might have in place of its own."""
    now = getattr(section, name)
    if isinstance(now, bool):
        return [not now]
    if isinstance(now, int | float):
        return [value for value in (now + 1, 1.1 * now, 0.9 * now, 0.9 * now + 0.05) if value != now]
    if isinstance(now, tuple):
        return [now[:1]]
    if now is None:
        return [0.37, 3]
    if isinstance(now, BaseModel):
        return [{"type": "gated"}, {"type": "student-t"}]
    if name == "resampling":
        return [scheme for scheme in SCHEMES if scheme != now]
    return [choice for choice in get_args(type(section).model_fields[name].annotation) if choice != now]


TICK = 0.1
AGENT = PlanarAgent(ChebyshevNetwork())
NACS, BUILT_NACS = NacsParameters(), compile_nacs()
PLACE = Place(Models.of(NACS), SensorSettings(), 4, TICK)
MODES = ((), ({"kind": "float", "wheel": 2},))


def of_a_law(section: Any) -> Any:
    return section.controller(BUILT_NACS, TICK)


def of_an_observer(section: Any) -> Any:
    return section.build(PLACE)


def of_a_formation(section: Any) -> Any:
    return agents_filter("f", section, load("formation/fault-free").plant, 1, np.arange(1))


def of_agents(section: Any) -> Any:
    plant = load("consensus/fault-free").plant
    return learner("f", section, TuningSettings(), AGENT, plant.agents, 1, np.arange(1))


def of_told(section: Any) -> Any:
    return [
        learner("f", kind, section, AGENT, 2, 1, np.arange(1)) for kind in (Unscented(type="unscented"), Marginalised(type="marginalised"))
    ]


FEEDBACK = {"feedback": "truth"}
OWN = {"tuning": "consistent"}
SECTIONS: list[tuple[Callable[[Any], Any], Any, set[str]]] = [  # builder, section, settings that are meant for others than the builder
    (of_a_law, PdSettings(type="pd", **FEEDBACK), {"feedback"}),
    (of_a_law, SlidingModeSettings(type="sliding-mode", slope_rad_s=0.3, reaching_rad_s2=0.2, **FEEDBACK), {"feedback"}),
    (of_a_law, OutputFeedbackSettings(type="output-feedback", **FEEDBACK), {"feedback"}),
    (of_a_law, UnfalsifiedSettings(type="unfalsified", **FEEDBACK), {"feedback", "integrals"}),
    (of_a_law, UnfalsifiedSettings(type="unfalsified", candidates="pid", **FEEDBACK), {"feedback"}),
    (of_an_observer, Ekf(type="ekf", **OWN), set()),
    (of_an_observer, Mekf(type="mekf", **OWN), set()),
    (of_an_observer, Sif(type="sif", **OWN), set()),
    (of_an_observer, NisSwitched(type="nis-switched", smoothing="windowed", **OWN), {"alpha"}),
    (of_an_observer, NisSwitched(type="nis-switched", smoothing="fading", **OWN), {"window"}),
    (of_an_observer, Ukf(type="ukf", **OWN), set()),
    (of_an_observer, Aukf(type="aukf", **OWN), {"directions"}),
    (of_an_observer, Aukf(type="aukf", measured="directions", **OWN), set()),
    (of_an_observer, Pf(type="pf", **OWN), {"directions"}),
    (of_an_observer, Pf(type="pf", measured="directions", proposal="bootstrap", **OWN), set()),
    (of_an_observer, Imm(type="imm", filter={"type": "mekf"}, modes=MODES, **OWN), {"transition", "initial"}),
    (of_a_formation, AukfSettings(type="aukf"), {"value"}),
    (of_a_formation, AukfSettings(type="aukf", fading="constant"), {"forgetting", "cap"}),
    (of_a_formation, PfSettings(type="pf"), set()),
    (of_agents, Adaptive(type="adaptive-law"), {"feedback", "tick_s"}),
    (of_agents, Unscented(type="unscented"), {"feedback"}),
    (of_agents, Marginalised(type="marginalised"), {"feedback"}),
    (of_told, TuningSettings(), set()),
]
NAMES = [
    pytest.param(build, section, name, id=f"{type(section).__name__}{number}.{name}")
    for number, (build, section, elsewhere) in enumerate(SECTIONS)
    for name in type(section).model_fields
    if name not in {"type", "filter", "modes", "allocation", "tuning", *elsewhere}
]


@pytest.mark.parametrize(("build", "section", "name"), NAMES)
def test_a_setting_that_is_changed_changes_what_is_built(build: Callable[[Any], Any], section: Any, name: str) -> None:
    for value in others(section, name):
        try:
            changed = type(section).model_validate(section.model_dump() | {name: value})
        except ValidationError:
            continue
        assert seen(build(changed)) != seen(build(section))
        return
    pytest.fail(f"no other value of {name} is allowed; tell this test one")
