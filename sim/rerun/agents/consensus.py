"""Agents that follow a leader as a Rerun recording: points with trails, the graph between them, and curves of every loop."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from models.dynamics.state_layout import POSITION
from sim.loop.recording import Recording
from sim.metrics.consensus import absolute_error, dynamics_error, relative_error
from sim.rerun.blueprint import BACKGROUND, TIMELINE, Page, blueprint
from sim.rerun.recording_file import recording_file
from sim.rerun.sink import APPLICATION, columns, describe, entity, style, time_column
from sim.scenario.consensus import ConsensusScenario
from sim.series.channels import Curve
from sim.series.consensus import chosen, line_styles, moving_mean, occurrences
from sim.series.palette import AXES, PALE_AXES, REFERENCE, Colour

Array = NDArray[np.floating]

AGENT_COLOURS: tuple[Colour, ...] = ((238, 84, 72), (255, 164, 66), (240, 222, 90), (92, 214, 120), (92, 156, 255), (190, 124, 245))
MOST = 12  # agents that have plots of their own
DRAWN_HZ, TRAIL_S = 25.0, 2.5
CLOSE = 0.045  # m
TURN = np.linspace(0.0, 2.0 * np.pi, 73)
LINK: Colour = (92, 104, 124)
ALL_LOOPS = {"dynamics": "Learned W phi [N]", "command": "Command [N]", "error": "Position minus leader [m]"}
DIVERGED = 1e3  # N or m: what is beyond is drawn there
STRIDE = 5  # ticks from one drawn weight to the next
ROWS: tuple[Colour, Colour] = ((92, 156, 255), (255, 164, 66))  # of W


@dataclass(frozen=True)
class ConsensusLayout(Page):
    """What the tabs of one trial are made of.

    Attributes:
      loops: their names.
      shown: the loop that is drawn large.
      plotted: numbers of the agents that have plots of their own.
      highs: upper end of axes on which what diverges would hide all else, by entity.
      learning: loops that have weights.
    """

    loops: tuple[str, ...]
    shown: str
    plotted: tuple[int, ...]
    highs: dict[str, float]
    learning: tuple[str, ...] = ()

    def tabs(self) -> list[Any]:
        """All tabs, each of views of its own."""
        weights = [self._weights()] if self.learning else []
        return [self._overview(), self._planes(), self._dynamics(), self._control(), self._learners(), *weights, self._run()]

    def _overview(self) -> Any:
        curves = [
            self._among("Absolute error AEM [m], zoomed in", "metrics/aem"),
            self._among("Relative error REM [m], zoomed in", "metrics/rem", legend=False),
            self._among("Error of the learned dynamics [N], zoomed in", "metrics/dynamics_error", legend=False),
        ]
        below = rrb.Horizontal(self._close_up(), self._events(), column_shares=[45, 55])
        left = rrb.Vertical(self._plane(self.shown, f"Agents of {self.shown}, the leader in yellow [m]"), below, row_shares=[62, 38])
        return rrb.Horizontal(left, rrb.Vertical(*curves), column_shares=[52, 48], name="Overview")

    def _planes(self) -> Any:
        return rrb.Grid(
            *(self._plane(loop, f"Agents of {loop} [m]") for loop in self.loops), grid_columns=min(4, len(self.loops)), name="Planes"
        )

    def _dynamics(self) -> Any:
        views = [
            self._plot(f"f + d and W phi (pale) of agent {agent}, {self.shown} [N]", f"dynamics/agent_{agent}/**") for agent in self.plotted
        ]
        return rrb.Grid(*views, grid_columns=min(3, len(views)), name="Dynamics")

    def _control(self) -> Any:
        views = [self._plot(f"Command of agent {agent}, {self.shown} [N]", f"control/agent_{agent}") for agent in self.plotted]
        effort = self._among("Command of all agents, length, mean over 0.5 s [N], zoomed in", "metrics/effort")
        return rrb.Vertical(effort, rrb.Grid(*views, grid_columns=min(3, len(views))), row_shares=[30, 70], name="Control")

    def _learners(self) -> Any:
        """What every loop makes of f + d, commands, and how far it is from the leader; one tab a quantity, an agent a column."""
        tabs = []
        for key, what in ALL_LOOPS.items():
            views = [
                self._plot(f"{what} along {axis}, agent {agent}", f"learners/{key}/{axis}/agent_{agent}", legend=agent == self.plotted[0])
                for axis in "xy"
                for agent in self.plotted
            ]
            tabs.append(rrb.Grid(*views, grid_columns=min(6, len(self.plotted)), name=what))
        return rrb.Tabs(*tabs, name="All loops")

    def _weights(self) -> Any:
        views = [
            self._plot(f"Weights of {loop}, agent {agent}", f"weights/{rr.escape_entity_path_part(loop)}/agent_{agent}", legend=False)
            for loop in self.learning
            for agent in self.plotted
        ]
        return rrb.Grid(*views, grid_columns=min(6, len(self.plotted)), name="Weights")

    def _among(self, name: str, path: str, legend: bool = True) -> Any:
        return self._plot(name, path, high=self.highs[path], legend=legend)

    def _plane(self, loop: str, name: str) -> Any:
        place = f"/{self.prefix}{path_of(loop)}"
        trail = rrb.VisibleTimeRanges(
            timeline=TIMELINE,
            start=rrb.TimeRangeBoundary.cursor_relative(seconds=-TRAIL_S),
            end=rrb.TimeRangeBoundary.cursor_relative(),
        )
        return rrb.Spatial2DView(
            name=name,
            origin=place,
            contents=[f"{place}/**", f"- {place}/close_up/**"],
            background=rrb.Background(color=BACKGROUND, kind="SolidColor"),
            visual_bounds=rrb.VisualBounds2D(x_range=(-2.1, 2.3), y_range=(-2.2, 2.2)),
            overrides={f"{place}/trail": trail},
        )

    def _close_up(self) -> Any:
        place = f"/{self.prefix}{path_of(self.shown)}/close_up"
        return rrb.Spatial2DView(
            name="The same relative to the leader, circles of 10, 20, 30 mm",
            origin=place,
            contents=[f"{place}/**"],
            background=rrb.Background(color=BACKGROUND, kind="SolidColor"),
            visual_bounds=rrb.VisualBounds2D(x_range=(-CLOSE, CLOSE), y_range=(-CLOSE, CLOSE)),
        )


def write_recording(path: Path, name: str, scenario: ConsensusScenario, flown: dict[str, Recording], configuration: dict[str, Any]) -> None:
    """Write all recorded trials as a self-contained .rrd that opens laid out.

    Rerun draws 2-D views with y downwards; the plane is drawn with y up, so that the leader goes round as in the figures.

    Args:
      path: file to be written.
      name: of the scenario; the recording's name in the viewer.
      scenario: with all its loops.
      flown: of one trial or more, by loop; several trials go under /trial_<number> each.
      configuration: nested settings, kept as a property of the recording.
    """
    numbers = next(iter(flown.values())).trials
    trials = {}
    for position, number in enumerate(numbers):
        one = {loop: of.select(np.array([position])) for loop, of in flown.items()}
        drawn = tuple(curves(scenario, one))
        duration = scenario.run.ticks * scenario.run.tick_s
        prefix = f"trial_{number}/" if len(numbers) > 1 else ""
        trials[f"Trial {number}"] = (
            one,
            drawn,
            ConsensusLayout(prefix, duration, tuple(one), chosen(one), plotted(scenario), _highs(drawn), learning(one)),
        )
    with recording_file(path, APPLICATION, blueprint({label: layout for label, (_, _, layout) in trials.items()})) as stream:
        describe(stream, name, configuration)
        for one, drawn, layout in trials.values():
            for loop, flight in one.items():
                _write_plane(stream, layout.prefix + path_of(loop), scenario, flight)
            for curve in drawn:
                stream.log(layout.prefix + entity(curve.path), style(curve), static=True)
                time = time_column(one[layout.shown].time)
                stream.send_columns(layout.prefix + entity(curve.path), [time], columns(curve))
            for curve in weight_curves(scenario, one):
                stream.log(layout.prefix + entity(curve.path), style(curve), static=True)
                stream.send_columns(layout.prefix + entity(curve.path), [time_column(one[layout.shown].time[::STRIDE])], columns(curve))
            _write_events(stream, layout.prefix, name, scenario, one)


def plotted(scenario: ConsensusScenario) -> tuple[int, ...]:
    """Numbers of the agents that have plots of their own: the first."""
    return tuple(range(1, min(scenario.plant.agents, MOST) + 1))


def path_of(loop: str) -> str:
    """Entity of a loop's plane."""
    return f"plane/{rr.escape_entity_path_part(loop)}"


