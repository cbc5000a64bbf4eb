"""How far long work is: a bar at a terminal, elsewhere a line every ten seconds."""

from __future__ import annotations

import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.text import Text

BETWEEN_LINES_S = 10.0
PREFIX = "progress: "


class Rate(ProgressColumn):
    """How many a second."""

    def __init__(self, unit: str) -> None:
        super().__init__()
        self._unit = unit

    def render(self, task: Task) -> Text:
        """Text of the column."""
        return Text(f"{task.speed:.3g} {self._unit}/s" if task.speed else "")


class Work:
    """A piece of work whose progress is shown while the block lasts.

    Args:
      console: where it is shown.
      unit: of what is counted, such as `trials`.
    """

    def __init__(self, console: Console, unit: str) -> None:
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            Rate(unit),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
        )
        self._console, self._unit = console, unit
        self._bar = Progress(*columns, console=console, transient=True, speed_estimate_period=120, disable=not console.is_terminal)
        self._task = self._bar.add_task("", total=None)
        self._what, self._done = "", 0.0
        self._begun = self._told = time.monotonic()

    def __enter__(self) -> Work:
        self._bar.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None) -> None:
        self._bar.stop()

    def report(self, what: str, done: float, of: float) -> None:
        """Say what is being done, how much of it is done, and of how much."""
        now = time.monotonic()
        if what != self._what:
            self._what, self._begun = what, now
            self._bar.reset(self._task)
        self._done = done
        self._bar.update(self._task, description=what, completed=int(done), total=int(of))
        if not self._console.is_terminal and now - self._told >= BETWEEN_LINES_S:
            self._told = now
            left = f", about {_duration((now - self._begun) * (of - done) / done)} left" if done > 0 else ""
            self._console.print(f"{PREFIX}{what}, {done:.0f} of {of:.0f} {self._unit}{left}")

    def advance(self, what: str, more: float, of: float) -> None:
        """Say that so much more of it is done."""
        self.report(what, self._done + more if what == self._what else more, of)


def _duration(seconds: float) -> str:
    for size, name in ((86400.0, "d"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.0f} {name}"
    return f"{max(1.0, seconds):.0f} s"
