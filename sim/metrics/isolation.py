"""Whether the agent whose sensor fails is named by its neighbours, how soon, and how often somebody is named for nothing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimation.neighbours_residuals import named
from sim.faults.events import OfSensor
from sim.loop.recording import Recording
from sim.metric import Metric
from sim.scenario.formation import FormationScenario

Array = NDArray[np.floating]


def isolation(loop: str, recording: Recording, scenario: FormationScenario) -> list[Metric]:
    """Of the first fault that is of one agent's sensor; false alarms are those before any fault."""
    settings = scenario.isolation
    if settings is None:
        return []
    ticks, dt = recording.ticks, recording.dt
    statistic = np.stack([values for name, values in recording.figures.items() if name.startswith("isolation/")], axis=-1)
    whom = named(statistic, max(1, round(settings.window_s / dt)), settings.tail)
    begins = min((fault.earliest_start for fault in scenario.faults), default=ticks * dt)
    before = slice(0, min(ticks, round(begins / dt)))
    raised = np.diff((whom[before] >= 0).astype(int), axis=0, prepend=0) > 0
    out = [
        Metric(loop, "isolation_false_alarms", "all", "1", np.sum(raised, axis=0).astype(float)),
        Metric(loop, "isolation_quiet_s", "all", "s", np.full(whom.shape[1], dt * before.stop)),
    ]
    single = [
        (fault.earliest_start, fault.agents[0] - 1)
        for fault in scenario.faults
        if isinstance(fault, OfSensor) and fault.agents != "all" and len(fault.agents) == 1
    ]
    if not single:
        return out
    start, agent = min(single)
    after = whom[round(start / dt) :]
    found = (after >= 0).any(axis=0)
    first = np.argmax(after >= 0, axis=0)
    right = found & (after[first, np.arange(after.shape[1])] == agent)
    declared = np.sum(after >= 0, axis=0)
    return [
        *out,
        Metric(loop, "isolation_right", "all", "1", right.astype(float)),
        Metric(loop, "isolation_missed", "all", "1", (~found).astype(float)),
        Metric(loop, "isolation_delay_s", "all", "s", np.where(found, dt * first, np.nan)),
        Metric(loop, "isolation_right_fraction", "all", "1", np.sum(after == agent, axis=0) / np.where(declared, declared, np.nan)),
    ]
