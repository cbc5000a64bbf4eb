"""Following a reference as a task for a learner: what it observes, what it may do, how well it does, and when it has failed."""

from __future__ import annotations

import numpy as np

from control.tracking import tracking_error
from models.attitude import quaternion
from models.dynamics.state_layout import ATTITUDE
from models.plants.register.entries import kind_of
from sim.bad_input import BadInput
from sim.loop.open_loop import OpenLoop
from sim.parts import Array, Flags
from sim.plant.kinds import tilt_deg

HALF_DEG = 0.5  # attitude error at which half of the reward of a tick is left
EFFORT = 0.01  # price of full torque about all axes, a tick
SLACK = 1e-6  # for rounding
AT_STOP = 0.99  # of the tilt limit: the stop gives a little


def full_torque(loop: OpenLoop, torque_nm: float | None) -> float:
    """Torque of an action of one, N m; default: the limit of a drive.

    Raises:
      BadInput: it is not positive, or is not given for a body without wheels.
    """
    assembly = loop.plant.assembly
    if torque_nm is None and not assembly.wheel_joints:
        raise BadInput(f"{loop.scenario.title}: has no wheels whose limit could be taken; give torque_nm, N m of an action of one")
    chosen = assembly.wheel_torque_limit if torque_nm is None else torque_nm
    if not 0.0 < chosen < np.inf:
        raise BadInput(f"torque_nm = {chosen}: must be positive, N m of an action of one")
    return float(chosen)


def observation(loop: OpenLoop) -> Array:
    """What is known at a tick without a filter, (trials, 9 + wheels), all of the last readings.

    Rotation vector from the reference to the body, rad in B; rate relative to the reference's, rad/s in B; acceleration that the
    reference asks for, rad/s2 in B; wheel speeds, rad/s.
    """
    read, asked = loop.estimate, loop.asked
    error = tracking_error(read, asked)
    alpha = (error.rotation @ asked.alpha_DN_D[..., None])[..., 0]
    return np.concatenate([quaternion.to_rotation_vector(error.dq), error.rate, alpha, read.omega_wheel], axis=-1)


def greatest(loop: OpenLoop) -> Array:
    """Bounds on the absolute value of an observation's components, (9 + wheels,): ranges of the sensors, and what the reference does."""
    sensors, wheels = loop.scenario.sensors, loop.wheels
    rate, alpha = (float(np.max(np.linalg.norm(part, axis=-1))) for part in loop.target[1:])
    own = [np.pi, np.sqrt(3.0) * sensors.gyro_range_rad_s + rate, alpha]
    return SLACK + np.concatenate([np.repeat(own, 3), np.full(wheels, sensors.wheel_full_scale_rad_s)])


def reward(loop: OpenLoop, action: Array) -> Array:
    """Of a tick by its end, (trials,): 1 / (1 + (angle / 0.5 deg)^2) of the true attitude error, less 0.01 of the mean square action."""
    return 1.0 / (1.0 + (error_deg(loop) / HALF_DEG) ** 2) - EFFORT * np.mean(action**2, axis=-1)


def failed(loop: OpenLoop) -> Flags:
    """Trials in which the body is at its stop, or the physics broke down, (trials,)."""
    limit = kind_of(loop.scenario.plant).tilt_limit_deg
    tilted: Flags = tilt_deg(loop.truth.state[:, ATTITUDE]) >= AT_STOP * (np.inf if limit is None else limit)
    return loop.failed | tilted


def error_deg(loop: OpenLoop) -> Array:
    """Angle between the true attitude and the reference's, (trials,) deg."""
    turn = quaternion.error(loop.truth.state[:, ATTITUDE], loop.asked.q_DN)
    return np.degrees(np.sqrt(np.sum(turn**2, axis=-1)))
