"""Jobs of worker processes that are killed."""

from __future__ import annotations

import os
import signal
from pathlib import Path


def dies_once(job: tuple[str, int]) -> int:
    """Twice a number; the process of job 2 is killed the first time."""
    folder, number = job
    been = Path(folder) / str(number)
    count = len(list(Path(folder).glob(f"{number}-*")))
    been.with_name(f"{number}-{count}").touch()
    if number == 2 and count == 0:
        os.kill(os.getpid(), signal.SIGKILL)
    return 2 * number


def dies_always(job: tuple[str, int]) -> int:
    """Twice a number; the process of job 1 is killed each time."""
    folder, number = job
    count = len(list(Path(folder).glob(f"{number}-*")))
    (Path(folder) / f"{number}-{count}").touch()
    if number == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return 2 * number
