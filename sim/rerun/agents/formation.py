"""A formation as a Rerun recording: all its members and a ghost of their leader in one scene, and the curves of every loop."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from sim.loop.recording import Recording
from sim.plant.kinds import compile_plant
from sim.rerun.agents.formation_scene import FreeScene, Scene, shades
from sim.rerun.agents.testbeds import RoomScene, wheel_curves
from sim.rerun.blueprint import BACKGROUND, Page, blueprint
from sim.rerun.recording_file import recording_file
from sim.rerun.sink import APPLICATION, describe, entity, style, time_column
from sim.scenario.formation import FormationScenario
from sim.series.channels import Curve
from sim.series.formation import FormationFlight, flights
from sim.series.palette import ALERT, CALM, LOOP_VARIANTS

Array = NDArray[np.floating]

CURVE_ROWS = 5000  # of a curve, each the mean of what it stands for
SMOOTH_S = 1.0  # of torques


def write_formation(
    path: Path, name: str, scenario: FormationScenario, recordings: dict[str, Recording], configuration: dict[str, Any]
) -> None:
    """Write the recorded trials as a self-contained .rrd that opens laid out; the scene shows one loop, the curves all.

    Args:
      path: file to be written.
      name: of the scenario; the recording's name in the viewer.
      scenario: with all its loops.
      recordings: by loop, of one recorded trial or more; several trials go under /trial_<number> each.
      configuration: nested settings, kept as a property of the recording.
    """
    loops = flights(recordings, scenario)
    numbers = loops[0].recorded
    shown = next((f for f in loops if scenario.loops[f.loop].feedback != "truth"), loops[0])
    scene = (RoomScene if scenario.wheels else FreeScene)(compile_plant(scenario.plant), shown)
    prefixes = {f"Trial {number}": f"trial_{number}/" if len(numbers) > 1 else "" for number in numbers}
    layouts = {label: layout(prefix, shown, loops, scene) for label, prefix in prefixes.items()}
    with recording_file(path, APPLICATION, blueprint(layouts)) as stream:
        describe(stream, name, configuration)
        for position, prefix in enumerate(prefixes.values()):
            _write_trial(stream, prefix, name, scene, shown, loops, position)


@dataclass(frozen=True)
class FormationLayout(Page):
    """What the tabs of one trial are made of.

    Attributes:
      shown: loop in the scene.
      loops: all of them.
      observed: loop/observer of every estimate.
      members: what they are called.
      eye: from where the scene is seen.
      wheeled: testbeds whose wheels are shown; without, there are none.
    """

    shown: str
    loops: tuple[str, ...]
    observed: tuple[str, ...]
    members: str
    eye: dict[str, Any]
    wheeled: tuple[int, ...]

    @property
    def state_timelines(self) -> str:
        """Title of the view of faults."""
        return "What goes wrong"

    def tabs(self) -> list[Any]:
        """All tabs, each of views of its own: Rerun allows a view one parent only."""
        return [self._overview(), self._errors(), *self._agents(), *([self._wheels()] if self.wheeled else []), self._run()]

    def _overview(self) -> Any:
        below = rrb.Horizontal(self._lanes(), self._events(), column_shares=[50, 50])
        velocity = [
            self._plot("Error of the estimated rates, RMS of all agents, log10 of 1/s", "velocity/all", legend=len(self.loops) == 1)
        ]
        fastest = [self._plot(f"Fastest wheel of each in {self.shown} [rpm]", "wheels/fastest")] if self.wheeled else []
        return rrb.Horizontal(
            rrb.Vertical(self._scene(), below, row_shares=[72, 28]),
            rrb.Vertical(self._fkae(), self._skae(legend=False), *(velocity if self.observed else []), *fastest),
            column_shares=[60, 40],
            name="Overview",
        )

    def _errors(self) -> Any:
        angle = self._plot(f"Angle between two {self.members}, RMS of all pairs, log10 of deg", "formation/angle", legend=False)
        return rrb.Vertical(self._fkae(), self._skae(legend=False), angle, name="Errors")

    def _agents(self) -> list[Any]:
        titles = [self._plot(f"Error of the estimated rate, {name} [1/s]", f"velocity/each/{entity(name)}") for name in self.observed]
        turn = self._plot(f"|sigma| of each of the {self.members} in {self.shown} [-], 1: half a turn", "agents/turn")
        if self.wheeled:
            turn = self._plot(f"Angle of each to the leader in {self.shown}, log10 of deg", "agents/angle")
        torque = self._plot(
            f"Torque of each of the {self.members} in {self.shown}, RMS over {SMOOTH_S:g} s [mN m]", "agents/torque", legend=False
        )
        known = self._plot(f"Error of what each makes of the leader's acceleration in {self.shown} [1/s2]", "agents/leader", legend=False)
        own = rrb.Vertical(turn, torque, known, name=self.members.capitalize())
        return [rrb.Grid(*titles, grid_columns=1 if len(titles) < 3 else 2, name="Estimation"), own] if titles else [own]

    def _wheels(self) -> Any:
        plots = [self._plot(f"Wheels of {i} in {self.shown} [rpm]", f"wheels/each/{i}", legend=i == 1) for i in self.wheeled]
        return rrb.Grid(*plots, grid_columns=2 if len(plots) < 9 else 3, name="Wheels")

    def _fkae(self) -> Any:
        return self._plot("Formation-keeping error, log10 of FKAE", "formation/fkae")

    def _skae(self, legend: bool = True) -> Any:
        return self._plot("Station-keeping error, log10 of SKAE", "formation/skae", legend=legend)

    def _scene(self) -> Any:
        return rrb.Spatial3DView(
            name=f"Loop {self.shown}: the {self.members}, their links, and in yellow the leader's attitude",
            origin=f"/{self.prefix}world",
            contents=[f"/{self.prefix}world/**"],
            background=rrb.Background(color=BACKGROUND, kind="SolidColor"),
            line_grid=rrb.LineGrid3D(visible=False),
            eye_controls=rrb.EyeControls3D(kind="Orbital", **self.eye),
        )


def layout(prefix: str, shown: FormationFlight, loops: list[FormationFlight], scene: Scene) -> FormationLayout:
    """What the tabs of one trial are made of."""
    observed = tuple(f"{flown.loop}/{name}" for flown in loops for name in _observers(flown))
    wheeled = tuple(i + 1 for i, _ in enumerate(shown.places)) if "wheel_speed" in shown.channels else ()
    names = tuple(f.loop for f in loops)
    return FormationLayout(prefix, float(shown.time[-1]), shown.loop, names, observed, scene.members, scene.eye, wheeled)


def _observers(flown: FormationFlight) -> list[str]:
    return [name.removesuffix("/mean") for name in flown.channels if name.endswith("/mean")]


def _write_trial(
    stream: Any, prefix: str, name: str, scene: Scene, shown: FormationFlight, loops: list[FormationFlight], position: int
) -> None:
    for path, what in scene.still():
        stream.log(f"{prefix}{path}", what, static=True)
    for path, rows, moved in scene.motion(position):
        stream.send_columns(prefix + path, [time_column(shown.dt * rows)], moved)
    for curve, ticks in _curves(shown, loops, position):
        stream.log(prefix + entity(curve.path), style(curve), static=True)
        lines = curve.values.shape[1]
        column = rr.Scalars.columns(scalars=curve.values.ravel()).partition(np.full(len(curve.values), lines))
        stream.send_columns(prefix + entity(curve.path), [time_column(shown.dt * ticks)], column)
    events = [(0, "INFO", f"{name}, trial {shown.recorded[position]}, {len(loops)} loops")]
    lane = [(0, "none")]
    for tick in sorted({t for o in shown.occurrences for t in (o.start_tick, o.end_tick)}):
        active = [o.text for o in shown.occurrences if o.start_tick <= tick < o.end_tick]
        lane.append((tick, "; ".join(active) or "none"))
    events += [(o.start_tick, "WARN", o.text) for o in sorted(shown.occurrences, key=lambda o: o.start_tick)]
    when, levels, texts = zip(*events, strict=True)
    stream.send_columns(f"{prefix}events", [time_column(shown.dt * np.array(when))], rr.TextLog.columns(text=texts, level=levels))
    when, states = zip(*dict(lane).items(), strict=True)
    there = list(dict.fromkeys(states))
    colours = rr.StateConfiguration(values=there, colors=[CALM if state == "none" else ALERT for state in there])
    stream.log(f"{prefix}state/fault", colours, static=True)
    stream.send_columns(f"{prefix}state/fault", [time_column(shown.dt * np.array(when))], rr.StateChange.columns(state=states))


def _curves(shown: FormationFlight, loops: list[FormationFlight], position: int) -> Iterator[tuple[Curve, NDArray[np.int64]]]:
    """Time series with the ticks of their rows."""
    ticks = len(shown.leader)
    stride = max(1, ticks // CURVE_ROWS)
    rows = np.arange(0, ticks, stride)
    place = int(np.flatnonzero(shown.trials == shown.recorded[position])[0])
    look = tuple(LOOP_VARIANTS[i % len(LOOP_VARIANTS)][1] for i in range(len(loops)))
    names = tuple(flown.loop for flown in loops)
    for figure, path, scale in (("fkae", "fkae", 1.0), ("skae", "skae", 1.0), ("formation_angle", "angle", np.degrees(1.0))):
        values = scale * np.stack([flown.figures[figure][rows, place] for flown in loops], axis=-1)
        yield Curve(f"formation/{path}", names, look, np.log10(np.maximum(values, 1e-12))), rows
    agents = tuple(f"{i + 1}" for i in range(len(shown.places)))
    colours = tuple(shades(len(shown.places)))
    together, labels = [], []
    for flown in loops:
        for name in _observers(flown):
            difference = flown.channels[f"{name}/mean"][:, position, :, 3:] - flown.channels["truth/state"][:, position, :, 3:]
            each = np.sqrt(_thinned(np.sum(difference**2, axis=-1), stride))
            yield Curve(f"velocity/each/{flown.loop}/{name}", agents, colours, each), rows
            together.append(0.5 * np.log10(np.maximum(np.mean(each**2, axis=-1), 1e-10)))
            labels.append(f"{flown.loop}/{name}" if len(loops) == 1 else flown.loop)
    if together:
        offset = 0 if len(loops) == 1 else sum(not _observers(flown) for flown in loops)  # a loop has one colour everywhere
        look = tuple(LOOP_VARIANTS[(i + offset) % len(LOOP_VARIANTS)][1] for i in range(len(together)))
        yield Curve("velocity/all", tuple(labels), look, np.stack(together, axis=-1)), rows
    yield Curve("agents/turn", agents, colours, np.linalg.norm(shown.channels["truth/state"][rows, position, :, :3], axis=-1)), rows
    square = np.sum(shown.channels["applied"][:, position] ** 2, axis=-1)
    torque = 1e3 * np.sqrt(np.maximum(uniform_filter1d(square, max(1, round(SMOOTH_S / shown.dt)), axis=0)[rows], 0.0))
    yield Curve("agents/torque", agents, colours, torque), rows
    if "wheel_speed" in shown.channels:
        yield from ((curve, rows) for curve in wheel_curves(shown, position, rows))
    known = np.linalg.norm(shown.channels["control/acceleration"][rows, position] - shown.leader[rows, None, 6:], axis=-1)
    yield Curve("agents/leader", agents, colours, known), rows


def _thinned(values: Array, stride: int) -> Array:
    """Means over `stride` ticks, (ticks, n) to (rows, n)."""
    return uniform_filter1d(values, stride, axis=0)[::stride] if stride > 1 else values
