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

AS_IT_IS = 0.5  # misfit below which a stretch fits as it stands
FITS = 0.2  # misfit below which a stretch fits another reading of it
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


TIMES = (Unit(1.0), Unit(1e-3, "times look like ms"), Unit(1e-6, "times look like us"), Unit(1e-9, "times look like ns"))
RATES = (
    Unit(1.0),
    Unit(np.pi / 180.0, "rates look like deg/s"),
    Unit(RPM, "rates look like rpm"),
    Unit(1e-3, "rates look like mrad/s"),
    Unit(-1.0, "rates have the opposite sign"),
    Unit(-np.pi / 180.0, "rates look like deg/s of the opposite sign"),
)
FORWARD = tuple(unit for unit in RATES if unit.factor > 0.0)  # of the opposite sign they are those from B to N, but for the frame
SCALAR_FIRST, FROM_B_TO_N = "quaternions look scalar first", "quaternions look like those from B to N"
BOTH = f"{SCALAR_FIRST} and from B to N"
SPEEDS = (
    Unit(1.0),
    Unit(RPM, "wheel speeds look like rpm"),
    Unit(np.pi / 180.0, "wheel speeds look like deg/s"),
    Unit(2.0 * np.pi, "wheel speeds look like revolutions per second"),
)
COMMANDS = (
    Unit(1.0),
    Unit(-1.0, "commands have the opposite sign"),
    Unit(1e-3, "commands look like mN m"),
    Unit(-1e-3, "commands look like mN m of the opposite sign"),
)
PLACES = (Unit(1.0), Unit(1e-3, "positions look like mm"))
VELOCITIES = (Unit(1.0), Unit(-1.0, "velocities have the opposite sign"))


def complaints(log: FlightLog, scenario: Any) -> list[tuple[int, str]]:
    """What does not fit in a log, as (trial, sentence); nothing where all fits or nothing tells.

    Args:
      log: readings and commands.
      scenario: whose plant it is said to be of.
    """
    check, rows = CHECKS[scenario.family], slice(0, ROWS)
    return [
        (int(trial), sentence)
        for i, trial in enumerate(log.trials)
        for sentence in check(log.time[rows, i], log.reading[rows, i], log.known[rows, i], scenario)
    ]


def _of_a_body(time: Array, reading: Array, command: Array, scenario: Any) -> list[str]:
    """Of readings (rows, 7 + wheels), and commands (rows, wheels) or, without wheels, (rows, 3)."""
    assembly = assembly_of(scenario)
    turning = _majority(_stretches(_turns(time, reading)))
    clock = TIMES if turning is None else tuple(unit for unit in TIMES if unit.said and unit.said in turning) or TIMES[:1]
    wheels = reading[:, WHEELS].T
    if len(wheels):
        told = command.T / assembly.wheel_inertia
        pairs = [_accelerations(time, speed[:, None], rate[:, None], SPEEDS, clock) for speed, rate in zip(wheels, told, strict=True)]
    else:
        momentum = reading[:, RATE] @ assembly.inertia
        torque = command - quaternion.cross(reading[:, RATE], momentum)
        pairs = [_accelerations(time, momentum, torque, RATES[:1], clock)] if turning == () else []
    driven = _majority([vote for pair in pairs for vote in _stretches(pair)])
    return list(dict.fromkeys([*(turning or ()), *(driven or ())]))


def _of_agents_in_the_plane(time: Array, reading: Array, known: Array, scenario: Any) -> list[str]:  # noqa: ARG001
    """Of readings (rows, agents, 4)."""
    place, speed = (reading[..., part].reshape(len(time), -1) for part in (POSITION, VELOCITY))
    speed = np.where(np.isnan(speed), 0.0, speed)
    foretold = 0.5 * (speed[1:] + speed[:-1]) * np.diff(time)[:, None]
    factors = _product(PLACES, VELOCITIES, TIMES)
    return list(_majority(_stretches([Comparison(np.nan_to_num(np.diff(place, axis=0)), foretold, factors)])) or ())


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


def _turns(time: Array, reading: Array) -> list[Comparison]:
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


def _accelerations(time: Array, speed: Array, acceleration: Array, speeds: Sequence[Unit], clock: Sequence[Unit]) -> list[Comparison]:
    """Changes of speed (rows, n) beside those that drives were told to make, (rows, n)."""
    there = np.flatnonzero(~np.isnan(speed).any(axis=-1))
    if len(there) < 2:
        return []
    told = np.concatenate([np.zeros((1, speed.shape[-1])), np.cumsum(np.nan_to_num(acceleration[:-1]) * np.diff(time)[:, None], axis=0)])
    commands = COMMANDS if len(clock) == 1 else COMMANDS[:2]  # mN m for N m is the same number as ms for s
    return [Comparison(np.diff(speed[there], axis=0), np.diff(told[there], axis=0), _product(speeds, commands, clock))]


def _majority(votes: list[Verdict | None]) -> Verdict | None:
    """What most of the stretches that tell look like; (): as they should; None: too few of them tell."""
    told = [vote for vote in votes if vote is not None]
    if len(told) < max(1.0, TELLING * len(votes)):
        return None
    best = max(dict.fromkeys(told), key=told.count)
    return best if told.count(best) > len(told) / 2 else None


def _stretches(comparisons: list[Comparison]) -> list[Verdict | None]:
    """What each stretch of a trial looks like, with windows of the length that shows most of them best; None: like nothing known."""
    rows = len(comparisons[0].seen) if comparisons else 0
    said = [verdict for one in comparisons for _, verdict in one.factors]
    best: list[Verdict | None] = []
    for length in LENGTHS:
        stretches = min(STRETCHES, rows // length // WINDOWS)
        if not stretches:
            break
        misfit = np.concatenate([_misfit(one, length, stretches) for one in comparisons])
        votes = [_vote(said, column) for column in misfit.T]
        if not best or _telling(votes) > _telling(best):
            best = votes
    return best


def _telling(votes: list[Verdict | None]) -> float:
    return sum(vote is not None for vote in votes) / len(votes)


def _misfit(one: Comparison, length: int, stretches: int) -> Array:
    """Square of the difference over the sum of the squares: 0 if alike, 1 if unrelated, 2 if opposite; (factors, stretches)."""
    windows = len(one.seen) // length // stretches
    rows = windows * length * stretches
    seen, foretold = (np.sum(side[:rows].reshape(stretches, windows, length, -1), axis=2) for side in (one.seen, one.foretold))
    square, other, between = (np.sum(a * b, axis=(-2, -1)) for a, b in ((seen, seen), (foretold, foretold), (seen, foretold)))
    factor = np.array([[k] for k, _ in one.factors])
    size = square + factor**2 * other
    return np.where(size > 0.0, 1.0 - 2.0 * factor * between / np.where(size > 0.0, size, 1.0), 1.0)


def _vote(said: list[Verdict], misfit: Array) -> Verdict | None:
    """What a stretch looks like, of the misfits of all readings of it; None: like none of them."""
    if misfit[said.index(())] < AS_IT_IS:
        return ()
    best = int(np.argmin(misfit))
    return said[best] if misfit[best] < FITS else None
