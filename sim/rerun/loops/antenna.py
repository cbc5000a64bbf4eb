"""What antenna mapping adds to a recording of several loops: its tabs, its factors of magnification, and two kinds of pictures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from matplotlib.figure import Figure
from numpy.typing import NDArray

from sim.metrics.antenna_study import CHANNELS
from sim.rerun.blueprint import BACKGROUND
from sim.rerun.loops.blueprint import LoopsLayout
from sim.rerun.loops.scene import Outlook
from sim.series.antenna import AntennaFlight
from sim.series.antenna_panels import DARK, plane, response
from sim.series.picture_style import STYLE
from sim.series.raster import pixels

Array = NDArray[np.floating]
Several = tuple[AntennaFlight, ...]

LARGEST_DEG = 12.0  # angle that is drawn
WIDTH, HEIGHT, DPI = 6.4, 4.3, 200
RESPONSES = ((False, "error"), (True, "effort"))


@dataclass(frozen=True)
class AntennaLayout(LoopsLayout):
    """Tabs of one trial of antenna mapping.

    Attributes:
      mapped: the loop whose controllers are looked at.
      panels: joints that are neither the hub's nor a wheel's.
    """

    mapped: str = ""
    panels: tuple[str, ...] = ()

    @property
    def state_timelines(self) -> str:
        """Title of the view of states."""
        return "What the tests say of the controller that is in the loop"

    def tabs(self) -> list[Any]:
        """All tabs, each of views of its own: Rerun allows a view one parent only."""
        panels = [self._panels()] if self.panels else []
        return [self._overview(), self._pointing(), self._controllers(), self._responses(), self._wheels(), *panels, self._run()]

    def _overview(self) -> Any:
        below = rrb.Horizontal(self._lanes(), self._events(), column_shares=[45, 55])
        right = [self._error(CHANNELS[0]), self._error(CHANNELS[1], legend=False), self._picture("plane", CHANNELS[0])]
        return rrb.Horizontal(
            rrb.Vertical(self._scene(), below, row_shares=[66, 34]),
            rrb.Vertical(*right, row_shares=[28, 28, 44]),
            column_shares=[62, 38],
            name="Overview",
        )

    def _pointing(self) -> Any:
        angles = [self._plot(f"{c.capitalize()} [deg]", f"pointing/{c}", corner="LeftTop") for c in CHANNELS]
        errors = [self._error(c, legend=False) for c in CHANNELS]
        return rrb.Horizontal(rrb.Vertical(*angles), rrb.Vertical(*errors), name="Pointing")

    def _error(self, channel: str, legend: bool = True) -> Any:
        return self._plot(f"Pointing error of {channel} [deg]", f"pointing/error_{channel}", legend=legend, corner="LeftTop")

    def _controllers(self) -> Any:
        columns = [
            rrb.Vertical(
                self._picture("plane", channel),
                self._plot(
                    f"Natural frequency of {channel} over lambda, rigid [-]", f"controllers/frequency_{channel}", corner="RightBottom"
                ),
                self._plot(f"Damping of {channel}, rigid [-]", f"controllers/damping_{channel}", legend=False),
                self._plot(
                    f"Tests of {channel} of {self.mapped} over the integral of y2 [-], zoomed in",
                    f"controllers/score_{channel}",
                    low=-1.5,
                    high=1.5,
                ),
                row_shares=[43, 19, 15, 23],
            )
            for channel in CHANNELS
        ]
        said = rrb.Vertical(self._events(), self._lanes(), row_shares=[60, 40])
        return rrb.Horizontal(*columns, said, column_shares=[34, 34, 32], name="Controllers")

    def _responses(self) -> Any:
        pictures = [self._picture(f"response_{kind}", channel) for _, kind in RESPONSES for channel in CHANNELS]
        return rrb.Grid(*pictures, grid_columns=2, name="Responses")

    def _wheels(self) -> Any:
        titles = {"torque": f"Wheel torque, commanded, %s [{self.torque}]", "speed": "Wheel speed, %s [rpm]"}
        columns = []
        for kind, title in titles.items():
            paths = {loop: f"wheels/{kind}/{rr.escape_entity_path_part(loop)}" for loop in self.loops}
            limits = {loop: self.ranges.get(f"wheels/{kind}/{loop}", (0.0, None)) for loop in self.loops}
            columns.append(
                [self._plot(title % loop, paths[loop], low=limits[loop][0], high=limits[loop][1], corner="LeftTop") for loop in paths]
            )
        return rrb.Horizontal(*(rrb.Vertical(*views) for views in columns), name="Wheels")

    def _panels(self) -> Any:
        return rrb.Vertical(
            *(self._plot(f"{p} against the hub [deg]", f"panels/{p}", corner="LeftTop") for p in self.panels), name="Panels"
        )

    def _picture(self, kind: str, channel: str) -> Any:
        titles = {"plane": "Controllers", "response_error": "Pointing error per reference", "response_effort": "Torque per reference"}
        return rrb.Spatial2DView(
            name=f"{titles[kind]}, {channel}",
            origin=f"/{self.prefix}pictures/{kind}/{channel}",
            background=rrb.Background(color=BACKGROUND, kind="SolidColor"),
        )


def outlook(several: Several) -> Outlook:
    """Seen from behind and above, panels across the picture; attitude and panels turn by round factors that let both be seen."""
    turn = max(float(np.max(np.abs(np.append(f.wanted, f.pointed)), initial=0.0)) for f in several)
    bend = max(float(np.max(np.abs(list(f.panels.values())), initial=0.0)) for f in several)
    turns, bends = (_round(LARGEST_DEG / max(most, 1e-3)) for most in (turn, bend))
    margin = (0.62, 0.2, 1.0), (0.28, 0.2, 1.0)
    return Outlook(up=(-1.0, 0.0, 0.0), raised=0.6, margin=margin, tip=(0.0, 1.0, 0.0), spread=0.62, turns=turns, bends=bends)


def _round(value: float) -> float:
    """Largest of 1, 2, 5 times a power of ten that does not exceed `value`, at least 1."""
    power = 10.0 ** np.floor(np.log10(max(value, 1.0)))
    return float(max(m * power for m in (1.0, 2.0, 5.0) if m * power <= max(value, 1.0) * (1.0 + 1e-9)))


def pictures(several: Several) -> Iterator[tuple[str, Any, tuple[NDArray[np.int64], Array] | None]]:
    """Entities with their image; of a plane also where in it, in pixels, the controller is from which tick on."""
    subject = several[0]
    for channel, name in enumerate(CHANNELS):
        figure, axes = _page()
        with mpl.rc_context(STYLE | DARK.style):
            plane(axes, several, channel, DARK)
            image = pixels(figure)[..., :3]
        path = subject.path(channel)
        ticks = np.concatenate([[0], np.minimum(subject.switches[channel] + 1, subject.recording.ticks - 1)])
        ticks, last = np.unique(ticks[::-1], return_index=True)
        place = axes.transData.transform(path[::-1][last])
        yield (
            f"pictures/plane/{name}",
            rr.Image(image).compress(jpeg_quality=95),
            (ticks, np.stack([place[:, 0], len(image) - place[:, 1]], axis=-1)),
        )
        for effort, kind in RESPONSES:
            figure, axes = _page()
            with mpl.rc_context(STYLE | DARK.style):
                response(axes, several, channel, effort, DARK)
                image = pixels(figure)[..., :3]
            yield f"pictures/response_{kind}/{name}", rr.Image(image).compress(jpeg_quality=95), None


def _page() -> tuple[Figure, Any]:
    with mpl.rc_context(STYLE | DARK.style):
        figure = Figure(figsize=(WIDTH, HEIGHT), dpi=DPI, layout="constrained")
        return figure, figure.add_subplot()
