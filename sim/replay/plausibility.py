"""Whether a log can be true: its rates against successive attitudes, its wheel speeds against what the motors were told.

Each unit, order or sign that logs are often wrong in is a reading of the log by other eyes. Of all of them that one is believed under
which the two sides of the comparison fit best, in most stretches of the log that tell at all. Faults, noise and rest tell nothing: under
no reading do the sides fit then. Nothing is said of a log that fits as it stands.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.attitude import quaternion
from models.dynamics.state_layout import ATTITUDE, POSITION, RATE, VELOCITY, WHEELS
from sim.loop.build import assembly_of
from sim.replay.flight_log import FlightLog
from sim.units import RPM

Array = NDArray[np.floating]
Verdict = tuple[str, ...]  # what a log looks like; empty: as it should

AS_IT_IS, BETTER = 0.1, 4.0  # misfit up to which a log fits as it stands, or how many times better another reading must fit it
FITS, ALIKE = 0.2, 0.02  # misfit below which a stretch tells, and difference of misfits that tells nothing
TELLING = 0.2  # share of the stretches that must fit some reading
STRETCHES, WINDOWS = 10, 8  # most of them in a trial, and least number of windows in each
LENGTHS = (1, 4, 16, 64)  # rows of a window
LONGEST = 5.0  # steps of the attitude, in their median, across which a turn is not followed
ROWS = 40_000  # of a trial that are looked at


class Unit(NamedTuple):
    """Another way to read a quantity.

    Attributes:
      factor: what the numbers are to be multiplied by.
      said: what the log looks like; empty: as it should.
    """

    factor: float
    said: str = ""


class Comparison(NamedTuple):
    """Two sides that ought to be equal, (rows, components), and what the log looks like if they differ by a factor.

    Attributes:
      seen: increments from row to row.
      foretold: what else in the log says that they are.
      factors: of seen to foretold, each with what is then to be said, nothing of the log as it stands.
    """

    seen: Array
    foretold: Array
    factors: list[tuple[float, Verdict]]


TAKEN_FOR_MS = Unit(1e3, "times look like s taken for ms")
TIMES = (
    Unit(1.0),
    Unit(1e-3, "times look like ms"),
    Unit(1e-6, "times look like us"),
    Unit(1e-9, "times look like ns"),
    TAKEN_FOR_MS,
)
RATES = (
    Unit(1.0),
    Unit(np.pi / 180.0, "rates look like deg/s"),
    Unit(RPM, "rates look like rpm"),
    Unit(-1.0, "rates have the opposite sign"),
    Unit(-np.pi / 180.0, "rates look like deg/s of the opposite sign"),
    Unit(180.0 / np.pi, "rates look like rad/s taken for deg/s"),
    Unit(1.0 / RPM, "rates look like rad/s taken for rpm"),
)
FORWARD = tuple(unit for unit in RATES if unit.factor > 0.0)  # of the opposite sign they are those from B to N, but for the frame
SCALAR_FIRST, FROM_B_TO_N = "quaternions look scalar first", "quaternions look like those from B to N"
BOTH = f"{SCALAR_FIRST} and from B to N"
SPEEDS = (  # not rad/s taken for rpm: a motor that gives a tenth looks like that
    Unit(1.0),
    Unit(RPM, "wheel speeds look like rpm"),
    Unit(np.pi / 180.0, "wheel speeds look like deg/s"),
    Unit(180.0 / np.pi, "wheel speeds look like rad/s taken for deg/s"),
)
COMMANDS = (
    Unit(1.0),
    Unit(-1.0, "commands have the opposite sign"),
    Unit(1e-3, "commands look like mN m"),
    Unit(-1e-3, "commands look like mN m of the opposite sign"),
    Unit(1e3, "commands look like N m taken for mN m"),
    Unit(-1e3, "commands look like N m taken for mN m of the opposite sign"),
)
PLACES = (Unit(1.0), Unit(1e-3, "positions look like mm"))
VELOCITIES = (Unit(1.0), Unit(-1.0, "velocities have the opposite sign"))


def complaints(log: FlightLog, scenario: Any) -> list[tuple[int, str]]:
    """What does not fit in a log, as (trial, sentence); nothing where all fits or nothing tells.

    Args:
      log: readings and commands.
      scenario: whose plant it is said to be of.
    """
    if np.isnan(log.reading).all():
        return [(int(trial), "no row has a reading") for trial in log.trials]
    check, rows = CHECKS[scenario.family], slice(0, ROWS)
    return [
        (int(trial), sentence)
        for i, trial in enumerate(log.trials)
        for sentence in check(log.time[rows, i], log.reading[rows, i], log.known[rows, i], scenario)
    ]


def _of_a_body(time: Array, reading: Array, command: Array, scenario: Any) -> list[str]:
    """Of readings (rows, 7 + wheels), and commands (rows, wheels) or, without wheels, (rows, 3)."""
    assembly = assembly_of(scenario)
    turned = turns(time, reading)
    turning = _judged(turned, misfits_of_stretches(turned))
    clock: Sequence[Unit] = TIMES
    if turning is not None:  # the turns have told what time is
        clock = tuple(Unit(unit.factor) for unit in TIMES[1:] if unit.said in " ".join(turning)) or TIMES[:1]
    wheels = reading[:, WHEELS].T
    if len(wheels):
        told = command.T / assembly.wheel_inertia
        pairs = [accelerations(time, speed[:, None], rate[:, None], SPEEDS, clock) for speed, rate in zip(wheels, told, strict=True)]
    else:
        momentum = reading[:, RATE] @ assembly.inertia
        torque = command - quaternion.cross(reading[:, RATE], momentum)
        pairs = [accelerations(time, momentum, torque, RATES[:1], clock)] if turning == () else [[]]
    driven = _judged(pairs[0], np.concatenate([misfits_of_stretches(pair) for pair in pairs], axis=-1)) if pairs[0] else None
    return list(dict.fromkeys([*(turning or ()), *(driven or ())]))


def _of_agents_in_the_plane(time: Array, reading: Array, known: Array, scenario: Any) -> list[str]:  # noqa: ARG001
    """Of readings (rows, agents, 4)."""
    place, speed = (reading[..., part].reshape(len(time), -1) for part in (POSITION, VELOCITY))
    speed = np.where(np.isnan(speed), 0.0, speed)
    foretold = 0.5 * (speed[1:] + speed[:-1]) * np.diff(time)[:, None]
    factors = _product(PLACES, VELOCITIES, [unit for unit in TIMES if unit != TAKEN_FOR_MS])  # which is the same number as mm
    moves = [Comparison(np.nan_to_num(np.diff(place, axis=0)), foretold, factors)]
    return list(_judged(moves, misfits_of_stretches(moves)) or ())


def _of_a_formation(time: Array, reading: Array, known: Array, scenario: Any) -> list[str]:  # noqa: ARG001
    """Its logs have attitudes alone, and nothing that they could be held against."""
    return []


CHECKS: dict[str, Callable[[Array, Array, Array, Any], list[str]]] = {
    "body": _of_a_body,
    "formation": _of_a_formation,
    "consensus": _of_agents_in_the_plane,
}


def _product(seen: Sequence[Unit], foretold: Sequence[Unit], clock: Sequence[Unit], order: str = "") -> list[tuple[float, Verdict]]:
    """Factors of the foretold side against the seen one, whose order has a verdict of its own."""
    return [
        (there.factor * when.factor / here.factor, tuple(part for part in (order, here.said, there.said, when.said) if part))
        for here, there, when in product(seen, foretold, clock)
    ]


def turns(time: Array, reading: Array) -> list[Comparison]:
    """Turns from attitude to attitude beside the rates between them, by every order of the quaternion."""
    there = np.flatnonzero(~np.isnan(reading[:, ATTITUDE]).any(axis=-1))
    known = np.asarray(~np.isnan(reading[:, RATE]).any(axis=-1))
    if len(there) < 2 or np.sum(known) < 2:
        return []
    rate = np.stack([np.interp(time, time[known], column[known]) for column in reading[:, RATE].T], axis=-1)
    swept = np.concatenate([np.zeros((1, 3)), np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time)[:, None], axis=0)])
    step = np.diff(time[there])
    followed = (step <= LONGEST * np.median(step)) & _read_between(known, there)
    foretold, q = np.diff(swept[there], axis=0)[followed], reading[there][:, ATTITUDE]
    first = np.roll(q, -1, axis=-1)
    orders = (("", q), (SCALAR_FIRST, first), (FROM_B_TO_N, quaternion.inverse(q)), (BOTH, quaternion.inverse(first)))
    return [
        Comparison(
            quaternion.error(attitude[1:], attitude[:-1])[followed],
            foretold,
            _product(RATES[:1], FORWARD if "B to N" in order else RATES, TIMES, order),
        )
        for order, attitude in orders
    ]


def _read_between(known: NDArray[np.bool_], nodes: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether anything was read in each span from node to node, both included."""
    count = np.concatenate([[0], np.cumsum(known)])
    return count[nodes[1:] + 1] > count[nodes[:-1]]


