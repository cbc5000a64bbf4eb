"""Parts of a closed loop that is not flown but read from a log: the plant is silent, and nobody acts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from models.plants.assembly import Assembly
from sim.parts import ActuatorOutput, Array, Decision, Flags
from sim.replay.flight_log import FlightLog
from sim.replay.log_columns import LogColumns


class LoggedTruth(NamedTuple):
    """What is so at one instant, NaN where nobody knows it."""

    state: Array  # (trials, [agents,] n)


class LoggedPlant:
    """Goes through the truth of a log tick by tick."""

    def __init__(self, log: FlightLog, assembly: Assembly) -> None:
        self.assembly, self.trials, self.step_s = assembly, len(log.trials), log.dt
        self._log, self._tick = log, 0

    def truth(self) -> LoggedTruth:
        """That of the tick."""
        return LoggedTruth(self._log.truth[self._tick])

    def put_back(self, where: Flags) -> None:
        """There is nothing to be put back: the log goes on."""

    def advance(self, wheel_torque: Array, push: Any, steps: int) -> None:
        """To the next tick, whatever acts."""
        self._tick += 1


@dataclass(frozen=True, eq=False)
class LoggedSensors:
    """Read what the log says was read."""

    log: FlightLog

    def rest(self) -> Array:
        """Zero until something has been read, (trials, n)."""
        return np.zeros(self.log.reading.shape[1:])

    def read(self, tick: int, truth: LoggedTruth, past: Array) -> Array:
        """Reading of a tick, (trials, n)."""
        return self.log.reading[tick]


@dataclass(frozen=True)
class SilentLaw:
    """Decides nothing."""

    trials: int

    def start(self, estimate: Any) -> None:
        """Nothing is remembered."""

    def says(self, tick: int, estimate: Any, memory: None) -> None:
        """Nothing is said."""

    def decide(self, tick: int, estimate: Any, messages: Any, memory: None) -> Decision:
        """A torque that nobody knows."""
        return Decision(np.full((self.trials, 3), np.nan), None, {})


@dataclass(frozen=True, eq=False)
class LoggedCommands:
    """Give what the log says was known of the drives."""

    log: FlightLog
    columns: LogColumns

    def rest(self) -> ActuatorOutput:
        """Nothing yet."""
        return self._given(0, self.log.reading[0])

    def give(self, tick: int, decision: Decision, estimate: Any, held: Array, before: ActuatorOutput, lost: Flags) -> ActuatorOutput:
        """What was known at a tick, with the reading that was held."""
        return self._given(tick, held)

    def _given(self, tick: int, held: Array) -> ActuatorOutput:
        return ActuatorOutput(np.zeros((len(held), 0)), None, self.columns.told(self.log.known[tick], held), None, {})


def nobody(tick: int, beliefs: tuple[Any, ...], truth: LoggedTruth, reading: Array, held: Array) -> None:
    """There is no law to be told anything."""


def nothing_changes(tick: int) -> None:
    """There is no plant to be changed."""
