"""`python -m benchmarks [TABLE ...]`: print all tables, or those named."""

from __future__ import annotations

import sys
import time

from benchmarks.campaign import campaign
from benchmarks.environment import environment, policies
from benchmarks.filters import filters
from benchmarks.loop import sizes, workers
from benchmarks.output import output
from benchmarks.particles import particles
from benchmarks.physics import physics
from benchmarks.show import machine
from benchmarks.steps import steps
from benchmarks.switching import switching

WORKS = (physics, steps, filters, switching, particles, sizes, workers, output, campaign, environment, policies)
TABLES = {work.__name__: work for work in WORKS}


def main() -> None:
    """Print the machine and the tables asked for."""
    asked = sys.argv[1:] or list(TABLES)
    if unknown := [name for name in asked if name not in TABLES]:
        sys.exit(f"no table {', '.join(unknown)}: there are {', '.join(TABLES)}")
    print(machine())
    start = time.perf_counter()
    for name in asked:
        TABLES[name]()
    print(f"\nall in {time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
