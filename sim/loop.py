"""The closed loop, tick by tick: measure, observe, estimate, command, allocate, inject faults, step, record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from control.allocation import PseudoInverseAllocation
from control.proportional_derivative import ProportionalDerivative
from estimation.gaussian import Belief
from sim.faults import FaultSchedule
from sim.observers import Bank
from sim.plant import Plant, SimulationFailed
from sim.recording import Recorder, Recording
from sim.references import Reference
from sim.sensors import Sensors

Array = NDArray[np.float64]

LOCKING_FRICTION_NM = 1.0  # far beyond any drive


@dataclass(frozen=True, eq=False)
class System:
    """All parts of a closed loop, for a set of trials.

    Attributes:
      feedback: who tells the controller the state: an observer's name, `truth` or `measurement`.
      command_step_nm: least step of the drives' torque set-point; 0: none.
      disturbance_B: torque of the environment, (ticks, trials, 3) N m in B.
      drive_noise: torque errors of the drives, (ticks, trials, wheels) N m.
    """

    plant: Plant
    sensors: Sensors
    faults: FaultSchedule
    disturbance_B: Array
    drive_noise: Array
    reference: Reference
    banks: tuple[Bank, ...]
    controller: ProportionalDerivative
    allocation: PseudoInverseAllocation
    feedback: str
    command_step_nm: float
    trials: NDArray[np.int64]
    ticks: int
    dt: float


def run(system: System, on_tick: Callable[[int, Recorder], None] | None = None) -> Recording:
    """Run the loop and return what it recorded; `on_tick` is called after every tick.

    Raises:
      SimulationFailed: with the recording until then as `recording`.
    """
    plant, faults, reference = system.plant, system.faults, system.reference
    recorder = Recorder(system.dt, system.ticks, system.trials, system.banks)
    steps = round(system.dt / plant.step_s)
    command = np.zeros((len(system.trials), system.allocation.wheel_axes.shape[1]))
    beliefs: list[Belief] = []
    held = np.full(1, np.nan)
    targets = {name: value for name, value in zip(("q", "omega", "alpha"), reference, strict=True)}

    for k in range(system.ticks):
        truth = plant.truth()
        recorder.put("truth/state", k, truth.state)
        reading = system.sensors.read(k, truth, recorder.array("truth/state"))
        if k == 0:
            beliefs = [bank.filter.initial(reading) for bank in system.banks]
        else:
            beliefs = [bank.filter.step(b, command, reading, system.dt) for bank, b in zip(system.banks, beliefs, strict=True)]
        held = np.where(np.isnan(reading), held, reading)
        estimate = _estimate(system, beliefs, truth.state, held)
        torque_B = system.controller.step(estimate[:, :4], estimate[:, 4:7], reference.q_DN[k], reference.omega_DN_D[k])
        command = _quantize(system.allocation.step(torque_B), system.command_step_nm)
        applied = faults.act(k, command + system.drive_noise[k])

        for index, belief in enumerate(beliefs):
            recorder.observe(index, k, belief)
        for name, value in (
            ("truth/qpos", truth.qpos),
            ("truth/qvel", truth.qvel),
            ("reading", reading),
            ("torque_B", torque_B),
            ("command", command),
            ("applied", applied),
            ("fault", faults.active[k]),
        ):
            recorder.put(name, k, value)
        if on_tick:
            on_tick(k, recorder)

        push = system.disturbance_B[k] if faults.torque_B is None else system.disturbance_B[k] + faults.torque_B[k]
        try:
            _change_plant(system, k)
            plant.advance(applied, push, steps)
        except SimulationFailed as failure:
            failure.trial = int(system.trials[failure.trial])
            failure.recording = recorder.finish(k + 1, targets, faults.occurrences)
            raise
    return recorder.finish(system.ticks, targets, faults.occurrences)


def _estimate(system: System, beliefs: list[Belief], truth: Array, reading: Array) -> Array:
    """State (trials, n) that the controller acts on."""
    if system.feedback == "truth":
        return truth
    if system.feedback == "measurement":
        return reading
    for bank, belief in zip(system.banks, beliefs, strict=True):
        if system.feedback in bank.names:
            return belief.mean[bank.names.index(system.feedback)]
    raise ValueError(f"feedback {system.feedback!r} is no observer of this loop")


def _quantize(command: Array, step: float) -> Array:
    return step * np.round(command / step) if step else command


def _change_plant(system: System, tick: int) -> None:
    """Carry out the faults that change the plant itself."""
    assembly, trials = system.plant.assembly, np.arange(len(system.trials))
    for change in system.faults.mass_changes:
        if change.tick == tick:
            inertia = assembly.inertia if change.inertia is None else change.inertia
            com = assembly.centre_of_mass if change.centre_of_mass is None else change.centre_of_mass
            system.plant.set_mass_properties(trials == change.trial, inertia[None], com[None])
    for lock in system.faults.lock_changes:
        if lock.tick == tick:
            friction = LOCKING_FRICTION_NM if lock.locked else assembly.wheel_friction
            system.plant.set_wheel_friction(trials == lock.trial, lock.wheel, friction)
