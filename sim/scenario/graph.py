"""Who hears whom, as scenario files say it; what they leave out is as published, for any number of agents."""

from __future__ import annotations

from itertools import cycle, islice
from typing import ClassVar, Literal

from pydantic import Field

from control.communication_graph import CommunicationGraph
from models.sections import NonNegative, Ordinal, Section


class GraphSettings(Section):
    """Links and their weights, agents counted from one."""

    chain: ClassVar[tuple[float, ...]]  # published weights of the links 1-2, 2-3, ..., over again where there are more agents
    closing: ClassVar[float | None]  # of the link between the first and the last; None: there is none
    seen: ClassVar[float]  # of what the first agent hears of the leader
    seen_last: ClassVar[float]  # of what the last does

    links: tuple[tuple[Ordinal, Ordinal, NonNegative], ...] | None = Field(
        None, description="both hear each other: [agent, agent, weight]; none given: as published"
    )
    one_way: tuple[tuple[Ordinal, Ordinal, NonNegative], ...] = Field((), description="the first hears the second: [agent, agent, weight]")
    leader: tuple[tuple[Ordinal, NonNegative], ...] | None = Field(
        None, description="who sees the leader: [agent, weight]; none given: the first and the last"
    )

    def build(self, agents: int) -> CommunicationGraph:
        """The graph of so many agents; raises ValueError where it is none that can track."""
        links = self._published_links(agents) if self.links is None else self.links
        leader = {1: self.seen} | {agents: self.seen_last if agents > 1 else self.seen}
        sees = tuple(leader.items()) if self.leader is None else self.leader
        named = [number for i, j, _ in (*links, *self.one_way) for number in (i, j)] + [number for number, _ in sees]
        if beyond := [number for number in named if number > agents]:
            raise ValueError(f"graph: there is no agent {beyond[0]}; there are {agents}")
        try:
            return CommunicationGraph.of(agents, links, sees, self.one_way)
        except ValueError as complaint:
            raise ValueError(f"graph: {complaint}") from None

    def _published_links(self, agents: int) -> tuple[tuple[int, int, float], ...]:
        chain = tuple((i, i + 1, weight) for i, weight in islice(enumerate(cycle(self.chain), 1), agents - 1))
        return chain if self.closing is None or agents <= 2 else (*chain, (1, agents, self.closing))


class FormationGraph(GraphSettings):
    """A ring (Rososhansky 2017, sec. 4.3)."""

    chain = (0.4, 0.6, 0.6, 0.8, 0.6)
    closing = 0.6
    seen, seen_last = 0.5, 0.5

    when_lost: Literal["hold", "skip"] = Field("hold", description="a message that does not come: the last one holds, or counts nothing")


class ConsensusGraph(GraphSettings):
    """A chain (Rososhansky 2017, sec. 5.3)."""

    chain = (0.7, 0.6, 0.7, 0.8, 0.9)
    closing = None
    seen, seen_last = 0.8, 0.9
