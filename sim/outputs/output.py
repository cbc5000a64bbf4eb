"""What an entry of the register of outputs says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

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


@dataclass(frozen=True)
class Output:
    """A kind of file that a run can leave in its folder.

    Attributes:
      key: name of the kind, as `--also` takes it.
      file: name of the file.
      write: puts it there; imports that take long belong inside.
      unasked: whether every run writes it.
      families: of scenarios that have something to show there; None: all.
      hint: a further line to say where it is said to be: what to do with it, and the command, of the file's path.
    """

    key: str
    file: str
    write: Callable[[Path, Flown], None]
    unasked: bool = False
    families: tuple[str, ...] | None = None
    hint: Callable[[Path], tuple[str, str]] | None = None
