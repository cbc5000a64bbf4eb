"""How the command ends when it is asked to: Ctrl-C, SIGTERM and SIGHUP are one."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

ASKING = ("SIGINT", "SIGTERM", "SIGHUP")  # the last is not known everywhere
INTERRUPTED = 130
AS_BEFORE = "interrupted: nothing was begun; the same command begins anew"


class Signals:
    """What the signals of a process do that ask it to end; they do nothing new before `listen`.

    The first raises KeyboardInterrupt, so that what is finished can be kept and the way on told without a further one's leave. The second
    is heard and not heeded; from the third on each interrupts again, for whoever cannot wait.
    """

    def __init__(self) -> None:
        self._heard = 0
        self._at_once = self._held = self._waiting = False
        self._numbers: list[int] = []

    def listen(self) -> None:
        """From now on. What the caller has chosen to ignore, as `nohup` does SIGHUP, stays ignored."""
        if threading.current_thread() is not threading.main_thread():
            return
        known = [number for name in ASKING if (number := getattr(signal, name, None)) is not None]
        self._numbers = [number for number in known if signal.getsignal(number) not in (signal.SIG_IGN, None)]
        for number in self._numbers:
            signal.signal(number, self._hear)

    def ignore(self) -> None:
        """From now on nothing disturbs: the process is ending."""
        for number in self._numbers:
            signal.signal(number, signal.SIG_IGN)

    @contextmanager
    def leaving_at_once(self) -> Iterator[None]:
        """A block, such as imports, that leaves nothing behind: end in its midst, since what it calls may catch an exception."""
        self._at_once = True
        yield
        self._at_once = False

    @contextmanager
    def held(self) -> Iterator[None]:
        """A short block, such as writing what took long: the first signal in it interrupts when it is over."""
        before, self._held = self._held, True
        try:
            yield
        finally:
            self._held = before
        self._catch_up()

    @contextmanager
    def heeded(self) -> Iterator[None]:
        """A long part of a block in which signals are held: they interrupt it."""
        before, self._held = self._held, False
        try:
            self._catch_up()
            yield
        finally:
            self._held = before

    def _catch_up(self) -> None:
        if self._waiting and not self._held:
            self._waiting = False
            raise KeyboardInterrupt

    def _hear(self, _number: int, _frame: FrameType | None) -> None:
        if self._at_once:
            os.write(2, f"{AS_BEFORE}\n".encode())
            os._exit(INTERRUPTED)
        self._heard += 1
        if self._heard == 1 and self._held:
            self._waiting = True
        elif self._heard != 2:
            raise KeyboardInterrupt


SIGNALS = Signals()
