"""Linear models of a scenario's plant, and the stability margins of its laws."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from nacs.arguments import real
from nacs.errors import in_one_line
from nacs.scenarios import Source, named
from sim.linear import linearize as of_plant
from sim.linear.linear_model import LinearModel
from sim.linear.of_loops import Case, cases
from sim.user_code.user_code import UserCode


def linearize(
    scenario: Source = "nacs/fault-free",
    *,
    loop: str | None = None,
    at: float | None = None,
    sampled: bool = False,
    way: Literal["differences", "mujoco"] = "differences",
    set: Mapping[str, Any] | None = None,  # as the command calls it
) -> LinearModel:
    """The plant of a scenario as a linear model, as `nacs linearize` gives it.

    >>> model = nacs.linearize("nacs/fault-free")
    >>> model.A.shape, model.input.names[:2]
    ((16, 16), ('motor1', 'motor2'))
    >>> model.state_space().B.shape
    (16, 7)

    Args:
      scenario: as for `nacs.run`; of one body.
      loop: which of several closed loops flies to `at`; default: the first.
      at: about where the first trial is after so many seconds; default: at rest in the reference's first attitude.
      sampled: at the control period, with exact delays; default: continuous, with Padé's approximation of them.
      way: central differences of the twin's own step, or MuJoCo's derivatives.
      set: dotted keys to values, taken instead of what the scenario says.

    Raises:
      NacsError: bad input, or the flight to `at` failed.
    """
    _, settings = named(scenario, set, None, None, UserCode())
    at = None if at is None else real("at", at)
    with in_one_line():
        return of_plant.linearize(settings, loop, at, sampled, way)


def margins(
    scenario: Source = "nacs/fault-free",
    *,
    loop: str | None = None,
    at: float | None = None,
    flown: bool = False,
    set: Mapping[str, Any] | None = None,  # as the command calls it
) -> list[Case]:
    """Gain, phase, delay and disk margins of a scenario's loops, in each mode that the law is told of.

    >>> [case] = nacs.margins("nacs/fault-free")
    >>> [round(one.gain_up, 1) for one in case.margins]
    [5.8, 4.6, 8.4, 4.5]

    Args:
      scenario: as for `nacs.run`; of one body.
      loop: one of several; default: all.
      at: as for `linearize`.
      flown: of the loops as they are flown, with their filters; default: told the state.
      set: dotted keys to values, taken instead of what the scenario says.

    Raises:
      NacsError: bad input, or every law switches.
    """
    _, settings = named(scenario, set, None, None, UserCode())
    at = None if at is None else real("at", at)
    with in_one_line():
        return cases(settings, loop, at, flown)
