"""The cross-check of an analytic model: divergence from the plant, its causes, the plant's own checks, and what fails as printed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.crosscheck.attribution import Attribution, attribute, present, size_deg
from sim.crosscheck.bench import Check
from sim.crosscheck.divergence import QUANTITIES, Quantity, divergence, passes
from sim.crosscheck.failure import Failure
from sim.crosscheck.family import PlantFamily
from sim.crosscheck.model_variants import Model
from sim.crosscheck.open_loop import Flight, fly
from sim.metric import Metric
from sim.scenario.one_body import Scenario

Array = NDArray[np.floating]

BARE_TOLERANCE_DEG = 1e-6


@dataclass(frozen=True, eq=False)
class CrossCheck:
    """All that was found.

    Attributes:
      flight: in closed loop, whose commands were flown again.
      model: under test.
      states: of the model, (ticks, trials, n).
      apart: divergence of the model from the plant by quantity, (ticks, trials).
      others: attitude divergence of the family's other models, deg, (ticks, trials).
      thresholds: by quantity.
      ticks: at which attribution is reported.
      causes: of the divergence in attitude.
      checks: of the plant.
      failures: of what is printed.
    """

    flight: Flight
    model: Model
    states: Array
    apart: dict[str, Array]
    others: dict[str, Array]
    thresholds: dict[str, float]
    ticks: tuple[int, ...]
    causes: Attribution
    checks: tuple[Check, ...]
    failures: tuple[Failure, ...]

    @property
    def passed(self) -> bool:
        """Whether all checks pass and all printed variants fail."""
        return all(check.passed for check in self.checks) and all(failure.fails for failure in self.failures)

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """Those of which the model has an opinion."""
        return tuple(quantity for quantity in QUANTITIES if quantity.name in self.apart)

    @property
    def tick_s(self) -> float:
        """Control period, s."""
        return self.flight.scenario.run.tick_s

    def instant(self, tick: int) -> str:
        """A tick as a person reads it, such as `10 s`."""
        return f"{tick * self.tick_s:g} s"


def examine(
    scenario: Scenario,
    family: PlantFamily[Any],
    model: Model,
    limits: dict[str, float],
    at_s: tuple[float, ...],
    progress: Callable[[str, int, int], None],
) -> CrossCheck:
    """Do it all for the scenario's trials.

    Args:
      scenario: what is flown.
      family: the register's entry of its plant.
      model: under test.
      limits: threshold of every quantity.
      at_s: instants at which attribution is reported, s.
      progress: called with what is being done, steps done and steps in all.
    """
    plant, tick_s = scenario.plant, scenario.run.tick_s
    ticks = tuple(sorted({round(s / tick_s) for s in at_s}))
    flight = fly(scenario, np.arange(scenario.run.trials), family.rig, partial(progress, "ticks of the closed-loop flight"))
    exact, whole = family.exact(plant), family.whole(plant)
    states = model.predict(flight, len(flight.states))
    effects = present(flight, family.effects)
    replays = 2 * len(effects) + 1
    done = 0

    def replayed() -> None:
        nonlocal done
        done += 1
        progress("replays", done, replays)

    progress("replays", 0, replays)
    causes, bare = attribute(flight, effects, model, exact, ticks[-1] + 1, replayed)
    others = {}
    for name, make in family.models.items():
        other = make(plant)
        if name != model.name:
            others[name] = divergence(whole, flight.states, other.predict(flight, len(flight.states)))["attitude"]
    last = f"{ticks[-1] * tick_s:g} s"
    bare_error = float(causes.bare.max())
    checks = [Check("every effect off", f"angle to exact equations, {last}", bare_error, BARE_TOLERANCE_DEG, "deg")]
    for i, check in enumerate(family.checks):
        progress("physics checks", i, len(family.checks))
        checks += check(plant)
    failures: list[Failure] = []
    for i, failure in enumerate(family.failures):
        progress("as printed", i, len(family.failures))
        failures += failure(flight, bare)
    apart = divergence(whole, flight.states, states)
    if model.reads_wheels:
        apart.pop("wheel", None)
    return CrossCheck(flight, model, states, apart, others, limits, ticks, causes, tuple(checks), tuple(failures))


def metrics(found: CrossCheck) -> list[Metric]:
    """Rows of `summary.json`; the phase is an instant, such as `10 s`, or `all`."""
    rows: list[Metric] = []
    last = len(found.states) - 1
    for quantity in found.quantities:
        values, limit = found.apart[quantity.name], found.thresholds[quantity.name]
        rows.append(Metric(found.model.name, f"{quantity.name}_passes_threshold_s", "all", "s", passes(values, limit, found.tick_s)))
        for tick in (*found.ticks, *((last,) if last not in found.ticks else ())):
            rows.append(Metric(found.model.name, f"divergence_{quantity.name}", found.instant(tick), quantity.unit, values[tick]))
    causes = found.causes
    for tick in found.ticks:
        phase = found.instant(tick)
        for i, (name, share) in enumerate(zip(causes.names, causes.shares(tick), strict=True)):
            rows.append(Metric(name, "share", phase, "1", np.array([share])))
            rows.append(Metric(name, "angle_deg", phase, "deg", np.array([size_deg(causes.contribution[i, tick])])))
        rows.append(Metric("all effects", "share", phase, "1", np.array([causes.shares(tick).sum()])))
        rows.append(Metric("all effects", "share_switched_on_alone", phase, "1", np.array([causes.shares_alone(tick).sum()])))
        rows.append(Metric("all effects", "rest", phase, "1", np.array([causes.rest(tick)])))
        rows.append(Metric("all effects", "angle_deg", phase, "deg", np.array([size_deg(causes.total[tick])])))
        rows.append(Metric("Euler in place of RK4", "angle_deg", phase, "deg", np.array([size_deg(causes.euler[tick])])))
    for check in found.checks:
        for metric, value in (("figure", check.figure), ("tolerance", check.tolerance)):
            rows.append(Metric(check.name, metric, check.measure, check.unit, np.array([value])))
        rows.append(Metric(check.name, "passed", check.measure, "1", np.array([float(check.passed)])))
    for failure in found.failures:
        phase = failure.measure
        for metric, value in (("figure_right", failure.right), ("figure_printed", failure.printed), ("limit", failure.limit)):
            rows.append(Metric(failure.variant, metric, phase, failure.unit, np.array([value])))
        rows.append(Metric(failure.variant, "when", phase, "s", np.array([failure.when])))
        rows.append(Metric(failure.variant, "fails", phase, "1", np.array([float(failure.fails)])))
    return rows
