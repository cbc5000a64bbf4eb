"""The closed loop: beside the bare physics of the same inputs, against the size of the batch, and with two workers."""

from __future__ import annotations

import multiprocessing
import os
import resource
from dataclasses import dataclass
from statistics import median

import numpy as np
from mujoco.batch import Batch

from benchmarks.measure import cpu_seconds, interleave, one_core, ratio, wall_seconds
from benchmarks.show import figure, table
from sim.campaign.blocks import simulate_all
from sim.loop.body_parts import BodyEffectors
from sim.loop.build import build
from sim.loop.closed_loop import System, run
from sim.loop.recording import Recording
from sim.scenario.files import load
from sim.scenario.one_body import Scenario

NAME = "nacs/wheel-failure"
SIZES = {1: 500, 4: 300, 16: 150, 64: 100, 256: 40, 1024: 10, 4096: 5}  # trials: ticks
SHARED = {64: 200, 1024: 14}  # trials: ticks
ROUNDS = 3


def scenario(ticks: int) -> Scenario:
    """The wheel fails from a fifth to two fifths of the run."""
    fifth = 0.1 * max(1, ticks // 5)
    return load(NAME, {"run.ticks": ticks, "faults.0.start_s": fifth, "faults.0.duration_s": fifth})


@dataclass(eq=False)
class Flight:
    """A batch of trials, flown again in every round: the whole loop and then its physics alone."""

    trials: int
    ticks: int
    system: System | None = None
    recording: Recording | None = None

    def set_up(self) -> float:
        """Build the loop, noise of the whole run included."""
        return cpu_seconds(self._build)

    def loop(self) -> float:
        """Five observers, sensors, control, faults and recording."""
        return cpu_seconds(self._fly)

    def physics(self) -> float:
        """The same trials through the same inputs, and nothing else."""
        assert self.system
        assert self.recording
        system, channels = self.system, self.recording.channels
        batch = Batch(system.plant.assembly.model, self.trials, 1)
        batch.reset(keyframe=0)
        qpos, qvel, ctrl, force = (batch.bind(name) for name in ("qpos", "qvel", "ctrl", "qfrc_applied"))
        qpos[:], qvel[:] = channels["truth/qpos"][0], channels["truth/qvel"][0]
        assert isinstance(system.effectors, BodyEffectors)
        applied, push, steps = channels["applied"], system.effectors.disturbance_B, round(system.dt / system.plant.step_s)

        def step() -> None:
            for k in range(self.ticks):
                ctrl[:, :4], force[:, :3] = applied[k], push[k]
                batch.step(nstep=steps)

        return cpu_seconds(step)

    def _build(self) -> None:
        self.system = build(scenario(self.ticks), np.arange(self.trials))

    def _fly(self) -> None:
        assert self.system
        self.recording = run(self.system)


def sizes() -> None:
    """Print the cost of a trial against the size of the batch."""
    rows = []
    with one_core():
        for trials, ticks in SIZES.items():
            flight = Flight(trials, ticks)
            set_up, loop, physics = interleave(ROUNDS, (flight.set_up, flight.loop, flight.physics))
            each = 1e6 / (trials * ticks)
            speed = 0.1 / (median(loop) * each * 1e-6)
            rows.append(
                (
                    *(str(trials), str(ticks), figure(1e3 * median(set_up))),
                    *(figure(each * median(loop)), figure(each * median(physics)), f"{ratio(loop, physics):.2f}", f"{speed:.0f}"),
                )
            )
    table(
        f"The loop of {NAME}, by size of the batch",
        ("trials", "ticks", "set up, ms", "loop, us", "bare physics, us", "ratio", "x real time"),
        rows,
        f"us: CPU time a trial and control tick of 0.1 s, ten RK4 steps, on one core; medians of {ROUNDS} interleaved rounds. The loop "
        "has five observers, sensors, control, allocation, faults, recording and the NEES of every observer; bare physics is "
        "mujoco.batch.Batch.step through the same inputs. set up: the model, and the noise of the whole run.",
    )


def share(trials: int, ticks: int, workers: int) -> tuple[float, float]:
    """Wall seconds of sharing the trials among workers, their start included, and CPU seconds of all processes."""
    blocks, nobody = np.array_split(np.arange(trials), workers), np.zeros(0, dtype=np.int64)
    before = _spent()
    wall = wall_seconds(lambda: list(simulate_all(scenario(ticks), blocks, nobody, workers, lambda _: None)))
    for child in multiprocessing.active_children():
        child.join()  # whose CPU time is known only then
    return wall, _spent() - before


def _spent() -> float:
    both = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(used.ru_utime + used.ru_stime for used in both)


def workers() -> None:
    """Print what a second process brings."""
    rows = []
    for trials, ticks in SHARED.items():
        one, two = zip(*(pair for _ in range(ROUNDS) for pair in [(share(trials, ticks, 1), share(trials, ticks, 2))]), strict=True)
        wall, cpu = zip(*((median(seconds) for seconds in zip(*taken, strict=True)) for taken in (one, two)), strict=True)
        rows.append((str(trials), str(ticks), *map(figure, (*wall, median(a[0] / b[0] for a, b in zip(one, two, strict=True)), *cpu))))
    load_average = os.getloadavg()[0]
    table(
        f"One and two worker processes, {NAME}",
        ("trials", "ticks", "wall of 1, s", "wall of 2, s", "faster", "CPU of 1, s", "CPU of 2, s"),
        rows,
        f"Trials cut into as many batches as workers, evaluation included; medians of {ROUNDS} interleaved rounds on {os.cpu_count()} "
        f"cores, where {load_average:.1f} processes wanted to run at the end. Two workers are started anew, and import the twin, each "
        "time; one works in the calling process.",
    )


if __name__ == "__main__":
    sizes()
    workers()
