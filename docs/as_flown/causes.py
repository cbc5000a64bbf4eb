"""Physical causes that the printed tables are asked about: their ranges before the tables are seen, and the settings they stand for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.units import RPM

Array = NDArray[np.floating]

TABLES = ("fault-free", "disturbance", "effectiveness-loss", "wheel-failure")  # tables 1 to 4 of the paper
ALL = (0, 1, 2, 3)
MOTOR_CONSTANT = 0.01404  # V s/rad, of the plant
PERIOD_RATIO = (1.0, 1.25, 1.0)  # of the periods about roll, pitch and yaw, so that the sinusoids are not alike
TILT_RATIO = 2.0 / 3.0  # of the amplitudes in pitch and roll
OFF_CENTRE = (0.78, -0.62)  # direction of the offset of the centre of mass in the plate's plane
BELOW_UM = 1.0
SPREAD = 0.13  # of pushes by hand, either way
PAUSE_S = 0.2  # from the end of a push to the one that stops it


class Cause(NamedTuple):
    """One number of the testbed that nobody printed.

    Attributes:
      name: as it is written.
      unit: in which `low` and `high` are.
      low: end of its range.
      high: end of its range; within it the logarithm is uniform before a table is seen, or the number itself if not `log`.
      tables: places in TABLES of those in whose flights it acts.
      log: whether its logarithm is the coordinate.
    """

    name: str
    unit: str
    low: float
    high: float
    tables: tuple[int, ...] = ALL
    log: bool = True

    def of_share(self, share: Array) -> Array:
        """Values at places in [0, 1] of the range."""
        if self.log:
            return self.low * (self.high / self.low) ** share
        return self.low + (self.high - self.low) * share

    def share_of(self, value: Array | float) -> Array:
        """Places in the range, the inverse of `of_share`."""
        if self.log:
            return np.log(np.asarray(value) / self.low) / np.log(self.high / self.low)
        return (np.asarray(value) - self.low) / (self.high - self.low)


CAUSES = (
    Cause("gyro noise", "mrad/s", 2.0, 14.0),
    Cause("attitude noise", "mrad", 0.1, 0.6),
    Cause("jitter of readings", "ms", 0.2, 6.0),
    Cause("torque of the air", "mN m", 0.05, 2.0),
    Cause("its correlation time", "s", 0.02, 0.3),
    Cause("top speed of the wheels", "rpm", 1500.0, 8000.0),
    Cause("dry friction of the wheels", "mN m", 0.005, 0.3),
    Cause("centre of mass off the axis", "um", 0.3, 10.0),
    Cause("yaw rate asked for, peak", "rad/s", 0.04, 0.3),
    Cause("period of the reference", "s", 6.0, 24.0),
    Cause("roll asked for", "deg", 2.0, 10.0),
    Cause("push about roll", "mN m s", 3.0, 30.0, (1,)),
    Cause("push about pitch", "mN m s", 3.0, 30.0, (1,)),
    Cause("duration of a push", "s", 0.05, 0.65, (1,), log=False),
    Cause("share of a push that is stopped", "1", 0.6, 1.1, (1,), log=False),
    Cause("friction of the wheel without power", "mN m", 0.02, 2.0, (3,)),
)
NAMES = tuple(cause.name for cause in CAUSES)


def acting(table: int) -> NDArray[np.int64]:
    """Places among CAUSES of those that act in the flights of a table."""
    return np.array([place for place, cause in enumerate(CAUSES) if table in cause.tables])


def values_of(shares: Array) -> Array:
    """Values of all causes (..., causes) at places in the unit cube (..., causes)."""
    return np.stack([cause.of_share(shares[..., place]) for place, cause in enumerate(CAUSES)], axis=-1)


def settings(table: int, values: Mapping[str, float]) -> dict[str, Any]:
    """Keys of the scenario of a table that stand for these causes, in the keys' own units."""
    period = values["period of the reference"]
    yaw = np.degrees(values["yaw rate asked for, peak"] * period / (2.0 * np.pi))
    roll, aside = values["roll asked for"], values["centre of mass off the axis"]
    keys: dict[str, Any] = {
        "sensors.gyro_noise_rad_s": 1e-3 * values["gyro noise"],
        "sensors.attitude_noise_rad": 1e-3 * values["attitude noise"],
        "sensors.jitter_s": 1e-3 * values["jitter of readings"],
        "plant.air_torque_nm": 1e-3 * values["torque of the air"],
        "plant.air_torque_correlation_s": values["its correlation time"],
        "plant.supply_voltage_v": MOTOR_CONSTANT * RPM * values["top speed of the wheels"],
        "plant.wheel_coulomb_nm": 1e-3 * values["dry friction of the wheels"],
        "plant.centre_of_mass_um": [aside * OFF_CENTRE[0], aside * OFF_CENTRE[1], BELOW_UM],
        "reference.amplitude_deg": [roll, TILT_RATIO * roll, float(yaw)],
        "reference.period_s": [period * ratio for ratio in PERIOD_RATIO],
    }
    if table == 1:
        keys["faults"] = _pushes(values)
    if table == 3:
        keys["faults"] = [
            {"kind": "float", "wheel": 1, "start_s": 20.0, "duration_s": 40.0},
            {
                "kind": "friction",
                "wheel": 1,
                "torque_nm": 1e-3 * values["friction of the wheel without power"],
                "start_s": 20.0,
                "duration_s": 40.0,
            },
        ]
    return {key: _plain(value) for key, value in keys.items()}


def _pushes(values: Mapping[str, float]) -> list[dict[str, Any]]:
    """Two pushes by hand about roll and pitch, each stopped, in whole ticks of 0.1 s."""
    duration = max(1, round(10.0 * values["duration of a push"])) / 10.0
    stopped, pushes = values["share of a push that is stopped"], []
    for start, axis, name in ((30.0, [1.0, 0.0, 0.0], "push about roll"), (32.0, [0.0, 1.0, 0.0], "push about pitch")):
        torque = 1e-3 * values[name] / duration
        for begin, size in ((start, torque), (start + duration + PAUSE_S, -stopped * torque)):
            pushes.append(
                {
                    "kind": "external-torque",
                    "torque_nm": {"uniform": [abs(size) * (1.0 - SPREAD), abs(size) * (1.0 + SPREAD)]},
                    "direction": [np.sign(size) * part for part in axis],
                    "start_s": round(begin, 1),
                    "duration_s": duration,
                }
            )
    return pushes


def _plain(value: Any) -> Any:
    """NumPy's numbers as Python's."""
    if isinstance(value, list):
        return [_plain(part) for part in value]
    if isinstance(value, dict):
        return {key: _plain(part) for key, part in value.items()}
    return float(value) if isinstance(value, np.floating) else value
