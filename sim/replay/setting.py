"""The scenario that a log's filters are built from, and which of them are run."""

from __future__ import annotations

from typing import Any

from pydantic import TypeAdapter, ValidationError

from sim.bad_input import BadInput
from sim.estimators.settings import ObserverSettings
from sim.estimators.tunings import TUNINGS
from sim.scenario import files
from sim.scenario.one_body import Scenario

DEFAULT = "nacs/fault-free"  # whose plant, sensors and filters a laboratory's log is taken to come from


def setting(about: dict[str, Any], label: str, tuning: str | None, overrides: dict[str, Any]) -> Any:
    """The scenario that a log's filters are built from: the log's own, or the NACS's defaults.

    Args:
      about: what the log says of itself.
      label: of the log, for complaints.
      tuning: of all filters, in place of their own.
      overrides: dotted key to value.
    """
    if tuning is not None and tuning not in TUNINGS:
        raise BadInput(f"--tuning {tuning}: no such set; there are {', '.join(TUNINGS)}")
    nacs = files.dumped(files.load(DEFAULT))
    try:
        data: dict[str, Any] = dict(about.get("settings", nacs)) | {"faults": []}  # nothing of this happens again
        one_body = "reference" in data
        if one_body:
            _of_one_body(data, nacs["observers"], tuning)
    except (KeyError, TypeError, ValueError, AttributeError):
        raise BadInput(f"{label}: its metadata are not what the twin writes") from None
    if tuning is not None and not one_body:
        raise BadInput(f"--tuning {tuning}: the filters of {label} have no tuning sets; change their keys by --set")
    if "sensors.set" in overrides:
        data["sensors"] = {}
    return files.check(data, label, overrides)


def _of_one_body(data: dict[str, Any], more: dict[str, Any], tuning: str | None) -> None:
    """With the testbed's filters beside its own, and one tuning if that is asked for."""
    observers, common = more | data["observers"], data["tuning"]
    if "control" in data:
        data["control"] = data["control"] | {"feedback": "truth"}
    # a tuning that was the scenario's is its own no longer, so that `--set tuning=...` means all of them, as in `nacs run`
    data["observers"] = {n: {k: v for k, v in o.items() if k != "tuning" or (v != common and not tuning)} for n, o in observers.items()}
    data["tuning"] = tuning or common


def choose(scenario: Any, about: dict[str, Any], loop: str, wanted: list[str], beside: bool = False) -> tuple[Any, tuple[str, ...]]:
    """The scenario with the filters that are run over a loop's log, and their names; raises BadInput for what there is not.

    Args:
      scenario: of the log.
      about: what the log says of itself.
      loop: whose log it is.
      wanted: filters by name, or by type where all its settings have defaults; empty: those of the loop.
      beside: whether there are filters of the user's own; none of the loop is then run that is not asked for.
    """
    if loop not in scenario.loop_names:
        raise BadInput(f"loop {loop!r}: the log's scenario has {', '.join(scenario.loop_names)}")
    return CHOICES[scenario.family](scenario, about, loop, wanted, beside)


def why_not(scenario: Any, loop: str) -> str | None:
    """Why the log of a loop cannot be replayed; None: it can."""
    settings = scenario.loops.get(loop)
    tick_s = getattr(settings, "tick_s", scenario.run.tick_s)
    if tick_s < scenario.run.tick_s:
        return f"loop {loop} learns every {tick_s:g} s, its log has a row every {scenario.run.tick_s:g} s"
    return None


def _of_a_body(scenario: Scenario, about: dict[str, Any], loop: str, wanted: list[str], beside: bool) -> tuple[Scenario, tuple[str, ...]]:
    own = about.get("settings", {}).get("observers", scenario.observers)
    single = scenario.singles()[loop]
    names = wanted or ([] if beside else [name for name in single.observers if name in own])
    chosen: dict[str, ObserverSettings] = {}
    for name in names:
        try:
            plain = {"type": name, "tuning": scenario.tuning}
            chosen[name] = scenario.observers.get(name) or TypeAdapter[ObserverSettings](ObserverSettings).validate_python(plain)
        except ValidationError:
            raise BadInput(f"--filter {name}: no such filter; there are {', '.join(scenario.observers)}") from None
    return single.model_copy(update={"observers": chosen}), tuple(chosen)


def _of_agents(scenario: Any, about: dict[str, Any], loop: str, wanted: list[str], beside: bool) -> tuple[Any, tuple[str, ...]]:
    """Of a formation; a loop that is closed by the truth is watched by all filters if none is named."""
    watching = [name for name in (scenario.loops[loop].feedback, *scenario.loops[loop].watching) if name in scenario.observers]
    names = wanted or ([] if beside else watching)
    for name in names:
        if name not in scenario.observers:
            raise BadInput(f"--filter {name}: no such filter; there are {', '.join(scenario.observers)}")
    watched = scenario.loops[loop].model_copy(update={"feedback": "truth", "watching": tuple(dict.fromkeys(names))})
    return scenario.model_copy(update={"loops": scenario.loops | {loop: watched}}), tuple(names)


def _of_learners(scenario: Any, about: dict[str, Any], loop: str, wanted: list[str], beside: bool) -> tuple[Any, tuple[str, ...]]:
    """A loop of agents that learn has one learner, called as the loop."""
    if wanted and wanted != [loop]:
        raise BadInput(f"--filter {wanted[0]}: the log of loop {loop} has one learner, {loop}")
    return scenario, (loop,)


CHOICES = {"body": _of_a_body, "formation": _of_agents, "consensus": _of_learners}