def curves(scenario: ConsensusScenario, flown: dict[str, Recording]) -> Iterator[Curve]:
    """Time series of one trial: metrics of all loops, dynamics and commands of the one that is drawn large."""
    colours = tuple(look.on_dark for name, look in line_styles(scenario).items() if name in flown)
    names = tuple(flown)

    def among(path: str, unit: str, values: dict[str, Array]) -> Curve:
        return Curve(path, tuple(f"{name} [{unit}]" for name in names), colours, np.stack([values[name] for name in names], axis=-1))

    yield among("metrics/aem", "m", {name: absolute_error(one)[:, 0] for name, one in flown.items()})
    yield among("metrics/rem", "m", {name: relative_error(one)[:, 0] for name, one in flown.items()})
    wrong = {name: np.sqrt(moving_mean(dynamics_error(one)[:, 0], one.dt)) for name, one in flown.items()}
    yield among("metrics/dynamics_error", "N", wrong)
    effort = {name: np.linalg.norm(one.channels["force"][:, 0], axis=(-2, -1)) for name, one in flown.items()}
    yield among("metrics/effort", "N", {name: moving_mean(value, flown[name].dt) for name, value in effort.items()})
    channels = flown[chosen(flown)].channels
    for number in plotted(scenario):
        agent = number - 1
        for key, shades, width, label in (("unknown", AXES, 3.0, "f + d"), ("learned", PALE_AXES, 1.2, "W phi")):
            names_of = tuple(f"{label} {axis} [N]" for axis in "xy")
            yield Curve(f"dynamics/agent_{number}/{key}", names_of, shades[:2], channels[key][:, 0, agent], width)
        yield Curve(f"control/agent_{number}", ("u x [N]", "u y [N]"), AXES[:2], channels["force"][:, 0, agent])

    leader = channels["reference/leader"]
    for number in plotted(scenario):
        of: dict[str, dict[str, Array]] = {
            "dynamics": {loop: one.channels["learned"][:, 0, number - 1] for loop, one in flown.items()},
            "command": {loop: one.channels["force"][:, 0, number - 1] for loop, one in flown.items()},
            "error": {loop: one.channels["truth/state"][:, 0, number - 1, POSITION] - leader for loop, one in flown.items()},
        }
        for key, values in of.items():
            for axis, letter in enumerate("xy"):
                within = {loop: np.clip(value[:, axis], -DIVERGED, DIVERGED) for loop, value in values.items()}
                yield among(f"learners/{key}/{letter}/agent_{number}", "m" if key == "error" else "N", within)


