"""From a scenario to the parts of its closed loop, for a set of trials."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from control.allocation import PseudoInverseAllocation
from control.proportional_derivative import ProportionalDerivative
from models import quaternion
from models.nacs import compile_nacs
from sim import randomness
from sim.faults import schedule
from sim.guests import Guests
from sim.loop import System
from sim.observers import Models, build_banks
from sim.plant import Plant
from sim.randomness import Stream
from sim.scenario import Scenario
from sim.sensors import Sensors, draw_noise

Array = NDArray[np.floating]


def build(scenario: Scenario, trials: NDArray[np.int64], guests: Guests | None = None) -> System:
    """All parts of the loop for the given trial numbers; trial i is the same in any company.

    Args:
      scenario: what is simulated.
      trials: numbers of the trials, (trials,).
      guests: the user's own filters and controller.
    """
    guests = guests or Guests()
    run, parameters = scenario.run, scenario.plant
    assembly = compile_nacs(parameters)
    wheels = len(assembly.wheel_joints)
    target = scenario.reference.at(run.tick_s * np.arange(run.ticks))
    plant = Plant(assembly, len(trials))
    turn = np.radians(scenario.start.attitude_error_deg) * randomness.normals(run.seed, trials, Stream.START, 1, 3)[0]
    plant.start(
        quaternion.multiply(quaternion.from_rotation_vector(turn), target.q_DN[0]),
        np.zeros(3),
        np.array(scenario.start.wheel_speed_rad_s),
    )
    for name, position in zip(("balance_x", "balance_y", "balance_z"), parameters.balance_position_mm, strict=True):
        plant.hold(name, 1e-3 * position)
    models = Models(plain=parameters.process(), with_drag=parameters.process(wheel_drag=True))
    faults = schedule(scenario.faults, run.seed, trials, run.ticks, run.tick_s, wheels)
    white = randomness.normals(run.seed, trials, Stream.AIR, run.ticks, 3)
    bits = parameters.command_bits
    return System(
        plant=plant,
        sensors=Sensors(
            scenario.sensors, draw_noise(scenario.sensors, run.seed, trials, run.ticks, wheels, run.tick_s), faults, run.tick_s
        ),
        faults=faults,
        disturbance_B=randomness.gauss_markov(white, parameters.air_torque_nm, parameters.air_torque_correlation_s, run.tick_s),
        drive_noise=parameters.drive_torque_noise_nm * randomness.normals(run.seed, trials, Stream.DRIVE, run.ticks, wheels),
        target=target,
        banks=build_banks(scenario.observers, models, scenario.sensors, wheels) + guests.banks(models, scenario.sensors),
        controller=guests.control() or ProportionalDerivative(scenario.control.proportional_nm, scenario.control.derivative_nms),
        allocation=PseudoInverseAllocation(assembly.wheel_axes, assembly.wheel_torque_limit),
        feedback=scenario.control.feedback,
        command_step_nm=2.0 * assembly.wheel_torque_limit / 2**bits if bits else 0.0,
        trials=trials,
        ticks=run.ticks,
        dt=run.tick_s,
    )
