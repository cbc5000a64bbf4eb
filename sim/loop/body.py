"""From a scenario of one body to the parts of its closed loop, for a set of trials."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from control.tracking import Target
from models.attitude import quaternion
from models.dynamics.unmodelled_torque import UnmodelledTorque
from models.dynamics.wheel_faults import WheelFault
from models.plants.assembly import Assembly
from models.plants.register.entries import kind_of
from models.plants.register.kind import DriveErrors, PlantKind
from sim import randomness
from sim.controllers.tracking import TrackingLaw, target_channels
from sim.estimators.believed import Models
from sim.estimators.filter_banks import build_filter_banks
from sim.estimators.learning_settings import compensates
from sim.faults.timeline import schedule
from sim.loop.body_parts import BodyChange, BodyChannels, BodyEffectors, BodyFeedback
from sim.loop.closed_loop import System
from sim.loop.variants import Variants
from sim.parts import Estimator
from sim.plant.batch import Plant
from sim.randomness import Stream
from sim.scenario.one_body import Scenario, StartSettings
from sim.scenario.surroundings import surroundings
from sim.sensors.sensors import SensorArrays, Sensors, draw_noise
from sim.user_code.laws import tracking
from sim.user_code.user_code import UserCode

Array = NDArray[np.floating]


def build_body(
    scenario: Scenario, trials: NDArray[np.int64], user_code: UserCode | None = None, variants: Variants | None = None
) -> System:
    """All parts of the one loop of a scenario for the given trial numbers; trial i is the same whatever the batch.

    Args:
      scenario: what is simulated, and what filters and controllers believe.
      trials: numbers of the trials, (trials,).
      user_code: the user's own filters and controller.
      variants: plant, sensors, faults and start of each trial where they differ.
    """
    user_code, variants = user_code or UserCode(), variants or Variants.alike(scenario, len(trials))
    run, parameters, law = scenario.run, scenario.plant, scenario.law
    kind: PlantKind[Any] = kind_of(parameters)
    assembly = kind.compile(parameters)
    inertia = kind.believed_inertia(parameters) if kind.believed_inertia else assembly.inertia
    wheels = len(assembly.wheel_joints)
    target = scenario.reference.at(run.tick_s * np.arange(run.ticks))
    settings = SensorArrays.of(variants.sensors)
    faults = schedule(variants.faults, scenario.parts, run.seed, trials, run.ticks, run.tick_s)
    noise = draw_noise(settings, run.seed, trials, run.ticks, wheels, run.tick_s, [one.distribution for one in variants.sensors])
    sensors = Sensors(settings, noise, faults, run.tick_s)
    observer = scenario.observers.get(law.feedback)
    modes = (WheelFault.healthy(wheels),) if observer is None else observer.faults(wheels)
    estimators = body_estimators(scenario, trials, user_code)
    controller = tracking(user_code.control(surroundings(scenario))) or law.controller(replace(assembly, inertia=inertia), run.tick_s)
    plant, unmodelled = _plant(assembly, scenario, variants, trials, target), _unmodelled(kind, scenario, variants)
    return System(
        plant=plant,
        sensors=sensors,
        estimators=estimators,
        feedback=BodyFeedback(law.feedback, estimators, unmodelled),
        law=TrackingLaw(controller, target),
        effectors=BodyEffectors(
            allocation=law.allocator(assembly, modes),
            command_step_nm=_command_step(kind, scenario, assembly),
            faults=faults,
            drive_noise=_drive_noise(kind, scenario, variants, trials, wheels),
            disturbance_B=_air(kind, scenario, variants, trials),
            wheels=wheels,
        ),
        change=BodyChange(plant, faults),
        trials=trials,
        ticks=run.ticks,
        dt=run.tick_s,
        channels=BodyChannels(faults, sensors.due, unmodelled),
        references=target_channels(target),
        occurrences=faults.occurrences,
    )


def body_estimators(scenario: Scenario, trials: NDArray[np.int64], user_code: UserCode) -> tuple[Estimator, ...]:
    """The observers of the one loop of a scenario, and the user's filters."""
    models, wheels = Models.of(scenario.plant), scenario.plant.wheel_axes.shape[1]
    banks = build_filter_banks(scenario.observers, models, scenario.sensors, wheels, scenario.run.tick_s, scenario.run.seed, trials)
    return (*banks, *user_code.filters(surroundings(scenario)))


def _air(kind: PlantKind[Any], scenario: Scenario, variants: Variants, trials: NDArray[np.int64]) -> Array:
    """Torque of the air flow round a plant, (ticks, trials, 3) N m in B."""
    run = scenario.run
    if kind.air is None:
        return np.zeros((run.ticks, len(trials), 3))
    deviation, correlation = np.array([kind.air(plant) for plant in variants.plants], dtype=float).T
    white = randomness.normals(run.seed, trials, Stream.AIR, run.ticks, 3)
    return randomness.gauss_markov(white, deviation[:, None], correlation[:, None], run.tick_s)


def _unmodelled(kind: PlantKind[Any], scenario: Scenario, variants: Variants) -> UnmodelledTorque | None:
    """The torque that each trial's plant has and no filter knows, if somebody learns it or knows it from the truth."""
    if not (compensates(scenario.law) or any(o.learns for o in scenario.observers.values())):
        return None
    return kind.learnable.torque(variants.plants) if kind.learnable else None


def _drive_noise(kind: PlantKind[Any], scenario: Scenario, variants: Variants, trials: NDArray[np.int64], wheels: int) -> Array:
    """Torque errors of a plant's drives, (ticks, trials, wheels) N m, or (ticks, trials, 3) without wheels."""
    run = scenario.run
    if kind.drives is None:
        return np.zeros((run.ticks, len(trials), wheels or 3))
    deviation = np.array([kind.drives(plant).torque_noise_nm for plant in variants.plants])
    return deviation[:, None] * randomness.normals(run.seed, trials, Stream.DRIVE, run.ticks, wheels or 3)


def _command_step(kind: PlantKind[Any], scenario: Scenario, assembly: Assembly) -> float:
    """Least step of the torque set-point, N m; 0: none."""
    bits = (kind.drives(scenario.plant) if kind.drives else DriveErrors()).command_bits
    return 2.0 * assembly.wheel_torque_limit / 2**bits if bits else 0.0


def _attitude(start: StartSettings, target: Target) -> Array:
    """Attitude (4,) that a start is near."""
    given = start.attitude
    return target.q_DN[0] if given is None else given


def _plant(assembly: Assembly, scenario: Scenario, variants: Variants, trials: NDArray[np.int64], target: Target) -> Plant:
    """The plant at the start: each trial's own, near the attitude that is given or the reference's."""
    plant = Plant(assembly, len(trials))
    dispersion = variants.dispersion(scenario.plant)
    if dispersion is not None:
        plant.disperse(dispersion)
    spread = np.radians([[start.attitude_error_deg] for start in variants.starts])
    turn = spread * randomness.normals(scenario.run.seed, trials, Stream.START, 1, 3)[0]
    near = np.stack([_attitude(start, target) for start in variants.starts])
    attitude = quaternion.multiply(quaternion.from_rotation_vector(turn), near)
    rate = np.array([start.rate for start in variants.starts])
    speeds = np.array([start.wheel_speed_rad_s for start in variants.starts])[:, : len(assembly.wheel_joints)]
    plant.start(attitude, rate, speeds)
    held = [kind_of(scenario.plant).holds(one) for one in variants.plants]
    for name in held[0]:
        plant.hold(name, np.array([own[name] for own in held]))
    return plant
