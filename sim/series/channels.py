"""The time series, timelines of states and events that a person is shown of one trial, whatever draws them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from models.attitude import quaternion
from models.dynamics.state_layout import ATTITUDE, RATE, WHEELS
from models.plants.assembly import Assembly
from sim.loop.recording import Recording
from sim.plant.batch import Diagnostics
from sim.series.palette import (
    ALERT,
    AXES,
    HEALTHY,
    PALE_AXES,
    REFERENCE,
    TOTAL,
    TRUTH,
    Colour,
    on_dark,
    wheel,
)
from sim.units import RPM

Array = NDArray[np.floating]


class Curve(NamedTuple):
    """Lines of one entity of a time series."""

    path: str
    names: tuple[str, ...]  # with the unit
    colours: tuple[Colour, ...]
    values: Array  # (ticks, lines)
    width: float = 1.5
    sigma: Array | None = None  # (ticks, lines), drawn as a band
    dots: bool = False
    aggregation: str | None = None  # of values that share a pixel; None: as the viewer likes


def curves(recording: Recording, truth: Diagnostics, assembly: Assembly, shown: str | None) -> Iterator[Curve]:
    """Time series of a recording of one trial; channels that it lacks are left out."""
    get = {name: array if name.startswith("reference/") else array[:, 0] for name, array in recording.channels.items()}
    state, wheels = get["truth/state"], [wheel(i) for i in range(len(assembly.wheel_joints))]
    colours = on_dark(recording.observers)
    q_BN, omega, speed = state[:, ATTITUDE], state[:, RATE], state[:, WHEELS]
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
    yield Curve("wheels/speed", each("rpm"), tuple(wheels), speed / RPM)
    yield Curve("wheels/momentum", each("mN m s"), tuple(wheels), 1e3 * assembly.wheel_inertia * speed)
    yield Curve("wheels/command", each("mN m"), tuple(wheels), 1e3 * get["command"])
    yield Curve("wheels/applied", each("mN m"), tuple(wheels), 1e3 * get["applied"])
    yield Curve("control/torque_B", xyz("", "mN m"), AXES, 1e3 * get["torque_B"])
    momentum = 1e3 * truth.momentum_N
    total = np.concatenate([momentum, np.linalg.norm(momentum, axis=-1, keepdims=True)], axis=-1)
    yield Curve("physics/momentum", (*xyz("", "mN m s"), "length [mN m s]"), (*AXES, TOTAL), total)
    yield Curve("physics/energy", ("energy [J]",), (TRUTH,), truth.energy[:, None])
    for name, colour in colours.items():
        part, mean = name, get[f"{name}/mean"]
        q_est, one = quaternion.normalize(mean[:, ATTITUDE]), name == shown
        error = 1e3 * quaternion.error(q_est, q_BN)
        width = 2.0 if one else 1.2
        yield Curve(f"attitude/error/{part}", (f"{name} [mrad]",), (colour,), np.linalg.norm(error, axis=-1, keepdims=True), width)
        rate = np.degrees(mean[:, RATE] - omega)
        yield Curve(f"rate/error/{part}", (f"{name} [deg/s]",), (colour,), np.linalg.norm(rate, axis=-1, keepdims=True), width)
        if mean.shape[-1] > 7:  # else the wheel speeds are read, not estimated
            spin = (mean[:, WHEELS] - speed) / RPM
            yield Curve(f"wheels/error/{part}", (f"{name} [rpm]",), (colour,), np.linalg.norm(spin, axis=-1, keepdims=True), width)
        if one:
            sigma = get.get(f"{name}/sigma")
            yield Curve("attitude/error_axes", xyz("", "mrad"), AXES, error, 1.2, None if sigma is None else 1e3 * sigma[:, :3])
            yield Curve("rate/estimate", xyz("estimate ", "deg/s"), PALE_AXES, np.degrees(mean[:, RATE]), 1.0)
        yield Curve(f"consistency/nis/{part}", (f"NIS {name} [-]",), (colour,), get[f"{name}/nis"][:, None], 1.6, dots=True)
        if f"{name}/nees" in get:
            yield Curve(f"consistency/nees/{part}", (f"NEES {name} [-]",), (colour,), get[f"{name}/nees"][:, None], 1.2)
        if limits := recording.thresholds[name]:
            value = np.stack([get[f"{name}/statistic"], *(np.full(len(state), limit) for limit in limits)], axis=-1)
            what = "P(fault)" if name in modal(recording.thresholds) else "smoothed NIS"
            on, off = (f"{limit:.0f}" if limit > 1.0 else f"{limit:g}" for limit in limits)
            lines = (f"{what} {name} [-]", f"declares above {on} [-]", f"withdraws below {off} [-]")
            yield Curve(f"consistency/statistic/{part}", lines, (colour, ALERT, HEALTHY), value)
        if f"{name}/modes" in get:
            modes = get[f"{name}/modes"]
            shades = (REFERENCE, *(wheel(i) for i in range(modes.shape[-1] - 1)))
            yield Curve(f"modes/{part}", tuple(f"mode {i + 1} [-]" for i in range(modes.shape[-1])), shades, modes)
    errors = (get[f"{shown}/mean"].shape[-1] if shown else state.shape[-1]) - 1  # the quaternion has a component too many
    complete = np.full(len(state), float(errors))
    for name, dof in (("nis", get[f"{shown}/dof"] if shown else complete), ("nees", complete)):
        yield Curve(f"consistency/{name}_band", *chi_square_band(dof))


def chi_square_band(dof: Array) -> tuple[tuple[str, str], tuple[Colour, Colour], Array, float]:
    """Names, colours, limits (ticks, 2) and width of the 95 % band of a NIS or NEES with `dof` (ticks,) degrees of freedom.

    NIS has those of what was read at a tick; where nothing was read there is no band.
    """
    known = dof[dof > 0.0]
    said = f"{known.max():.0f} dof" + ("" if np.ptp(known) == 0.0 else ", fewer where readings are missing") if len(known) else "no dof"
    limits = chi2.ppf([0.025, 0.975], np.where(dof > 0.0, dof, np.nan)[:, None])
    return (f"2.5 % of chi-square, {said} [-]", f"97.5 % of chi-square, {said} [-]"), (REFERENCE,) * 2, limits, 1.0


def degrees_of_freedom(recording: Recording, observer: str) -> int:
    """Of an observer's NIS while nothing is missing; zero if it never says."""
    return int(np.max(np.nan_to_num(recording.channels[f"{observer}/dof"]), initial=0.0))


