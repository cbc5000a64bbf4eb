"""From a scenario of any kind to the parts of one of its closed loops, for a set of trials."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

from estimation.state_space import Euclidean, StateSpace
from models.plants.assembly import Assembly
from models.plants.register.entries import KINDS
from models.plants.register.parameters import Parameters
from sim.loop.body import body_estimators, build_body
from sim.loop.closed_loop import System
from sim.loop.consensus import build_consensus, consensus_estimators
from sim.loop.formation import build_formation, formation_estimators
from sim.loop.recorder import MULTIPLICATIVE
from sim.loop.variants import Variants
from sim.parts import Estimator
from sim.plant.kinds import compile_plant
from sim.randomness import Trials
from sim.scenario.consensus import ConsensusScenario
from sim.scenario.files import AnyScenario
from sim.scenario.formation import FormationScenario
from sim.scenario.one_body import Scenario
from sim.user_code.user_code import UserCode

Builder = Callable[[Any, str, Trials, UserCode, Variants | None], System]


def build(
    scenario: AnyScenario, trials: Trials, user_code: UserCode | None = None, variants: Variants | None = None, loop: str | None = None
) -> System:
    """All parts of a closed loop of a scenario for the given trial numbers; trial i is the same whatever the batch.

    Args:
      scenario: what is simulated, and what filters and controllers believe.
      trials: numbers of the trials, (trials,).
      user_code: the user's own filters and controller.
      variants: plant, sensors, faults and start of each trial where they differ.
      loop: its name; None: the first.
    """
    return BUILDERS[scenario.family](scenario, loop or scenario.loop_names[0], trials, user_code or UserCode(), variants)


def build_estimators(scenario: AnyScenario, trials: Trials, user_code: UserCode, loop: str) -> tuple[Estimator, ...]:
    """The estimators of a closed loop alone, as `build` makes them."""
    return ESTIMATORS[scenario.family](scenario, loop, trials, user_code)


def assembly_of(scenario: AnyScenario) -> Assembly:
    """The compiled plant of a scenario."""
    return _compiled(scenario.plant)


def errors_of(scenario: AnyScenario) -> StateSpace:
    """Coordinates in which estimates are held against the truth."""
    return ERRORS[scenario.family]


def _body(scenario: Scenario, loop: str, trials: Trials, user_code: UserCode, variants: Variants | None) -> System:
    single = scenario.singles()[loop]
    return build_body(single, trials, user_code, variants.of_loop(single) if variants else None)


def _formation(scenario: FormationScenario, loop: str, trials: Trials, user_code: UserCode, variants: Variants | None) -> System:
    return build_formation(scenario, loop, _compiled(scenario.plant), trials, user_code)


def _consensus(scenario: ConsensusScenario, loop: str, trials: Trials, user_code: UserCode, variants: Variants | None) -> System:
    return build_consensus(scenario, loop, trials, user_code)


def _compiled(parameters: Parameters) -> Assembly:
    """All loops of a scenario share one model."""
    return _compiled_from(parameters.type, parameters.model_dump_json())


@lru_cache(maxsize=2)
def _compiled_from(kind: str, said: str) -> Assembly:
    return compile_plant(KINDS[kind].parameters.model_validate_json(said))


def _body_estimators(scenario: Scenario, loop: str, trials: Trials, user_code: UserCode) -> tuple[Estimator, ...]:
    return body_estimators(scenario.singles().get(loop, scenario), trials, user_code)


ESTIMATORS: dict[str, Callable[[Any, str, Trials, UserCode], tuple[Estimator, ...]]] = {
    "body": _body_estimators,
    "formation": formation_estimators,
    "consensus": consensus_estimators,
}
ERRORS: dict[str, StateSpace] = {"body": MULTIPLICATIVE, "formation": Euclidean(), "consensus": Euclidean()}
BUILDERS: dict[str, Builder] = {"body": _body, "formation": _formation, "consensus": _consensus}
