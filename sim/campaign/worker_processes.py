"""Worker processes of this machine: each has a pool of its own, so that one that is lost takes no other's job with it."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import TypeVar

from sim.signals import SIGNALS
from sim.text.table_style import counted

Job = TypeVar("Job")
Result = TypeVar("Result")

AGAIN = 2  # times that a job is done anew after its worker was lost; then the job itself is likely to be what kills it


class WorkersLost(RuntimeError):
    """Some jobs could not be done, since the workers that had them were lost each time; all others were."""

    def __init__(self, jobs: int) -> None:
        super().__init__(
            f"{counted(jobs, 'block')} of trials could not be flown: the worker process was lost {AGAIN + 1} times "
            "(killed, or out of memory? fewer trials together or fewer --workers need less)"
        )


def in_processes(function: Callable[[Job], Result], jobs: list[Job], workers: int) -> Iterator[Result]:
    """Results as they come, in any order; a job whose worker is lost is done again by a new one.

    Args:
      function: of the jobs; it and they can be pickled.
      jobs: what is to be done.
      workers: processes.

    Raises:
      WorkersLost: after all other results, if workers were lost over some jobs AGAIN times more.
    """
    left = deque((job, 0) for job in jobs)
    with SIGNALS.held():  # a process that is interrupted while it starts another leaves it behind
        idle = [one_process() for _ in range(min(workers, len(jobs)))]
    busy: dict[Future[Result], tuple[ProcessPoolExecutor, Job, int]] = {}
    given_up = 0
    results = list[Result]()
    try:
        while left or busy:
            while left and idle:
                with SIGNALS.held():
                    job, losses = left.popleft()
                    pool = idle.pop()
                    try:
                        busy[_submit(pool, function, job)] = pool, job, losses
                    except BrokenProcessPool:  # it was lost while it had nothing to do
                        left.appendleft((job, losses))
                        idle.append(one_process())
            yield from results  # the workers are busy again while these are dealt with
            results = []
            done, _ = wait(busy, return_when=FIRST_COMPLETED)
            for future in done:
                pool, job, losses = busy.pop(future)
                try:
                    results.append(future.result())
                    idle.append(pool)
                except BrokenProcessPool:
                    idle.append(one_process())
                    if losses < AGAIN:
                        left.append((job, losses + 1))
                    else:
                        given_up += 1
        yield from results
        if given_up:
            raise WorkersLost(given_up)
    finally:
        for pool in idle + [pool for pool, _, _ in busy.values()]:
            pool.shutdown(wait=False, cancel_futures=True)
        for child in multiprocessing.active_children():  # this process would otherwise wait for them before it ends
            child.terminate()


def one_process() -> ProcessPoolExecutor:
    """A pool of one process, which dies with this one, even if this one is killed.

    Spawned, not forked: a fork would inherit MuJoCo's threads.
    """
    with deaf_children():  # the first pool starts the process that minds its semaphores
        return ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"), initializer=_die_with_parent)


@contextmanager
def deaf_children() -> Iterator[None]:
    """Processes that are started here never hear Ctrl-C or a hang-up: whoever started them decides when they end."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})  # a mask is inherited, also through exec
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _submit(pool: ProcessPoolExecutor, function: Callable[[Job], Result], job: Job) -> Future[Result]:
    """Hand a job to a pool, which starts its process with the first."""
    with deaf_children():
        return pool.submit(function, job)


def _die_with_parent() -> None:
    """Watch the parent from a thread: an orphan of the pool would otherwise wait for work for ever."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
