"""What the cross-check must know of a kind of plant: its analytic models, effects, physics checks and printed errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic

from models.dynamics.wheeled_body import WheeledBody
from models.plants.register.kind import PlantKind
from sim.crosscheck.attribution import Effect
from sim.crosscheck.bench import Check
from sim.crosscheck.failure import FailureFunction
from sim.crosscheck.model_variants import Model
from sim.crosscheck.open_loop import PLAIN, Change, Dynamics, P, Rig

INSTANTS = (1.0, 3.0, 10.0, 30.0)  # s


@dataclass(frozen=True)
class PlantFamily(Generic[P]):
    """A kind of plant of one body, P being its parameters; one without an entry in `sim.crosscheck.register` has the default.

    Attributes:
      models: by name, from the plant's parameters; the first is the default.
      exact: equations of the plant without any of its effects.
      whole: its mass properties as a body with wheels, of which there may be none.
      effects: what the plant has beyond the exact equations, each with what switches it off.
      checks: of the plant against textbook physics.
      failures: of what is printed and cannot be right.
      rig: what it needs so that it can be flown without feedback.
      instants: at which attribution is reported unless others are given, s.
    """

    models: Mapping[str, Callable[[P], Model]]
    exact: Callable[[P], Dynamics]
    whole: Callable[[P], WheeledBody]
    effects: tuple[Effect, ...]
    checks: tuple[Callable[[P], list[Check]], ...]
    failures: tuple[FailureFunction, ...] = ()
    rig: Rig = PLAIN
    instants: tuple[float, ...] = INSTANTS


def effects_of(kind: PlantKind[Any]) -> tuple[Effect, ...]:
    """What values of its parameters switch off, as its entry in the register of plants says."""
    return tuple(Effect(name, Change(tuple(values.items()))) for name, values in kind.effects.items())


FAULTS = Effect("the scenario's faults", Change(no_faults=True))
