"""Which scenarios there are, and their checked settings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any

from nacs.arguments import several, table, text, whole_if_given
from nacs.errors import in_one_line
from nacs.nacs_error import NacsError
from sim.scenario import catalogue, files
from sim.scenario.files import AnyScenario
from sim.user_code.user_code import UserCode

Source = str | Path | Mapping[str, Any] | AnyScenario


def scenarios(beginning: str = "") -> dict[str, str]:
    """Names of the scenarios that come with the twin, and their titles.

    >>> sorted(nacs.scenarios("nacs/wheel"))
    ['nacs/wheel-failure']

    Args:
      beginning: of the names, such as a family.
    """
    beginning = text("beginning", beginning)
    return {
        name: catalogue.title(catalogue.SCENARIOS / f"{name}.toml") for name in catalogue.scenario_names() if name.startswith(beginning)
    }


def load(
    scenario: Source = "nacs/fault-free",
    *,
    set: Mapping[str, Any] | None = None,  # as the command calls it
    trials: int | None = None,
    seed: int | None = None,
    observers: Sequence[Any] = (),
) -> AnyScenario:
    """The checked settings of a scenario of any family.

    >>> nacs.load("nacs/fault-free", set={"run.ticks": 100}).run.ticks
    100

    Args:
      scenario: name, path of a TOML file, the content of one as a dictionary, or settings that were loaded before.
      set: dotted keys to values, taken instead of what the scenario says; `tuning` and `sensors.set` take a shipped set's name.
      trials: number of trials.
      seed: root seed.
      observers: filters of your own that will join, and may close the loop.

    Raises:
      NacsError: one line with file and key.
    """
    return named(scenario, set, trials, seed, user_code_of(observers, None))[1]


def named(
    scenario: Source, changes: Mapping[str, Any] | None, trials: int | None, seed: int | None, user_code: UserCode
) -> tuple[str, AnyScenario]:
    """What the scenario is called, and its checked settings; the arguments are those of `load`."""
    given = (("run.trials", whole_if_given("trials", trials, 1)), ("run.seed", whole_if_given("seed", seed)))
    asked = {key: value for key, value in given if value is not None}
    changed = table("set", changes)
    if not isinstance(scenario, str | Path | Mapping) and not hasattr(scenario, "loop_names"):
        raise NacsError(f"scenario={scenario!r:.60}: must be a name, a path, a dictionary, or loaded settings")
    with in_one_line():
        overrides = {
            **{key: value for key, value in changed.items() if key not in asked},
            **asked,
        }  # those asked for have the last word
        if isinstance(scenario, str | Path):
            return str(scenario), files.load(str(scenario), deepcopy(overrides), user_code.names)
        label, data = ("dictionary", scenario) if isinstance(scenario, Mapping) else (scenario.title, files.dumped(scenario))
        return label, files.check(deepcopy(dict(data)), label, deepcopy(overrides), user_code.names)


def user_code_of(observers: Sequence[Any], controller: Any) -> UserCode:
    """Filters and a law of the user's; raises NacsError if `observers` is no sequence."""
    return UserCode(several("observers", observers, "classes, objects or FILE.py:CLASS"), controller)