def accelerations(time: Array, speed: Array, acceleration: Array, speeds: Sequence[Unit], clock: Sequence[Unit]) -> list[Comparison]:
    """Changes of speed (rows, n) beside those that drives were told to make, (rows, n)."""
    there = np.flatnonzero(~np.isnan(speed).any(axis=-1))
    if len(there) < 2:
        return []
    told = np.concatenate([np.zeros((1, speed.shape[-1])), np.cumsum(np.nan_to_num(acceleration[:-1]) * np.diff(time)[:, None], axis=0)])
    commands = COMMANDS if len(clock) == 1 else COMMANDS[:2]  # mN m for N m is the same number as ms for s
    return [Comparison(np.diff(speed[there], axis=0), np.diff(told[there], axis=0), _product(speeds, commands, clock))]


def _judged(comparisons: list[Comparison], misfit: Array) -> Verdict | None:
    """What a log looks like, of the misfits (readings, stretches) of all readings of it; (): as it should; None: nothing tells.

    Stretches that fit none of the readings do not count. Readings that fit as well as the best are said with it.
    """
    said = [verdict for one in comparisons for _, verdict in one.factors]
    telling = misfit.size > 0 and misfit.min(axis=0) < FITS
    if np.sum(telling) < max(1.0, TELLING * misfit.shape[-1]):
        return None
    score = np.mean(np.minimum(misfit[:, telling], 1.0), axis=-1)
    plain, best = score[said.index(())], float(np.min(score))
    if plain <= max(AS_IT_IS, BETTER * best):
        return ()
    if best >= FITS:
        return None
    alike = [verdict for verdict, misfits in zip(said, score, strict=True) if misfits <= best + ALIKE]
    return alike[0] if len(alike) == 1 else (" or ".join(" and ".join(one) for one in alike),)


