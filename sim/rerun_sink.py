"""A run as a Rerun recording: written by columns at the end, or streamed to an open viewer while it happens."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlsplit

import numpy as np
import rerun as rr
from numpy.typing import NDArray
from scipy.stats import chi2

from models import quaternion
from models.assembly import Assembly
from sim.loop import System
from sim.plant import Diagnostics, diagnose
from sim.recording import Recorder, Recording
from sim.rerun_blueprint import TIMELINE, Layout, blueprint
from sim.rerun_scene import (
    ABOVE,
    AXES,
    BORESIGHT,
    GHOST_LABEL,
    GHOST_OFFSET,
    PALE_AXES,
    REFERENCE,
    TOTAL,
    TRUTH,
    Colour,
    body_path,
    floating_body,
    lab_of_N,
    log_scene,
    observer_colours,
    rotate,
    to_lab,
    wheel_colours,
)

Array = NDArray[np.floating]

Thresholds = dict[str, tuple[float, float] | None]

APPLICATION = "nacs"
VIEWER = "rerun+http://127.0.0.1:9876/proxy"
RPM = 30.0 / np.pi
HEALTHY: Colour = (46, 125, 70)
CALM: Colour = (52, 60, 72)
ALERT: Colour = (214, 72, 62)


class Scales(NamedTuple):
    """How large small things are drawn."""

    momentum: float = 10.0  # m per N m s
    error: float = 100.0  # angle drawn per angle of error

    @classmethod
    def of(cls, recording: Recording, assembly: Assembly, shown: str | None) -> Scales:
        """Round numbers that let the longest arrow and the largest error of a run just fit into the picture."""
        wheels = recording.channels["truth/state"][..., 7:]
        longest = float(np.max(np.abs(wheels), initial=0.0)) * assembly.wheel_inertia
        error = 0.0
        if shown:
            error = float(
                np.max(quaternion.angle(recording.channels[f"{shown}/mean"][..., :4], recording.channels["truth/state"][..., :4]))
            )
        return cls(_round(0.3 / max(longest, 1e-9)), _round(np.radians(10.0) / max(error, 1e-9)))

    def __str__(self) -> str:
        return f"1 mN m s = {self.momentum:g} mm; wire frame: error x {self.error:g}"


class Curve(NamedTuple):
    """Lines of one entity of a time series."""

    path: str
    names: tuple[str, ...]  # with the unit
    colours: tuple[Colour, ...]
    values: Array  # (ticks, lines)
    width: float = 1.5
    sigma: Array | None = None  # (ticks, lines), drawn as a band
    dots: bool = False


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
    shown = _shown(recording.observers, feedback)
    scales = Scales.of(recording, assembly, shown)
    several = len(recording.trials) > 1
    prefixes = {f"Trial {number}": f"trial_{number}/" if several else "" for number in recording.trials}
    duration = float(recording.time[-1])
    layout = blueprint(
        {label: _layout(prefix, assembly, recording.thresholds, shown, scales, duration) for label, prefix in prefixes.items()}
    )
    time = _time(recording.time)
    with rr.RecordingStream(APPLICATION) as stream:
        stream.save(path, default_blueprint=layout)
        _describe(stream, scenario_name, configuration)
        for i, prefix in enumerate(prefixes.values()):
            one = recording.select(np.array([i]))
            _start(stream, prefix, one.thresholds, assembly, one.channels["reference/q"])
            truth = diagnose(assembly, one.channels["truth/qpos"][:, 0], one.channels["truth/qvel"][:, 0])
            for entity, columns in _motion(one, truth, assembly, scales):
                stream.send_columns(prefix + entity, [time], columns)
            for curve in _curves(one, truth, assembly, shown):
                stream.log(prefix + curve.path, _style(curve), static=True)
                stream.send_columns(prefix + curve.path, [time], _columns(curve))
            lanes = _lanes(one)
            _name_faults(stream, prefix, [state for _, state in lanes["fault"]])
            for lane, changes in lanes.items():
                ticks, states = zip(*changes, strict=True)
                stream.send_columns(f"{prefix}state/{lane}", [_time(one.dt * np.array(ticks))], rr.StateChange.columns(state=states))
            ticks, levels, texts = zip(*_events(one, scenario_name), strict=True)
            stream.send_columns(f"{prefix}events", [_time(one.dt * np.array(ticks))], rr.TextLog.columns(text=texts, level=levels))


class LiveStream:
    """Shows the first trial of a running loop in an open viewer, tick by tick."""

    def __init__(self, scenario_name: str, system: System, configuration: dict[str, Any], url: str = VIEWER) -> None:
        """Connect and lay the viewer out.

        Raises:
          ConnectionError: no viewer listens at `url`.
        """
        address = urlsplit(url)
        host, port = address.hostname or "127.0.0.1", address.port or 9876
        try:
            socket.create_connection((host, port), timeout=2.0).close()
        except OSError:
            raise ConnectionError(f"no Rerun viewer listens at {host}:{port}; start one with `rerun --bind 127.0.0.1`") from None
        self._system, self._scales = system, Scales()
        self._thresholds = {name: limits for bank in system.banks for name, limits in zip(bank.names, bank.thresholds, strict=True)}
        self._shown = _shown(tuple(self._thresholds), system.feedback)
        self._lanes: dict[str, str] = {}
        self._stream = rr.RecordingStream(APPLICATION)
        layout = blueprint({"": _layout("", system.plant.assembly, self._thresholds, self._shown, self._scales, None)})
        self._stream.connect_grpc(url, default_blueprint=layout)
        self._stream.disable_timeline("log_time")
        _describe(self._stream, scenario_name, configuration)
        _start(self._stream, "", self._thresholds, system.plant.assembly, system.target.q_DN)
        _name_faults(self._stream, "", [o.text for o in system.faults.occurrences if o.trial == 0])

    def on_tick(self, tick: int, recorder: Recorder) -> None:
        """Send what is so at `tick`; a callback of the loop."""
        now = self._instant(tick, recorder)
        time = _time(np.array([tick * recorder.dt]))
        assembly, first = self._system.plant.assembly, not self._lanes
        truth = diagnose(assembly, now.channels["truth/qpos"][:, 0], now.channels["truth/qvel"][:, 0])
        for entity, columns in _motion(now, truth, assembly, self._scales):
            self._stream.send_columns(entity, [time], columns)
        for curve in _curves(now, truth, assembly, self._shown):
            if first:
                self._stream.log(curve.path, _style(curve), static=True)
            self._stream.send_columns(curve.path, [time], _columns(curve))
        for lane, ((_, state),) in _lanes(now).items():
            if self._lanes.get(lane) != state:
                self._lanes[lane] = state
                self._stream.send_columns(f"state/{lane}", [time], rr.StateChange.columns(state=[state]))

    def close(self) -> None:
        """Send what is still under way and disconnect."""
        self._stream.disconnect()

    def __enter__(self) -> LiveStream:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _instant(self, tick: int, recorder: Recorder) -> Recording:
        """The first trial at one tick; without what is reduced only later: sigma and NEES."""
        here = slice(tick, tick + 1)
        channels = {
            name: recorder.array(name)[here, :1]
            for name in ("truth/state", "truth/qpos", "truth/qvel", "torque_B", "command", "applied", "fault")
        }
        for index, bank in enumerate(recorder.banks):
            for member, name in enumerate(bank.names):
                for part in ("mean", "nis", "dof", "statistic", "declared"):
                    channels[f"{name}/{part}"] = recorder.array(f"{index}:{part}")[here, member, :1]
        target = self._system.target
        channels |= {"reference/q": target.q_DN[here], "reference/omega": target.omega_DN_D[here]}
        ongoing = tuple(
            o._replace(start_tick=0, end_tick=1)
            for o in self._system.faults.occurrences
            if o.trial == 0 and o.start_tick <= tick < o.end_tick
        )
        return Recording(recorder.dt, recorder.trials[:1], channels, self._thresholds, ongoing)


def _shown(observers: tuple[str, ...], feedback: str) -> str | None:
    """Whose ghost is visible: the feedback observer's; the first one's when the loop is closed by truth or readings."""
    return feedback if feedback in observers else next(iter(observers), None)


def _hybrids(thresholds: Thresholds) -> tuple[str, ...]:
    return tuple(name for name, limits in thresholds.items() if limits)


def _layout(prefix: str, assembly: Assembly, thresholds: Thresholds, shown: str | None, scales: Scales, duration_s: float | None) -> Layout:
    wheels = tuple(body_path(assembly.scene, int(assembly.scene.joint(j).bodyid[0])) for j in assembly.wheel_joints)
    body = body_path(assembly.scene, floating_body(assembly))
    return Layout(prefix, tuple(thresholds), _hybrids(thresholds), body, wheels, shown, str(scales), duration_s)


def _time(seconds: Array) -> Any:
    # rounded to whole nanoseconds: Rerun truncates floats, which would put instants 1 ns early
    return rr.TimeColumn(TIMELINE, duration=np.round(1e9 * seconds).astype("timedelta64[ns]"))


def _describe(stream: Any, scenario_name: str, configuration: dict[str, Any]) -> None:
    stream.send_recording_name(scenario_name)
    stream.send_property("configuration", rr.AnyValues(**dict(_flat(configuration))))
    rows = "\n".join(f"| {key} | {value} |" for key, value in _flat(configuration))
    page = f"# {scenario_name}\n\n| key | value |\n|:--|:--|\n{rows}\n"
    stream.log("configuration", rr.TextDocument(page, media_type="text/markdown"), static=True)


def _flat(settings: Any, prefix: str = "") -> Iterator[tuple[str, str | float]]:
    """Dotted keys of nested settings, and values that a person can read."""
    for key, value in settings.items():
        name = f"{prefix}{key}"
        if isinstance(value, dict) and value:
            yield from _flat(value, f"{name}.")
        elif isinstance(value, list | tuple) and value and all(isinstance(v, dict) for v in value):
            for number, item in enumerate(value):
                yield from _flat(item, f"{name}.{number}.")
        elif isinstance(value, str | bool | int | float):
            yield name, value
        else:
            yield name, json.dumps(value, default=str)


def _start(stream: Any, prefix: str, thresholds: Thresholds, assembly: Assembly, q_DN: Array) -> None:
    """Everything that does not change in a trial."""
    log_scene(stream, prefix, assembly, observer_colours(thresholds))
    mount, pivot = lab_of_N(assembly), assembly.model.body_pos[floating_body(assembly)]
    trace = pivot + rotate(to_lab(q_DN, mount), BORESIGHT)
    stream.log(f"{prefix}world/reference_trace", rr.LineStrips3D([trace], colors=[(*REFERENCE, 120)], radii=0.0007), static=True)
    for name, limits in thresholds.items():
        if limits:
            states = rr.StateConfiguration(values=["healthy", "declared"], labels=["Kalman gain", "sliding gain"], colors=[HEALTHY, ALERT])
            stream.log(f"{prefix}state/{rr.escape_entity_path_part(name)}", states, static=True)


def _name_faults(stream: Any, prefix: str, states: list[str]) -> None:
    """Colour the lane of faults: calm while there is none."""
    values = list(dict.fromkeys(["none", *states]))
    stream.log(f"{prefix}state/fault", rr.StateConfiguration(values=values, colors=[CALM, *[ALERT] * (len(values) - 1)]), static=True)


def _motion(recording: Recording, truth: Diagnostics, assembly: Assembly, scales: Scales) -> Iterator[tuple[str, Any]]:
    """Entities that move, with their columns, of a recording of one trial."""
    state = recording.channels["truth/state"][:, 0]
    root, mount = floating_body(assembly), lab_of_N(assembly)
    pivot = truth.position[:, root]
    for body in range(1, assembly.model.nbody):
        columns = rr.Transform3D.columns(translation=truth.position[:, body], quaternion=truth.quaternion[:, body])
        yield body_path(assembly.scene, body), columns
    yield "world/reference", rr.Transform3D.columns(translation=pivot, quaternion=to_lab(recording.channels["reference/q"], mount))
    for name in recording.observers:
        part = rr.escape_entity_path_part(name)
        q_BN = quaternion.normalize(recording.channels[f"{name}/mean"][:, 0, :4])
        yield f"world/estimate/{part}", rr.Transform3D.columns(translation=pivot + GHOST_OFFSET, quaternion=to_lab(q_BN, mount))
        error = scales.error * quaternion.error(q_BN, state[:, :4])
        size = np.linalg.norm(error, axis=-1, keepdims=True)
        error = error * np.minimum(1.0, 0.5 * np.pi / np.maximum(size, 1e-12))  # a lost filter shall not seem to come round again
        magnified = quaternion.multiply(quaternion.from_rotation_vector(error), state[:, :4])
        yield f"world/magnified/{part}", rr.Transform3D.columns(translation=pivot, quaternion=to_lab(magnified, mount))
        labels = [f"{name}: {a:.2f} mrad off" for a in 1e3 * quaternion.angle(q_BN, state[:, :4])]
        yield f"world/labels/{part}", rr.Points3D.columns(positions=pivot + GHOST_OFFSET + GHOST_LABEL, labels=labels)
    yield "world/trail", rr.Points3D.columns(positions=pivot + rotate(truth.quaternion[:, root], BORESIGHT))
    total = rotate(np.broadcast_to(mount, (len(state), 4)), truth.momentum_N)
    yield "world/momentum", rr.Arrows3D.columns(origins=pivot + ABOVE, vectors=scales.momentum * total)
    for joint, speed in zip(assembly.wheel_joints, state[:, 7:].T, strict=True):
        place = assembly.scene.joint(joint)
        axis = assembly.scene.jnt_axis[place.id]
        arrow = scales.momentum * assembly.wheel_inertia * speed[:, None] * axis
        yield f"{body_path(assembly.scene, int(place.bodyid[0]))}/momentum", rr.Arrows3D.columns(vectors=arrow)


def _curves(recording: Recording, truth: Diagnostics, assembly: Assembly, shown: str | None) -> Iterator[Curve]:
    """Time series of a recording of one trial; channels that it lacks are left out."""
    get = {name: array if name.startswith("reference/") else array[:, 0] for name, array in recording.channels.items()}
    state, wheels = get["truth/state"], wheel_colours(assembly)
    colours = observer_colours(recording.observers)
    q_BN, omega, speed = state[:, :4], state[:, 4:7], state[:, 7:]
    target, numbered = get["reference/q"], tuple(f"RW{i + 1}" for i in range(speed.shape[1]))

    def xyz(what: str, unit: str) -> tuple[str, ...]:
        return tuple(f"{what}{axis} [{unit}]" for axis in "xyz")

    def each(unit: str) -> tuple[str, ...]:
        return tuple(f"{name} [{unit}]" for name in numbered)

    turn = np.degrees(quaternion.to_rotation_vector(q_BN))
    yield Curve("attitude/reference", xyz("reference ", "deg"), PALE_AXES, np.degrees(quaternion.to_rotation_vector(target)), 1.0)
    yield Curve("attitude/truth", xyz("", "deg"), AXES, turn)
    yield Curve("attitude/tracking", xyz("", "deg"), AXES, np.degrees(quaternion.error(q_BN, target)))
    yield Curve("rate/truth", xyz("", "deg/s"), AXES, np.degrees(omega))
    yield Curve("rate/reference", xyz("reference ", "deg/s"), PALE_AXES, np.degrees(get["reference/omega"]), 1.0)
    yield Curve("wheels/speed", each("rpm"), tuple(wheels), RPM * speed)
    yield Curve("wheels/momentum", each("mN m s"), tuple(wheels), 1e3 * assembly.wheel_inertia * speed)
    yield Curve("wheels/command", each("mN m"), tuple(wheels), 1e3 * get["command"])
    yield Curve("wheels/applied", each("mN m"), tuple(wheels), 1e3 * get["applied"])
    yield Curve("control/torque_B", xyz("", "mN m"), AXES, 1e3 * get["torque_B"])
    momentum = 1e3 * truth.momentum_N
    total = np.concatenate([momentum, np.linalg.norm(momentum, axis=-1, keepdims=True)], axis=-1)
    yield Curve("physics/momentum", (*xyz("", "mN m s"), "length [mN m s]"), (*AXES, TOTAL), total)
    yield Curve("physics/energy", ("energy [J]",), (TRUTH,), truth.energy[:, None])
    for name, colour in colours.items():
        part, mean = rr.escape_entity_path_part(name), get[f"{name}/mean"]
        q_est, one = quaternion.normalize(mean[:, :4]), name == shown
        error = 1e3 * quaternion.error(q_est, q_BN)
        width = 2.0 if one else 1.2
        yield Curve(f"attitude/error/{part}", (f"{name} [mrad]",), (colour,), np.linalg.norm(error, axis=-1, keepdims=True), width)
        rate = np.degrees(mean[:, 4:7] - omega)
        yield Curve(f"rate/error/{part}", (f"{name} [deg/s]",), (colour,), np.linalg.norm(rate, axis=-1, keepdims=True), width)
        spin = RPM * (mean[:, 7:] - speed)
        yield Curve(f"wheels/error/{part}", (f"{name} [rpm]",), (colour,), np.linalg.norm(spin, axis=-1, keepdims=True), width)
        if one:
            sigma = get.get(f"{name}/sigma")
            yield Curve("attitude/error_axes", xyz("", "mrad"), AXES, error, 1.2, None if sigma is None else 1e3 * sigma[:, :3])
            yield Curve("rate/estimate", xyz("estimate ", "deg/s"), PALE_AXES, np.degrees(mean[:, 4:7]), 1.0)
        yield Curve(f"consistency/nis/{part}", (f"NIS {name} [-]",), (colour,), get[f"{name}/nis"][:, None], 1.6, dots=True)
        if f"{name}/nees" in get:
            yield Curve(f"consistency/nees/{part}", (f"NEES {name} [-]",), (colour,), get[f"{name}/nees"][:, None], 1.2)
        if limits := recording.thresholds[name]:
            value = np.stack([get[f"{name}/statistic"], *(np.full(len(state), limit) for limit in limits)], axis=-1)
            lines = (f"smoothed NIS {name} [-]", f"declares above {limits[0]:.0f} [-]", f"withdraws below {limits[1]:.0f} [-]")
            yield Curve(f"consistency/statistic/{part}", lines, (colour, ALERT, HEALTHY), value)
    for name, dof in (("nis", float(state.shape[1])), ("nees", float(state.shape[1] - 1))):
        limits = chi2.ppf([0.025, 0.975], dof)
        bounds = (f"2.5 % of chi-square, {dof:.0f} dof [-]", f"97.5 % of chi-square, {dof:.0f} dof [-]")
        yield Curve(f"consistency/{name}_band", bounds, (REFERENCE,) * 2, np.tile(limits, (len(state), 1)), 1.0)


def _style(curve: Curve) -> Any:
    if curve.dots:
        return rr.SeriesPoints(names=curve.names, colors=curve.colours, marker_sizes=curve.width, markers="circle")
    look: dict[str, Any] = {"names": curve.names, "colors": curve.colours, "widths": [curve.width] * len(curve.names)}
    return rr.SeriesLines(**look) if curve.sigma is None else rr.Measurements.from_fields(**look)


def _columns(curve: Curve) -> Any:
    lines = curve.values.shape[1]
    if curve.sigma is None:
        return rr.Scalars.columns(scalars=curve.values.ravel()).partition(np.full(len(curve.values), lines))
    columns = rr.Measurements.columns(values=curve.values.ravel(), variances=curve.sigma.ravel() ** 2)
    return columns.partition(np.full(len(curve.values), lines))


def _lanes(recording: Recording) -> dict[str, list[tuple[int, str]]]:
    """Changes (tick, state) of the faults and of every detector in a recording of one trial."""
    faults = ["none"] * recording.ticks
    for o in recording.occurrences:
        for k in range(o.start_tick, min(o.end_tick, recording.ticks)):
            faults[k] = o.text if faults[k] == "none" else f"{faults[k]}, {o.text}"
    lanes = {"fault": faults}
    for name in _hybrids(recording.thresholds):
        declared = recording.channels[f"{name}/declared"][:, 0]
        lanes[rr.escape_entity_path_part(name)] = ["declared" if d else "healthy" for d in declared]
    return {lane: [(k, s) for k, s in enumerate(states) if k == 0 or s != states[k - 1]] for lane, states in lanes.items()}


def _events(recording: Recording, scenario_name: str) -> list[tuple[int, str, str]]:
    """What happened in a recording of one trial, as (tick, level, text), in order."""
    faults = [o for o in recording.occurrences if o.start_tick < recording.ticks]
    events = [(0, "INFO", f"start of {scenario_name}, trial {recording.trials[0]}")]
    events += [(o.start_tick, "ERROR", f"fault begins: {o.text}") for o in faults]
    events += [(o.end_tick, "INFO", f"fault ends: {o.text}") for o in faults if o.end_tick < recording.ticks]
    for name in _hybrids(recording.thresholds):
        declared = recording.channels[f"{name}/declared"][:, 0].astype(bool)
        for k in map(int, np.flatnonzero(np.diff(declared, prepend=False))):
            began = max((o.start_tick for o in faults if o.start_tick <= k), default=None)
            cause = "though none has begun" if began is None else f"{recording.dt * (k - began):.1f} s after the last one began"
            events.append((k, "WARN", f"{name} declares a fault, {cause}") if declared[k] else (k, "INFO", f"{name} withdraws its fault"))
    return [*sorted(events, key=lambda e: e[0]), (recording.ticks - 1, "INFO", "end of the recording")]


def _round(value: float) -> float:
    """Largest of 1, 2, 5 times a power of ten that does not exceed `value`."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(m * power for m in (1.0, 2.0, 5.0) if m * power <= value * (1 + 1e-9)))
