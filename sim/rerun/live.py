"""A run shown in an open Rerun viewer while it happens."""

from __future__ import annotations

import socket
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import rerun as rr

from sim.loop.closed_loop import System
from sim.loop.recorder import Recorder
from sim.loop.recording import Recording
from sim.plant.batch import diagnose
from sim.rerun.blueprint import blueprint
from sim.rerun.sink import (
    APPLICATION,
    Scales,
    columns,
    describe,
    entity,
    layout,
    motion,
    name_faults,
    start,
    style,
    time_column,
    who_is_shown,
)
from sim.series.channels import curves, state_timelines

VIEWER = "rerun+http://127.0.0.1:9876/proxy"


def connect(stream: rr.RecordingStream, url: str, page: Any) -> None:
    """Send a stream to an open viewer, laid out by a blueprint.

    Raises:
      ConnectionError: no viewer listens at `url`.
    """
    address = urlsplit(url)
    host, port = address.hostname or "127.0.0.1", address.port or 9876
    try:
        socket.create_connection((host, port), timeout=2.0).close()
    except OSError:
        raise ConnectionError(f"no Rerun viewer listens at {host}:{port}; start one with `rerun --bind 127.0.0.1`") from None
    stream.connect_grpc(url, default_blueprint=page)
    stream.disable_timeline("log_time")


class LiveStream:
    """Shows the first trial of a running loop in an open viewer, tick by tick."""

    def __init__(self, scenario_name: str, system: System, closed_by: str, configuration: dict[str, Any], url: str = VIEWER) -> None:
        """Connect and lay the viewer out.

        Raises:
          ConnectionError: no viewer listens at `url`.
        """
        self._system, self._scales = system, Scales()
        self._thresholds = {name: limits for bank in system.estimators for name, limits in zip(bank.names, bank.thresholds, strict=True)}
        self._shown = who_is_shown(tuple(self._thresholds), closed_by)
        self._lanes: dict[str, str] = {}
        self._stream = rr.RecordingStream(APPLICATION)
        duration = system.dt * (system.ticks - 1)
        page = blueprint({"": layout("", system.plant.assembly, self._thresholds, self._shown, self._scales, duration)}, live=True)
        connect(self._stream, url, page)
        describe(self._stream, scenario_name, configuration)
        start(self._stream, "", self._thresholds, system.plant.assembly, system.references["q"])
        name_faults(self._stream, "", [o.text for o in system.occurrences if o.trial == 0])

    def on_tick(self, loop: str, tick: int, recorder: Recorder) -> None:  # noqa: ARG002
        """Send what is so at `tick`; a callback of the loop."""
        now = self._instant(tick, recorder)
        time = time_column(np.array([tick * recorder.dt]))
        assembly, first = self._system.plant.assembly, not self._lanes
        truth = diagnose(assembly, now.channels["truth/qpos"][:, 0], now.channels["truth/qvel"][:, 0])
        for path, moved in motion(now, truth, assembly, self._scales):
            self._stream.send_columns(path, [time], moved)
        for curve in curves(now, truth, assembly, self._shown):
            if first:
                self._stream.log(entity(curve.path), style(curve), static=True)
            self._stream.send_columns(entity(curve.path), [time], columns(curve))
        for lane, ((_, state),) in state_timelines(now).items():
            if self._lanes.get(lane) != state:
                self._lanes[lane] = state
                self._stream.send_columns(entity(f"state/{lane}"), [time], rr.StateChange.columns(state=[state]))
                level = "INFO" if state in ("none", "healthy") else "WARN"
                self._stream.send_columns("events", [time], rr.TextLog.columns(text=[f"{lane}: {state}"], level=[level]))

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
        for index, bank in enumerate(recorder.estimators):
            for member, name in enumerate(bank.names):
                for part in ("mean", "nis", "dof", "statistic", "declared"):
                    channels[f"{name}/{part}"] = recorder.array(f"{index}:{part}")[here, member, :1]
        target = self._system.references
        channels |= {"reference/q": target["q"][here], "reference/omega": target["omega"][here]}
        ongoing = tuple(
            o._replace(start_tick=0, end_tick=1) for o in self._system.occurrences if o.trial == 0 and o.start_tick <= tick < o.end_tick
        )
        return Recording(recorder.dt, recorder.trials[:1], channels, self._thresholds, ongoing)
