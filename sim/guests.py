"""A researcher's own filters and controllers: Python files named on the command line, flown beside the built-in ones."""

from __future__ import annotations

from dataclasses import dataclass

from control.tracking import Controller
from sim.observers import Bank, Models
from sim.sensors import SensorSettings


@dataclass(frozen=True)
class Guests:
    """What the user named, as FILE.py:CLASS; loaded anew in every process.

    Attributes:
      observers: filters that join the scenario's.
      controller: a control law in place of the scenario's.
    """

    observers: tuple[str, ...] = ()
    controller: str | None = None

    def banks(self, models: Models, sensors: SensorSettings) -> tuple[Bank, ...]:
        """The user's filters, one bank each."""
        return ()

    def control(self) -> Controller | None:
        """The user's control law, if there is one."""
        return None
