"""Made-up readings with which a user's class is tried before anything is flown, and the test that trials do not depend on each other."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from models.attitude import quaternion
from models.dynamics.state_layout import StateLayout
from sim.user_code.user_class import UserClass

Array = NDArray[np.floating]

_TURN = np.array([[0.01, -0.02, 0.03], [0.1, 0.2, -0.1], [-0.3, 0.1, 0.2]])
TRIALS = len(_TURN)


def readings(layout: StateLayout) -> Array:
    """States of three trials that differ, (3, [agents,] n)."""
    blocks = []
    for block in layout.blocks:
        wide = np.resize(_TURN[:, ::-1], (TRIALS, len(block.names)))
        attitude = quaternion.from_rotation_vector(_TURN) if len(block.names) == 4 else _TURN
        blocks.append({"attitude": attitude, "rate": 0.1 * wide, "wheels": 5.0 * wide}.get(block.kind, 0.5 * wide))
    one = np.concatenate(blocks, axis=-1)
    if layout.agents is None:
        return one
    shift = 1.0 + 0.01 * np.arange(layout.agents)
    return one[:, None] * shift[:, None]


def same_whatever_the_batch(source: UserClass, run: Callable[[slice], Array]) -> None:
    """Complain if a trial comes out differently alone than among others; what draws random numbers is not judged."""
    together, again, alone = run(slice(None)), run(slice(None)), run(slice(1, 2))
    if np.array_equal(together, again) and not np.allclose(together[1:2], alone, rtol=1e-6, atol=1e-12):
        raise source.complaint("step", "a trial comes out differently among others than alone; the first axis is trials, work on the last")
