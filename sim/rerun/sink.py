"""A run as a Rerun recording: written by columns at the end, or streamed to an open viewer while it happens."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from models.attitude import quaternion
from models.dynamics.state_layout import ATTITUDE, WHEELS
from models.plants.assembly import Assembly
from sim.loop.recording import Recording
from sim.plant.batch import Diagnostics, diagnose
from sim.rerun.blueprint import TIMELINE, WHEEL_VIEW, Camera, Layout, blueprint
from sim.rerun.geoms import rotate
from sim.rerun.recording_file import recording_file
from sim.rerun.scene import (
    ABOVE,
    CENTRE,
    GHOST_LABEL,
    GHOST_OFFSET,
    body_path,
    boresight,
    floating_body,
    lab_of_N,
    log_scene,
    size_of,
    stands,
    to_lab,
)
from sim.series.channels import Curve, curves, events, hybrids, modal, state_timelines
from sim.series.palette import ALERT, CALM, HEALTHY, REFERENCE, on_dark

Array = NDArray[np.floating]

Thresholds = dict[str, tuple[float, float] | None]

APPLICATION = "nacs"


class Scales(NamedTuple):
    """How large small things are drawn."""

    momentum: float = 10.0  # m per N m s
    error: float = 100.0  # angle drawn per angle of error

    @classmethod
    def of(cls, recording: Recording, assembly: Assembly, shown: str | None) -> Scales:
        """Round numbers that let the longest arrow and the largest error of a run just fit into the picture."""
        wheels = recording.channels["truth/state"][..., WHEELS]
        longest = float(np.max(np.abs(np.nan_to_num(wheels)), initial=0.0)) * assembly.wheel_inertia
        error = 0.0
        if shown:
            mean, truth = recording.channels[f"{shown}/mean"], recording.channels["truth/state"]
            error = float(np.max(np.nan_to_num(quaternion.angle(mean[..., ATTITUDE], truth[..., ATTITUDE]))))
        return cls(_round(0.3 * size_of(assembly) / max(longest, 1e-9)), _round(np.radians(10.0) / max(error, 1e-9)))

    def __str__(self) -> str:
        return f"1 mN m s = {self.momentum:g} mm; wire frame: error x {self.error:g}"


def write_recording(
    path: Path, scenario_name: str, recording: Recording, assembly: Assembly, feedback: str, configuration: dict[str, Any]
) -> None:
    """Write a run as a self-contained .rrd that opens laid out.

    Args:
      path: file to be written.
      scenario_name: family/name; the recording's name in the viewer.
      recording: of one or more trials; several go under /trial_<number> each.
      assembly: the plant that was run.
      feedback: who told the controller the state; its ghost is the visible one.
      configuration: nested settings, kept as a property of the recording.
    """
    shown = who_is_shown(recording.observers, feedback)
    scales = Scales.of(recording, assembly, shown)
    several = len(recording.trials) > 1
    prefixes = {f"Trial {number}": f"trial_{number}/" if several else "" for number in recording.trials}
    duration = float(recording.time[-1])
    page = blueprint({label: layout(prefix, assembly, recording.thresholds, shown, scales, duration) for label, prefix in prefixes.items()})
    with recording_file(path, APPLICATION, page) as stream:
        describe(stream, scenario_name, configuration)
        for i, prefix in enumerate(prefixes.values()):
            one = recording.select(np.array([i]))
            one = one.until(one.counted)  # of a trial that broke down what there was until then
            time = time_column(one.time)
            start(stream, prefix, one.thresholds, assembly, one.channels["reference/q"])
            truth = diagnose(assembly, one.channels["truth/qpos"][:, 0], one.channels["truth/qvel"][:, 0])
            for path_in_file, moved in motion(one, truth, assembly, scales):
                stream.send_columns(prefix + path_in_file, [time], moved)
            for curve in curves(one, truth, assembly, shown):
                stream.log(prefix + entity(curve.path), style(curve), static=True)
                stream.send_columns(prefix + entity(curve.path), [time], columns(curve))
            changes_of = state_timelines(one)
            name_faults(stream, prefix, [state for _, state in changes_of["fault"]])
            for lane, changes in changes_of.items():
                ticks, states = zip(*changes, strict=True)
                stream.send_columns(
                    prefix + entity(f"state/{lane}"), [time_column(one.dt * np.array(ticks))], rr.StateChange.columns(state=states)
                )
            ticks, levels, texts = zip(*events(one, scenario_name), strict=True)
            stream.send_columns(f"{prefix}events", [time_column(one.dt * np.array(ticks))], rr.TextLog.columns(text=texts, level=levels))


def who_is_shown(observers: tuple[str, ...], feedback: str) -> str | None:
    """Whose ghost is visible: the feedback observer's; the first one's when the loop is closed by truth or readings."""
    return feedback if feedback in observers else next(iter(observers), None)


def layout(prefix: str, assembly: Assembly, thresholds: Thresholds, shown: str | None, scales: Scales, duration_s: float) -> Layout:
    """What the tabs of one trial are made of."""
    wheels = tuple(body_path(assembly.scene, int(assembly.scene.joint(j).bodyid[0])) for j in assembly.wheel_joints)
    body = body_path(assembly.scene, floating_body(assembly))
    body_camera, wheel_camera = Camera(), Camera()
    if not stands(assembly):
        hubs = [assembly.scene.body_pos[assembly.scene.joint(joint).bodyid[0]] for joint in assembly.wheel_joints]
        aims = (assembly.scene.stat.center, CENTRE), (np.mean(hubs, axis=0), np.array(WHEEL_VIEW["look_target"]))
        body_camera, wheel_camera = (Camera(to - size_of(assembly) * home, size_of(assembly)) for to, home in aims)
    return Layout(
        prefix,
        duration_s,
        "Testbed" if stands(assembly) else "Spacecraft",
        tuple(thresholds),
        hybrids(thresholds),
        modal(thresholds),
        body,
        wheels,
        shown,
        str(scales),
        body_camera,
        wheel_camera,
    )


def entity(path: str) -> str:
    """An entity path whose parts may hold any character."""
    return "/".join(rr.escape_entity_path_part(part) for part in path.split("/"))


def time_column(seconds: Array) -> Any:
    """Index of a column, (rows,) s."""
    # rounded to whole nanoseconds: Rerun truncates floats, which would put instants 1 ns early
    return rr.TimeColumn(TIMELINE, duration=np.round(1e9 * seconds).astype("timedelta64[ns]"))


def describe(stream: Any, scenario_name: str, configuration: dict[str, Any]) -> None:
    """Name the recording and keep its settings, as a property and as a page."""
    stream.send_recording_name(scenario_name)
    stream.send_property("configuration", rr.AnyValues(**{"scenario": scenario_name, **dict(_flat(configuration))}))
    rows = "\n".join(f"| {key} | {value} |" for key, value in _flat(configuration))
    page = f"# {scenario_name}\n\n| key | value |\n|:--|:--|\n{rows}\n"
    stream.log("configuration", rr.TextDocument(page, media_type="text/markdown"), static=True)


def _flat(settings: Any, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Dotted keys of nested settings, and values as text: Rerun wants one type for a key in all recordings of a process."""
    for key, value in settings.items():
        name = f"{prefix}{key}"
        if isinstance(value, dict) and value:
            yield from _flat(value, f"{name}.")
        elif isinstance(value, list | tuple) and value and all(isinstance(v, dict) for v in value):
            for number, item in enumerate(value):
                yield from _flat(item, f"{name}.{number}.")
        else:
            yield name, value if isinstance(value, str) else json.dumps(value, default=str)


