"""Who hears whom in a formation, and how much weight that is given."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import breadth_first_order

Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class CommunicationGraph:
    """Weighted links between agents, and from a leader to some of them (Rososhansky 2017, fig. 4.1); directed ones, too.

    Attributes:
      weights: a_ij of what agent i hears of agent j, (agents, agents), zero on the diagonal; zero: nothing. Published graphs are
        symmetric, and the proofs of convergence are for those.
      leader: a_i0, (agents,); zero: the agent does not see the leader.
    """

    weights: Array
    leader: Array

    def __post_init__(self) -> None:
        agents = len(self.leader)
        if self.weights.shape != (agents, agents):
            raise ValueError(f"weights of {self.weights.shape[0]} agents, leader's of {agents}")
        if np.any(self.weights < 0.0) or np.any(self.leader < 0.0):
            raise ValueError("a weight is negative")
        if np.any(np.diagonal(self.weights)):
            raise ValueError(f"agent {int(np.flatnonzero(np.diagonal(self.weights))[0]) + 1} is linked to itself")
        if unreached := self.unreached():
            raise ValueError(f"no path leads from the leader to {', '.join(str(i + 1) for i in unreached)}")

    @classmethod
    def of(
        cls,
        agents: int,
        links: Iterable[tuple[int, int, float]],
        leader: Iterable[tuple[int, float]],
        one_way: Iterable[tuple[int, int, float]] = (),
    ) -> CommunicationGraph:
        """From links both ways (i, j, weight), who sees the leader (i, weight), and who hears whom (i, j, weight), counted from one."""
        weights, seen = np.zeros((agents, agents)), np.zeros(agents)
        for i, j, weight in links:
            weights[i - 1, j - 1] = weights[j - 1, i - 1] = weight
        for i, j, weight in one_way:
            weights[i - 1, j - 1] = weight
        for i, weight in leader:
            seen[i - 1] = weight
        return cls(weights, seen)

    @property
    def agents(self) -> int:
        """How many."""
        return len(self.leader)

    @cached_property
    def listening(self) -> Array:
        """Weights of what each agent hears, the leader being the first that speaks: (agents, 1 + agents)."""
        return np.concatenate([self.leader[:, None], self.weights], axis=1)

    @cached_property
    def ways(self) -> NDArray[np.int64]:
        """Receiver and sender (0: the leader) of each message of a tick, (messages, 2)."""
        return np.argwhere(self.listening > 0.0)

    def unreached(self) -> list[int]:
        """Agents, counted from zero, to which no path leads from the leader."""
        everyone = np.zeros((self.agents + 1, self.agents + 1))
        everyone[1:, :] = self.listening
        reached = breadth_first_order(everyone.T, 0, return_predecessors=False)
        return sorted(set(range(self.agents)) - {int(i) - 1 for i in reached})


def lumped_error(own: Array, heard: Array, listening: Array) -> Array:
    """Weighted sum of an agent's differences from all that it hears of (Rososhansky 2017, eq. 4.12).

    Args:
      own: of each agent, (..., agents, n).
      heard: what each agent has of leader and agents, (..., agents, 1 + agents, n), or (..., 1, 1 + agents, n) if all have the same.
      listening: weights, (..., agents, 1 + agents).

    Returns:
      Sum over j of a_ij (own_i - heard_ij), (..., agents, n).
    """
    return (listening[..., None, :] @ (own[..., None, :] - heard))[..., 0, :]
