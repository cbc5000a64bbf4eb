"""What a plant, its sensors and its network have that can fail."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]

FAMILIES = {"body": "one body", "formation": "a formation", "consensus": "agents in the plane"}


@dataclass(frozen=True, eq=False)
class Parts:
    """What there is to fail, and how it is while nothing does.

    Attributes:
      family: of the scenario.
      sensors: components of a reading by sensor, in the reading's order.
      agents: how many; 0: one body, whose arrays have no axis of agents.
      wheels: of each.
      axes: of a torque or force on each.
      messages: receiver, from zero, and sender, the leader being 0, of each, (messages, 2), as a graph's ways.
      noise: deviation of each sensor, or one where a fault can only multiply it, (sensors,).
      gains: of the law, where faults can change them, (gains,).
      disturbance: amplitude N, rate rad/s and number of each agent, (agents, 3), where faults can change them.
    """

    family: str
    sensors: dict[str, int]
    agents: int = 0
    wheels: int = 0
    axes: int = 3
    messages: NDArray[np.int64] = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    noise: Any = 1.0
    gains: Any = ()
    disturbance: Any = (0.0, 0.0, 1.0)

    @property
    def each(self) -> tuple[int, ...]:
        """Axes of what every agent has for itself."""
        return (self.agents,) if self.agents else ()

    def count(self, what: str) -> int:
        """How many there are of something, of each agent where there are several."""
        if what == "components":
            return sum(self.sensors.values())
        counted = getattr(self, what)
        return counted if isinstance(counted, int) else len(counted)

    def components(self, sensor: str) -> NDArray[np.int64]:
        """Which components of a reading a sensor gives, or all of them do."""
        return np.flatnonzero(np.repeat([sensor in ("all", name) for name in self.sensors], list(self.sensors.values())))

    def numbers(self, sensor: str) -> NDArray[np.int64]:
        """Place of a sensor among all, or all places."""
        return np.flatnonzero([sensor in ("all", name) for name in self.sensors])

    def along(self, i: int, j: int) -> NDArray[np.int64]:
        """Which messages go along a link, in both directions."""
        receiver, sender = self.messages[:, 0] + 1, self.messages[:, 1]
        return np.flatnonzero(((receiver == i) & (sender == j)) | ((receiver == j) & (sender == i)))
