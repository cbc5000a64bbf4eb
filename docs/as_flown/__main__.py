"""The inference, step by step: `python -m docs.as_flown fly`, `refine` (as often as there is patience), `infer`.

`fly` makes the flights of a Sobol design, `refine` adds flights where the posterior of those that there are is, and `infer` makes
docs/as-flown.toml, docs/as-flown.png and the tables of docs/as-flown.md. What was flown is kept in docs/as_flown/flights.npz.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from docs.as_flown.causes import ALL, TABLES
from docs.as_flown.emulator import Emulator, emulate, flights, printed, without
from docs.as_flown.flights import fly, keep, sobol
from docs.as_flown.picture import draw
from docs.as_flown.posterior import Posterior, infer
from docs.as_flown.words import listed, tables

Array = NDArray[np.floating]

DOCS = Path(__file__).parents[1]
FLOWN = Path(__file__).with_name("flights.npz")
TRIALS = 2  # at each point
FIRST = 6  # power of two: points of the Sobol design
ADDED = 64  # points of a refinement
WIDER = 1.5  # than the posterior are the points of a refinement about its mean
FITS = (*(without(table) for table in ALL), ALL, *((table,) for table in ALL))


def first_flights() -> None:
    """The Sobol design."""
    shares = sobol(FIRST)
    keep(FLOWN, shares, np.stack([_flown(table, shares, 0) for table in ALL]))


def refine() -> None:
    """Flights at points of the posteriors that each leave a table out, somewhat widened."""
    shares, residuals = flights(FLOWN)
    emulators = emulated(shares, residuals)
    fits = [infer(emulators, printed(), without(table), steps=600) for table in ALL]
    rng = np.random.default_rng(len(shares))
    each = [fit.mean + WIDER * (rng.permutation(fit.shares)[: ADDED // len(fits)] - fit.mean) for fit in fits]
    added = np.clip(np.concatenate(each), 0.0, 1.0)
    new = np.stack([_flown(table, added, TRIALS * len(shares)) for table in ALL])
    keep(FLOWN, np.concatenate([shares, added]), np.concatenate([residuals, new], axis=1))


def infer_all() -> None:
    """Every posterior, what is written of it, and the picture."""
    emulators = emulated(*flights(FLOWN))
    posteriors = []
    for chosen in FITS:
        posteriors.append(infer(emulators, printed(), chosen))
        _say(posteriors[-1])
    fits: dict[tuple[int, ...], Posterior] = {one.tables: one for one in posteriors}
    (DOCS / "as-flown.toml").write_text(listed(fits), encoding="utf-8")
    draw(fits, DOCS / "as-flown.png")
    print(tables(emulators, fits))


def emulated(shares: Array, residuals: Array) -> dict[int, Emulator]:
    """An emulator of each table."""
    return {table: emulate(table, shares, residuals[table]) for table in ALL}


def _flown(table: int, shares: Array, first: int) -> Array:
    began = time.process_time()
    residuals = fly(table, shares, first, TRIALS)
    print(f"{TABLES[table]}: {residuals[..., 0, 0].size} flights, {time.process_time() - began:.0f} s of a processor", file=sys.stderr)
    return residuals


def _say(fit: Posterior) -> None:
    names = ", ".join(str(table + 1) for table in fit.tables)
    print(f"tables {names}: worth {fit.effective:.0f} samples, accepted {fit.accepted:.2f}", file=sys.stderr)


COMMANDS: dict[str, Callable[[], None]] = {"fly": first_flights, "refine": refine, "infer": infer_all}

if __name__ == "__main__":
    COMMANDS[sys.argv[1]]()
