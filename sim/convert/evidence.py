"""What physics says of a laboratory's columns: under which order, direction, signs, units and clock they fit each other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import permutations, product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from sim.convert.units import UNITS
from sim.replay.plausibility import ALIKE, FITS, TELLING, TIMES, Comparison, accelerations, misfits_of_stretches, turns

Array = NDArray[np.floating]

ROWS = 4000  # that are looked at
EVEN = 0.5  # share of the median by which most intervals of a clock differ from it at most
WINDOW = 16  # rows, over which turns are larger than noise
CLOCKS = {unit: UNITS["time"][unit] for unit in ("s", "ms", "us", "ns")}
RATE_UNITS = ("rad/s", "deg/s", "rpm")
TORQUE_UNITS = ("N m", "mN m")
ORDERS = ("scalar-last", "scalar-first")
READINGS = tuple((order, direction) for direction in ("q_BN", "q_NB") for order in ORDERS)  # as `turns` has them


class Turning(NamedTuple):
    """One way to read attitudes, rates and clock together.

    Attributes:
      order: of the quaternion's components.
      direction: of the quaternion.
      axes: which column of the rates is the first, the second and the third; (3,).
      signs: of the rates about them; (3,).
      unit: of the rates.
      clock: unit of the time stamps.
    """

    order: str
    direction: str
    axes: tuple[int, ...]
    signs: tuple[int, ...]
    unit: str
    clock: str

    @property
    def strangeness(self) -> tuple[int, int, bool]:
        """How many axes change places, how many signs change, and whether the direction is the rarer one."""
        return sum(i != axis for i, axis in enumerate(self.axes)), self.signs.count(-1), self.direction == "q_NB"


class Driving(NamedTuple):
    """One way to read wheel speeds and commands together.

    Attributes:
      unit: of the speeds.
      torque: unit of the commands.
      commands: which command is each wheel's.
      signs: of the commands.
    """

    unit: str
    torque: str
    commands: tuple[int, ...]
    signs: tuple[int, ...]


class Verdict(NamedTuple):
    """The reading that fits best, of those that fit alike the least strange one.

    Attributes:
      best: the reading.
      misfit: of its two sides: 0 alike, 1 unrelated, 2 opposite.
      alike: others that fit as well.
      next: misfit of the best of those that do not.
    """

    best: Any
    misfit: float
    alike: tuple[Any, ...]
    next: float


def scale(attitude: Array) -> float:
    """What the length of a quaternion is in the numbers of four columns, (rows, 4); 1 if within a per cent of it."""
    length = float(np.nanmedian(np.sqrt(np.sum(attitude**2, axis=-1))))
    return 1.0 if abs(length - 1.0) < 0.01 or not length > 0.0 else length


def ticks(values: Array) -> bool:
    """Whether a column, (rows,), only rises, and mostly by the same."""
    steps = np.diff(values)
    return len(steps) > 1 and bool((steps > 0.0).all()) and float(np.mean(np.abs(steps / np.median(steps) - 1.0) < EVEN)) > 0.9


def unit_quaternions(columns: dict[str, Array]) -> list[tuple[str, ...]]:
    """Neighbouring columns whose squares add up to one in nearly every row, four each."""
    names, found = list(columns), []
    for four in (names[i : i + 4] for i, _ in enumerate(names[:-3])):
        if len({len(columns[name]) for name in four}) > 1:
            continue
        square = np.sum(np.stack([columns[name] for name in four]) ** 2, axis=0)
        there = square[~np.isnan(square)]
        if len(there) and np.mean(np.abs(there - 1.0) < 0.02) > 0.99:
            found.append(tuple(four))
    return found


def period(attitude: Array, rates: Array, unit: str) -> float | None:
    """Seconds from row to row, under which rates in a unit turn as far as attitudes of any order; None: nothing turns."""
    rows = _liveliest(rates)
    compared = turns(np.arange(len(rates), dtype=float)[rows], np.concatenate([attitude / scale(attitude), rates], axis=-1)[rows])
    if not compared or len(compared[0].seen) < WINDOW:
        return None
    windows = len(compared[0].seen) // WINDOW
    seen, foretold = (side[: windows * WINDOW].reshape(windows, WINDOW, 3).sum(axis=1) for side in compared[0][:2])
    turned, swept = np.sum(seen**2), np.sum(foretold**2)
    return float(np.sqrt(turned / swept) / UNITS["rate"][unit]) if turned > 0.0 and swept > 0.0 else None


def turning(stamps: Array, attitude: Array, rates: Array, clocks: dict[str, float], orders: Sequence[str] = ORDERS) -> Verdict | None:
    """How attitudes, rates and time stamps fit each other; None: nothing tells.

    Args:
      stamps: (rows,) from zero on.
      attitude: four columns in any order, (rows, 4).
      rates: (rows, 3).
      clocks: units that the stamps may be in, and what each is in s.
      orders: those that the quaternion's components may have.
    """
    rows = _liveliest(rates)
    q = attitude[rows] / scale(attitude)
    compared: list[Comparison] = []
    readings: list[Turning] = []
    for axes in permutations((0, 1, 2)):
        by_reading = turns(stamps[rows], np.concatenate([q, rates[rows][:, axes]], axis=-1))
        for (order, direction), one in zip(READINGS, by_reading, strict=False):
            for signs in product((1, -1), repeat=3) if order in orders else ():
                ways = [Turning(order, direction, axes, signs, unit, clock) for unit in RATE_UNITS for clock in clocks]
                factors = [(UNITS["rate"][way.unit] * clocks[way.clock], ()) for way in ways]
                compared.append(Comparison(one.seen, one.foretold * np.array(signs), list(factors)))
                readings.extend(ways)
    return _chosen(readings, misfits_of_stretches(compared), lambda way: way.strangeness)


def _liveliest(rates: Array) -> slice:
    """The rows one after the other, so many as are looked at, in which the body turns most; rates are (rows, 3)."""
    total = np.concatenate([[0.0], np.cumsum(np.sum(np.nan_to_num(rates) ** 2, axis=-1))])
    if len(rates) <= ROWS:
        return slice(0, ROWS)
    begin = int(np.argmax(total[ROWS:] - total[:-ROWS]))
    return slice(begin, begin + ROWS)


def driving(time: Array, speeds: Array, commands: Array, inertia: Array) -> Verdict | None:
    """How wheel speeds and commands, (rows, wheels), fit each other along a time in s; None: nothing tells.

    Args:
      time: (rows,) s.
      speeds: as they stand in the file.
      commands: likewise.
      inertia: of the wheels, kg m2; one number, or (wheels,).
    """
    wheels = speeds.shape[-1]
    rows, each = slice(0, ROWS), np.broadcast_to(inertia, (wheels,))
    ways = [(unit, torque, sign) for unit in RATE_UNITS for torque in TORQUE_UNITS for sign in (1, -1)]
    factors = [(sign * UNITS["torque"][torque] / UNITS["rate"][unit], ()) for unit, torque, sign in ways]
    score = np.ones((len(ways), wheels, wheels))
    for wheel, command in product(range(wheels), repeat=2):
        pair = accelerations(time[rows], speeds[rows, wheel, None], commands[rows, command, None] / each[wheel], TIMES[:1], TIMES[:1])
        misfit = misfits_of_stretches([one._replace(factors=list(factors)) for one in pair])
        if misfit.size and np.any(telling := misfit.min(axis=0) < FITS):
            score[:, wheel, command] = np.mean(np.minimum(misfit[:, telling], 1.0), axis=-1)
    readings, totals = [], []
    for unit, torque in product(RATE_UNITS, TORQUE_UNITS):
        by_sign = np.stack([score[ways.index((unit, torque, sign))] for sign in (1, -1)])
        least = by_sign.min(axis=0)
        _, whose = linear_sum_assignment(least)
        signs = tuple(1 if by_sign[0, i, j] <= by_sign[1, i, j] else -1 for i, j in enumerate(whose))
        readings.append(Driving(unit, torque, tuple(int(j) for j in whose), signs))
        totals.append([least[i, j] for i, j in enumerate(whose)])
    return _chosen(readings, np.array(totals), lambda way: (way.signs.count(-1),))


def _chosen(readings: list[Any], misfit: Array, strangeness: Callable[[Any], tuple[Any, ...]]) -> Verdict | None:
    """The least strange of the readings that fit as well as the best; misfits are (readings, stretches)."""
    telling = misfit.size > 0 and misfit.min(axis=0) < FITS
    if np.sum(telling) < max(1.0, TELLING * misfit.shape[-1]):
        return None
    score = np.mean(np.minimum(misfit[:, telling], 1.0), axis=-1)
    alike = np.flatnonzero(score <= score.min() + ALIKE)
    if score.min() >= FITS:
        return None
    by_strangeness = sorted(alike.tolist(), key=lambda i: (strangeness(readings[i]), score[i]))
    others = np.delete(score, alike)
    best = by_strangeness[0]
    return Verdict(
        readings[best], float(score[best]), tuple(readings[i] for i in by_strangeness[1:]), float(others.min()) if len(others) else 1.0
    )
