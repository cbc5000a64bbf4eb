"""MuJoCo's own viewer on the closed loop, in real time."""

from __future__ import annotations

import time

import mujoco
import mujoco.viewer
import numpy as np

from sim.build import build
from sim.loop import run
from sim.recording import Recorder
from sim.scenario import Scenario

FRAMES_PER_TICK = 6


def fly(scenario: Scenario) -> None:
    """Fly trial 0 of the first loop in a window until the run or the window ends; motion between ticks is interpolated."""
    system = build(next(iter(scenario.singles().values())), np.zeros(1, dtype=np.int64))
    model = system.plant.assembly.scene
    data = mujoco.MjData(model)
    velocity = np.zeros(model.nv)
    with mujoco.viewer.launch_passive(model, data, show_left_ui=False, show_right_ui=False) as window:
        mujoco.mjv_defaultFreeCamera(model, window.cam)
        started = time.perf_counter()

        def show(tick: int, recorder: Recorder) -> None:
            now = recorder.array("truth/qpos")[tick, 0]
            before = recorder.array("truth/qpos")[max(tick - 1, 0), 0]
            mujoco.mj_differentiatePos(model, velocity, system.dt, before, now)
            for frame in range(1, FRAMES_PER_TICK + 1):
                if not window.is_running():
                    raise KeyboardInterrupt
                data.qpos[:] = before
                mujoco.mj_integratePos(model, data.qpos, velocity, system.dt * frame / FRAMES_PER_TICK)
                data.time = system.dt * (tick - 1 + frame / FRAMES_PER_TICK)
                mujoco.mj_forward(model, data)
                window.sync()
                time.sleep(max(0.0, started + data.time - time.perf_counter()))

        run(system, show)
