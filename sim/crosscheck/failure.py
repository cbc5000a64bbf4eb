"""How something printed that cannot be right is shown to fail."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.crosscheck.open_loop import Flight

Array = NDArray[np.floating]


class Failure(NamedTuple):
    """How a printed variant fails.

    Attributes:
      variant: its name.
      measure: what is looked at.
      right: figure of the right equations.
      printed: figure of the printed ones.
      limit: that the right one must keep and the printed one must exceed.
      unit: of the three.
      when: instant at which the printed one exceeds the limit, s; NaN where there is none.
      remark: one line on how it fails.
    """

    variant: str
    measure: str
    right: float
    printed: float
    limit: float
    unit: str
    when: float
    remark: str

    @property
    def fails(self) -> bool:
        """Whether the printed variant fails as it must, and the right one does not."""
        return self.right <= self.limit and not self.printed <= self.limit


FailureFunction = Callable[[Flight, Array], list[Failure]]
