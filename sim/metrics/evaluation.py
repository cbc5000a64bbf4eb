"""Figures of merit of a closed loop of any kind of scenario."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from sim.loop.closed_loop import System
from sim.loop.recording import Recording
from sim.metrics import antenna_study, consensus, formation, one_body
from sim.metrics.one_body import Metric
from sim.scenario.consensus import ConsensusScenario
from sim.scenario.files import AnyScenario
from sim.scenario.formation import FormationScenario
from sim.scenario.one_body import Scenario


def evaluate(scenario: AnyScenario, loop: str, system: System, recording: Recording) -> list[Metric]:
    """All metrics of a loop; each trial's value is the same whatever the batch.

    Args:
      scenario: with all its loops.
      loop: name of the loop.
      system: that was run.
      recording: that it left.
    """
    return EVALUATIONS[scenario.family](scenario, loop, system, recording)


def _body(scenario: Scenario, loop: str, system: System, recording: Recording) -> list[Metric]:
    single, assembly = scenario.singles()[loop], system.plant.assembly
    return one_body.evaluate(recording, assembly, loop, single) + antenna_study.judge(assembly, recording, loop, single.law)


def _formation(scenario: FormationScenario, loop: str, system: System, recording: Recording) -> list[Metric]:  # noqa: ARG001
    return formation.evaluate(loop, recording, scenario)


def _consensus(scenario: ConsensusScenario, loop: str, system: System, recording: Recording) -> list[Metric]:  # noqa: ARG001
    return consensus.evaluate(loop, recording)


EVALUATIONS: dict[str, Callable[[Any, str, System, Recording], list[Metric]]] = {
    "body": _body,
    "formation": _formation,
    "consensus": _consensus,
}
