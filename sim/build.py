"""From a scenario to the parts of its closed loop, for a set of trials."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from control.allocation import PseudoInverseAllocation
from control.proportional_derivative import ProportionalDerivative
from control.tracking import Target
from models import quaternion
from models.assembly import Assembly
from models.nacs import BALANCE_MASSES, compile_nacs
from sim import randomness
from sim.faults import schedule
from sim.guests import Guests
from sim.loop import System
from sim.observers import Models, build_banks
from sim.plant import Plant
from sim.randomness import Stream
from sim.scenario import Scenario
from sim.sensors import SensorArrays, Sensors, draw_noise
from sim.variants import Variants

Array = NDArray[np.floating]


def build(scenario: Scenario, trials: NDArray[np.int64], guests: Guests | None = None, variants: Variants | None = None) -> System:
    """All parts of the loop for the given trial numbers; trial i is the same in any company.

    Args:
      scenario: what is simulated, and what filters and controllers believe.
      trials: numbers of the trials, (trials,).
      guests: the user's own filters and controller.
      variants: plant, sensors, faults and start of each trial where they differ.
    """
    guests, variants = guests or Guests(), variants or Variants.alike(scenario, len(trials))
    run, parameters = scenario.run, scenario.plant
    assembly = compile_nacs(parameters)
    wheels = len(assembly.wheel_joints)
    models = Models(plain=parameters.process(), with_drag=parameters.process(wheel_drag=True))
    target = scenario.reference.at(run.tick_s * np.arange(run.ticks))
    sensors = SensorArrays.of(variants.sensors)
    faults = schedule(variants.faults, run.seed, trials, run.ticks, run.tick_s, wheels)
    bits = parameters.command_bits
    return System(
        plant=_plant(assembly, scenario, variants, trials, target),
        sensors=Sensors(sensors, draw_noise(sensors, run.seed, trials, run.ticks, wheels, run.tick_s), faults, run.tick_s),
        faults=faults,
        disturbance_B=randomness.gauss_markov(
            randomness.normals(run.seed, trials, Stream.AIR, run.ticks, 3),
            variants.plant_values("air_torque_nm")[:, None],
            variants.plant_values("air_torque_correlation_s")[:, None],
            run.tick_s,
        ),
        drive_noise=variants.plant_values("drive_torque_noise_nm")[:, None]
        * randomness.normals(run.seed, trials, Stream.DRIVE, run.ticks, wheels),
        target=target,
        banks=build_banks(scenario.observers, models, scenario.sensors, wheels) + guests.banks(models, scenario.sensors, wheels),
        controller=guests.control(models, scenario.sensors, wheels)
        or ProportionalDerivative(scenario.control.proportional_nm, scenario.control.derivative_nms),
        allocation=PseudoInverseAllocation(assembly.wheel_axes, assembly.wheel_torque_limit),
        feedback=scenario.control.feedback,
        command_step_nm=2.0 * assembly.wheel_torque_limit / 2**bits if bits else 0.0,
        trials=trials,
        ticks=run.ticks,
        dt=run.tick_s,
    )


def _plant(assembly: Assembly, scenario: Scenario, variants: Variants, trials: NDArray[np.int64], target: Target) -> Plant:
    """The plant at the start: each trial's own, at the reference's attitude but for a small turn, at rest."""
    plant = Plant(assembly, len(trials))
    dispersion = variants.dispersion(scenario.plant)
    if dispersion is not None:
        plant.disperse(dispersion)
    spread = np.radians([[start.attitude_error_deg] for start in variants.starts])
    turn = spread * randomness.normals(scenario.run.seed, trials, Stream.START, 1, 3)[0]
    attitude = quaternion.multiply(quaternion.from_rotation_vector(turn), target.q_DN[0])
    plant.start(attitude, np.zeros(3), np.array([start.wheel_speed_rad_s for start in variants.starts]))
    for name, position in zip(BALANCE_MASSES, 1e-3 * variants.plant_values("balance_position_mm").T, strict=True):
        plant.hold(name, position)
    return plant
