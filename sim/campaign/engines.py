"""Where shards are computed: processes of this machine, or a cluster of dask.distributed."""

from __future__ import annotations

import itertools
import logging
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from typing import Any, Protocol, TypeVar

from sim.bad_input import BadInput
from sim.campaign.worker_processes import AGAIN, WorkersLost, deaf_children, in_processes
from sim.processor import processor
from sim.signals import SIGNALS

Job = TypeVar("Job")
Result = TypeVar("Result")

IN_FLIGHT = 2  # jobs a worker of a cluster has waiting: enough to keep it busy, and memory flat


class SchedulerLost(RuntimeError):
    """The scheduler of a cluster no longer answers; results that came are sound."""


class Engine(Protocol):
    """Runs independent jobs somewhere."""

    def processors(self) -> set[str]:
        """Kinds of processors that compute."""
        ...

    def map(self, function: Callable[[Job], Result], jobs: list[Job]) -> Iterator[Result]:
        """Results as they come, in any order; function and jobs can be pickled.

        Raises:
          WorkersLost: workers were lost over some jobs time and again; all others were done.
          SchedulerLost: the cluster is gone.
        """
        ...


class Local:
    """Processes of the standard library; with one worker, this very process."""

    def __init__(self, workers: int) -> None:
        self.workers = workers

    def processors(self) -> set[str]:
        """That of this machine."""
        return {processor()}

    def map(self, function: Callable[[Job], Result], jobs: list[Job]) -> Iterator[Result]:
        """Results as they come."""
        return map(function, jobs) if self.workers == 1 else in_processes(function, jobs, self.workers)


class Dask:
    """A cluster of dask.distributed by its client."""

    def __init__(self, client: Any) -> None:
        self._client = client

    def processors(self) -> set[str]:
        """Those of the workers that are there now."""
        return set(self._client.run(processor).values())

    def map(self, function: Callable[[Job], Result], jobs: list[Job]) -> Iterator[Result]:
        """Results as they come."""
        from dask.distributed import CancelledError, KilledWorker, as_completed  # noqa: PLC0415  # an extra

        queue, lost = iter(jobs), 0
        count = IN_FLIGHT * max(1, len(self._client.scheduler_info()["workers"]))
        try:
            running = as_completed([self._client.submit(function, job, pure=False) for job in itertools.islice(queue, count)])
            for future in running:
                for job in itertools.islice(queue, 1):
                    running.add(self._client.submit(function, job, pure=False))
                try:
                    result = future.result()
                except KilledWorker:
                    lost += 1
                    continue
                future.release()
                yield result
        except (CancelledError, OSError, TimeoutError):  # what a client says whose scheduler is gone
            raise SchedulerLost("the dask scheduler was lost") from None
        if lost:
            raise WorkersLost(lost)


@contextmanager
def _cluster(workers: int, scheduler: str | None) -> Iterator[Dask]:
    """A cluster made here for the time being, or a running scheduler's.

    Whatever dask can start (SLURM, Kubernetes, SSH) is thereby an engine; the twin must be installed on its workers.
    """
    try:
        import dask  # noqa: PLC0415  # an extra
        from dask.distributed import Client, LocalCluster  # noqa: PLC0415
    except ImportError:
        raise BadInput("--engine dask needs dask.distributed: pip install 'nacs-twin[cluster]'") from None
    with SIGNALS.held(), ExitStack() as stack:  # what is interrupted while it starts or ends a cluster leaves processes behind
        stack.callback(logging.disable, logging.root.manager.disable)
        logging.disable(logging.CRITICAL)  # what is lost is told in one line, not by each part of the cluster that misses it
        stack.enter_context(dask.config.set({"distributed.scheduler.allowed-failures": AGAIN}))
        address: Any = scheduler
        try:
            if scheduler is None:
                here = "127.0.0.1:0"  # any free port of this machine alone, also for the pages that dask serves
                with deaf_children():
                    address = stack.enter_context(
                        LocalCluster(
                            n_workers=workers,
                            threads_per_worker=1,
                            host="127.0.0.1",
                            dashboard_address=here,
                            worker_dashboard_address=here,
                            silence_logs=logging.CRITICAL + 1,
                        )
                    )
            client = stack.enter_context(Client(address, timeout=5 if scheduler else 120))
        except (OSError, TimeoutError, ValueError) as refused:
            what = f"--scheduler {scheduler}: no dask scheduler answers there" if scheduler else "--engine dask: no local cluster starts"
            raise BadInput(f"{what} ({type(refused).__name__}: {refused})") from None
        with SIGNALS.heeded():
            yield Dask(client)


@contextmanager
def _local(workers: int) -> Iterator[Local]:
    yield Local(workers)


def engine(name: str, workers: int, scheduler: str | None) -> AbstractContextManager[Engine]:
    """Engine by name, while it is needed; entering it raises BadInput if dask is missing or the scheduler cannot be reached."""
    return _cluster(workers, scheduler) if name == "dask" else _local(workers)