def start(stream: Any, prefix: str, thresholds: Thresholds, assembly: Assembly, q_DN: Array) -> None:
    """Everything that does not change in a trial."""
    log_scene(stream, prefix, assembly, on_dark(thresholds))
    mount, pivot, size = lab_of_N(assembly), assembly.model.body_pos[floating_body(assembly)], size_of(assembly)
    trace = pivot + rotate(to_lab(q_DN, mount), boresight(assembly))
    stream.log(f"{prefix}world/reference_trace", rr.LineStrips3D([trace], colors=[(*REFERENCE, 120)], radii=size * 0.0007), static=True)
    for name, limits in thresholds.items():
        if limits:
            labels = ["healthy", "faulty"] if name in modal(thresholds) else ["Kalman gain", "sliding gain"]
            states = rr.StateConfiguration(values=["healthy", "declared"], labels=labels, colors=[HEALTHY, ALERT])
            stream.log(f"{prefix}state/{rr.escape_entity_path_part(name)}", states, static=True)


def name_faults(stream: Any, prefix: str, states: list[str]) -> None:
    """Colour the lane of faults: calm while there is none."""
    values = list(dict.fromkeys(["none", *states]))
    stream.log(f"{prefix}state/fault", rr.StateConfiguration(values=values, colors=[CALM, *[ALERT] * (len(values) - 1)]), static=True)


