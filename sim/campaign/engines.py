"""Where shards are computed: processes of this machine, or a cluster of dask.distributed."""

from __future__ import annotations

import itertools
import multiprocessing
import os
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from typing import Any, Protocol, TypeVar

from sim.bad_input import BadInput

Job = TypeVar("Job")
Result = TypeVar("Result")

IN_FLIGHT = 2  # jobs a worker has waiting: enough to keep it busy, and memory flat


def processes(workers: int) -> ProcessPoolExecutor:
    """A pool that dies with this process, even if it is killed.

    Spawned, not forked: a fork would inherit MuJoCo's threads.
    """
    return ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"), initializer=_die_with_parent)


def stop(pool: ProcessPoolExecutor) -> None:
    """End a pool now, whatever its workers are at: this process would otherwise wait for them before it ends."""
    pool.shutdown(wait=False, cancel_futures=True)
    for child in multiprocessing.active_children():
        child.terminate()


def _die_with_parent() -> None:
    """Watch the parent from a thread: an orphan of the pool would otherwise wait for work for ever."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


class Engine(Protocol):
    """Runs independent jobs somewhere."""

    def map(self, function: Callable[[Job], Result], jobs: list[Job]) -> Iterator[Result]:
        """Results as they come, in any order; function and jobs can be pickled."""
        ...


class Local:
    """Processes of the standard library; with one worker, this very process."""

    def __init__(self, workers: int) -> None:
        self.workers = workers

    def map(self, function: Callable[[Job], Result], jobs: list[Job]) -> Iterator[Result]:
        """Results as they come."""
        if self.workers == 1:
            yield from map(function, jobs)
            return
        pool = processes(self.workers)
        try:
            queue = iter(jobs)
            waiting: set[Future[Result]] = {pool.submit(function, job) for job in itertools.islice(queue, IN_FLIGHT * self.workers)}
            while waiting:
                done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                waiting |= {pool.submit(function, job) for job in itertools.islice(queue, len(done))}
                for future in done:
                    yield future.result()
        finally:
            stop(pool)


class Dask:
    """A cluster of dask.distributed: one made here for the time being, or a running scheduler's.

    Whatever dask can start (SLURM, Kubernetes, SSH) is thereby an engine; the twin must be installed on its workers.
    """

    def __init__(self, workers: int, scheduler: str | None) -> None:
        self.workers, self.scheduler = workers, scheduler

    def map(self, function: Callable[[Job], Result], jobs: list[Job]) -> Iterator[Result]:
        """Results as they come; raises BadInput if dask is missing or the scheduler cannot be reached."""
        try:
            from dask.distributed import Client, LocalCluster, as_completed  # noqa: PLC0415  # an extra
        except ImportError:
            raise BadInput("--engine dask needs dask.distributed: pip install 'nacs-twin[cluster]'") from None
        cluster: Any = None
        try:
            if self.scheduler is None:
                here = "127.0.0.1:0"  # any free port of this machine alone, also for the pages that dask serves
                cluster = LocalCluster(
                    n_workers=self.workers, threads_per_worker=1, host="127.0.0.1", dashboard_address=here, worker_dashboard_address=here
                )
            client = Client(cluster or self.scheduler, timeout=120 if cluster else 5)
        except (OSError, TimeoutError, ValueError) as refused:
            what = (
                f"--scheduler {self.scheduler}: no dask scheduler answers there"
                if self.scheduler
                else "--engine dask: no local cluster starts"
            )
            raise BadInput(f"{what} ({type(refused).__name__}: {refused})") from None
        with client:
            try:
                count = IN_FLIGHT * max(1, len(client.scheduler_info()["workers"]))
                queue = iter(jobs)
                running = as_completed([client.submit(function, job, pure=False) for job in itertools.islice(queue, count)])
                for future in running:
                    for job in itertools.islice(queue, 1):
                        running.add(client.submit(function, job, pure=False))
                    yield future.result()
                    future.release()
            finally:
                if cluster is not None:
                    cluster.close()


def engine(name: str, workers: int, scheduler: str | None) -> Engine:
    """Engine by name."""
    return Dask(workers, scheduler) if name == "dask" else Local(workers)
