"""`crosscheck.rrd`: the plant and the body that the model believes in side by side, how they part, and why."""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from models.attitude import quaternion
from models.dynamics.state_layout import ATTITUDE, RATE, WHEELS
from models.plants.assembly import Assembly
from sim.crosscheck.attribution import size_deg
from sim.crosscheck.divergence import passes
from sim.crosscheck.study import CrossCheck
from sim.loop.recording import Recording
from sim.plant.batch import diagnose
from sim.rerun.blueprint import BACKGROUND, BOTH_BODIES, TIMELINE, TRAIL_S, Camera
from sim.rerun.loops.scene import ROWS_MOST
from sim.rerun.recording_file import recording_file
from sim.rerun.scene import CENTRE, GHOST_LABEL, GHOST_OFFSET, body_path, floating_body, lab_of_N, size_of, stands, to_lab
from sim.rerun.sink import APPLICATION, Scales, columns, describe, entity, motion, start, style, time_column
from sim.series.channels import Curve
from sim.series.palette import ALERT, AXES, PALE_AXES, TRUTH, Colour, on_dark, wheel
from sim.units import RPM

Array = NDArray[np.floating]

ARROW = 0.25  # m of the longest arrow of momentum on a plant of the testbed's size
FURTHER = 1.6  # times the testbed's distance
EFFECTS: tuple[Colour, ...] = (
    (92, 148, 255), (255, 160, 80), (60, 205, 180), (240, 110, 130), (180, 140, 255), (240, 205, 90), (120, 205, 250), (205, 165, 125),
    (160, 170, 185), (250, 165, 200), (185, 220, 120),
)  # fmt: skip


