"""Units that laboratories write, by what is measured, in the units of a flight log."""

from __future__ import annotations

import re
from typing import Literal, NamedTuple

import numpy as np

from sim.units import RPM

DEG = np.pi / 180.0
Quantity = Literal["time", "rate", "torque", "momentum", "length", "velocity", "force", "number"]

# by quantity: each unit as a person writes it, and what one of it is in the unit of a log; the first is the log's own
UNITS: dict[Quantity, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0},
    "rate": {"rad/s": 1.0, "deg/s": DEG, "rpm": RPM, "mrad/s": 1e-3, "mdeg/s": 1e-3 * DEG, "rev/s": 2.0 * np.pi},
    "torque": {"N m": 1.0, "mN m": 1e-3, "uN m": 1e-6, "N cm": 1e-2, "gf cm": 9.80665e-5},
    "momentum": {"N m s": 1.0, "mN m s": 1e-3},
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "velocity": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3},
    "force": {"N": 1.0, "mN": 1e-3},
    "number": {"1": 1.0},
}
OTHER_SPELLINGS = {"dps": "deg/s", "degps": "deg/s", "sec": "s", "seconds": "s", "msec": "ms", "usec": "us", "µs": "us", "hz": "rev/s"}
_OF_COLUMNS: tuple[tuple[str, Quantity], ...] = (  # of a log, by what their names hold
    (r"omega|wheel", "rate"),
    (r"command|torque", "torque"),
    (r"momentum", "momentum"),
    (r"force", "force"),
    (r"_x\d", "length"),
    (r"_v\d|surface", "velocity"),
    (r"time_s", "time"),
)


class Said(NamedTuple):
    """A unit that some text names.

    Attributes:
      quantity: what it is a unit of.
      unit: as `UNITS` spells it.
    """

    quantity: Quantity
    unit: str


def quantity_of(column: str) -> Quantity:
    """What a column of a flight log measures."""
    return next((quantity for pattern, quantity in _OF_COLUMNS if re.search(pattern, column)), "number")


def factor(quantity: Quantity, unit: str | float) -> float:
    """What one of a unit is in the log's own; a number is that itself.

    Raises:
      ValueError: there is no such unit of the quantity.
    """
    if not isinstance(unit, str):
        return unit
    for name, size in UNITS[quantity].items():
        if _plain(name) == _plain(unit):
            return size
    known = ", ".join(UNITS[quantity])
    raise ValueError(f"unit {unit!r} is none of {quantity}; there are {known}, or give what one of it is in {next(iter(UNITS[quantity]))}")


def said_by(text: str, quantities: tuple[Quantity, ...]) -> Said | None:
    """The unit among those of some quantities that a text spells."""
    return next((Said(q, name) for q in quantities for name in UNITS[q] if _plain(name) == _plain(text)), None)


def _plain(text: str) -> str:
    """Without what people spell differently."""
    text = re.sub(r"[\s_*·.^]", "", text.replace("°", "deg")).lower()
    text = OTHER_SPELLINGS.get(text, text)
    return re.sub(r"[/]", "", text)
