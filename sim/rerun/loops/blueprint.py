"""How a recording of several closed loops opens in Rerun: tabs on which the loops share their plots, and the camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from sim.rerun.blueprint import BACKGROUND, TIMELINE, Page


@dataclass(frozen=True)
class LoopsLayout(Page):
    """What the tabs of one trial of several loops are made of.

    Attributes:
      loops: their names.
      axes: names of the three tracking errors.
      gains: title of every gain that some law has, by entity.
      laws: titles of the control laws, by type.
      torque: its unit.
      modal: loops whose observer has modes, and how many.
      wheeled: whether there are reaction wheels.
      particles: whether a particle filter closes a loop.
      learners: loops whose observer learns a torque.
      ranges: of axes on which the start would hide all else, by entity.
      trails: entities of the pointers' trails.
      trail_s: how long they are.
      about: scales of what is drawn.
      eye: of the 3-D view.
    """

    loops: tuple[str, ...]
    axes: tuple[str, ...]
    gains: dict[str, str]
    laws: dict[str, str]
    torque: str
    modal: dict[str, int]
    wheeled: bool
    particles: bool
    learners: tuple[str, ...]
    ranges: dict[str, tuple[float, float]]
    trails: tuple[str, ...]
    trail_s: float
    about: str
    eye: dict[str, Any]

    @property
    def state_timelines(self) -> str:
        """Title of the view of faults."""
        return "The fault, and what each loop's observer believes"

    def tabs(self) -> list[Any]:
        """All tabs, each of views of its own: Rerun allows a view one parent only."""
        modes = [self._modes()] if self.modal else []
        learned = [self._learned()] if self.learners else []
        wheels = [self._wheels()] if self.wheeled else []
        return [
            self._overview(),
            self._tracking(),
            *modes,
            self._control(),
            self._torque(),
            *wheels,
            self._estimation(),
            *learned,
            self._run(),
        ]

    def _overview(self) -> Any:
        below = rrb.Horizontal(self._lanes(), self._events(), column_shares=[58, 42])
        modes = [self._any_fault(legend=False)] if self.modal else []
        return rrb.Horizontal(
            rrb.Vertical(self._scene(), below, row_shares=[66, 34]),
            rrb.Vertical(self._angle(), *modes, self._effort(legend=False)),
            column_shares=[66, 34],
            name="Overview",
        )

    def _tracking(self) -> Any:
        errors = [self._among(f"Tracking error {axis} [deg]", f"tracking/error_{axis}", legend=False) for axis in self.axes]
        titles = [f"Running RMSE of {axis} [deg], restarted where a fault begins or ends" for axis in self.axes]
        running = [self._among(title, f"tracking/rmse_{axis}", legend=False) for title, axis in zip(titles, self.axes, strict=True)]
        pairs = rrb.Horizontal(rrb.Vertical(*errors), rrb.Vertical(*running))
        return rrb.Vertical(self._angle(), pairs, row_shares=[32, 68], name="Tracking")

    def _modes(self) -> Any:
        gains = [self._among(title, path) for path, title in self.gains.items()]
        many = [loop for loop, modes in self.modal.items() if modes > 2]
        each = [self._plot(f"Probability of each mode, {loop} [-]", f"modes/each/{rr.escape_entity_path_part(loop)}") for loop in many]
        left = rrb.Vertical(self._any_fault(), *each, self._lanes())
        return rrb.Horizontal(left, rrb.Grid(*gains, grid_columns=1 if len(gains) < 3 else 2), name="Modes")

    def _control(self) -> Any:
        titles = [f"Torque demanded about {axis}, moving mean [{self.torque}]" for axis in "xyz"]
        means = [self._among(title, f"control/mean_{axis}", legend=axis == "x") for title, axis in zip(titles, "xyz", strict=True)]
        right = rrb.Vertical(self._effort(legend=False), self._lanes())
        return rrb.Horizontal(rrb.Vertical(*means), right, column_shares=[60, 40], name="Control")

    def _torque(self) -> Any:
        laws = [
            rrb.Vertical(
                *(self._among(f"{title}: torque about {x}, every tick [{self.torque}]", f"control/torque_{x}/{law}") for x in "xyz")
            )
            for law, title in self.laws.items()
        ]
        return rrb.Horizontal(*laws, name="Torque")

    def _wheels(self) -> Any:
        speeds = [self._plot(f"Wheel speed, {loop} [rpm]", f"wheels/speed/{rr.escape_entity_path_part(loop)}") for loop in self.loops]
        return rrb.Grid(*speeds, grid_columns=2 if len(speeds) > 3 else 1, name="Wheels")

    def _estimation(self) -> Any:
        nis = "NIS of the observer that closes the loop [-], 95 % band"
        ess = [self._among("Effective number of particles, moving mean", "estimation/ess", legend=False)] if self.particles else []
        return rrb.Vertical(
            *(self._errors() if self.wheeled else self._decades()),
            *ess,
            self._plot(nis, "estimation/nis", "estimation/nis_band/**", high=50.0, legend=False),
            name="Estimation",
        )

    def _errors(self) -> list[Any]:
        return [
            self._among("Attitude error of the estimate that closes the loop [deg]", "estimation/attitude"),
            self._among("Rate error of the estimate that closes the loop, length [deg/s]", "estimation/rate", legend=False),
        ]

    def _decades(self) -> list[Any]:
        """Without a gyro errors span decades: from a first guess of a rate to what is left of it."""
        return [
            self._plot("Attitude error of the estimate, moving RMS [log10 of deg]", "estimation/decades_of_attitude"),
            self._plot("Rate error of the estimate, moving RMS [log10 of deg/s]", "estimation/decades_of_rate", legend=False),
        ]

    def _learned(self) -> Any:
        torques = [self._plot(f"Unmodelled torque about {axis}, learned and applied [mN m]", f"learned/torque_{axis}") for axis in "xyz"]
        error = self._among("Learned minus applied torque, length, moving RMS [mN m]", "learned/error", legend=False)
        return rrb.Vertical(*torques, error, name="Learned torque")

    def _angle(self) -> Any:
        return self._among("Tracking error of the body (truth), angle [deg]", "tracking/angle")

    def _any_fault(self, legend: bool = True) -> Any:
        return self._among("Probability that a wheel has failed [-]", "modes/any_fault", legend)

    def _effort(self, legend: bool = True) -> Any:
        return self._among(f"Torque demanded, length, moving RMS [{self.torque}]", "control/effort", legend)

    def _among(self, name: str, path: str, legend: bool = True) -> Any:
        """A plot of all loops, of which the start may leave the picture; the legend, which is the same in all, is not in each."""
        low, high = self.ranges.get(path, (0.0, None))
        return self._plot(
            f"{name}, zoomed in" if high and path.startswith(("tracking", "estimation")) else name,
            path,
            high=high,
            low=low,
            legend=legend,
            corner="LeftTop",
        )

    def _scene(self) -> Any:
        trail = rrb.VisibleTimeRanges(
            timeline=TIMELINE,
            start=rrb.TimeRangeBoundary.cursor_relative(seconds=-self.trail_s),
            end=rrb.TimeRangeBoundary.cursor_relative(),
        )
        return rrb.Spatial3DView(
            name=f"All loops, and in yellow the axes that they should have; {self.about}",
            origin=f"/{self.prefix}world",
            contents=[f"/{self.prefix}world/**"],
            background=rrb.Background(color=BACKGROUND, kind="SolidColor"),
            line_grid=rrb.LineGrid3D(visible=False),
            eye_controls=rrb.EyeControls3D(kind="Orbital", **self.eye),
            overrides={f"{self.prefix}{path}": trail for path in self.trails},
        )