def misfits_of_stretches(comparisons: list[Comparison]) -> Array:
    """Misfits of all readings of a trial in each of its stretches, with windows of the length that tells most; (readings, stretches)."""
    rows = len(comparisons[0].seen) if comparisons else 0
    best = np.zeros((sum(len(one.factors) for one in comparisons), 0))
    for length in LENGTHS:
        stretches = min(STRETCHES, rows // length // WINDOWS)
        if not stretches:
            break
        misfit = np.concatenate([_misfit(one, length, stretches) for one in comparisons])
        if not best.size or _telling(misfit) > _telling(best):
            best = misfit
    return best


def _telling(misfit: Array) -> float:
    """Share of the stretches that fit some reading, and among equal shares the better fit."""
    least = np.min(misfit, axis=0)
    return float(np.mean(least < FITS) + 0.01 * (1.0 - np.mean(np.minimum(least, 1.0))))


def _misfit(one: Comparison, length: int, stretches: int) -> Array:
    """Square of the difference over the sum of the squares: 0 if alike, 1 if unrelated, 2 if opposite; (factors, stretches)."""
    windows = len(one.seen) // length // stretches
    rows = windows * length * stretches
    seen, foretold = (np.sum(side[:rows].reshape(stretches, windows, length, -1), axis=2) for side in (one.seen, one.foretold))
    square, other, between = (np.sum(a * b, axis=(-2, -1)) for a, b in ((seen, seen), (foretold, foretold), (seen, foretold)))
    factor = np.array([[k] for k, _ in one.factors])
    size = square + factor**2 * other
    return np.where(size > 0.0, 1.0 - 2.0 * factor * between / np.where(size > 0.0, size, 1.0), 1.0)
