"""A plant linearised: derivatives of its step, in coordinates in which an attitude has three of them. No physics is written here."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from models.attitude import quaternion
from models.plants.assembly import Assembly
from sim.plant.batch import Truth

Array = NDArray[np.floating]

_TO_SCALAR_LAST = np.array([1, 2, 3, 0])
_TURN, _RATE, _SHARE = 1e-4, 1e-3, 1e-2  # perturbations: rad or m, rad/s or m/s, of the drives' limit (or of rad/s2 by the inertia)
_FINER = 100  # implicitfast is of first order: its derivatives are taken over so much shorter a step
_MATTERS = 1e-9  # change of attitude or rate in a step, by that of an angle which should change nothing


class OperatingPoint(NamedTuple):
    """Where a plant is linearised: MuJoCo's state, and what acts on it."""

    qpos: Array  # (nq,)
    qvel: Array  # (nv,)
    wheel_torque: Array  # (wheels,) N m of motors on wheels
    torque_B: Array  # (3,) N m on the body
    holds: Mapping[str, float]  # set-points of other actuators


class StepModel(NamedTuple):
    """x_next = x + drift + (A - I) dx + B du over `dt` seconds, dx from the operating point."""

    A: Array
    B: Array
    drift: Array
    dt: float


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Error coordinates of MuJoCo's state: angles of all joints, an attitude by its rotation vector in B, then all rates, (2 nv,)."""

    assembly: Assembly

    @property
    def model(self) -> mujoco.MjModel:
        """What is stepped."""
        return self.assembly.model

    @cached_property
    def attitude(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Places of q_BN, scalar last, in qpos, and of omega_BN_B in qvel."""
        joint = self.model.joint(self.assembly.attitude_joints[0])
        free = 3 * int(joint.type[0] == mujoco.mjtJoint.mjJNT_FREE)
        return int(joint.qposadr[0]) + free + _TO_SCALAR_LAST, int(joint.dofadr[0]) + free + np.arange(3)

    @cached_property
    def wheels(self) -> NDArray[np.intp]:
        """Places of the wheels' speeds in qvel."""
        return np.array([int(self.model.joint(name).dofadr[0]) for name in self.assembly.wheel_joints], dtype=np.intp)

    @cached_property
    def drives(self) -> NDArray[np.intp]:
        """Places of the wheels' torques in ctrl."""
        model = self.model
        return np.array([int(model.actuator_ctrladr[model.actuator(name).id]) for name in self.assembly.wheel_actuators], dtype=np.intp)

    @cached_property
    def names(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Of all coordinates, and their units."""
        angles, rates = np.full(self.model.nv, "", dtype=object), np.full(self.model.nv, "", dtype=object)
        units = np.full(self.model.nv, "rad", dtype=object)
        for joint in map(self.model.joint, range(self.model.njnt)):
            slides = int(joint.type[0]) in (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_FREE))
            first, count = int(joint.dofadr[0]), len(joint.damping)
            labels = [joint.name] if count == 1 else [f"{joint.name}{i + 1}" for i in np.arange(count)]
            angles[first : first + count], rates[first : first + count] = labels, [f"{label}_rate" for label in labels]
            units[first : first + count] = "m" if slides else "rad"
        _, body = self.attitude
        angles[body], rates[body], units[body] = ["theta1", "theta2", "theta3"], ["omega1", "omega2", "omega3"], "rad"
        for i, dof in enumerate(self.wheels.tolist()):
            angles[dof], rates[dof] = f"angle{i + 1}", f"wheel{i + 1}"
        return (*angles, *rates), (*units, *(f"{unit}/s" for unit in units))

    @cached_property
    def carried(self) -> NDArray[np.intp]:
        """Angles of the other joints: their places in qpos, and with them in the coordinates, (2, n)."""
        body = set(self.attitude[1].tolist())
        pairs = []
        for joint in map(self.model.joint, range(self.model.njnt)):
            dofs = int(joint.dofadr[0]) + np.arange(len(joint.damping))
            pairs += [(int(joint.qposadr[0]) + i, dof) for i, dof in enumerate(dofs.tolist()) if dof not in body]
        return np.array(pairs, dtype=np.intp).reshape(-1, 2).T

    def moved(self, point: OperatingPoint, error: Array) -> tuple[Array, Array]:
        """States (n, nq), (n, nv) that lie `error`, (n, 2 nv), beside a point."""
        place, (turned, spinning), (other, dof) = np.tile(point.qpos, (len(error), 1)), self.attitude, self.carried
        place[:, other] += error[:, dof]
        place[:, turned] = quaternion.multiply(quaternion.from_rotation_vector(error[:, spinning]), point.qpos[turned])
        return place, point.qvel + error[:, self.model.nv :]

    def beside(self, point: OperatingPoint, qpos: Array, qvel: Array) -> Array:
        """How far states (n, nq), (n, nv) are from a point, (n, 2 nv)."""
        error, (turned, spinning), (other, dof) = np.zeros((len(qpos), 2 * self.model.nv)), self.attitude, self.carried
        error[:, dof] = qpos[:, other] - point.qpos[other]
        error[:, spinning] = quaternion.error(qpos[:, turned], point.qpos[turned])
        error[:, self.model.nv :] = qvel - point.qvel
        return error

    @cached_property
    def ignorable(self) -> NDArray[np.bool_]:
        """Coordinates on which nothing else should depend, (2 nv,): angles of wheels, places and velocities of a free body."""
        found, wheels, nv = np.zeros(2 * self.model.nv, dtype=bool), self.wheels, self.model.nv
        found[wheels] = True
        joint = self.model.joint(self.assembly.attitude_joints[0])
        if joint.type[0] == mujoco.mjtJoint.mjJNT_FREE:
            flight = int(joint.dofadr[0]) + np.arange(3)
            found[flight], found[nv + flight] = True, True
        return found

    def needed(self, step: StepModel) -> NDArray[np.bool_]:
        """Coordinates that are states: all but those that are ignorable, as they should be; an imbalance makes a wheel's angle one."""
        moved = np.zeros(len(step.A), dtype=bool)
        _, body = self.attitude
        moved[body], moved[self.model.nv + body] = True, True
        matters = (np.abs(step.A[moved]) > _MATTERS).any(axis=0)
        return ~(self.ignorable & ~matters)


def at_state(assembly: Assembly, q_BN: Array, omega_BN_B: Array, omega_wheel: Array, holds: Mapping[str, float]) -> OperatingPoint:
    """The point with an attitude (4,), rates (3,) rad/s and wheel speeds (wheels,) rad/s, other joints where they come to rest."""
    model, coordinates = assembly.model, Coordinates(assembly)
    qpos, qvel = np.array(model.keyframe(assembly.keyframe).qpos), np.array(model.keyframe(assembly.keyframe).qvel)
    turned, spinning = coordinates.attitude
    qpos[turned], qvel[spinning], qvel[coordinates.wheels] = q_BN, omega_BN_B, omega_wheel
    for name, place in holds.items():
        qpos[model.jnt_qposadr[model.actuator(name).trnid[0]]] = place
    placed = OperatingPoint(qpos, qvel, np.zeros(len(assembly.wheel_joints)), np.zeros(3), holds)
    return _settled(assembly, _settled(assembly, placed))


def _settled(assembly: Assembly, point: OperatingPoint) -> OperatingPoint:
    """The point with joints other than the body's and the wheels' nearer to where they rest on it, by one of Newton's steps."""
    coordinates = Coordinates(assembly)
    nv = assembly.model.nv
    own = np.ones(nv, dtype=bool)
    own[coordinates.attitude[1]], own[coordinates.ignorable[:nv]] = False, False
    if not own.any():
        return point
    step = by_differences(assembly, point, 1)
    which = np.flatnonzero(np.tile(own, 2))
    error = np.zeros(2 * nv)
    error[which] = np.linalg.solve(np.eye(len(which)) - step.A[np.ix_(which, which)], step.drift[which])
    qpos, qvel = coordinates.moved(point, error[None])
    return point._replace(qpos=qpos[0], qvel=qvel[0])


def at_truth(truth: Truth, wheel_torque: Array, torque_B: Array, holds: Mapping[str, float]) -> OperatingPoint:
    """The point where the first trial of a flight is, under these torques, (wheels,) and (3,) N m."""
    return OperatingPoint(truth.qpos[0].copy(), truth.qvel[0].copy(), wheel_torque, torque_B, holds)


def by_differences(assembly: Assembly, point: OperatingPoint, steps: int) -> StepModel:
    """Central differences of the plant's own steps, as the twin takes them (RK4), under inputs that are held.

    Dry friction, which has no derivative where a wheel stands still and none that matters elsewhere, is left out.

    Args:
      assembly: what is stepped.
      point: from where.
      steps: physics steps over which the model reaches.
    """
    return _differences(assembly, _without_dry_friction(assembly.model), point, steps)


def by_mujoco(assembly: Assembly, point: OperatingPoint) -> StepModel:
    """MuJoCo's own derivatives (`mjd_transitionFD`), which refuse RK4: of a copy that steps by implicitfast, a hundredth as far.

    Those by the torque from outside, which MuJoCo does not take, are differences of the same copy's step.
    """
    model = _without_dry_friction(assembly.model)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST.value
    model.opt.timestep = assembly.model.opt.timestep / _FINER
    coordinates = Coordinates(assembly)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = point.qpos, point.qvel
    data.ctrl[coordinates.drives] = point.wheel_torque
    data.qfrc_applied[coordinates.attitude[1]] = point.torque_B
    for name, place in point.holds.items():
        data.ctrl[model.actuator_ctrladr[model.actuator(name).id]] = place
    A, B = np.zeros((2 * model.nv, 2 * model.nv)), np.zeros((2 * model.nv, model.nu))
    mujoco.mjd_transitionFD(model, data, 1e-5, True, A, B, None, None)
    other = _differences(assembly, model, point, 1)
    wheels = len(coordinates.drives)
    return StepModel(A, np.hstack([B[:, coordinates.drives], other.B[:, wheels:]]), other.drift, other.dt)


def _without_dry_friction(model: mujoco.MjModel) -> mujoco.MjModel:
    smooth = copy.copy(model)
    smooth.dof_frictionloss[:] = 0.0
    return smooth


def _differences(assembly: Assembly, model: mujoco.MjModel, point: OperatingPoint, steps: int) -> StepModel:
    coordinates = Coordinates(assembly)
    wheels, states = len(coordinates.drives), 2 * model.nv
    push = _SHARE * float(np.trace(assembly.inertia)) / 3.0
    sizes = np.concatenate(
        [
            *(np.full(model.nv, _TURN), np.full(model.nv, _RATE)),
            *(np.full(wheels, _SHARE * assembly.wheel_torque_limit), np.full(3, push)),
        ]
    )
    change = np.vstack([np.diag(sizes), -np.diag(sizes), np.zeros(len(sizes))])
    batch = Batch(model, len(change), 1)
    batch.reset(keyframe=model.keyframe(assembly.keyframe).id)
    qpos, qvel, ctrl, applied = (batch.bind(name) for name in ("qpos", "qvel", "ctrl", "qfrc_applied"))
    qpos[:], qvel[:] = coordinates.moved(point, change[:, :states])
    for name, place in point.holds.items():
        ctrl[:, model.actuator_ctrladr[model.actuator(name).id]] = place
    ctrl[:, coordinates.drives] = point.wheel_torque + change[:, states : states + wheels]
    applied[:, coordinates.attitude[1]] = point.torque_B + change[:, states + wheels :]
    batch.step(nstep=steps)
    after = coordinates.beside(point, qpos, qvel)
    slopes = ((after[: len(sizes)] - after[len(sizes) : -1]) / (2.0 * sizes[:, None])).T
    return StepModel(slopes[:, :states], slopes[:, states:], after[-1], steps * float(model.opt.timestep))
