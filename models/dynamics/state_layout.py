"""Which components a state has, in which order: names, units and places, written once."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]

# places in the state of one body, [q_BN, omega_BN_B, wheel speeds], and in its error coordinates
ATTITUDE, RATE, WHEELS, MOTION = slice(0, 4), slice(4, 7), slice(7, None), slice(0, 7)
ROTATION, RATE_ERROR, WHEEL_ERRORS = slice(0, 3), slice(3, 6), slice(6, None)
# places in the state of one of several bodies by modified Rodrigues parameters, [sigma, dsigma/dt]
SIGMA, SIGMA_RATE = slice(0, 3), slice(3, 6)
# places in the state of an agent in the plane, [x, v]
POSITION, VELOCITY, PLANE = slice(0, 2), slice(2, 4), slice(0, 4)

Kind = Literal["attitude", "rate", "wheels", "position", "velocity"]


class Block(NamedTuple):
    """Components that belong together.

    Attributes:
      kind: what they are.
      names: of the components.
      unit: of each.
      errors: how many error coordinates they have; a quaternion's are the three of a rotation vector.
    """

    kind: Kind
    names: tuple[str, ...]
    unit: str
    errors: int


@dataclass(frozen=True)
class StateLayout:
    """The blocks of a state, one after the other.

    Attributes:
      blocks: in order.
      agents: how many bodies have such a state; None: one, without an axis of agents.
    """

    blocks: tuple[Block, ...]
    agents: int | None = None

    @classmethod
    def of_a_body(cls, wheels: int) -> StateLayout:
        """[q_BN, omega_BN_B, wheel speeds]; with no wheels [q_BN, omega_BN_B]."""
        attitude = Block("attitude", ("q1", "q2", "q3", "q4"), "1", 3)
        rate = Block("rate", ("omega1", "omega2", "omega3"), "rad/s", 3)
        spin = Block("wheels", tuple(f"wheel{i + 1}" for i, _ in enumerate(range(wheels))), "rad/s", wheels)
        return cls((attitude, rate, spin) if wheels else (attitude, rate))

    @classmethod
    def by_rodrigues(cls, agents: int) -> StateLayout:
        """[sigma, dsigma/dt] of each of several bodies."""
        sigma = Block("attitude", ("sigma1", "sigma2", "sigma3"), "1", 3)
        return cls((sigma, Block("rate", ("dsigma1", "dsigma2", "dsigma3"), "1/s", 3)), agents)

    @classmethod
    def in_the_plane(cls, agents: int) -> StateLayout:
        """[x, v] of each of several agents."""
        return cls((Block("position", ("x1", "x2"), "m", 2), Block("velocity", ("v1", "v2"), "m/s", 2)), agents)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Of all components."""
        return tuple(name for block in self.blocks for name in block.names)

    @cached_property
    def units(self) -> tuple[str, ...]:
        """Of all components."""
        return tuple(block.unit for block in self.blocks for _ in block.names)

    @property
    def size(self) -> int:
        """Number of components."""
        return len(self.names)

    @property
    def errors(self) -> int:
        """Number of error coordinates."""
        return sum(block.errors for block in self.blocks)

    @cached_property
    def rest(self) -> Array:
        """The state of a body at rest in N, (n,)."""
        rest = np.zeros(self.size)
        for block in self.blocks:
            if len(block.names) > block.errors:
                rest[self.places[block.kind].stop - 1] = 1.0  # the scalar part of a quaternion
        return rest

    @property
    def lead(self) -> tuple[int, ...]:
        """Axes behind that of trials and before the components."""
        return () if self.agents is None else (self.agents,)

    @cached_property
    def places(self) -> dict[str, slice]:
        """Components of each block, by its kind."""
        return dict(_spans((block.kind, len(block.names)) for block in self.blocks))

    @cached_property
    def error_places(self) -> dict[str, slice]:
        """Error coordinates of each block, by its kind."""
        return dict(_spans((block.kind, block.errors) for block in self.blocks))

    def repeated(self, values: dict[str, float]) -> Array:
        """One value for each error coordinate, by the kind of its block, (errors,)."""
        return np.concatenate([np.full(block.errors, values.get(block.kind, 0.0)) for block in self.blocks])

    def columns(self) -> tuple[str, ...]:
        """Names of the components of all agents, agent by agent: `agent2_sigma1`."""
        if self.agents is None:
            return self.names
        return tuple(f"agent{i + 1}_{name}" for i, _ in enumerate(range(self.agents)) for name in self.names)


def _spans(sizes: Iterable[tuple[str, int]]) -> Iterable[tuple[str, slice]]:
    start = 0
    for name, size in sizes:
        yield name, slice(start, start + size)
        start += size