def write_crosscheck(
    path: Path, name: str, found: CrossCheck, assembly: Assembly, tables: Iterable[Table], configuration: dict[str, Any]
) -> None:
    """Write the first trial of a cross-check as a self-contained .rrd that opens laid out.

    Args:
      path: file to be written.
      name: of the scenario.
      found: the cross-check.
      assembly: the plant.
      tables: what is said of it at the terminal.
      configuration: nested settings, kept as a property of the recording.
    """
    recording, model = _with_ghost(found), found.model.name
    time = recording.time
    stride = -(-len(time) // ROWS_MOST)  # of poses; curves keep every tick
    posed = replace(recording, channels={channel: values[::stride] for channel, values in recording.channels.items()})
    truth = diagnose(assembly, posed.channels["truth/qpos"][:, 0], posed.channels["truth/qvel"][:, 0])
    scales = _as_it_is(Scales.of(recording, assembly, None))
    if not assembly.wheel_joints:
        scales = scales._replace(momentum=ARROW * size_of(assembly) / float(np.linalg.norm(truth.momentum_N, axis=-1).max()))
    with recording_file(path, APPLICATION, _page(found, assembly, scales, float(time[-1]))) as stream:
        describe(stream, f"{name}: cross-check of {model}", configuration)
        start(stream, "", recording.thresholds, assembly, recording.channels["reference/q"])
        for path_in_file, moved in motion(posed, truth, assembly, scales):
            if not path_in_file.startswith(("world/magnified", "world/labels")):
                stream.send_columns(path_in_file, [time_column(time[::stride])], moved)
        angles = found.apart["attitude"][::stride, 0]
        for path_in_file, moved in _ghost(found.model.name, angles, posed, assembly, truth.position[:, floating_body(assembly)]):
            stream.send_columns(path_in_file, [time_column(time[::stride])], moved)
        for curve in _curves(found):
            stream.log(entity(curve.path), style(curve), static=True)
            stream.send_columns(entity(curve.path), [time_column(time[: len(curve.values)])], columns(curve))
        ticks, levels, texts = zip(*_events(found), strict=True)
        stream.send_columns("events", [time_column(found.tick_s * np.array(ticks))], rr.TextLog.columns(text=texts, level=levels))
        stream.log("tables", rr.TextDocument(_document(tables), media_type="text/markdown"), static=True)


def _as_it_is(scales: Scales) -> Scales:
    """The ghost over the testbed shows the model's attitude as it is."""
    return scales._replace(error=1.0)


def _with_ghost(found: CrossCheck) -> Recording:
    """The first trial of the flight, with the model in the place of an observer."""
    one = found.flight.recording.select(np.array([0]))
    return replace(one, channels=one.channels | {f"{found.model.name}/mean": found.states[:, :1]}, thresholds={found.model.name: None})


def _ghost(name: str, angles: Array, recording: Recording, assembly: Assembly, pivot: Array) -> Iterator[tuple[str, Any]]:
    """The wire frame of the model's body over the plant's, and the label of its solid ghost beside it; angles (rows,) deg between them."""
    part = rr.escape_entity_path_part(name)
    q_BN = recording.channels[f"{name}/mean"][:, 0, ATTITUDE]
    yield f"world/magnified/{part}", rr.Transform3D.columns(translation=pivot, quaternion=to_lab(q_BN, lab_of_N(assembly)))
    labels = [f"{name}: {angle:.2f} deg off" for angle in angles]
    yield f"world/labels/{part}", rr.Points3D.columns(positions=pivot + size_of(assembly) * (GHOST_OFFSET + GHOST_LABEL), labels=labels)


def _curves(found: CrossCheck) -> Iterator[Curve]:
    """Time series of the first trial."""
    plant, model, name = found.flight.states[:, 0], found.states[:, 0], found.model.name
    colour = on_dark([name])[name]
    for quantity in found.quantities:
        values, limit = found.apart[quantity.name][:, 0], found.thresholds[quantity.name]
        with_limit = np.stack([values, np.full(len(values), limit)], axis=-1)
        unit = "relative" if quantity.unit == "1" else quantity.unit
        lines = (f"{quantity.label} [{unit}]", f"threshold {limit:.3g} [{unit}]")
        yield Curve(f"divergence/{quantity.name}", lines, (colour, ALERT), with_limit, 1.8)
    over = np.stack([found.apart[q.name][:, 0] / found.thresholds[q.name] for q in found.quantities], axis=-1)
    decades = np.log10(np.maximum(over, 1e-3))
    yield Curve("decades/all", tuple(f"{q.label} [decades]" for q in found.quantities), EFFECTS[: len(found.quantities)], decades)
    yield Curve("decades/threshold", ("threshold [decades]",), (ALERT,), np.zeros((len(decades), 1)), 1.2)
    for who, states, colours in ((name, model, PALE_AXES), ("plant", plant, AXES)):
        turn = np.degrees(quaternion.to_rotation_vector(states[:, ATTITUDE]))
        yield Curve(f"attitude/{who}", tuple(f"{who} {a} [deg]" for a in "xyz"), colours, turn)
        yield Curve(f"rate/{who}", tuple(f"{who} {a} [deg/s]" for a in "xyz"), colours, np.degrees(states[:, RATE]))
        width = 1.0 if who == name else 2.0
        wheels = tuple(wheel(i) for i in range(states.shape[1] - 7))
        if not wheels:
            continue
        yield Curve(f"wheels/{who}", tuple(f"{who} RW{i + 1} [rpm]" for i in range(len(wheels))), wheels, states[:, WHEELS] / RPM, width)
    sizes = size_deg(found.causes.contribution[:, :, :1])
    order = [i for i in np.argsort(-sizes[:, -1]) if sizes[i, -1] > 1e-3 * sizes[:, -1].max()]  # the others are in the table
    for place, i in enumerate(order):
        effect, tint = found.causes.names[i], EFFECTS[place % len(EFFECTS)]
        yield Curve(f"causes/{effect}", (f"{effect} [deg]",), (tint,), sizes[i][:, None], 2.0 if place < 4 else 1.2)
    yield Curve("causes/total", ("total [deg]",), (TRUTH,), size_deg(found.causes.total[:, :1])[:, None], 2.6)


def _events(found: CrossCheck) -> list[tuple[int, str, str]]:
    """When thresholds are passed in the first trial, (tick, level, text), in order."""
    happened = [(0, "INFO", f"plant and {found.model.name} start from one state; the same commands from now on")]
    for quantity in found.quantities:
        limit = found.thresholds[quantity.name]
        instant = float(passes(found.apart[quantity.name][:, 0], limit, found.tick_s))
        unit = "" if quantity.unit == "1" else f" {quantity.unit}"
        if np.isfinite(instant):
            happened.append((round(instant / found.tick_s), "WARN", f"{quantity.label} passes {limit:.3g}{unit}"))
    for occurrence in found.flight.recording.occurrences:
        if occurrence.trial == 0 and occurrence.start_tick < len(found.states):
            happened.append((occurrence.start_tick, "ERROR", f"fault begins: {occurrence.text}"))
    return sorted(happened, key=lambda event: event[0])


def _document(tables: Iterable[Table]) -> str:
    """The tables as the terminal shows them."""
    text = io.StringIO()
    console = Console(file=text, width=80, no_color=True, markup=False)
    for table in tables:
        console.print(table)
    return f"```\n{text.getvalue()}\n```\n"


def _page(found: CrossCheck, assembly: Assembly, scales: Scales, duration_s: float) -> Any:
    """Two tabs: what happens, and the figures."""
    body, name = body_path(assembly.scene, floating_body(assembly)), found.model.name
    whole, horizon = (0.0, duration_s), (0.0, max(found.ticks) * found.tick_s)
    trail = rrb.VisibleTimeRanges(
        timeline=TIMELINE,
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-TRAIL_S),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
    scene = rrb.Spatial3DView(
        name=f"Plant (solid), {name} (ghost beside it, wire frame over it); {_arrows(assembly, scales)}",
        origin="/world",
        contents=["/world/**", f"- /{body}/outline/**"],
        background=rrb.Background(color=BACKGROUND, kind="SolidColor"),
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=rrb.EyeControls3D(kind="Orbital", **_eye(assembly)),
        overrides={"world/trail": trail},
    )
    log = rrb.TextLogColumns(timeline_columns=[TIMELINE], text_log_columns=["LogLevel", "Body"])
    tables = rrb.TextDocumentView(name="Tables", origin="/tables")
    overview = rrb.Horizontal(
        rrb.Vertical(scene, rrb.TextLogView(name="Thresholds passed", origin="/events", columns=log), row_shares=[76, 24]),
        rrb.Vertical(
            _plot(f"Why: angle that each effect adds to the attitude, first {horizon[1]:g} s [deg]", horizon, "causes/**"),
            _plot("All quantities over their thresholds, decades; 0: the threshold", whole, "decades/**", legend="RightBottom"),
            _plot(f"Attitude, rotation vector from N [deg]: plant, {name} (pale)", whole, "attitude/**", legend="RightTop"),
            row_shares=[40, 30, 30],
        ),
        column_shares=[54, 46],
        name="Overview",
    )
    both = rrb.Horizontal(
        rrb.Vertical(*(_plot(f"Divergence in {q.label}", whole, f"divergence/{q.name}") for q in found.quantities[:3])),
        rrb.Vertical(
            *(_plot(f"Divergence in {q.label}", whole, f"divergence/{q.name}") for q in found.quantities[3:]),
            _plot(f"Body rate [deg/s]: plant, {name} (pale)", whole, "rate/**"),
            *([_plot(f"Wheel speed [rpm]: plant, {name} (thin)", whole, "wheels/**")] if found.states.shape[-1] > 7 else []),
        ),
        name="Divergence",
    )
    configuration = rrb.TextDocumentView(name="Configuration", origin="/configuration")
    return rrb.Blueprint(
        rrb.Tabs(overview, both, rrb.Horizontal(tables, configuration, name="Tables"), active_tab=0),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="paused", loop_mode="all"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_layout=False,
        auto_views=False,
    )


def _arrows(assembly: Assembly, scales: Scales) -> str:
    """How long arrows of momentum are."""
    if assembly.wheel_joints:
        return str(scales).split(";", maxsplit=1)[0]
    return f"total momentum: 1 N m s = {scales.momentum:.2g} m"


def _eye(assembly: Assembly) -> dict[str, Any]:
    """The testbed's camera, for a plant of another size further away: such have wings."""
    if stands(assembly):
        return Camera().of(BOTH_BODIES)
    size = size_of(assembly)
    eye = Camera(assembly.scene.stat.center - size * CENTRE, size).of(BOTH_BODIES)
    position, target = np.array(eye["position"]), np.array(eye["look_target"])
    return eye | {"position": tuple(map(float, target + FURTHER * (position - target)))}


def _plot(name: str, seconds: tuple[float, float], *contents: str, legend: str = "LeftTop") -> Any:
    first, last = (rr.TimeRangeBoundary.absolute(seconds=s) for s in seconds)
    return rrb.TimeSeriesView(
        name=name,
        origin="/",
        contents=[f"/{path}" for path in contents],
        axis_x=rrb.TimeAxis(view_range=rr.TimeRange(start=first, end=last)),
        plot_legend=rrb.PlotLegend(legend),
    )
