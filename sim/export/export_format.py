"""What an entry of the register of formats says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from sim.series.signals.signal import Signals


@dataclass(frozen=True)
class ExportFormat:
    """A kind of file that signals can be given away in.

    Attributes:
      key: name of the kind, as `--to` takes it.
      suffix: of its files.
      write: makes one of signals and the name of the scenario.
      needs: packages that it needs beyond the twin's own, as they are imported; all of the extra `data`.
    """

    key: str
    suffix: str
    write: Callable[[Path, Signals], None]
    needs: tuple[str, ...] = ()
