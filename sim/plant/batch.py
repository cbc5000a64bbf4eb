"""The plant: many simulations of one MuJoCo model, offered as truth. No physics is written here."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import mujoco
import numpy as np
from mujoco.batch import Batch, SimulationError
from numpy.typing import NDArray

from models.attitude.quaternion import attitude_matrix
from models.plants.assembly import Assembly
from models.plants.register.kind import Joint

Array = NDArray[np.floating]

_TO_SCALAR_LAST = np.array([1, 2, 3, 0])
_SUPPLY = 7  # place of the voltage limit in the gain parameters of a `dcmotor`

# The plant reads the warning counters and fails; by default MuJoCo would print and write MUJOCO_LOG.TXT into the user's folder.
mujoco.set_mju_user_warning(lambda _: None)


class SimulationFailed(RuntimeError):
    """The physics became invalid, or a filter broke down; says which trial, when and why.

    `causes` has every trial that failed, by its number or position as `trial` is one.
    """

    def __init__(self, trial: int, time: float, cause: str, causes: dict[int, str] | None = None) -> None:
        super().__init__(cause)
        self.trial, self.time, self.cause = trial, time, cause
        self.causes = causes or {trial: cause}

    def __str__(self) -> str:
        return f"trial {self.trial} failed at t = {self.time:.3f} s: {self.cause}"


class Truth(NamedTuple):
    """What is so, at one instant; leading axis: trial, then agent where a plant has several."""

    time: float  # s
    q_BN: Array  # (trials, [agents,] 4) scalar last
    omega_BN_B: Array  # (trials, [agents,] 3) rad/s
    omega_wheel: Array  # (trials, wheels) rad/s, relative to the body
    qpos: Array  # (trials, nq) MuJoCo's own state
    qvel: Array  # (trials, nv)

    @property
    def state(self) -> Array:
        """[q_BN, omega_BN_B, omega_wheel], (trials, n), the state of the analytic models."""
        return np.concatenate([self.q_BN, self.omega_BN_B, self.omega_wheel], axis=-1)


class Dispersion(NamedTuple):
    """Plants that differ from trial to trial; leading axis: trial."""

    inertia: Array  # (trials, 3, 3) kg m2, locked wheels, about the centre of rotation
    centre_of_mass: Array  # (trials, 3) m
    joints: Mapping[str, Joint]  # what resists in each, by name, (trials,)


class Plant:
    """Trials of an assembly, advanced together by `mujoco.batch.Batch`; bit-identical at any number of trials and threads."""

    def __init__(self, assembly: Assembly, trials: int, threads: int = 1) -> None:
        model = assembly.model
        self.assembly = assembly
        self.trials = trials
        self.step_s = float(model.opt.timestep)
        self._batch = Batch(model, trials, threads)
        self._batch.reset(keyframe=model.keyframe(assembly.keyframe).id)
        self.inertia: Array = np.tile(assembly.inertia, (trials, 1, 1))  # of each trial, faults aside
        self.centre_of_mass: Array = np.tile(assembly.centre_of_mass, (trials, 1))
        self.wheel_coulomb: Array = np.full((trials, len(assembly.wheel_joints)), assembly.wheel_friction)
        self._steps_done = 0
        self._start = self._batch.bind("qpos").copy(), self._batch.bind("qvel").copy()
        quaternion, rate = [], []
        for name in assembly.attitude_joints:
            joint = model.joint(name)
            free = joint.type[0] == mujoco.mjtJoint.mjJNT_FREE
            quaternion.append(int(joint.qposadr[0]) + 3 * free + _TO_SCALAR_LAST)
            rate.append(int(joint.dofadr[0]) + 3 * free + np.arange(3))
        one = len(quaternion) == 1
        self._quaternion = quaternion[0] if one else np.array(quaternion, dtype=int).reshape(-1, 4)
        self._rate = rate[0] if one else np.array(rate, dtype=int).reshape(-1, 3)
        self._wheel_dof = np.array([model.joint(n).dofadr[0] for n in assembly.wheel_joints], dtype=int)
        self._wheel_control = np.array([model.actuator_ctrladr[model.actuator(n).id] for n in assembly.wheel_actuators], dtype=int)

    def truth(self) -> Truth:
        """The present state."""
        qpos, qvel = self._batch.bind("qpos"), self._batch.bind("qvel")
        time = self._batch.bind("time")[0]
        return Truth(float(time), qpos[:, self._quaternion], qvel[:, self._rate], qvel[:, self._wheel_dof], qpos.copy(), qvel.copy())

    def start(self, q_BN: Array, omega_BN_B: Array, omega_wheel: Array) -> None:
        """Set the state at t = 0; shapes as in Truth, or broadcastable to them."""
        qpos, qvel = self._batch.bind("qpos"), self._batch.bind("qvel")
        qpos[:, self._quaternion] = q_BN
        qvel[:, self._rate] = omega_BN_B
        qvel[:, self._wheel_dof] = omega_wheel
        self._start = qpos.copy(), qvel.copy()

    @property
    def physics(self) -> Array:
        """MuJoCo's own state with all that the next step depends on but the model, (trials, n); a copy, which may be set again."""
        state: Array = self._batch.state.copy()
        return state

    @physics.setter
    def physics(self, state: Array) -> None:
        self._batch.state[:] = state
        self._steps_done = round(float(self._batch.bind("time").max()) / self.step_s)

    def hold(self, actuator: str, setpoint: Array | float) -> None:
        """Command an actuator that is not a wheel, such as a balance mass, from now on."""
        self._batch.bind("ctrl")[:, self.assembly.model.actuator_ctrladr[self.assembly.model.actuator(actuator).id]] = setpoint

    def advance(self, wheel_torque: Array, torque_B: Array, steps: int) -> None:
        """Advance by whole physics steps under constant inputs.

        Args:
          wheel_torque: commanded to the drives, (trials, wheels) N m on the wheel.
          torque_B: external, about the centre of rotation (or of mass of a free body), (trials, [agents,] 3) N m in B.
          steps: physics steps.

        Raises:
          SimulationFailed: MuJoCo raised, warned, or produced a number that is not finite.
        """
        self._batch.bind("ctrl")[:, self._wheel_control] = wheel_torque
        self._batch.bind("qfrc_applied")[:, self._rate] = torque_B
        causes, time = self._step(steps), self._steps_done * self.step_s
        self._steps_done += steps
        self._raise(causes, time)

    def _step(self, steps: int) -> dict[int, str]:
        """Advance all trials; what broke down in which of them."""
        causes: dict[int, str] = {}
        try:
            self._batch.step(nstep=steps)
        except SimulationError as failure:
            causes = {int(trial): self._batch.error(int(trial)) for trial in failure.ids}
        if self._batch.warning[..., 1].any():
            for trial, kind in np.argwhere(self._batch.warning[..., 1]).tolist():
                causes.setdefault(trial, f"MuJoCo warned {mujoco.mjtWarning(kind).name}")
        if not np.isfinite(self._batch.state).all():
            for trial in np.unique(np.argwhere(~np.isfinite(self._batch.state))[:, 0]).tolist():
                causes.setdefault(trial, "the state is not finite")
        return causes

    def _raise(self, causes: dict[int, str], time: float) -> None:
        """Raise SimulationFailed if anything broke down."""
        if causes:
            first = min(causes)
            raise SimulationFailed(first, time, causes[first], causes)

    def put_back(self, where: NDArray[np.bool_]) -> None:
        """Put some trials, (trials,), back to their start, where they do no harm; the others are as they were."""
        which = np.flatnonzero(where)
        now = self._batch.bind("time").max()
        self._batch.reset(which, keyframe=self.assembly.model.keyframe(self.assembly.keyframe).id)
        qpos, qvel, time = self._batch.bind("qpos"), self._batch.bind("qvel"), self._batch.bind("time")
        qpos[which], qvel[which], time[which] = self._start[0][which], self._start[1][which], now

    def set_mass_properties(self, trials: Array, inertia: Array, centre_of_mass: Array) -> None:
        """Give some trials another locked-wheel inertia (3, 3) kg m2 and centre of mass (3,) m, or one each; rates are kept.

        `trials` is a boolean mask, (trials,).
        """
        if not np.any(trials):
            return
        properties = self.assembly.reassemble(inertia, centre_of_mass)
        body = self.assembly.model.body(properties.body).id
        for field, value in (
            ("body_mass", properties.mass),
            ("body_ipos", properties.centre_of_mass),
            ("body_inertia", properties.moments),
            ("body_iquat", properties.axes),
        ):
            self._batch.expand(field)[trials, body] = value
        self._batch.set_const(np.flatnonzero(trials))

    def disperse(self, dispersion: Dispersion) -> None:
        """Give every trial a plant of its own, from the start on."""
        everyone = np.ones(self.trials, dtype=bool)
        self.inertia, self.centre_of_mass = dispersion.inertia, dispersion.centre_of_mass
        self.set_mass_properties(everyone, self.inertia, self.centre_of_mass)
        for name, resists in dispersion.joints.items():
            joint = self.assembly.model.joint(name)
            dofs = int(joint.dofadr[0]) + np.arange(len(joint.damping))
            if resists.dry_friction is not None:
                self._batch.expand("dof_frictionloss")[:, dofs] = resists.dry_friction[:, None]
            if resists.damping is not None:
                self._batch.expand("dof_damping")[:, dofs] = resists.damping[:, None]
            if resists.stiffness is not None:
                self._batch.expand("jnt_stiffness")[:, joint.id] = resists.stiffness
        frictions = [dispersion.joints.get(name, Joint()).dry_friction for name in self.assembly.wheel_joints]
        for wheel, friction in enumerate(frictions):
            if friction is not None:
                self.wheel_coulomb[:, wheel] = friction

    def set_supply_voltage(self, volts: Array) -> None:
        """Give the drives of each trial's wheels another usable voltage, (trials,) V: their top speed is that over the motor constant."""
        wheels = [self.assembly.model.actuator(name).id for name in self.assembly.wheel_actuators]
        self._batch.expand("actuator_gainprm")[:, wheels, _SUPPLY] = volts[:, None]

    def set_wheel_friction(self, trials: Array, wheel: int, coulomb: Array | float, viscous: Array | float | None = None) -> None:
        """Set the dry (N m) and viscous (N m s/rad) friction of a wheel's bearing in some trials; a large dry one locks it."""
        dof = self._wheel_dof[wheel]
        self._batch.expand("dof_frictionloss")[trials, dof] = coulomb
        if viscous is not None:
            self._batch.expand("dof_damping")[trials, dof] = viscous


