"""Of two beliefs of one kind: the one in some trials or agents, the other in the rest."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def choose(where: NDArray[np.bool_], one: Any, other: Any) -> Any:
    """`one` where it is so, else `other`; arrays with the leading axes of `where`, in tuples of any depth, None where `other` is."""
    if isinstance(other, tuple):
        parts = [choose(where, *pair) for pair in zip(one, other, strict=True)]
        return type(other)(*parts) if hasattr(other, "_fields") else tuple(parts)
    return None if other is None else np.where(where.reshape(*where.shape, *(1,) * (np.ndim(other) - where.ndim)), one, other)
