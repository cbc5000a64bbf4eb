"""MuJoCo's own viewer in real time: on a closed loop while it is flown, or on a motion that is known."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import mujoco
import mujoco.viewer
import numpy as np
from numpy.typing import NDArray

from sim.loop.build import build
from sim.loop.closed_loop import run_whole
from sim.loop.motion import FIRST
from sim.loop.recorder import Recorder
from sim.scenario.files import AnyScenario

FRAMES_PER_TICK = 6
FRAME_S = 1 / 60
CLOSING_S = 5.0


def fly(scenario: AnyScenario, loop: str) -> None:
    """Fly a loop of trial 0 in a window until the run or the window ends; motion between ticks is interpolated."""
    system = build(scenario, FIRST, loop=loop)
    model = system.plant.assembly.scene
    data = mujoco.MjData(model)
    velocity = np.zeros(model.nv)
    with _window(model, data) as window:
        started = time.perf_counter()

        def show(tick: int, recorder: Recorder) -> None:
            now = recorder.array("truth/qpos")[tick, 0]
            before = recorder.array("truth/qpos")[max(tick - 1, 0), 0]
            mujoco.mj_differentiatePos(model, velocity, system.dt, before, now)
            for frame in range(1, FRAMES_PER_TICK + 1):
                data.qpos[:] = before
                mujoco.mj_integratePos(model, data.qpos, velocity, system.dt * frame / FRAMES_PER_TICK)
                data.time = system.dt * (tick - 1 + frame / FRAMES_PER_TICK)
                _draw(window, model, data, started)

        run_whole(system, show)


def show(model: mujoco.MjModel, qpos: NDArray[np.floating], dt: float) -> None:
    """Show poses (ticks, nq), `dt` seconds apart, in a window until they or the window end; of many a second every so many."""
    data = mujoco.MjData(model)
    stride = max(1, round(FRAME_S / dt))
    with _window(model, data) as window:
        started = time.perf_counter()
        for tick in range(0, len(qpos), stride):
            data.qpos[:] = qpos[tick]
            data.time = dt * tick
            _draw(window, model, data, started)


@contextmanager
def _window(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[Any]:
    others = threading.enumerate()
    try:
        with mujoco.viewer.launch_passive(model, data, show_left_ui=False, show_right_ui=False) as window:
            mujoco.mjv_defaultFreeCamera(model, window.cam)
            yield window
    finally:
        for drawing in (thread for thread in threading.enumerate() if thread not in others):
            drawing.join(CLOSING_S)  # a program that ends while MuJoCo still closes the window crashes


def _draw(window: Any, model: mujoco.MjModel, data: mujoco.MjData, started: float) -> None:
    """Show the state and wait until it is due; raises KeyboardInterrupt once the window is closed."""
    if not window.is_running():
        raise KeyboardInterrupt
    mujoco.mj_forward(model, data)
    window.sync()
    time.sleep(max(0.0, started + data.time - time.perf_counter()))
