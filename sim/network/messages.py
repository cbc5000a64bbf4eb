"""What agents have heard of each other: messages that may be lost, come late, or find their link cut."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from control.communication_graph import CommunicationGraph
from sim.faults.effects import CUT, LOSS, MESSAGE_AGE
from sim.faults.timeline import Timeline
from sim.randomness import RandomStream

Array = NDArray[np.floating]
Flags = NDArray[np.bool_]


class Messages(NamedTuple):
    """What every agent has at a tick."""

    messages: Array  # (trials, agents or 1, 1 + agents, n)
    listening: Array  # weights, (trials or 1, agents, 1 + agents)
    received: Flags  # (trials or 1, ways) whether a message came


class Network:
    """Carries the messages of a run, tick after tick, in all trials."""

    def __init__(self, graph: CommunicationGraph, faults: Timeline, losses: RandomStream, skip: bool) -> None:
        self._graph, self._faults, self._losses, self._skip = graph, faults, losses, skip
        late = faults.tracks.get(MESSAGE_AGE)
        self._longest = 0 if late is None else int(np.round(late.values.max() / faults.dt))
        self._ideal = not any(effect in faults.tracks for effect in (LOSS, MESSAGE_AGE, CUT))
        self._under_way: list[Array] = []
        self._held: Array | None = None

    def carry(self, tick: int, sent: Array | None) -> Messages:
        """Deliver what leader and agents say, (trials, 1 + agents, n). The first messages are never lost."""
        assert sent is not None, "agents of a network have something to say"
        graph = self._graph
        everything = np.ones((1, len(graph.ways)), dtype=bool)
        if self._ideal:
            return Messages(sent[:, None], graph.listening[None], everything)
        arriving = self._arriving(tick, sent)
        probability, cut = self._faults.at(LOSS, tick), self._faults.at(CUT, tick)
        lost = ~everything if probability is None else self._losses.tick() < probability
        whole = everything if cut is None else ~cut
        received = ~lost & whole
        receiver, sender = graph.ways.T
        if self._held is None:
            self._held = np.repeat(arriving[:, None], graph.agents, axis=1)
        else:
            self._held[:, receiver, sender] = np.where(received[..., None], arriving[:, sender], self._held[:, receiver, sender])
        counted = received if self._skip else np.broadcast_to(whole, received.shape)
        listening = np.zeros((len(received), *graph.listening.shape))
        listening[:, receiver, sender] = np.where(counted, graph.listening[receiver, sender], 0.0)
        return Messages(self._held, listening, received)

    def _arriving(self, tick: int, sent: Array) -> Array:
        """What was said as long ago as messages take, (trials, 1 + agents, n); at first what was said first."""
        age = self._faults.at(MESSAGE_AGE, tick)
        if age is None:
            return sent
        self._under_way = [*self._under_way, sent][-(self._longest + 1) :]
        ticks = np.minimum(np.round(age[:, 0] / self._faults.dt).astype(int), len(self._under_way) - 1)
        if len(ticks) == 1:
            return self._under_way[-1 - int(ticks[0])]
        return np.stack(self._under_way)[len(self._under_way) - 1 - ticks, np.arange(len(ticks))]
