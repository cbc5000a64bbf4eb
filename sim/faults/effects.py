"""What faults can do: a register of effects, each a quantity over time that some part of the loop reads."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sim.faults.parts import Parts

Array = NDArray[np.floating]


@dataclass(frozen=True)
class Effect:
    """A quantity that faults change.

    Attributes:
      name: of it.
      size: its axes behind trials and agents: how long each is, or as many as there are of something.
      neutral: its value while nothing is wrong, or what of the parts says it.
      each: it has an axis of agents, where there are several.
      flag: it is true or false.
      pulsation_rad_s: of the wave whose amplitude it is.
      numbered: its pulsation is multiplied by an agent's number.
    """

    name: str
    size: tuple[int | Literal["wheels", "axes", "gains", "sensors", "components", "messages"], ...]
    neutral: float | Literal["gains", "noise", "disturbance"] = 0.0
    each: bool = True
    flag: bool = False
    pulsation_rad_s: float | None = None
    numbered: bool = False

    def __hash__(self) -> int:
        return hash(self.name)

    def shape(self, parts: Parts) -> tuple[int, ...]:
        """Axes behind the trials."""
        return (*(parts.each if self.each else ()), *(parts.count(n) if isinstance(n, str) else n for n in self.size))

    def rest(self, parts: Parts) -> Array:
        """Its value while nothing is wrong, broadcast to those axes."""
        return np.asarray(getattr(parts, self.neutral) if isinstance(self.neutral, str) else self.neutral, dtype=float)


DRIVE_GAIN = Effect("drive gain", ("wheels",), 1.0)  # share of the torque that a drive is told that it gives
DRIVE_OFFSET = Effect("drive offset", ("wheels",))  # N m that it gives besides
LOCKED = Effect("locked", ("wheels",))  # how far a bearing has seized, 0 to 1
FRICTION = Effect("friction", ("wheels",))  # N m of dry friction in a bearing besides its own
COMMAND_GAIN = Effect("command gain", ("axes",), 1.0)  # share of what the law commands that is carried out
COMMAND_OFFSET = Effect("command offset", ("axes",))  # N m or N that is carried out besides
GAINS = Effect("gains", ("gains",), "gains")  # of a law
SLIDING = Effect("sliding", (2,))  # whether a constant stands for the sliding terms, and which, N
PUSH = Effect("push", ("axes",))  # on bodies from outside, N m in B or N
OWN_MASS = Effect("own mass", (1,), 1.0)  # share of a body's own inertia and centre of mass that counts
INERTIA = Effect("inertia", (3, 3))  # kg m2 besides
CENTRE_OF_MASS = Effect("centre of mass", (3,))  # m besides
DYNAMICS = Effect("dynamics", (2,), 1.0)  # factor of the unknown dynamics
DISTURBANCE = Effect("disturbance", (3,), "disturbance")  # amplitude N, rate rad/s, number of an agent
NOISE = Effect("noise", ("sensors",), "noise")  # deviation of each sensor, or factor of it
BIAS = Effect("bias", ("components",))  # of each component of a reading
MISSING = Effect("missing", ("sensors",), flag=True)  # a sensor says nothing
AGE = Effect("age", (1,))  # s, of what a reading describes
LOSS = Effect("loss", ("messages",), each=False)  # probability that a message is lost
MESSAGE_AGE = Effect("message age", (1,), each=False)  # s
CUT = Effect("cut", ("messages",), each=False, flag=True)  # a message's link is cut
ACTIVE = Effect("active", (), each=False, flag=True)  # some fault lasts


def wave(pulsation_rad_s: float, numbered: bool = False) -> Effect:
    """Amplitude of a torque a [sin pt, cos pt, sin 2pt], p being multiplied by an agent's number if `numbered`."""
    each = " times the number" if numbered else ""
    return Effect(f"wave of {pulsation_rad_s!r} rad/s{each}", (1,), pulsation_rad_s=pulsation_rad_s, numbered=numbered)


class Track:
    """An effect over a run: constant from one of its instants to the next.

    Attributes:
      starts: ticks from which on each value holds, the first being 0.
      values: (starts, trials or 1, ...), 1 where all trials are alike.
    """

    def __init__(self, starts: NDArray[np.int64], values: NDArray[Any]) -> None:
        self.starts: list[int] = starts.tolist()
        self.values = values

    def at(self, tick: int) -> NDArray[Any]:
        """The value at a tick, (trials or 1, ...)."""
        found: NDArray[Any] = self.values[bisect_right(self.starts, tick) - 1]
        return found

    def starts_at(self, tick: int) -> bool:
        """Whether another value may hold from that tick on."""
        place = bisect_left(self.starts, tick)
        return place < len(self.starts) and self.starts[place] == tick
