"""How a recording opens in Rerun: tabs, views, the camera, and what is hidden at first."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import rerun as rr
import rerun.blueprint as rrb

TIMELINE = "sim_time"
TRAIL_S = 15.0

_part = rr.escape_entity_path_part

BACKGROUND = (17, 22, 30)
UP = (0.0, 0.0, 1.0)
BOTH_BODIES = {"position": (-0.385, -0.535, 1.31), "look_target": (0.125, -0.165, 1.115), "eye_up": UP}
WHEEL_VIEW = {"position": (-0.22, -0.15, 1.21), "look_target": (0.0, 0.0, 1.075), "eye_up": UP}


class Camera(NamedTuple):
    """The place of a plant relative to the testbed's, for which the cameras above are set up."""

    moved: Sequence[float] = (0.0, 0.0, 0.0)  # m
    size: float = 1.0

    def of(self, eye: dict[str, Any]) -> dict[str, Any]:
        """A camera's settings for this plant."""
        points = {
            key: tuple(self.size * x + float(shift) for x, shift in zip(eye[key], self.moved, strict=True))
            for key in ("position", "look_target")
        }
        return eye | points


@dataclass(frozen=True)
class Page:
    """Views of one trial that every layout has.

    Attributes:
      prefix: of its entities; empty, or ending in a slash.
      duration_s: shown by the time axes.
    """

    prefix: str
    duration_s: float

    @property
    def state_timelines(self) -> str:
        """Title of the view of faults."""
        return "Faults, and the gain that each detector chooses"

    def _plot(
        self, name: str, *contents: str, high: float | None = None, low: float = 0.0, legend: bool = True, corner: str = "RightTop"
    ) -> Any:
        return rrb.TimeSeriesView(
            name=name,
            origin=f"/{self.prefix}",
            contents=[f"/{self.prefix}{path}" for path in contents],
            axis_x=self._time_axis(),
            axis_y=None if high is None else rrb.ScalarAxis(range=(low, high)),
            plot_legend=rrb.PlotLegend(corner, visible=legend),
        )

    def _run(self) -> Any:
        document = rrb.TextDocumentView(name="Configuration", origin="/configuration")
        return rrb.Horizontal(document, self._events(), column_shares=[50, 50], name="Run")

    def _time_axis(self) -> Any:
        start, end = (rr.TimeRangeBoundary.absolute(seconds=s) for s in (0.0, self.duration_s))
        return rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end))

    def _lanes(self) -> Any:
        return rrb.StateTimelineView(name=self.state_timelines, origin=f"/{self.prefix}state", time_view=self._time_axis())

    def _events(self) -> Any:
        columns = rrb.TextLogColumns(timeline_columns=[TIMELINE], text_log_columns=["LogLevel", "Body"])
        return rrb.TextLogView(name="Events", origin=f"/{self.prefix}events", columns=columns)