def learning(flown: dict[str, Recording]) -> tuple[str, ...]:
    """Loops that have weights."""
    return tuple(loop for loop, one in flown.items() if "weights" in one.channels)


def weight_curves(scenario: ConsensusScenario, flown: dict[str, Recording]) -> Iterator[Curve]:
    """All weights of every agent in every loop that learns, of one trial: the row of W for x in blue, that for y in orange."""
    for loop in learning(flown):
        weights = flown[loop].channels["weights"][::STRIDE, 0]
        half = weights.shape[-1] // 2
        names = tuple(f"W {axis} {term}" for axis in "xy" for term in range(1, half + 1))
        shades = tuple(colour for row in ROWS for colour in (row,) * half)
        for number in plotted(scenario):
            yield Curve(f"weights/{loop}/agent_{number}", names, shades, weights[:, number - 1].astype(float), 1.0)


def _highs(drawn: tuple[Curve, ...]) -> dict[str, float]:
    """Upper ends of axes: twice the worst of what the better half of the loops makes of the second half of the run."""
    highs = {}
    for curve in drawn:
        if curve.path.startswith("metrics/"):
            late = np.nanmax(np.where(np.isfinite(curve.values), curve.values, np.inf)[len(curve.values) // 10 :], axis=0)
            highs[curve.path] = float(2.0 * np.median(late[late > 0.0])) if np.isfinite(np.median(late[late > 0.0])) else 1.0
    return highs


def _write_plane(stream: Any, place: str, scenario: ConsensusScenario, flown: Recording) -> None:
    numbers = range(1, scenario.plant.agents + 1)
    names, colours = [str(number) for number in numbers], [AGENT_COLOURS[(number - 1) % len(AGENT_COLOURS)] for number in numbers]
    stride = max(1, round(1.0 / (DRAWN_HZ * flown.dt)))
    rows = np.arange(0, len(flown.channels["reference/leader"]), stride)
    time = [time_column(flown.dt * rows)]
    up = np.array([1.0, -1.0])
    agents = np.clip(flown.channels["truth/state"][rows, 0, :, :2], -1e3, 1e3) * up
    leader = flown.channels["reference/leader"][rows] * up
    graph = scenario.communication()
    ends = [(int(i), int(j)) for i, j in np.argwhere(np.triu(graph.weights + graph.weights.T) > 0.0)]
    seen = [int(i) for i in np.flatnonzero(graph.leader)]
    strips = [np.stack([agents[:, i], agents[:, j]], axis=1) for i, j in ends] + [np.stack([agents[:, i], leader], axis=1) for i in seen]
    links = np.stack(strips, axis=1)  # (rows, links, 2, 2)
    stream.log(
        f"{place}/leader_path",
        rr.LineStrips2D([flown.channels["reference/leader"] * up], colors=[(*REFERENCE, 90)], radii=0.004),
        static=True,
    )
    shades = [LINK] * len(ends) + [REFERENCE] * len(seen)
    stream.log(f"{place}/links", rr.LineStrips2D.from_fields(colors=shades, radii=0.006), static=True)
    stream.send_columns(
        f"{place}/links",
        time,
        rr.LineStrips2D.columns(strips=list(links.reshape(-1, 2, 2))).partition(np.full(len(rows), links.shape[1])),
    )
    for entity_path, radius in ((f"{place}/trail", 0.012), (f"{place}/agents", 0.055)):
        stream.log(entity_path, rr.Points2D.from_fields(colors=colours, radii=radius), static=True)
        stream.send_columns(
            entity_path, time, rr.Points2D.columns(positions=agents.reshape(-1, 2)).partition(np.full(len(rows), agents.shape[1]))
        )
    near = f"{place}/close_up"
    stream.log(f"{place}/agents", rr.Points2D.from_fields(labels=names, show_labels=True), static=True)
    stream.log(f"{near}/leader", rr.Points2D([[0.0, 0.0]], colors=[REFERENCE], radii=0.0016), static=True)
    circles = [0.01 * r * np.stack([np.cos(TURN), np.sin(TURN)], axis=-1) for r in (1, 2, 3)]
    stream.log(f"{near}/circles", rr.LineStrips2D(circles, colors=[LINK] * 3, radii=0.0002), static=True)
    stream.log(f"{near}/agents", rr.Points2D.from_fields(colors=colours, radii=0.0013, labels=names, show_labels=True), static=True)
    relative = (agents - leader[:, None]).reshape(-1, 2)
    stream.send_columns(f"{near}/agents", time, rr.Points2D.columns(positions=relative).partition(np.full(len(rows), agents.shape[1])))
    stream.log(f"{place}/leader", rr.Points2D.from_fields(colors=[REFERENCE], radii=0.07), static=True)
    stream.send_columns(f"{place}/leader", time, rr.Points2D.columns(positions=leader))


def _write_events(stream: Any, prefix: str, name: str, scenario: ConsensusScenario, flown: dict[str, Recording]) -> None:
    dt, told = next(iter(flown.values())).dt, [(0.0, "INFO", f"{name}: {scenario.title}")]
    told += [(dt * one.start_tick, "WARN", f"{one.text}, until {dt * one.end_tick:g} s") for one in occurrences(flown)]
    told.append((scenario.run.ticks * scenario.run.tick_s, "INFO", "end of the recording"))
    times, levels, texts = zip(*told, strict=True)
    stream.send_columns(f"{prefix}events", [time_column(np.array(times))], rr.TextLog.columns(text=texts, level=levels))
