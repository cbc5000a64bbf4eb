"""Files that a command leaves in its folder: each whole, and none lost because another cannot be written."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import typer

from sim.cli.terminal import FAILED, INTERRUPTED, err
from sim.whole_file import NotWritten, remove_abandoned, whole_file


class ResultFiles:
    """Files of one folder, which is made with the first of them; what a killed process left half written there is removed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        remove_abandoned(folder)
        self._written = set[str]()
        self._refused = list[str]()

    def write(self, name: str, write: Callable[[Path], object]) -> None:
        """Write a file by a function of the path; if it cannot be written, what was there stays, and `refusal` tells of it."""
        try:
            with whole_file(self.folder / name) as temporary:
                write(temporary)
        except NotWritten as refused:
            self._refused.append(str(refused))
        else:
            self._written.add(name)

    def remove_others(self, names: Iterable[str]) -> None:
        """Remove what an older run left under these names and this one did not write; nothing if something could not be written."""
        for name in names if not self._refused else ():
            if name not in self._written and (self.folder / name).is_file():
                (self.folder / name).unlink()

    def __contains__(self, name: str) -> bool:
        """Whether a file was written."""
        return name in self._written

    @property
    def refusal(self) -> str | None:
        """What could not be written, in words; None: all was."""
        if not self._refused:
            return None
        kept = f"; written whole: {', '.join(sorted(self._written))}" if self._written else ""
        others = f", nor {len(self._refused) - 1} more" if len(self._refused) > 1 else ""
        return f"{self._refused[0]}{others}{kept}"

    def end_if_refused(self) -> None:
        """Leave the command, with one line, if something could not be written."""
        if self.refusal:
            err.print(f"error: {self.refusal}", style="red")
            raise typer.Exit(FAILED)


@contextmanager
def interrupted_as(line: str) -> Iterator[None]:
    """Answer an interruption of the block with one line and its exit code."""
    try:
        yield
    except KeyboardInterrupt:
        err.print(f"interrupted: {line}")
        raise typer.Exit(INTERRUPTED) from None
