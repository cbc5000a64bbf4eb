"""What a user's class is told of a scenario's loops, by kind of scenario."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimation.state_space import Euclidean, Multiplicative
from models.plants.register.entries import kind_of
from sim.estimators.believed import Models
from sim.faults.kinds import Fault
from sim.faults.readings import DropOut
from sim.scenario.consensus import ConsensusScenario
from sim.scenario.formation import FormationScenario
from sim.scenario.one_body import Scenario
from sim.user_code.surroundings import Setting, Surroundings

Array = NDArray[np.floating]

NEVER_READ = 1.0  # variance in R of what is never read, where it has no effect


def surroundings(scenario: Any) -> Surroundings:
    """Those of a scenario's loops, which are all alike to a user's class."""
    return KINDS[scenario.family](scenario)


def _of_a_body(scenario: Scenario) -> Surroundings:
    models, sensors = Models.of(scenario.plant), scenario.sensors
    all_wheels = scenario.plant.wheel_axes.shape[1]
    wheels = all_wheels if models.speeds_are_states else 0
    layout = kind_of(scenario.plant).layout(scenario.plant)
    noise = np.diag(np.repeat(sensors.variances, [3, 3, wheels]))
    setting = Setting(models.plain, models.with_drag, layout, Multiplicative(), noise, wheels)
    missing = sensors.dropout_probability > 0 or max(sensors.periods_s.values()) > 1.5 * scenario.run.tick_s or _drops_out(scenario.faults)
    return Surroundings(
        setting=setting,
        inputs=wheels or (2 * all_wheels or 3),
        wheels=all_wheels,
        measured=lambda reading: reading[..., : layout.size],
        command=(lambda known: known[..., :wheels]) if wheels else (lambda known: known),
        unread=() if sensors.gyro else ("rate",),
        gaps=missing,
    )


def _of_a_formation(scenario: FormationScenario) -> Surroundings:
    kind = kind_of(scenario.plant)
    layout, process = kind.layout(scenario.plant), kind.believed(scenario.plant, False, None)
    noise = np.diag(
        layout.repeated({"attitude": scenario.reading_distribution.variance * scenario.reading_deviation**2, "rate": NEVER_READ})
    )
    setting = Setting(process, process, layout, Euclidean(), noise, 0)

    def measured(reading: Array) -> Array:
        return np.concatenate([reading, np.full(reading.shape, np.nan)], axis=-1)

    return Surroundings(
        setting, 6 if scenario.wheels else 3, 0, measured, lambda known: known, ("rate",), _drops_out(scenario.faults), True
    )


def _of_consensus(scenario: ConsensusScenario) -> Surroundings:
    kind, sensors = kind_of(scenario.plant), scenario.sensors
    layout, process = kind.layout(scenario.plant), kind.believed(scenario.plant, False, None)
    noise = np.diag(layout.repeated({"position": sensors.position_std_m**2, "velocity": sensors.speed_std_m_s**2}))
    noise = sensors.distribution.variance * noise
    setting = Setting(process, process, layout, Euclidean(), noise, 0)
    return Surroundings(setting, 2, 0, lambda reading: reading, lambda known: known.force, gaps=_drops_out(scenario.faults), networked=True)


def _drops_out(faults: tuple[Fault, ...]) -> bool:
    """Whether a sensor falls silent."""
    return any(isinstance(fault, DropOut) for fault in faults)


KINDS: dict[str, Callable[[Any], Surroundings]] = {"body": _of_a_body, "formation": _of_a_formation, "consensus": _of_consensus}
