"""The closed loop, tick by tick: measure, observe, estimate, command, allocate, inject faults, step, record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from control.allocation import Allocation
from control.tracking import Controller, Estimate, Memoryless, RememberingController, Target
from estimation.gaussian import Belief, LostDefiniteness
from models.attitude.quaternion import IDENTITY
from models.dynamics.unmodelled_torque import UnmodelledTorque
from sim.estimators.filter_banks import Bank
from sim.faults.timeline import FaultSchedule
from sim.loop.recording import Recorder, Recording
from sim.plant.batch import Plant, SimulationFailed
from sim.sensors.sensors import Sensors

Array = NDArray[np.floating]

LOCKING = 40.0  # friction of a seized bearing over the drive's limit


@dataclass(frozen=True, eq=False)
class System:
    """All parts of a closed loop, for a set of trials.

    Attributes:
      target: what is to be followed at every tick, (ticks, ...).
      feedback: who tells the controller the state: an observer's name, `truth` or `measurement`.
      command_step_nm: least step of the drives' torque set-point; 0: none.
      disturbance_B: torque of the environment, (ticks, trials, 3) N m in B.
      drive_noise: torque errors of the drives, (ticks, trials, wheels) N m; of a body without wheels (ticks, trials, 3).
      trials: their numbers, (trials,).
      dt: control period, s.
      unmodelled: what filters learn and are held against; None: none does.
    """

    plant: Plant
    sensors: Sensors
    faults: FaultSchedule
    disturbance_B: Array
    drive_noise: Array
    target: Target
    banks: tuple[Bank, ...]
    controller: Controller | RememberingController
    allocation: Allocation
    feedback: str
    command_step_nm: float
    trials: NDArray[np.int64]
    ticks: int
    dt: float
    unmodelled: UnmodelledTorque | None = None


def run(system: System, on_tick: Callable[[int, Recorder], None] | None = None) -> Recording:
    """Run the loop and return what it recorded; `on_tick` is called after every tick.

    Raises:
      SimulationFailed: with the recording until then as `recording`.
    """
    recorder = Recorder(system.dt, system.ticks, system.trials, system.banks)
    try:
        _fly(system, recorder, on_tick)
    except SimulationFailed as failure:
        failure.trial = int(system.trials[failure.trial])
        failure.recording = recorder.finish(system.target, system.faults.occurrences)
        raise
    return recorder.finish(system.target, system.faults.occurrences)


def _fly(system: System, recorder: Recorder, on_tick: Callable[[int, Recorder], None] | None) -> None:
    """The loop itself; a trial's number in an exception is its position."""
    plant, faults = system.plant, system.faults
    steps = round(system.dt / plant.step_s)
    wheels = plant.assembly.wheel_axes.shape[1]
    command: Array = np.zeros((plant.trials, wheels or 3))
    law = system.controller if isinstance(system.controller, RememberingController) else Memoryless(system.controller)
    learnt, shared = None, system.allocation.start((plant.trials,))
    beliefs: tuple[Belief, ...] = ()
    held: Array = np.tile(np.concatenate([IDENTITY, np.zeros(3 + wheels)]), (plant.trials, 1))  # until something has been read

    for k in range(system.ticks):
        truth = plant.truth()
        recorder.put("truth/state", k, truth.state)
        unmodelled = system.unmodelled.at(truth.state) if system.unmodelled else None
        reading = system.sensors.read(k, truth, recorder.array("truth/state"))
        beliefs = _observe(system, beliefs, np.concatenate([command, held[..., 7:]], axis=-1), reading, k)
        held = np.where(np.isnan(reading), held, reading)
        estimate = _estimate(system, beliefs, truth.state, held, reading, unmodelled)

        learnt = law.start(estimate) if k == 0 else learnt
        torque_B, learnt, notes = law.decide(estimate, Target(*(part[k] for part in system.target)), learnt)
        demand, shared = system.allocation.step(torque_B, estimate, shared)
        command = _quantize(demand, system.command_step_nm)
        applied = faults.act(k, command + system.drive_noise[k])
        push = system.disturbance_B[k] if faults.torque_B is None else system.disturbance_B[k] + faults.torque_B[k]

        recorder.observe(k, beliefs)
        recorder.tick(
            k,
            {
                "truth/qpos": truth.qpos,
                "truth/qvel": truth.qvel,
                "reading": reading,
                "torque_B": torque_B,
                "command": command,
                "applied": applied,
                "fault": faults.active[k],
                **({} if unmodelled is None else {"truth/unmodelled": unmodelled}),
                **{f"control/{name}": note for name, note in notes.items()},
            },
        )
        if on_tick:
            on_tick(k, recorder)
        _change_plant(system, k)
        plant.advance(*((applied, push) if wheels else (applied[:, :0], push + applied)), steps)


