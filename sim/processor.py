"""Which processor computes: it decides the last bits, since BLAS picks its kernels by it."""

from __future__ import annotations

import platform
from collections.abc import Iterable
from functools import cache

import scipy.linalg  # noqa: F401  # so that SciPy's BLAS is loaded beside NumPy's, and is asked too
from threadpoolctl import threadpool_info

MIXED = "computed by different kernels of BLAS: equal to 1e-11, not to the bit"


@cache
def processor() -> str:
    """Kind of machine and the kernels that BLAS chose on it, such as `x86_64 openblas Haswell`."""
    kernels = {f"{found['internal_api']} {found.get('architecture') or found['version']}" for found in threadpool_info() if _blas(found)}
    return " ".join([platform.machine(), *sorted(kernels)])


def described(processors: Iterable[str]) -> dict[str, object]:
    """What a summary says of the processors that computed its numbers."""
    names = sorted(set(processors))
    return {"processors": names} | ({"mixed_processors": MIXED} if len(names) > 1 else {})


def _blas(found: dict[str, str]) -> bool:
    return found["user_api"] == "blas"
