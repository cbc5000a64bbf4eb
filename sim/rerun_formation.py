"""A formation as a Rerun recording: all spacecraft and a ghost of their leader in one scene, their links as lines that fade."""

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

from models import modified_rodrigues
from models.assembly import Assembly
from models.formation import colour, compile_formation
from sim.formation_loop import Flown
from sim.formation_settings import FormationScenario
from sim.palette import ALERT, AXES, CALM, LOOP_VARIANTS, REFERENCE, Colour
from sim.rerun_blueprint import BACKGROUND, UP, Page, blueprint
from sim.rerun_geoms import drawn, visible_geoms
from sim.rerun_sink import APPLICATION, describe, entity, style, time_column
from sim.series import Curve

Array = NDArray[np.floating]

ROWS_MOST, RATE_MOST_HZ = 4000, 10.0  # poses in the file
CURVE_ROWS = 5000  # of a curve, each the mean of what it stands for
LINK: Colour = (90, 220, 160)
LINK_LEADER: Colour = (255, 226, 120)
SMOOTH_S = 1.0  # of torques
QUALITY_S = 1.0  # over which the share of messages that came is reckoned
AXIS, LEADER_AXIS = 0.75, 1.0  # m
HALF_ANGLE = np.radians(27.5)


def write_formation(path: Path, name: str, scenario: FormationScenario, flown: dict[str, Flown], configuration: dict[str, Any]) -> None:
    """Write the recorded trials as a self-contained .rrd that opens laid out; the scene shows one loop, the curves all.

    Args:
      path: file to be written.
      name: of the scenario; the recording's name in the viewer.
      scenario: with all its loops.
      flown: by loop, of one recorded trial or more; several trials go under /trial_<number> each.
      configuration: nested settings, kept as a property of the recording.
    """
    assembly = compile_formation(scenario.plant)
    loops = list(flown.values())
    numbers = loops[0].recorded
    shown = next((f for f in loops if scenario.loops[f.loop].feedback != "truth"), loops[0])
    prefixes = {f"Trial {number}": f"trial_{number}/" if len(numbers) > 1 else "" for number in numbers}
    layouts = {label: layout(prefix, shown, loops) for label, prefix in prefixes.items()}
    with rr.RecordingStream(APPLICATION) as stream:
        stream.save(path, default_blueprint=blueprint(layouts))
        describe(stream, name, configuration)
        for position, prefix in enumerate(prefixes.values()):
            _write_trial(stream, prefix, name, assembly, shown, loops, position)


@dataclass(frozen=True)
class FormationLayout(Page):
    """What the tabs of one trial are made of.

    Attributes:
      shown: loop in the scene.
      loops: all of them.
      observed: loop/observer of every estimate.
      size: of the scene, m.
    """

    shown: str
    loops: tuple[str, ...]
    observed: tuple[str, ...]
    size: float

    @property
    def lanes(self) -> str:
        """Title of the view of faults."""
        return "What goes wrong"

    def tabs(self) -> list[Any]:
        """All tabs, each of views of its own: Rerun allows a view one parent only."""
        return [self._overview(), self._errors(), *self._agents(), self._run()]

    def _overview(self) -> Any:
        below = rrb.Horizontal(self._lanes(), self._events(), column_shares=[50, 50])
        velocity = [
            self._plot("Error of the estimated rates, RMS of all agents, log10 of 1/s", "velocity/all", legend=len(self.loops) == 1)
        ]
        return rrb.Horizontal(
            rrb.Vertical(self._scene(), below, row_shares=[72, 28]),
            rrb.Vertical(self._fkae(), self._skae(legend=False), *(velocity if self.observed else [])),
            column_shares=[60, 40],
            name="Overview",
        )

    def _errors(self) -> Any:
        angle = self._plot("Angle between two spacecraft, RMS of all pairs, log10 of deg", "formation/angle", legend=False)
        return rrb.Vertical(self._fkae(), self._skae(legend=False), angle, name="Errors")

    def _agents(self) -> list[Any]:
        titles = [self._plot(f"Error of the estimated rate, {name} [1/s]", f"velocity/each/{entity(name)}") for name in self.observed]
        turn = self._plot(f"|sigma| of each spacecraft in {self.shown} [-], 1: half a turn", "agents/turn")
        torque = self._plot(f"Torque of each spacecraft in {self.shown}, RMS over {SMOOTH_S:g} s [mN m]", "agents/torque", legend=False)
        known = self._plot(f"Error of what each makes of the leader's acceleration in {self.shown} [1/s2]", "agents/leader", legend=False)
        own = rrb.Vertical(turn, torque, known, name="Spacecraft")
        return [rrb.Grid(*titles, grid_columns=1 if len(titles) < 3 else 2, name="Estimation"), own] if titles else [own]

    def _run(self) -> Any:
        document = rrb.TextDocumentView(name="Configuration", origin="/configuration")
        return rrb.Horizontal(document, self._events(), column_shares=[50, 50], name="Run")

    def _fkae(self) -> Any:
        return self._plot("Formation-keeping error, log10 of FKAE", "formation/fkae")

    def _skae(self, legend: bool = True) -> Any:
        return self._plot("Station-keeping error, log10 of SKAE", "formation/skae", legend=legend)

    def _scene(self) -> Any:
        distance = 0.98 * self.size / np.tan(HALF_ANGLE)
        eye = {"position": (0.28 * distance, -distance, 0.16 * distance), "look_target": (0.0, 0.0, 0.0), "eye_up": UP}
        return rrb.Spatial3DView(
            name=f"Loop {self.shown}: the spacecraft, their links, and in yellow the leader's attitude",
            origin=f"/{self.prefix}world",
            contents=[f"/{self.prefix}world/**"],
            background=rrb.Background(color=BACKGROUND, kind="SolidColor"),
            line_grid=rrb.LineGrid3D(visible=False),
            eye_controls=rrb.EyeControls3D(kind="Orbital", **eye),
        )


