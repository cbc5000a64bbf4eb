"""One closed loop of a formation as pictures and recordings show it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.faults.timeline import Occurrence
from sim.loop.recording import Recording
from sim.randomness import Trials
from sim.scenario.formation import FormationScenario

Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class FormationFlight:
    """What was recorded of a loop, and what its scenario says of places and links.

    Attributes:
      loop: its name.
      recording: figures of all trials, and some trials as a whole.
      scenario: with all its loops.
    """

    loop: str
    recording: Recording
    scenario: FormationScenario

    @property
    def dt(self) -> float:
        """Of a tick, s."""
        return self.recording.dt

    @property
    def time(self) -> Array:
        """Of every tick, (ticks,) s."""
        return self.recording.time

    @property
    def trials(self) -> Trials:
        """Numbers of all trials, (trials,)."""
        return self.recording.flown

    @property
    def recorded(self) -> Trials:
        """Numbers of the recorded ones."""
        return self.recording.trials

    @property
    def places(self) -> Array:
        """Of the agents, (agents, 3) m."""
        return self.scenario.plant.places

    @property
    def ways(self) -> NDArray[np.int64]:
        """Receiver and sender (0: the leader) of each message, (messages, 2)."""
        return self.scenario.communication().ways

    @property
    def weights(self) -> Array:
        """Of each message, (messages,)."""
        graph = self.scenario.communication()
        return graph.listening[graph.ways[:, 0], graph.ways[:, 1]]

    @property
    def leader(self) -> Array:
        """[sigma, rate, second derivative], (ticks, 9)."""
        return self.recording.channels["reference/leader"]

    @property
    def occurrences(self) -> tuple[Occurrence, ...]:
        """Events of the first recorded trial."""
        return tuple(event for event in self.recording.occurrences if event.trial == 0)

    @property
    def figures(self) -> dict[str, Array]:
        """By name, (ticks, trials)."""
        return self.recording.figures

    @property
    def channels(self) -> dict[str, Array]:
        """Of the recorded trials by name, (ticks, recorded, ...)."""
        return self.recording.channels


def flights(recordings: dict[str, Recording], scenario: FormationScenario) -> list[FormationFlight]:
    """All loops."""
    return [FormationFlight(name, recording, scenario) for name, recording in recordings.items()]