def hybrids(thresholds: dict[str, tuple[float, float] | None]) -> tuple[str, ...]:
    """Observers that declare faults."""
    return tuple(name for name, limits in thresholds.items() if limits)


def modal(thresholds: dict[str, tuple[float, float] | None]) -> tuple[str, ...]:
    """Observers with probabilities of modes: what they compare with their thresholds is a probability, so these are below one."""
    return tuple(name for name, limits in thresholds.items() if limits and limits[0] < 1.0)


def state_timelines(recording: Recording) -> dict[str, list[tuple[int, str]]]:
    """Changes (tick, state) of the faults and of every detector in a recording of one trial."""
    faults = ["none"] * recording.ticks
    for o in recording.occurrences:
        for k in range(o.start_tick, min(o.end_tick, recording.ticks)):
            faults[k] = o.text if faults[k] == "none" else f"{faults[k]}, {o.text}"
    states_of = {"fault": faults}
    for name in hybrids(recording.thresholds):
        declared = recording.channels[f"{name}/declared"][:, 0]
        states_of[name] = ["declared" if d else "healthy" for d in declared]
    return {lane: [(k, s) for k, s in enumerate(states) if k == 0 or s != states[k - 1]] for lane, states in states_of.items()}


def events(recording: Recording, scenario_name: str) -> list[tuple[int, str, str]]:
    """What happened in a recording of one trial, as (tick, level, text), in order."""
    faults = [o for o in recording.occurrences if o.start_tick < recording.ticks]
    found = [(0, "INFO", f"start of {scenario_name}, trial {recording.trials[0]}")]
    found += [(o.start_tick, "ERROR", f"fault begins: {o.text}") for o in faults]
    found += [(o.end_tick, "INFO", f"fault ends: {o.text}") for o in faults if o.end_tick < recording.ticks]
    for name in hybrids(recording.thresholds):
        declared = recording.channels[f"{name}/declared"][:, 0].astype(bool)
        for k in map(int, np.flatnonzero(np.diff(declared, prepend=False))):
            began = max((o.start_tick for o in faults if o.start_tick <= k), default=None)
            cause = "none has begun" if began is None else f"{recording.dt * (k - began):.1f} s into the last"
            found.append((k, "WARN", f"{name} declares a fault ({cause})") if declared[k] else (k, "INFO", f"{name} withdraws its fault"))
    return [*sorted(found, key=lambda e: e[0]), (recording.ticks - 1, "INFO", "end of the recording")]
