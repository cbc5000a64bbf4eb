"""Cost of the closed loop against the bare physics, on one core: `make bench`.

The bare physics is `mujoco.batch.Batch.step` of the same model, replaying the same starts and inputs tick by tick. Runs are
interleaved; medians and their ratio are what counts, since single timings on a shared machine mean little.
"""

from __future__ import annotations

import os
import statistics
import time

import numpy as np
from mujoco.batch import Batch

from sim.build import build
from sim.loop import System, run
from sim.recording import Recording
from sim.scenario import load

SCENARIO = "nacs/wheel-failure"
ROUNDS = 5


def loop_seconds(trials: int, ticks: int) -> tuple[float, System, Recording]:
    """Wall time of the whole loop: five observers, sensors, control, faults and recording."""
    scenario = load(SCENARIO, {"run.ticks": ticks, "faults.0.start_s": 0.1 * ticks / 5, "faults.0.duration_s": 0.1 * ticks / 5})
    system = build(scenario, np.arange(trials))
    start = time.perf_counter()
    recording = run(system)
    return time.perf_counter() - start, system, recording


def physics_seconds(system: System, recording: Recording) -> float:
    """Wall time of stepping the same trials through the same inputs and nothing else."""
    model = system.plant.assembly.model
    batch = Batch(model, len(recording.trials), 1)
    batch.reset(keyframe=0)
    qpos, qvel, ctrl, force = (batch.bind(name) for name in ("qpos", "qvel", "ctrl", "qfrc_applied"))
    qpos[:], qvel[:] = recording.channels["truth/qpos"][0], recording.channels["truth/qvel"][0]
    applied, push = recording.channels["applied"], system.disturbance_B
    steps = round(system.dt / system.plant.step_s)
    start = time.perf_counter()
    for k in range(recording.ticks):
        ctrl[:, :4] = applied[k]
        force[:, :3] = push[k]
        batch.step(nstep=steps)
    return time.perf_counter() - start


def main() -> None:
    """Print the two figures that the twin is held to."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    print(f"{SCENARIO}, one core, {ROUNDS} rounds\n")
    print(f"{'trials':>6} {'ticks':>6} {'loop':>12} {'bare physics':>14} {'ratio':>7} {'x real time':>12}")
    for trials, ticks in ((1, 1000), (10, 300), (64, 150), (256, 50)):
        loops, bare = [], []
        for _ in range(ROUNDS):
            wall, system, recording = loop_seconds(trials, ticks)
            loops.append(wall)
            bare.append(physics_seconds(system, recording))
        loop, physics = statistics.median(loops), statistics.median(bare)
        each = 1e6 / (trials * ticks)
        ratio = statistics.median(a / b for a, b in zip(loops, bare, strict=True))
        speed = trials * ticks * system.dt / loop
        print(f"{trials:>6} {ticks:>6} {each * loop:>9.1f} us {each * physics:>11.1f} us {ratio:>7.2f} {speed:>12.0f}")
    print("\nus: per trial and control tick of 0.1 s")


if __name__ == "__main__":
    main()