def motion(recording: Recording, truth: Diagnostics, assembly: Assembly, scales: Scales) -> Iterator[tuple[str, Any]]:
    """Entities that move, with their columns, of a recording of one trial."""
    state = recording.channels["truth/state"][:, 0]
    root, mount = floating_body(assembly), lab_of_N(assembly)
    pivot, size = truth.position[:, root], size_of(assembly)
    beside, above = size * GHOST_OFFSET, size * ABOVE
    for body in range(1, assembly.model.nbody):
        yield (
            body_path(assembly.scene, body),
            rr.Transform3D.columns(translation=truth.position[:, body], quaternion=truth.quaternion[:, body]),
        )
    yield "world/reference", rr.Transform3D.columns(translation=pivot, quaternion=to_lab(recording.channels["reference/q"], mount))
    for name in recording.observers:
        part = rr.escape_entity_path_part(name)
        q_BN = quaternion.normalize(recording.channels[f"{name}/mean"][:, 0, ATTITUDE])
        yield f"world/estimate/{part}", rr.Transform3D.columns(translation=pivot + beside, quaternion=to_lab(q_BN, mount))
        error = scales.error * quaternion.error(q_BN, state[:, ATTITUDE])
        length = np.linalg.norm(error, axis=-1, keepdims=True)
        error = error * np.minimum(1.0, 0.5 * np.pi / np.maximum(length, 1e-12))  # a lost filter shall not seem to come round again
        magnified = quaternion.multiply(quaternion.from_rotation_vector(error), state[:, ATTITUDE])
        yield f"world/magnified/{part}", rr.Transform3D.columns(translation=pivot, quaternion=to_lab(magnified, mount))
        labels = [f"{name}: {a:.2f} mrad off" for a in 1e3 * quaternion.angle(q_BN, state[:, ATTITUDE])]
        yield f"world/labels/{part}", rr.Points3D.columns(positions=pivot + beside + size * GHOST_LABEL, labels=labels)
    yield "world/trail", rr.Points3D.columns(positions=pivot + rotate(truth.quaternion[:, root], boresight(assembly)))
    total = rotate(np.broadcast_to(mount, (len(state), 4)), truth.momentum_N)
    yield "world/momentum", rr.Arrows3D.columns(origins=pivot + above, vectors=scales.momentum * total)
    for joint, speed in zip(assembly.wheel_joints, state[:, WHEELS].T, strict=True):
        place = assembly.scene.joint(joint)
        axis = assembly.scene.jnt_axis[place.id]
        arrow = scales.momentum * assembly.wheel_inertia * speed[:, None] * axis
        yield f"{body_path(assembly.scene, int(place.bodyid[0]))}/momentum", rr.Arrows3D.columns(vectors=arrow)


def style(curve: Curve) -> Any:
    """Names, colours and widths of a curve; static."""
    if curve.dots:
        return rr.SeriesPoints(names=curve.names, colors=curve.colours, marker_sizes=curve.width, markers="circle")
    look: dict[str, Any] = {"names": curve.names, "colors": curve.colours, "widths": [curve.width] * len(curve.names)}
    if curve.aggregation:
        look["aggregation_policy"] = curve.aggregation
    return rr.SeriesLines(**look) if curve.sigma is None else rr.Measurements.from_fields(**look)


def columns(curve: Curve) -> Any:
    """All values of a curve."""
    lines = curve.values.shape[1]
    if curve.sigma is None:
        return rr.Scalars.columns(scalars=curve.values.ravel()).partition(np.full(len(curve.values), lines))
    measured = rr.Measurements.columns(values=curve.values.ravel(), variances=curve.sigma.ravel() ** 2)
    return measured.partition(np.full(len(curve.values), lines))


def _round(value: float) -> float:
    """Largest of 1, 2, 5 times a power of ten that does not exceed `value`."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(m * power for m in (1.0, 2.0, 5.0) if m * power <= value * (1 + 1e-9)))
