"""Files that are there wholly or not at all: written beside their place, made durable, and renamed."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from secrets import token_hex

_TEMPORARY = re.compile(r"\..*-(\d+)-[0-9a-f]{8}\.part(\..*)?")  # as `whole_file` names them, with the number of the process

_MINE = set[str]()  # names of what this process writes now


class NotWritten(OSError):
    """A file cannot be written; the message is one line, and what was in its place before is there still."""


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A path to write to, in the folder of `path`; the file takes its place when the block ends well and is gone otherwise.

    The name is no other process's, so that two that write the same file never write into each other's. It ends as `path` does, for writers
    that go by the ending.

    Raises:
      NotWritten: the block or the file system refused; what was there before is there still.
    """
    whole = Path(os.path.abspath(path))  # a folder called ~ is one, whatever a library makes of it
    temporary = whole.with_name(f".{path.stem}-{os.getpid()}-{token_hex(4)}.part{path.suffix}")
    _MINE.add(temporary.name)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        with temporary.open("r+b") as file:
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except OSError as refused:
        reason = os.strerror(refused.errno) if refused.errno else " ".join(str(refused).split())
        raise NotWritten(f"{path} cannot be written: {reason}") from None
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        _MINE.discard(temporary.name)


def write_whole(path: Path, content: bytes) -> None:
    """Write bytes wholly or not at all; raises NotWritten."""
    with whole_file(path) as temporary:
        temporary.write_bytes(content)


def remove_abandoned(folder: Path) -> None:
    """Remove what processes left that were killed while they wrote a file of a folder; those that still run keep theirs.

    In a container that is started again this process may have the very number of the one that was killed.
    """
    for path in folder.glob(".*.part*"):
        found = _TEMPORARY.fullmatch(path.name)
        if found and path.name not in _MINE and (int(found[1]) == os.getpid() or not _runs(int(found[1]))):
            path.unlink(missing_ok=True)


def _runs(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:  # it is another user's
        return True
    return True
