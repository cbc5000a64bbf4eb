"""What a user's class is told of the loop that it joins."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.state_space import StateSpace
from models.dynamics.process import ProcessModel
from models.dynamics.state_layout import StateLayout

Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Setting:
    """What a user's class is constructed with, as its one argument.

    Attributes:
      process: analytic model of the plant as the paper writes it (`derivative`, `linearize`; see models/dynamics/process.py).
      process_with_drag: the same with the wheels' friction, where there are wheels.
      layout: names, units and places of the components of its state, and how many agents have one.
      space: error coordinates of that state (`difference`, `displace`).
      measurement_noise: R in those coordinates, (errors, errors).
      wheels: number of wheels whose speeds are components of the state.
    """

    process: ProcessModel
    process_with_drag: ProcessModel
    layout: StateLayout
    space: StateSpace
    measurement_noise: Array
    wheels: int

    @property
    def variances(self) -> tuple[float, ...]:
        """Variance of a reading in each block of the state: of one body small rotation (rad2), rate (rad2/s2), wheel speed (rad2/s2)."""
        diagonal = np.diagonal(self.measurement_noise)
        return tuple(float(diagonal[place.start]) for place in self.layout.error_places.values())


class Surroundings(NamedTuple):
    """How a user's filter or law sits in a loop.

    Attributes:
      setting: what its class is told.
      inputs: size of the command that its filter is given.
      wheels: of one body, whose speeds its law is told.
      measured: what its filter is given of a reading, (trials, [agents,] n), NaN where nothing is read.
      command: what its filter is given of what is known of the drives, (trials, [agents,] inputs).
      unread: blocks of the state that are never read.
      gaps: whether readings can be missing.
      networked: whether its law hears of neighbours and a leader instead of following a target.
    """

    setting: Setting
    inputs: int
    wheels: int
    measured: Callable[[Array], Array]
    command: Callable[[Any], Array]
    unread: tuple[str, ...] = ()
    gaps: bool = False
    networked: bool = False