@dataclass(frozen=True)
class Layout(Page):
    """What the tabs of one trial are made of.

    Attributes:
      plant: what it is called.
      observers: names of all observers.
      hybrids: those that declare faults.
      modal: those of them that do so by the probabilities of modes.
      body: entity of the floating body.
      wheels: entities of the wheels.
      shown: observer whose ghost is visible at first.
      about: scales of what is drawn, for the title of the 3-D view.
      camera: where the 3-D views look from.
      wheel_camera: where that of the wheels does.
    """

    plant: str
    observers: tuple[str, ...]
    hybrids: tuple[str, ...]
    modal: tuple[str, ...]
    body: str
    wheels: tuple[str, ...]
    shown: str | None
    about: str
    camera: Camera
    wheel_camera: Camera

    @property
    def state_timelines(self) -> str:
        """Title of the view of faults."""
        return "Faults, and what each detector says" if self.modal else super().state_timelines

    def tabs(self) -> list[Any]:
        """All tabs, each of views of its own: Rerun allows a view one parent only."""
        modes = [self._modes()] if self.modal else []
        return [self._overview(), self._estimators(), *modes, self._wheels(), self._control(), self._consistency(), self._run()]

    def _overview(self) -> Any:
        statistic = self._statistic(self.shown if self.shown in self.hybrids else next(iter(self.hybrids), None))
        return rrb.Horizontal(
            rrb.Vertical(
                self._testbed(),
                self._lanes(),
                rrb.Horizontal(self._events(), statistic, column_shares=[48, 52]),
                row_shares=[56, 19, 25],
            ),
            rrb.Vertical(
                self._axes_error(),
                self._plot("Body rate [deg/s]: truth, estimate (pale)", "rate/estimate", "rate/truth"),
                self._plot("Wheel speed [rpm]", "wheels/speed"),
                row_shares=[30, 30, 40],  # an axis of thousands of rpm needs height for its numbers
            ),
            column_shares=[54, 46],
            name="Overview",
        )

    def _estimators(self) -> Any:
        return rrb.Vertical(
            self._plot("Attitude error of every observer, angle [mrad]", "attitude/error/**"),
            rrb.Horizontal(
                self._plot("Rate error of every observer, length [deg/s]", "rate/error/**"),
                self._plot("Wheel speed error of every observer, length [rpm]", "wheels/error/**"),
            ),
            rrb.Horizontal(self._axes_error(), self._lanes()),
            name="Estimators",
        )

    def _modes(self) -> Any:
        views = [self._plot(f"Probability of each mode of {m} [-], the first is healthy", f"modes/{_part(m)}") for m in self.modal]
        return rrb.Vertical(*views, self._lanes(), row_shares=[*[70 / len(views)] * len(views), 30], name="Modes")

    def _wheels(self) -> Any:
        about = f"Wheels and their momentum; {self.about.split(';', maxsplit=1)[0]}"
        return rrb.Horizontal(
            rrb.Vertical(
                self._scene(
                    about,
                    self.wheel_camera.of(WHEEL_VIEW),
                    [*(f"{w}/**" for w in self.wheels), self.body, f"{self.body}/outline/**", "world/lab/**"],
                ),
                self._plot("Wheel momentum [mN m s]", "wheels/momentum"),
                self._lanes(),
                row_shares=[54, 28, 18],
            ),
            rrb.Vertical(
                self._plot("Wheel speed [rpm]", "wheels/speed"),
                self._plot("Wheel torque, commanded [mN m]", "wheels/command"),
                self._plot("Wheel torque, applied [mN m]", "wheels/applied"),
                row_shares=[40, 30, 30],
            ),
            name="Wheels",
        )

    def _control(self) -> Any:
        return rrb.Horizontal(
            rrb.Vertical(
                self._plot("Attitude, rotation vector from N [deg]: truth, reference (pale)", "attitude/reference", "attitude/truth"),
                self._plot("Tracking error, truth - reference [deg]", "attitude/tracking"),
                self._plot("Torque on the body, commanded [mN m]", "control/torque_B"),
            ),
            rrb.Vertical(
                self._plot("Body rate [deg/s]: truth, reference (pale)", "rate/reference", "rate/truth"),
                self._plot("Total angular momentum in N [mN m s]", "physics/momentum"),
                self._plot("Mechanical energy [J]", "physics/energy"),
            ),
            name="Control",
        )

    def _consistency(self) -> Any:
        return rrb.Horizontal(
            rrb.Vertical(*(self._statistic(name) for name in self.hybrids), self._lanes()),
            rrb.Vertical(
                self._plot("NIS of every observer [-], 95 % band", "consistency/nis/**", "consistency/nis_band", high=50.0),
                self._plot("NEES of every observer [-], 95 % band", "consistency/nees/**", "consistency/nees_band", high=50.0),
            ),
            name="Consistency",
        )

    def _testbed(self) -> Any:
        who = f"{self.plant}, and what {self.shown} believes; " if self.shown else f"{self.plant}; "
        return self._scene(f"{who}{self.about}", self.camera.of(BOTH_BODIES), ["world/**", f"- {self.body}/outline/**"])

    def _axes_error(self) -> Any:
        return self._plot(f"Attitude error of {self.shown}, estimate - truth [mrad], band: 1 sigma", "attitude/error_axes")

    def _statistic(self, hybrid: str | None) -> Any:
        if hybrid is None:
            return self._plot("NIS of every observer [-], 95 % band", "consistency/nis/**", "consistency/nis_band", high=50.0)
        what = "Probability of a fault by" if hybrid in self.modal else "Smoothed NIS of"
        return self._plot(f"{what} {hybrid} [-]", f"consistency/statistic/{_part(hybrid)}")

    def _scene(self, name: str, eye: dict[str, Any], contents: Iterable[str]) -> Any:
        hidden = {
            f"{self.prefix}world/{what}/{_part(observer)}": rrb.EntityBehavior(visible=False)
            for what in ("estimate", "magnified", "labels")
            for observer in self.observers
            if observer != self.shown
        }
        trail = rrb.VisibleTimeRanges(
            timeline=TIMELINE,
            start=rrb.TimeRangeBoundary.cursor_relative(seconds=-TRAIL_S),
            end=rrb.TimeRangeBoundary.cursor_relative(),
        )
        return rrb.Spatial3DView(
            name=name,
            origin=f"/{self.prefix}world",
            contents=[f"- /{self.prefix}{path[2:]}" if path.startswith("- ") else f"/{self.prefix}{path}" for path in contents],
            background=rrb.Background(color=BACKGROUND, kind="SolidColor"),
            line_grid=rrb.LineGrid3D(visible=False),
            eye_controls=rrb.EyeControls3D(kind="Orbital", **eye),
            overrides={**hidden, f"{self.prefix}world/trail": trail},
        )


def blueprint(trials: dict[str, Any], live: bool = False) -> Any:
    """Blueprint of a recording: the tabs of its trial, or a tab of tabs for each of several; `live` follows what arrives."""
    first, *others = trials.values()
    tabs = first.tabs() if not others else [rrb.Tabs(*layout.tabs(), name=label) for label, layout in trials.items()]
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=0),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following" if live else "paused", loop_mode="all"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_layout=False,
        auto_views=False,
    )
