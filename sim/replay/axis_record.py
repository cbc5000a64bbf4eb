"""A log as the record of one axis: torque about it, angle and rate, as a candidate controller of that axis alone is judged by."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.attitude import quaternion
from models.dynamics.state_layout import ATTITUDE, MOTION, RATE
from models.plants.assembly import Assembly
from sim.bad_input import BadInput
from sim.replay.flight_log import FlightLog
from sim.replay.time_stamps import without_gaps

Array = NDArray[np.floating]

ALONE_DEG = 30.0  # turn up to which rotations about the axes add up, within 15 %
FARTHEST_DEG = 150.0  # beyond it a rotation vector may jump


class AxisRecord(NamedTuple):
    """What was told to the plant about one axis, and what it did; (ticks, trials) each."""

    time: Array  # (ticks,) s, from the log's first row
    torque: Array  # N m on the body
    angle: Array  # rad, component of the rotation vector from N
    rate: Array  # rad/s


def axis_records(label: str, log: FlightLog, assembly: Assembly) -> tuple[tuple[AxisRecord, AxisRecord, AxisRecord], tuple[str, ...]]:
    """Records of the body's three axes, and what is to be said of them.

    Missing readings are the last ones that there were, gaps are filled at the log's period with the command held, and intervals that
    jitter count as the period. A last row without a command is left out.

    Args:
      label: of the log, for complaints.
      log: of one body; its commands are motor torques on the wheels, or torques on a body without wheels.
      assembly: the plant, whose wheel axes say what torque the body felt.

    Raises:
      BadInput: the body turns so far that it has no angles about its axes, or nothing was read.
    """
    notes = []
    if log.intervals is not None:
        worst = float(np.max(np.abs(log.intervals / log.dt - 1.0)))
        notes.append(
            f"{label}: intervals differ from the period of {log.dt:g} s by up to {100.0 * worst:.2g} %; they are taken as the period"
        )
    log, _ = without_gaps(log)
    known = ~np.isnan(log.known).any(axis=(1, 2))
    command, reading = log.known[known], log.reading[known]
    reading = reading.copy()
    reading[np.isnan(reading[..., ATTITUDE]).any(axis=-1), ATTITUDE] = np.nan
    reading = _held(label, reading)
    torque = -np.einsum("aw,ktw->kta", assembly.wheel_axes, command) if assembly.wheel_joints else command
    turn = quaternion.to_rotation_vector(reading[..., ATTITUDE])
    farthest = float(np.degrees(np.max(np.linalg.norm(turn, axis=-1))))
    if farthest > FARTHEST_DEG:
        raise BadInput(
            f"{label}: the body turns by up to {farthest:.0f} deg; its axes have angles of their own up to {FARTHEST_DEG:.0f} deg"
        )
    if farthest > ALONE_DEG:
        notes.append(f"{label}: the body turns by up to {farthest:.0f} deg, where each axis on its own is a coarse picture")
    time = log.dt * np.arange(len(command))
    first, second, third = (AxisRecord(time, torque[..., i], turn[..., i], reading[..., RATE][..., i]) for i in (0, 1, 2))
    return (first, second, third), tuple(notes)


def _held(label: str, reading: Array) -> Array:
    """Attitudes and rates with missing components replaced by the last ones before, at the start by the first ones after; (ticks, ...)."""
    moving = reading[..., MOTION]
    there = ~np.isnan(moving)
    if not there.any(axis=0).all():
        raise BadInput(f"{label}: attitude or rate was never read")
    row = np.arange(len(moving)).reshape(-1, *(1,) * (moving.ndim - 1))
    last = np.maximum.accumulate(np.where(there, row, -1), axis=0)
    return np.take_along_axis(moving, np.where(last < 0, np.argmax(there, axis=0), last), axis=0)
