"""The entry of the command `nacs`: it answers signals before it imports what takes seconds."""

from __future__ import annotations

import sys
from typing import NoReturn

from sim.signals import SIGNALS


def main() -> NoReturn:
    """Be the command of this process, and leave with its exit code: 0 done, 2 bad input, 3 failed, 130 interrupted."""
    SIGNALS.listen()
    with SIGNALS.leaving_at_once():
        from sim.cli.command import command
    code = command()
    SIGNALS.ignore()  # what could be asked for happens anyway
    sys.exit(code)


if __name__ == "__main__":
    main()
