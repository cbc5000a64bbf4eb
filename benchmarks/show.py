"""Tables of text at 100 columns, and the machine that they were measured on."""

from __future__ import annotations

import math
import os
import platform
import re
import textwrap
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

WIDTH = 100


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]], note: str = "") -> None:
    """Print rows under their columns: the first column to the left, numbers to the right."""
    widths = [max(map(len, column)) for column in zip(columns, *rows, strict=True)]
    print(f"\n{title}\n{'=' * len(title)}")
    for line in (columns, ["-" * width for width in widths], *rows):
        cells = (cell.rjust(width) for cell, width in zip(line[1:], widths[1:], strict=True))
        print("  ".join([line[0].ljust(widths[0]), *cells]).rstrip())
    if note:
        print(textwrap.fill(note, WIDTH), flush=True)


def figure(value: float) -> str:
    """A number in the two digits that a shared machine is good for; from 100 on, whole."""
    digits = max(0, 1 - math.floor(math.log10(abs(value)))) if value else 0
    return f"{value:.{digits}f}"


def machine() -> str:
    """Processor, cores, Python and the packages that carry the twin."""
    cpuinfo = Path("/proc/cpuinfo")
    found = re.search(r"model name\s*:\s*(.+)", cpuinfo.read_text(encoding="utf-8")) if cpuinfo.exists() else None
    processor = found[1] if found else platform.processor() or platform.machine()
    packages = ", ".join(f"{name} {version(name)}" for name in ("mujoco", "numpy", "scipy", "rerun-sdk", "pyarrow"))
    return f"{processor}, {os.cpu_count()} cores, {platform.system()} {platform.machine()}; Python {platform.python_version()}, {packages}"
