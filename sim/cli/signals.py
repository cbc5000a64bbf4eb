"""How the command ends when it is asked to: Ctrl-C, SIGTERM and SIGHUP are one."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

ASKING = ("SIGINT", "SIGTERM", "SIGHUP")  # the last is not known everywhere


@contextmanager
def interruptible() -> Iterator[None]:
    """Let a signal raise KeyboardInterrupt once, so that what is finished can be kept and the way on told without a further one's leave.

    The second is heard and not heeded; from the third on each interrupts again, for whoever cannot wait. After the block a command that was
    asked to end is ending, and nothing disturbs it any more. What its caller has chosen to ignore, as `nohup` does SIGHUP, stays ignored.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    heard = 0

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        nonlocal heard
        heard += 1
        if heard != 2:
            raise KeyboardInterrupt

    before = {number: signal.getsignal(number) for name in ASKING if (number := getattr(signal, name, None)) is not None}
    changed = {number: handler for number, handler in before.items() if handler not in (signal.SIG_IGN, None)}
    try:
        for number in changed:
            signal.signal(number, interrupt)
        yield
    finally:
        for number, handler in changed.items():
            signal.signal(number, signal.SIG_IGN if heard else handler)
