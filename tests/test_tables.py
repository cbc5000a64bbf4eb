"""Tables at the terminal: headings and bands fit what is flown."""

from __future__ import annotations

import numpy as np
import pytest
from rich.table import Table
from scipy.stats import chi2

from sim.metric import Metric
from sim.metrics.results import rows
from sim.scenario.files import load
from sim.tables.one_body import estimators, made_with

TRIALS = 4


def table(wheels: dict[str, bool], missing: float = 0.0, dof: float | None = None) -> Table:
    """Of some filters, which estimate wheel speeds or do not."""
    found = [Metric("loop", "incomplete_readings", "all", "1", np.full(TRIALS, missing))]
    for name, estimated in wheels.items():
        found += [Metric(name, part, "all", "1", np.full(TRIALS, 7.0)) for part in ("nees_mean", "nis_mean")]
        found += [Metric(name, "nis_dof_mean", "all", "1", np.full(TRIALS, dof))] if dof else []
        found += [Metric(name, "rmse_truth_wheel", "all", "rad/s", np.ones(TRIALS))] if estimated else []
    return estimators(rows(found), list(wheels), None, TRIALS)


def headings(shown: Table) -> list[str]:
    return [str(column.header).replace("\n", " ") for column in shown.columns]


def band(dof: int) -> str:
    return "{:.2f} .. {:.2f}".format(*chi2.ppf([0.025, 0.975], dof * TRIALS) / TRIALS)


@pytest.mark.parametrize(("wheels", "dof"), [(True, 10), (False, 6)])
def test_filters_alike_are_headed_by_their_degrees_of_freedom(wheels: bool, dof: int) -> None:
    shown = table({"ekf": wheels, "ukf": wheels})
    assert {f"NEES {dof} dof", f"NIS {dof} dof"} <= set(headings(shown))
    assert shown.caption == f"means over {TRIALS} trials; consistent NEES and NIS at a tick: {band(dof)} (95 %)"


def test_filters_that_differ_have_their_own() -> None:
    shown = table({"ekf": True, "learning": False})
    assert headings(shown)[:2] == ["filter", "dof"]
    assert {"NEES", "NIS"} <= set(headings(shown))
    assert list(shown.columns[1].cells) == ["10", "6"]
    assert f"at a tick: {band(10)} with 10 dof, {band(6)} with 6 dof (95 %)" in str(shown.caption)


def test_nis_has_fewer_where_readings_are_missing() -> None:
    shown = table({"ekf": True}, missing=3.0)
    assert {"NEES 10 dof", "NIS <= 10 dof"} <= set(headings(shown))
    assert f"consistent NEES, and NIS of complete readings, at a tick: {band(10)}" in str(shown.caption)


def test_without_observers_nothing_is_said_of_consistency() -> None:
    assert table({}).caption == f"means over {TRIALS} trials"


def test_nis_of_incomplete_readings_stands_beside_its_degrees_of_freedom() -> None:
    shown = table({"ekf": True}, missing=3.0, dof=6.25)
    place = headings(shown).index("NIS (dof)")
    assert list(shown.columns[place].cells) == ["7 (6.25)"]
    assert "NIS 10 dof" in headings(table({"ekf": True}, dof=10.0))


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({}, "twin: tuning consistent, sensors bench; the paper's Q and R: --set tuning=paper"),
        ({"tuning": "paper", "sensors.set": "paper"}, "twin: tuning paper, sensors paper"),
        (
            {"sensors.gyro_noise_rad_s": 0.1},
            "twin: tuning consistent, sensors of the scenario's own; the paper's Q and R: --set tuning=paper",
        ),
    ],
)
def test_a_papers_table_says_how_the_twins_figures_beside_it_were_made(settings: dict[str, object], said: str) -> None:
    scenario = load("nacs/fault-free", settings)
    assert made_with([one.tuning for one in scenario.observers.values()], scenario.sensors) == said
