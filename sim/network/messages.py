"""What agents have heard of each other: messages that may be lost, come late, or find their link cut."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from control.communication_graph import CommunicationGraph
from sim.formation_randomness import Blocks

Array = NDArray[np.floating]
Flags = NDArray[np.bool_]


class Heard(NamedTuple):
    """What every agent has at a tick."""

    messages: Array  # (trials, agents or 1, 1 + agents, n)
    listening: Array  # weights, (trials or 1, agents, 1 + agents)
    received: Flags  # (trials or 1, ways) whether a message came


class LinkFaults(NamedTuple):
    """What befalls messages, tick by tick."""

    loss: Array  # (ticks,) probability
    delay: NDArray[np.int64]  # (ticks,) in ticks
    cut: Flags  # (ticks, messages) of the graph's ways

    @classmethod
    def none(cls, ticks: int, graph: CommunicationGraph) -> LinkFaults:
        """Nothing does."""
        return cls(np.zeros(ticks), np.zeros(ticks, dtype=np.int64), np.zeros((ticks, len(graph.ways)), dtype=bool))


class Network:
    """Carries the messages of a run, tick after tick, in all trials."""

    def __init__(self, graph: CommunicationGraph, faults: LinkFaults, losses: Blocks, skip: bool) -> None:
        self._graph, self._faults, self._losses, self._skip = graph, faults, losses, skip
        self._ideal = not (faults.loss.any() or faults.delay.any() or faults.cut.any())
        self._under_way: list[Array] = []
        self._held: Array | None = None

    def carry(self, tick: int, sent: Array | None) -> Heard:
        """Deliver what leader and agents say, (trials, 1 + agents, n). The first messages are never lost."""
        assert sent is not None, "agents of a network have something to say"
        graph, faults = self._graph, self._faults
        everything = np.ones((1, len(graph.ways)), dtype=bool)
        if self._ideal:
            return Heard(sent[:, None], graph.listening[None], everything)
        self._under_way = [*self._under_way, sent][-(int(faults.delay.max()) + 1) :]
        arriving = self._under_way[max(0, len(self._under_way) - 1 - int(faults.delay[tick]))]
        lost = self._losses.tick() < faults.loss[tick] if faults.loss.any() else ~everything
        received = ~lost & ~faults.cut[tick]
        receiver, sender = graph.ways.T
        if self._held is None:
            self._held = np.repeat(arriving[:, None], graph.agents, axis=1)
        else:
            self._held[:, receiver, sender] = np.where(received[..., None], arriving[:, sender], self._held[:, receiver, sender])
        counted = received if self._skip else np.broadcast_to(~faults.cut[tick], received.shape)
        listening = np.zeros((len(received), *graph.listening.shape))
        listening[:, receiver, sender] = np.where(counted, graph.listening[receiver, sender], 0.0)
        return Heard(self._held, listening, received)
