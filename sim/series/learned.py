"""What loops have learned of the unmodelled torque in one trial, as curves, whatever draws them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from sim.series.channels import Curve
from sim.series.loops import Flight, moving_rms, window
from sim.series.palette import TRUTH

Array = NDArray[np.floating]

UNIT, SCALE = "mN m", 1e3


def learners(several: tuple[Flight, ...]) -> tuple[Flight, ...]:
    """Loops that are closed by an observer that learns something."""
    found = []
    for flight in several:
        torque = flight.recording.channels.get(f"{flight.closing}/learned")
        if torque is not None and torque.any():
            found.append(flight)
    return tuple(found)


def learned(flight: Flight) -> Array:
    """The learned torque, (ticks, 3) mN m in B."""
    return SCALE * flight.channel(f"{flight.closing}/learned")


def applied(flight: Flight) -> Array:
    """The unmodelled torque that the plant applies, (ticks, 3) mN m in B."""
    return SCALE * flight.channel("truth/unmodelled")


def torque_error(flight: Flight, ticks: int) -> Array:
    """Length of learned minus applied torque, RMS over so many ticks, (ticks,) mN m."""
    return moving_rms(np.linalg.norm(learned(flight) - applied(flight), axis=-1), ticks)


def learned_curves(several: tuple[Flight, ...]) -> Iterator[Curve]:
    """Learned torques about each axis beside the one that is applied in the last of the loops, and how far off each is."""
    found = learners(several)
    if not found:
        return
    names, colours = tuple(f"{flight.name} [{UNIT}]" for flight in found), tuple(flight.look.on_dark for flight in found)
    true = applied(found[-1])
    for axis, label in enumerate("xyz"):
        lines = np.stack([*(learned(flight)[:, axis] for flight in found), true[:, axis]], axis=-1)
        yield Curve(f"learned/torque_{label}", (*names, f"applied in {found[-1].name} [{UNIT}]"), (*colours, TRUTH), lines, 1.2)
    errors = np.stack([torque_error(flight, window(several)) for flight in found], axis=-1)
    yield Curve("learned/error", names, colours, errors, 1.2)
