"""What an entry of the register of outputs says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from sim.faults.parts import FAMILIES
from sim.loop.recording import Recording


class Flown(NamedTuple):
    """A run that an output can tell of.

    Attributes:
      name: of the scenario, as it was asked for.
      scenario: its settings.
      recordings: of the recorded trials, by loop; there is at least one.
      law: name of the user's own control law; None: the scenario's.
      configuration: what a file says of how it was made.
    """

    name: str
    scenario: Any
    recordings: dict[str, Recording]
    law: str | None
    configuration: dict[str, Any]


def _nothing(scenario: Any) -> str:  # noqa: ARG001
    return ""


def not_of(family: str) -> Callable[[Any], str]:
    """What a scenario of any other family lacks."""
    own = FAMILIES[family]
    return lambda scenario: "" if scenario.family == family else f"is of {own}, and this scenario is of {FAMILIES[scenario.family]}"


@dataclass(frozen=True)
class Output:
    """A kind of file that a run can leave in its folder.

    Attributes:
      key: name of the kind, as `--also` takes it.
      file: name of the file.
      write: puts it there; imports that take long belong inside.
      unasked: whether every run writes it.
      missing: what a scenario lacks for it, in words that follow the option; nothing if it can be written.
      hint: a further line to say where it is said to be: what to do with it, and the command, of the file's path.
    """

    key: str
    file: str
    write: Callable[[Path, Flown], None]
    unasked: bool = False
    missing: Callable[[Any], str] = _nothing
    hint: Callable[[Path], tuple[str, str]] | None = None
