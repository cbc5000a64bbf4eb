"""Quantities that channels of a recording are made of."""

from __future__ import annotations

from sim.series.signals.entry import COUNTED, Part
from sim.series.signals.signal import Axis

XYZ = Axis("axis", ("x", "y", "z"))
PLANE = Axis("plane", ("x", "y"))
QUATERNION = Axis("quaternion", ("q1", "q2", "q3", "q4"))
RODRIGUES = Axis("rodrigues", ("1", "2", "3"))
WHEEL, JOINT, SENDER, WEIGHT, MASS = (Axis(name, COUNTED) for name in ("wheel", "joint", "sender", "weight", "mass"))
MODE = Axis("mode_{observer}", COUNTED)  # observers differ in their modes
CHANNEL = Axis("channel", ("azimuth", "elevation"))  # of an antenna

ATTITUDE = Part("attitude", "", QUATERNION, "1", "N to B", "attitude q_BN, scalar last")
RATE = Part("rate", "rate_", XYZ, "rad/s", "B", "rate omega_BN_B")
WHEEL_SPEED = Part("wheel_speed", "wheel_speed", WHEEL, "rad/s", "W", "wheel speed relative to the body")
ROTATION = Part("rotation", "rotation_", XYZ, "rad", "B", "rotation about each axis")
DESIRED_ATTITUDE = Part("attitude", "", QUATERNION, "1", "N to D", "desired attitude q_DN, scalar last")
DESIRED_RATE = Part("rate", "rate_", XYZ, "rad/s", "D", "desired rate omega_DN_D")
DESIRED_ACCELERATION = Part("acceleration", "acceleration_", XYZ, "rad/s2", "D", "desired angular acceleration")
SIGMA = Part("sigma", "sigma", RODRIGUES, "1", "N to B", "attitude sigma, modified Rodrigues parameters")
SIGMA_RATE = Part("sigma_rate", "sigma_rate", RODRIGUES, "1/s", "N to B", "first derivative of sigma")
SIGMA_ACCELERATION = Part("sigma_acceleration", "sigma_acceleration", RODRIGUES, "1/s2", "N to B", "second derivative of sigma")
POSITION = Part("position", "position_", PLANE, "m", "N", "position in the plane")
VELOCITY = Part("velocity", "velocity_", PLANE, "m/s", "N", "velocity in the plane")
FORCE = Part("", "", PLANE, "N", "N", "force on the agent")
TOLD_FORCE = Part("force", "force_", PLANE, "N", "N", "force on the agent")
SURFACE = Part("surface", "surface_", PLANE, "m/s", "N", "sliding surface")
WHEEL_TORQUE = Part("wheel", "wheel", WHEEL, "N m", "W", "torque of each motor on its wheel")
BODY_TORQUE = Part("body", "", XYZ, "N m", "B", "torque on the body")
TORQUE = Part("", "", XYZ, "N m", "B", "torque on the body")
TOLD_TORQUE = Part("torque", "torque_", XYZ, "N m", "B", "torque on the body")
MOMENTUM = Part("momentum", "momentum_", XYZ, "N m s", "B", "momentum of the wheels relative to the body")
UNMODELLED = Part("unmodelled", "unmodelled_", XYZ, "N m", "B", "torque on the body that no rigid body's model has")
JOINT_ANGLE = Part("angle", "angle_", JOINT, "rad", "", "angle of each wheel and panel about its hinge")
JOINT_RATE = Part("angle_rate", "angle_rate_", JOINT, "rad/s", "", "rate of each wheel and panel about its hinge")
MASS_POSITION = Part("mass_position", "mass_position_", MASS, "m", "B", "position of each balance mass along its rail")
MASS_SPEED = Part("mass_speed", "mass_speed_", MASS, "m/s", "B", "speed of each balance mass along its rail")
WORLD_POSITION = Part("position", "position_", XYZ, "m", "N", "position of a body that floats freely")
WORLD_VELOCITY = Part("velocity", "velocity_", XYZ, "m/s", "N", "velocity of a body that floats freely")


def scalar(what: str, unit: str = "1", name: str = "") -> Part:
    """One number."""
    return Part(name, f"{name}_" if name else "", None, unit, "", what)


def numbered(axis: Axis, what: str, unit: str = "1", stem: str = "", frame: str = "") -> Part:
    """Numbers along an axis."""
    return Part("", stem, axis, unit, frame, what)