class Diagnostics(NamedTuple):
    """Conserved quantities and body poses of recorded states; leading axes as given."""

    energy: Array  # (...,) J, kinetic plus potential
    momentum_N: Array  # (..., 3) N m s, total angular momentum about the pivot, or of a free body about its centre of mass
    position: Array  # (..., bodies, 3) m, in the lab frame
    quaternion: Array  # (..., bodies, 4) scalar last, body to lab


def diagnose(assembly: Assembly, qpos: Array, qvel: Array) -> Diagnostics:
    """Evaluate MuJoCo at recorded states (..., nq), (..., nv), after the run, so that the run pays nothing for it."""
    model = assembly.model
    lead = qpos.shape[:-1]
    batch = Batch(model, int(np.prod(lead)), 1)
    energy, com, velocity, spin, position, attitude = (
        batch.bind(name) for name in ("energy", "subtree_com", "subtree_linvel", "subtree_angmom", "xpos", "xquat")
    )
    batch.bind("qpos")[:] = qpos.reshape(-1, model.nq)
    batch.bind("qvel")[:] = qvel.reshape(-1, model.nv)
    batch.forward(stage=mujoco.mjtStage.mjSTAGE_VEL.value)
    joint = model.joint(assembly.attitude_joints[0])
    body = int(joint.bodyid[0])
    lab = spin[:, body]
    if joint.type[0] == mujoco.mjtJoint.mjJNT_BALL:  # about its pivot, about the centre of mass where there is none
        lab = lab + model.body_subtreemass[body] * np.cross(com[:, body] - model.body_pos[body], velocity[:, body])
    lab_of_N = attitude_matrix(model.body_quat[body][_TO_SCALAR_LAST])  # maps the lab's axes to those of N
    return Diagnostics(
        energy=energy.sum(-1).reshape(lead),
        momentum_N=(lab @ lab_of_N.T).reshape(*lead, 3),
        position=position.reshape(*lead, model.nbody, 3).copy(),
        quaternion=attitude.reshape(*lead, model.nbody, 4)[..., _TO_SCALAR_LAST],
    )
