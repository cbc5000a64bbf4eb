"""Tables of a run at the terminal, by kind of scenario."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rich.table import Table

from sim.metrics.claims import CLAIMS
from sim.metrics.results import Row
from sim.scenario.one_body import Scenario
from sim.tables import antenna, consensus, formation, one_body, windows


def tables_of(rows: list[Row], scenario: Any, trials: int, guests: tuple[str, ...], law: str | None) -> list[Table | str]:
    """What is shown of a run.

    Args:
      rows: statistics of its metrics.
      scenario: that was flown.
      trials: how many were finished.
      guests: names of the user's own filters.
      law: name of the user's own control law.
    """
    return TABLES[scenario.family](rows, scenario, trials, guests, law)


def _body(rows: list[Row], scenario: Scenario, trials: int, guests: tuple[str, ...], law: str | None) -> list[Table | str]:
    shown: list[Table | str] = []
    if scenario.loops:
        shown += _several(rows)(rows, scenario, trials)
        if scenario.claims:
            shown.append(one_body.claims(CLAIMS[scenario.claims](rows)))
        return shown
    if scenario.published:
        filters = [scenario.observers[name] for name in scenario.published.values if name in scenario.observers]
        caption = one_body.made_with([one.tuning for one in filters], scenario.sensors)
        shown.append(one_body.residuals(rows, scenario.published, caption))
    shown.append(one_body.estimators(rows, [*scenario.observers, *guests], scenario.published, trials))
    if any(row.metric == "rms_pointing_deg" for row in rows):
        shown += antenna.antenna(rows, scenario, trials)
    return [*shown, f"{one_body.loop(rows)}{f', controller {law}' if law else ''}"]


def _several(rows: list[Row]) -> Callable[[list[Row], Scenario, int], list[Table]]:
    """Tables of several loops, by what was measured of them."""
    measured = {row.metric for row in rows}
    if "rms_pointing_deg" in measured:
        return antenna.antenna
    return windows.windows if "rms_rate_error" in measured else one_body.loops


TABLES: dict[str, Callable[[list[Row], Any, int, tuple[str, ...], str | None], list[Any]]] = {
    "body": _body,
    "formation": lambda rows, scenario, trials, guests, law: formation.formation(rows, scenario, trials),  # noqa: ARG005
    "consensus": lambda rows, scenario, trials, guests, law: consensus.consensus(rows, scenario, trials),  # noqa: ARG005
}