def layout(prefix: str, shown: Flown, loops: list[Flown]) -> FormationLayout:
    """What the tabs of one trial are made of."""
    observed = tuple(f"{flown.loop}/{name}" for flown in loops for name in _observers(flown))
    size = float(np.max(np.linalg.norm(shown.places, axis=-1))) + 1.1
    return FormationLayout(prefix, float(shown.time[-1]), shown.loop, tuple(f.loop for f in loops), observed, size)


def _observers(flown: Flown) -> list[str]:
    return [name.removesuffix("/mean") for name in flown.channels if name.endswith("/mean")]


def _write_trial(stream: Any, prefix: str, name: str, assembly: Assembly, shown: Flown, loops: list[Flown], position: int) -> None:
    _log_scene(stream, prefix, assembly, shown)
    for path, rows, moved in _motion(shown, position):
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


def _log_scene(stream: Any, prefix: str, assembly: Assembly, shown: Flown) -> None:
    """Log once what does not move: geoms under their bodies, axes, the leader's ghost."""
    scene = assembly.scene

    def static(path: str, *what: Any) -> None:
        stream.log(f"{prefix}{path}", *what, static=True)

    static("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    for geom in visible_geoms(scene):
        body, own = scene.body(int(scene.geom_bodyid[geom])).name, scene.geom(int(geom)).name
        static(f"world/{entity(body)}/{rr.escape_entity_path_part(own.rpartition('/')[2])}", drawn(scene, int(geom)))
    triad = rr.Arrows3D(vectors=AXIS * np.eye(3), colors=AXES, radii=0.018)
    for body in assembly.attitude_joints:
        static(f"world/{entity(body)}/axes", triad)
    static("world/leader/axes", rr.Arrows3D(vectors=LEADER_AXIS * np.eye(3), colors=AXES, radii=0.022))
    ghost = {"fill_mode": "MajorWireframe", "colors": [REFERENCE]}
    static("world/leader/bus", rr.Boxes3D(half_sizes=[[0.21, 0.21, 0.27]], radii=0.008, **ghost))
    wings = rr.Boxes3D(half_sizes=[[0.17, 0.30, 0.008]] * 2, centers=[[0, 0.65, 0], [0, -0.65, 0]], radii=0.006, **ghost)
    static("world/leader/wings", wings)
    labels = [f"{i + 1}" for i in range(len(shown.places))] if len(shown.places) <= 12 else None
    outward = shown.places * (1.0 + 0.95 / np.linalg.norm(shown.places, axis=-1, keepdims=True))
    colours = [tuple(int(255 * c) for c in colour(i, len(shown.places))) for i in range(len(shown.places))]
    if labels:
        static("world/labels", rr.Points3D(outward, labels=labels, colors=colours, radii=0.004))


def _motion(shown: Flown, position: int) -> Iterator[tuple[str, NDArray[np.int64], Any]]:
    """Entities that move: path, ticks of its rows, columns."""
    ticks = len(shown.leader)
    stride = max(1, int(np.ceil(ticks / ROWS_MOST)), round(1.0 / (RATE_MOST_HZ * shown.dt)))
    rows = np.arange(0, ticks, stride)
    attitude = shown.channels["q_BN"][rows, position]
    for agent, place in enumerate(shown.places):
        where = np.broadcast_to(place, (len(rows), 3))
        yield f"world/{entity(f'craft_{agent + 1}/hull')}", rows, rr.Transform3D.columns(translation=where, quaternion=attitude[:, agent])
    leader = modified_rodrigues.to_quaternion(shown.leader[rows, :3])
    yield "world/leader", rows, rr.Transform3D.columns(translation=np.zeros((len(rows), 3)), quaternion=leader)
    came = uniform_filter1d(shown.channels["received"][:, position].astype(float), max(1, round(QUALITY_S / shown.dt)), axis=0)[rows]
    places = np.concatenate([np.zeros((1, 3)), shown.places])
    for (receiver, sender), weight, quality in zip(shown.ways, shown.weights, came.T, strict=True):
        if sender - 1 > receiver:  # of the two messages of a link one draws it
            continue
        base = np.array(LINK if sender else LINK_LEADER)
        strength = np.clip(quality * (0.35 + 0.65 * weight), 0.0, 1.0)
        colours = np.concatenate([np.tile(base, (len(rows), 1)), 255.0 * strength[:, None]], axis=-1).astype(np.uint8)
        packed = np.array([int.from_bytes(bytes(c), "big") for c in colours], dtype=np.uint32)
        strip = np.broadcast_to(places[[sender, receiver + 1]], (len(rows), 2, 3))
        yield (
            f"world/links/{sender}-{receiver + 1}",
            rows,
            rr.LineStrips3D.columns(strips=list(strip), colors=packed, radii=np.where(strength > 0.02, 0.008 + 0.016 * strength, 0.0)),
        )


def _curves(shown: Flown, loops: list[Flown], position: int) -> Iterator[tuple[Curve, NDArray[np.int64]]]:
    """Time series with the ticks of their rows."""
    ticks = len(shown.leader)
    stride = max(1, ticks // CURVE_ROWS)
    rows = np.arange(0, ticks, stride)
    place = int(np.flatnonzero(shown.trials == shown.recorded[position])[0])
    shades = tuple(LOOP_VARIANTS[i % len(LOOP_VARIANTS)][1] for i in range(len(loops)))
    names = tuple(flown.loop for flown in loops)
    for figure, path, scale in (("fkae", "fkae", 1.0), ("skae", "skae", 1.0), ("formation_angle", "angle", np.degrees(1.0))):
        values = scale * np.stack([flown.figures[figure][rows, place] for flown in loops], axis=-1)
        yield Curve(f"formation/{path}", names, shades, np.log10(np.maximum(values, 1e-12))), rows
    own = tuple(tuple(int(255 * c) for c in colour(i, len(shown.places))) for i in range(len(shown.places)))
    agents = tuple(f"{i + 1}" for i in range(len(shown.places)))
    colours: tuple[Colour, ...] = tuple((r, g, b) for r, g, b in own)
    together, labels = [], []
    for flown in loops:
        for name in _observers(flown):
            difference = flown.channels[f"{name}/mean"][:, position, :, 3:] - flown.channels["state"][:, position, :, 3:]
            each = np.sqrt(_thinned(np.sum(difference**2, axis=-1), stride))
            yield Curve(f"velocity/each/{flown.loop}/{name}", agents, colours, each), rows
            together.append(0.5 * np.log10(np.maximum(np.mean(each**2, axis=-1), 1e-10)))
            labels.append(f"{flown.loop}/{name}" if len(loops) == 1 else flown.loop)
    if together:
        offset = 0 if len(loops) == 1 else sum(not _observers(flown) for flown in loops)  # a loop has one colour everywhere
        look = tuple(LOOP_VARIANTS[(i + offset) % len(LOOP_VARIANTS)][1] for i in range(len(together)))
        yield Curve("velocity/all", tuple(labels), look, np.stack(together, axis=-1)), rows
    yield Curve("agents/turn", agents, colours, np.linalg.norm(shown.channels["state"][rows, position, :, :3], axis=-1)), rows
    square = np.sum(shown.channels["applied"][:, position] ** 2, axis=-1)
    torque = 1e3 * np.sqrt(np.maximum(uniform_filter1d(square, max(1, round(SMOOTH_S / shown.dt)), axis=0)[rows], 0.0))
    yield Curve("agents/torque", agents, colours, torque), rows
    known = np.linalg.norm(shown.channels["acceleration"][rows, position] - shown.leader[rows, None, 6:], axis=-1)
    yield Curve("agents/leader", agents, colours, known), rows


def _thinned(values: Array, stride: int) -> Array:
    """Means over `stride` ticks, (ticks, n) to (rows, n)."""
    return uniform_filter1d(values, stride, axis=0)[::stride] if stride > 1 else values
