"""The inference, step by step: `python -m docs.as_flown fly`, `refine` (as often as there is patience), `choose`, `infer`.

`fly` makes the flights of a Sobol design, `refine` adds flights where the posterior of those that there are is, `choose` flies
its likeliest samples for the scenarios' numbers, and `infer` makes
docs/as-flown.toml, docs/as-flown.png and the tables of docs/as-flown.md; `score FOLDER SEED ...` holds runs against print. What was
flown is kept in docs/as_flown/flights.npz.
"""

from __future__ import annotations

import argparse
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
from docs.as_flown.score import score
from docs.as_flown.words import FITTED, likeliest, listed, tables

Array = NDArray[np.floating]

DOCS = Path(__file__).parents[1]
FLOWN, CHOSEN = (Path(__file__).with_name(name) for name in ("flights.npz", "candidates.npz"))
TRIALS = 2  # at each point
FIRST = 6  # power of two: points of the Sobol design
ADDED = 64  # points of a refinement
CANDIDATES, CANDIDATE_TRIALS = 12, 4  # that are flown for the scenarios' numbers, and in how many trials each
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
    fits = [infer(emulators, printed(), without(table), steps=60) for table in ALL]
    rng = np.random.default_rng(len(shares))
    each = [fit.mean + WIDER * (rng.permutation(fit.shares)[: ADDED // len(fits)] - fit.mean) for fit in fits]
    added = np.clip(np.concatenate(each), 0.0, 1.0)
    new = np.stack([_flown(table, added, TRIALS * len(shares)) for table in ALL])
    keep(FLOWN, np.concatenate([shares, added]), np.concatenate([residuals, new], axis=1))


def choose() -> None:
    """Fly tables 1 to 3 at the likeliest samples of their posterior, for the scenarios' numbers."""
    fit = infer(emulated(*flights(FLOWN)), printed(), FITTED)
    best = np.argsort(-fit.densities)
    _, first = np.unique(fit.shares[best].round(6), axis=0, return_index=True)
    shares = fit.shares[best[np.sort(first)[:CANDIDATES]]]
    keep(CHOSEN, shares, np.stack([fly(table, shares, 1000, CANDIDATE_TRIALS) for table in FITTED]))


def infer_all() -> None:
    """Every posterior, what is written of it, and the picture."""
    emulators = emulated(*flights(FLOWN))
    posteriors = []
    for chosen in FITS:
        posteriors.append(infer(emulators, printed(), chosen))
        _say(posteriors[-1])
    fits: dict[tuple[int, ...], Posterior] = {one.tables: one for one in posteriors}
    (DOCS / "as-flown.toml").write_text(listed(fits, likeliest(*flights(CHOSEN))), encoding="utf-8")
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
    print(f"tables {names}: worth {fit.effective:.0f} samples", file=sys.stderr)


def held_against_print(folder: str, *seeds: str) -> None:
    """What `docs/as_flown/score.py` says of runs."""
    print("\n".join(score(Path(folder), seeds)))


COMMANDS: dict[str, Callable[..., None]] = {
    "fly": first_flights,
    "refine": refine,
    "choose": choose,
    "infer": infer_all,
    "score": held_against_print,
}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m docs.as_flown", description=__doc__)
    parser.add_argument("command", choices=COMMANDS)
    parser.add_argument("arguments", nargs="*", help="of `score`: a folder with runs, and their seeds")
    asked = parser.parse_args()
    COMMANDS[asked.command](*asked.arguments)
