"""Several closed loops on the same trial, set side by side: what of each is shown, whatever draws it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from control.gain_blending import blend
from models.attitude import quaternion
from models.attitude.euler_angles import to_euler_313, wrapped_difference
from models.dynamics.state_layout import ATTITUDE, RATE, WHEELS
from sim.estimators.settings import WheelMode
from sim.loop.recording import Recording
from sim.scenario.one_body import Scenario
from sim.scenario.references import EulerRates
from sim.series.channels import Curve, chi_square_band, degrees_of_freedom
from sim.series.line_styles import LineStyle, line_styles
from sim.series.palette import REFERENCE, wheel
from sim.units import RPM

Array = NDArray[np.floating]

LEAST = 1e-9  # deg or deg/s that is shown where errors are by decades
GAIN_UNITS = {"proportional_nm": "N m", "derivative_nms": "N m s", "slope_rad_s": "rad/s", "reaching_rad_s2": "rad/s2"}
GAIN_NAMES = {"proportional_nm": "K_p", "derivative_nms": "K_d", "slope_rad_s": "lambda", "reaching_rad_s2": "K"}


@dataclass(frozen=True, eq=False)
class Flight:
    """One closed loop in one trial.

    Attributes:
      name: of the loop.
      scenario: of this loop alone.
      recording: of one trial.
      look: how it is drawn.
    """

    name: str
    scenario: Scenario
    recording: Recording
    look: LineStyle

    def channel(self, name: str) -> Array:
        """A channel without its axis of trials, (ticks, ...)."""
        array = self.recording.channels[name]
        return array if name.startswith("reference/") else array[:, 0]

    @property
    def closing(self) -> str | None:
        """The observer that tells the controller the state; None if truth or readings do."""
        feedback = self.scenario.law.feedback
        return feedback if feedback in self.recording.observers else None

    @cached_property
    def angle(self) -> Array:
        """How far the true attitude is from the reference, (ticks,) deg."""
        return np.degrees(quaternion.angle(self.channel("truth/state")[:, ATTITUDE], self.channel("reference/q")))

    @property
    def axes(self) -> tuple[str, ...]:
        """What the three tracking errors are called."""
        return ("phi", "theta", "psi") if isinstance(self.scenario.reference, EulerRates) else ("x", "y", "z")

    @cached_property
    def errors(self) -> Array:
        """Tracking error of the true attitude, (ticks, 3) deg: by 3-1-3 Euler angles where the reference has rates of them, else in B."""
        truth, desired = self.channel("truth/state")[:, ATTITUDE], self.channel("reference/q")
        if isinstance(self.scenario.reference, EulerRates):
            return np.degrees(wrapped_difference(to_euler_313(truth), to_euler_313(desired)))
        return np.degrees(quaternion.error(truth, desired))

    @property
    def probabilities(self) -> Array | None:
        """Of each mode, (ticks, modes), as the controller was told them; None if nobody estimates the mode."""
        return self.channel(f"{self.closing}/modes") if f"{self.closing}/modes" in self.recording.channels else None

    @property
    def modes(self) -> tuple[str, ...]:
        """Names of the modes, the healthy one first."""
        return tuple(", ".join(_mode(fault) for fault in mode) or "healthy" for mode in self._believed)

    @property
    def wheels_of_modes(self) -> tuple[int | None, ...]:
        """The first wheel, from zero, that each mode is about; None: no wheel."""
        return tuple(mode[0].wheel - 1 if mode else None for mode in self._believed)

    @property
    def _believed(self) -> tuple[tuple[WheelMode, ...], ...]:
        observer = self.scenario.observers.get(self.closing or "")
        return () if observer is None else observer.mode_settings

    @property
    def gains(self) -> dict[str, Array]:
        """Gains that the law used, by key, (ticks,)."""
        ticks = self.recording.ticks
        return {key: np.broadcast_to(blend(gain, self.probabilities), (ticks,)) for key, gain in self.scenario.law.gains.items()}

    def error_of_estimate(self) -> Array:
        """Attitude error (deg) and rate error (deg/s) of the observer that closes the loop, (ticks, 2)."""
        truth, mean = self.channel("truth/state"), self.channel(f"{self.closing}/mean")
        attitude = quaternion.angle(quaternion.normalize(mean[:, ATTITUDE]), truth[:, ATTITUDE])
        return np.degrees(np.stack([attitude, np.linalg.norm(mean[:, RATE] - truth[:, RATE], axis=-1)], axis=-1))


def _mode(fault: WheelMode) -> str:
    said = {"float": "floats", "lock": "is locked", "hard-over": "is hard over", "effectiveness": "is weak"}
    return f"wheel {fault.wheel} {said[fault.kind]}"


def flights(scenario: Scenario, recordings: dict[str, Recording], position: int = 0) -> tuple[Flight, ...]:
    """The loops that were recorded, in one trial, given by its position among the recorded ones."""
    singles, styles = scenario.singles(), line_styles(scenario)
    which = np.array([position])
    return tuple(Flight(name, singles[name], recording.select(which), styles[name]) for name, recording in recordings.items())


def edges(several: tuple[Flight, ...]) -> list[int]:
    """Ticks at which a fault begins or ends in any of the loops; the loops without it are cut there too, to be compared."""
    ends = {tick for flight in several for o in flight.recording.occurrences for tick in (o.start_tick, o.end_tick)}
    last = max(flight.recording.ticks for flight in several)
    return sorted(tick for tick in ends if 0 < tick < last)


def running_rms(values: Array, restarts: list[int]) -> Array:
    """Root mean square since the start or since the last restart, along the first axis; (ticks, ...)."""
    parts = np.split(values, [tick for tick in restarts if tick < len(values)])
    count = [np.arange(1, len(part) + 1).reshape(-1, *[1] * (values.ndim - 1)) for part in parts]
    return np.concatenate([np.sqrt(np.cumsum(part**2, axis=0) / n) for part, n in zip(parts, count, strict=True)])


def moving_mean(values: Array, ticks: int) -> Array:
    """Mean over a window of so many ticks, (ticks,)."""
    return uniform_filter1d(values, max(1, ticks), mode="nearest")


def moving_rms(values: Array, ticks: int) -> Array:
    """Root mean square over a window of so many ticks, (ticks,)."""
    return np.sqrt(np.maximum(moving_mean(values**2, ticks), 0.0))


def window(several: tuple[Flight, ...]) -> int:
    """Ticks over which noisy curves are smoothed: about a hundredth of the run."""
    return max(1, max(flight.recording.ticks for flight in several) // 100)


def with_particles(several: tuple[Flight, ...]) -> tuple[Flight, ...]:
    """Loops that are closed by a particle filter."""
    return tuple(flight for flight in several if f"{flight.closing}/ess" in flight.recording.channels)


def torque_unit(several: tuple[Flight, ...]) -> tuple[float, str]:
    """What a torque in N m is multiplied with, and the unit it then has: of a spacecraft, or of a testbed."""
    most = max(float(np.nanmax(np.abs(flight.channel("torque_B")))) for flight in several)
    return (1.0, "N m") if most > 0.1 else (1e3, "mN m")


def curves(several: tuple[Flight, ...], restarts: list[int], smooth: int) -> Iterator[Curve]:
    """Time series, a line for each loop on one entity a quantity; what a loop lacks is left out."""
    scale, unit = torque_unit(several)
    torque = {flight: scale * flight.channel("torque_B") for flight in several}
    running = {flight: running_rms(flight.errors, restarts) for flight in several}
    yield from _among("tracking/angle", "deg", {f: f.angle for f in several})
    for axis, label in enumerate(several[0].axes):
        yield from _among(f"tracking/error_{label}", "deg", {f: f.errors[:, axis] for f in several})
        yield from _among(f"tracking/rmse_{label}", "deg", {f: running[f][:, axis] for f in several})
    yield from _among("modes/any_fault", "-", {f: 1.0 - modes[:, 0] for f in several if (modes := f.probabilities) is not None})
    for law in dict.fromkeys(f.scenario.law.type for f in several):
        family = [f for f in several if f.scenario.law.type == law]
        for key in family[0].gains:
            yield from _among(f"gains/{law}/{key}", GAIN_UNITS[key], {f: f.gains[key] for f in family})
        for axis, label in enumerate("xyz"):  # extremes are kept: a law that switches would look idle on the viewer's average
            yield from _among(f"control/torque_{label}/{law}", unit, {f: torque[f][:, axis] for f in family}, aggregation="MinMax")
    for axis, label in enumerate("xyz"):
        yield from _among(f"control/mean_{label}", unit, {f: moving_mean(torque[f][:, axis], smooth) for f in several})
    yield from _among("control/effort", unit, {f: moving_rms(np.linalg.norm(torque[f], axis=-1), smooth) for f in several})
    for flight in several:
        speed = flight.channel("truth/state")[:, WHEELS] / RPM
        numbers = range(speed.shape[1])
        if numbers:
            yield Curve(f"wheels/speed/{flight.name}", tuple(f"RW{i + 1} [rpm]" for i in numbers), tuple(map(wheel, numbers)), speed, 1.2)
        if (probabilities := flight.probabilities) is not None and probabilities.shape[1] > 2:
            shades = tuple(REFERENCE if number is None else wheel(number) for number in flight.wheels_of_modes)
            yield Curve(f"modes/each/{flight.name}", tuple(f"{mode} [-]" for mode in flight.modes), shades, probabilities, 1.2)
    closed = [f for f in several if f.closing]
    yield from _among("estimation/attitude", "deg", {f: f.error_of_estimate()[:, 0] for f in closed})
    yield from _among("estimation/rate", "deg/s", {f: f.error_of_estimate()[:, 1] for f in closed})
    for i, what in enumerate(("attitude", "rate")):
        decades = {f: np.log10(moving_rms(f.error_of_estimate()[:, i], smooth).clip(LEAST)) for f in closed}
        yield from _among(f"estimation/decades_of_{what}", "log10", decades)
    yield from _among(
        "estimation/ess", "particles", {f: moving_mean(f.channel(f"{f.closing}/ess"), smooth) for f in with_particles(several)}
    )
    yield from _among("estimation/nis", "-", {f: f.channel(f"{f.closing}/nis") for f in closed}, dots=True)
    bands = {degrees_of_freedom(f.recording, f.closing): f.channel(f"{f.closing}/dof") for f in closed if f.closing}
    for dof, each in sorted(bands.items()):
        yield Curve(f"estimation/nis_band/{dof}", *chi_square_band(each))


def _among(path: str, unit: str, lines: dict[Flight, Array], dots: bool = False, aggregation: str | None = None) -> Iterator[Curve]:
    if lines:
        names, colours = tuple(f"{flight.name} [{unit}]" for flight in lines), tuple(flight.look.on_dark for flight in lines)
        yield Curve(path, names, colours, _side_by_side(lines.values()), 1.2, dots=dots, aggregation=aggregation)


def _side_by_side(lines: Iterable[Array]) -> Array:
    """Columns of one array, those of loops that ended early filled up with NaN."""
    columns = list(lines)
    longest = max(map(len, columns))
    return np.stack([np.pad(column.astype(float), (0, longest - len(column)), constant_values=np.nan) for column in columns], axis=-1)
