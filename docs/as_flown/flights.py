"""Flights of a design: the paper's four cases at each of its points, with the root mean squares of the filters' residuals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from control.tracking import Target
from docs.as_flown.causes import CAUSES, NAMES, TABLES, settings, values_of
from sim.controllers.tracking import TrackingLaw
from sim.loop.build import assembly_of, build
from sim.loop.closed_loop import System, run
from sim.loop.variants import Variants
from sim.metrics import one_body
from sim.plant.batch import Plant
from sim.scenario.files import load
from sim.scenario.one_body import Scenario

Array = NDArray[np.floating]

FILTERS = ("ekf", "sif", "nis-windowed", "nis-fading")
STATES = ("q1", "q2", "q3", "q4", "omega1", "omega2", "omega3")
SEED = 40410  # of the design and, with the table's number added, of its flights; nothing else is reported of it
STEP_S = 0.02  # physics step: twice the default's in half the time; residuals of eleven of twelve trials are alike to 0.3 %, of one to 2 %


def sobol(exponent: int) -> Array:
    """Scrambled Sobol points (2 ** exponent, causes) in the unit cube."""
    return qmc.Sobol(len(CAUSES), rng=SEED).random_base2(exponent)


def fly(table: int, shares: Array, first: int, trials: int) -> Array:
    """Root mean squares of the residuals at points of the unit cube, (points, trials, filters, states); NaN where a trial broke down.

    All points are flown as one batch.

    Args:
      table: place among TABLES.
      shares: the points, (points, causes).
      first: number of the first trial, so that no two flights share random numbers.
      trials: at each point.
    """
    each = [scenario_at(table, share) for share in shares]
    own = [one for one in each for _ in np.arange(trials)]
    numbers = first + np.arange(len(own))
    variants = Variants([s.plant for s in own], [s.sensors for s in own], [s.faults for s in own], [s.start for s in own])
    recording = run(_with_own_references_and_drives(build(own[0], numbers, variants=variants), own)).sound()
    rows = {(m.subject, m.metric): m.values for m in one_body.evaluate(recording, assembly_of(own[0])) if m.phase == "all"}
    out = np.full((len(own), len(FILTERS), len(STATES)), np.nan)
    flown = np.isin(numbers, recording.trials)
    out[flown] = np.stack([np.stack([rows[f, f"rmse_residual_{s}"] for s in STATES], axis=-1) for f in FILTERS], axis=1)
    return out.reshape(len(shares), trials, len(FILTERS), len(STATES))


def scenario_at(table: int, share: Array) -> Scenario:
    """The case of a table at a point of the unit cube."""
    values = dict(zip(NAMES, values_of(share).tolist(), strict=True))
    scenario = load(f"nacs/as-flown/{TABLES[table]}", settings(table, values) | {"run.seed": SEED + 1 + table, "plant.step_s": STEP_S})
    assert isinstance(scenario, Scenario)
    return scenario


def _with_own_references_and_drives(system: System, own: list[Scenario]) -> System:
    """A loop whose trials differ also in what a batch has in common otherwise: the reference and the voltage of the drives."""
    assert isinstance(system.law, TrackingLaw)
    assert isinstance(system.plant, Plant)
    time = system.dt * np.arange(system.ticks)
    each = [scenario.reference.at(time) for scenario in own]
    target = Target(*(np.stack(part, axis=1) for part in zip(*each, strict=True)))
    system.plant.set_supply_voltage(np.array([scenario.plant.model_dump()["supply_voltage_v"] for scenario in own]))
    return replace(system, law=replace(system.law, target=target))


def keep(path: Path, shares: Array, residuals: Array) -> None:
    """Write points (points, causes) and what was flown there, (tables, points, trials, filters, states)."""
    np.savez_compressed(path, shares=shares, residuals=residuals.astype(np.float32))
