"""A recording as a file, put together in memory and then written in one piece."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import rerun as rr


@contextmanager
def recording_file(path: Path, application: str, page: Any) -> Iterator[rr.RecordingStream]:
    """A stream for everything that the file holds, which opens laid out as `page` says.

    Rerun's own writer works in a thread, which tells the terminal of a full disk and leaves half a file; here it is an OSError.

    Raises:
      OSError: the file cannot be written.
    """
    with rr.RecordingStream(application) as stream:
        held = stream.memory_recording()
        stream.send_blueprint(page, make_active=False, make_default=True)
        yield stream
    path.write_bytes(held.drain_as_bytes())
