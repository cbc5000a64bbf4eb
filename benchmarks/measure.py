"""How costs are measured: everything to be compared in turn, round after round, on one core, in CPU time."""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager


@contextmanager
def one_core() -> Iterator[None]:
    """Stay on one core, processes started meanwhile included."""
    if not hasattr(os, "sched_setaffinity"):  # macOS, Windows
        yield
        return
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(cores)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)


def cpu_seconds(work: Callable[[], object]) -> float:
    """CPU time of this process for one call: what others do on a shared machine is not in it, but for the caches."""
    start = time.process_time()
    work()
    return time.process_time() - start


def wall_seconds(work: Callable[[], object]) -> float:
    """Wall time of one call."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def interleave(rounds: int, contenders: Sequence[Callable[[], float]]) -> list[list[float]]:
    """Seconds of every contender in every round, the rounds interleaved so that a slow minute of the machine hits all alike."""
    taken = [[seconds() for seconds in contenders] for _ in range(rounds)]
    return [list(each) for each in zip(*taken, strict=True)]


def ratio(over: Iterable[float], under: Iterable[float]) -> float:
    """Median of the ratios of the rounds."""
    return statistics.median(a / b for a, b in zip(over, under, strict=True))