def _observe(system: System, beliefs: tuple[Belief, ...], known: Array, reading: Array, tick: int) -> tuple[Belief, ...]:
    """One step of every bank; a filter that breaks down ends the run, saying which filter and trial.

    `known`, (trials, 2 wheels), is the torque commanded since the last tick and the wheel speeds that were read then; of a body without
    wheels (trials, 3) only the torque on it.
    """
    if tick == 0:
        return tuple(bank.filter.initial(bank.measured(reading)) for bank in system.banks)
    after = []
    for bank, belief in zip(system.banks, beliefs, strict=True):
        try:
            after.append(bank.filter.step(belief, bank.inputs(known), bank.measured(reading), system.dt))
        except LostDefiniteness as lost:
            member, trial = lost.where[-2:]
            raise SimulationFailed(trial, tick * system.dt, f"{bank.names[member]}: its innovation covariance lost definiteness") from None
    return tuple(after)


def _estimate(system: System, beliefs: tuple[Belief, ...], truth: Array, held: Array, reading: Array, unmodelled: Array | None) -> Estimate:
    """State that the controller acts on; `held` is the last reading without its gaps, `unmodelled` the true torque of that name."""
    state = {"truth": truth, "measurement": held}.get(system.feedback)
    modes, q_read, learned = None, None, unmodelled if system.feedback == "truth" else None
    for bank, belief in zip(system.banks, beliefs, strict=True):
        if system.feedback in bank.names:
            member = bank.names.index(system.feedback)
            state = belief.mean[member]
            modes = belief.modes.probabilities[member] if belief.modes is not None else None
            q_read = reading[..., :4]
            torques = getattr(belief.memory, "learned", None)
            learned = torques[member] if torques is not None else None
    if state is None:
        raise ValueError(f"feedback {system.feedback!r} is no observer of this loop")
    wheels = state[..., 7:] if state.shape[-1] == held.shape[-1] else held[..., 7:]  # as read, where no state
    return Estimate(state[..., :4], state[..., 4:7], wheels, modes, q_read, learned)


def _quantize(command: Array, step: float) -> Array:
    return step * np.round(command / step) if step else command


def _change_plant(system: System, tick: int) -> None:
    """Carry out the faults that change the plant itself, at the ticks at which something changes."""
    plant, faults = system.plant, system.faults
    if faults.locked is not None:
        now, before = faults.locked[tick], faults.locked[tick - 1] if tick else np.zeros_like(faults.locked[0])
        for wheel in np.flatnonzero((now != before).any(axis=0)):
            changed = (now != before)[:, wheel]
            friction = np.where(now[:, wheel], LOCKING * plant.assembly.wheel_torque_limit, plant.wheel_coulomb)
            plant.set_wheel_friction(changed, int(wheel), friction[changed])
    if faults.mass is not None:
        which, was = faults.mass[tick], faults.mass[tick - 1] if tick else np.full_like(faults.mass[0], -1)
        back = (which != was) & (which < 0)
        plant.set_mass_properties(back, plant.inertia[back], plant.centre_of_mass[back])
        for index in np.unique(which[(which != was) & (which >= 0)]):
            plant.set_mass_properties((which != was) & (which == index), *faults.masses[index])
