"""Files that are there wholly or not at all: written beside their place, made durable, and renamed."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from secrets import token_hex


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
    temporary = path.with_name(f".{path.stem}-{os.getpid()}-{token_hex(4)}.part{path.suffix}")
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


def write_whole(path: Path, content: bytes) -> None:
    """Write bytes wholly or not at all; raises NotWritten."""
    with whole_file(path) as temporary:
        temporary.write_bytes(content)
