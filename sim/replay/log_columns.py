"""Which columns a log has, by kind of scenario: readings, what is known of the drives, and the truth."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.dynamics.state_layout import StateLayout
from sim.estimators.consensus import AppliedControl
from sim.loop.recording import Recording

Array = NDArray[np.floating]


class LogColumns(NamedTuple):
    """Names of one agent's columns; of several agents each is preceded by `agent1_`, `agent2_`, ...

    Attributes:
      layout: of the state, whose components are the truth's columns.
      reading: of the reading.
      known: of what the filters know of the drives.
      told: the array of what is known (trials, [agents,] k) as the filters of a loop are told it, with the reading that is held.
      recorded: what is known, of a recording, (ticks, trials, [agents,] k).
      plant: which kind of plant it is of.
      unit_quaternion: whether the first four components of a reading are one.
    """

    layout: StateLayout
    reading: tuple[str, ...]
    known: tuple[str, ...]
    told: Callable[[Array, Array], Any]
    recorded: Callable[[Recording], Array]
    plant: str
    unit_quaternion: bool = False

    def all(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """Columns of all agents, agent by agent."""
        return names if self.layout.agents is None else tuple(f"agent{i}_{name}" for i in self._agents for name in names)

    @property
    def _agents(self) -> range:
        return range(1, 1 + (self.layout.agents or 0))

    @property
    def truth(self) -> tuple[str, ...]:
        """Columns of the truth."""
        return tuple(f"truth_{name}" for name in self.all(self.layout.names))


def columns_of(scenario: Any) -> LogColumns:
    """Those of a scenario's logs."""
    return KINDS[scenario.family](scenario)


def _of_a_body(scenario: Any) -> LogColumns:
    wheels = scenario.plant.wheel_axes.shape[1]
    layout = StateLayout.of_a_body(wheels)
    known = tuple(f"command{i + 1}" for i, _ in enumerate(range(wheels))) or ("torque1", "torque2", "torque3")
    return LogColumns(
        layout=layout,
        reading=layout.names,
        known=known,
        told=lambda command, held: np.concatenate([command, held[..., layout.size - wheels :]], axis=-1),
        recorded=lambda recording: recording.channels["command"],
        plant=scenario.plant.type,
        unit_quaternion=True,
    )


def _of_a_formation(scenario: Any) -> LogColumns:
    layout = StateLayout.by_rodrigues(scenario.plant.agents)
    known = ("torque1", "torque2", "torque3", *(("momentum1", "momentum2", "momentum3") if scenario.wheels else ()))
    plant = scenario.plant.type
    return LogColumns(layout, layout.blocks[0].names, known, lambda known, _: known, lambda recording: recording.channels["known"], plant)


def _of_consensus(scenario: Any) -> LogColumns:
    layout = StateLayout.in_the_plane(len(scenario.plant.start))
    known = ("force1", "force2", "surface1", "surface2")
    return LogColumns(
        layout,
        layout.names,
        known,
        lambda known, _: AppliedControl(known[..., :2], known[..., 2:]),
        lambda recording: recording.channels["known"],
        scenario.plant.type,
    )


KINDS: dict[str, Callable[[Any], LogColumns]] = {"body": _of_a_body, "formation": _of_a_formation, "consensus": _of_consensus}
