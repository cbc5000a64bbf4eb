"""Digital twin of the NACS, an air-bearing CubeSat testbed with four reaction wheels, and of other spacecraft.

>>> import nacs
>>> flown = nacs.run("nacs/disturbance", trials=10, seed=7)
>>> print(flown)                     # the tables that the command prints
>>> flown.signals.truth_rate         # what happened: an array with axes trial, time, axis
>>> flown.metrics                    # how good it was: a row a trial and metric
>>> flown.report()                   # a figure
>>> flown.show()                     # the Rerun viewer
>>> nacs.linearize().poles           # a linear model of the plant: A, B, C, D

Nothing is computed here: these are the commands' own parts. What goes wrong is a `NacsError` of one line.
"""

from __future__ import annotations

import nacs.checked_environment  # noqa: F401  # before anything else

# isort: split
from nacs.commands import Results, campaign, crosscheck, replay
from nacs.fmu import export_fmu
from nacs.linear import linearize, margins
from nacs.nacs_error import NacsError
from nacs.run import Run, run
from nacs.scenarios import load, scenarios
from nacs.twin import Twin

__all__ = [
    "NacsError",
    "Results",
    "Run",
    "Twin",
    "campaign",
    "crosscheck",
    "export_fmu",
    "linearize",
    "load",
    "margins",
    "replay",
    "run",
    "scenarios",
]
