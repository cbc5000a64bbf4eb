"""The entry of the command `nacs`: it sees to it that the twin's packages are its own before it imports one of them."""

from __future__ import annotations

import sys
from typing import NoReturn

from nacs_twin.own_packages import misplaced, shared

BAD_INPUT = 2


def main() -> NoReturn:
    """Be the command of this process, or say in one line which package is in its way."""
    _refuse(misplaced())
    from sim.cli.main import main as command  # noqa: PLC0415  # not before
    from sim.signals import SIGNALS  # noqa: PLC0415

    SIGNALS.listen()
    with SIGNALS.leaving_at_once():
        said = shared()
    _refuse(said)
    command()


def _refuse(said: str | None) -> None:
    if said is not None:
        print(f"error: {said}", file=sys.stderr)
        sys.exit(BAD_INPUT)


if __name__ == "__main__":
    main()
