"""What any body that turns freely must do by textbook physics, with reaction wheels or without."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import null_space
from scipy.special import ellipj

from models.attitude import quaternion
from models.dynamics.state_layout import ATTITUDE
from sim.crosscheck.bench import NO_TORQUE, Bench, Check, advance, column, without_spin
from sim.crosscheck.open_loop import P
from sim.plant.batch import Plant, diagnose

Array = NDArray[np.floating]

SPINNING = np.array([300.0, 280.0, -300.0, -290.0])  # rad/s
ASYMMETRIC = 1e-4  # least difference of two moments over the sum of the three
SPEED = 100.0  # rad/s, of wheels that are slowed down


def locked_inertia(bench: Bench[P], parameters: P) -> list[Check]:
    """Momentum of the whole at unit rates with wheels that stand still: the columns of the published J."""
    chosen, made = bench.made(parameters, **bench.bare)
    plant = Plant(made, 3)
    plant.start(quaternion.IDENTITY, np.eye(3), np.zeros(len(made.wheel_joints)))
    truth = plant.truth()
    found = diagnose(made, truth.qpos, truth.qvel).momentum_N.T
    error = float(np.abs(found - chosen.inertia).max() / np.abs(chosen.inertia).max())
    return [Check("locked-wheel inertia" if made.wheel_joints else "inertia", "an element's error", error, 1e-9, "1")]


def torque_free_rotor(bench: Bench[P], parameters: P) -> list[Check]:
    """Euler's asymmetric body against Jacobi's elliptic functions (Landau & Lifshitz, Mechanics, sec. 37), 100 s.

    Wheels that stand still relative to N keep doing so without friction; the rest is a body of inertia J - J_w W W'.
    """
    _, made = bench.made(parameters, bench.clamped, **bench.bare)
    if np.diff(np.linalg.eigvalsh(without_spin(made))).min() < ASYMMETRIC * np.trace(made.inertia):
        _, made = bench.made(parameters, bench.clamped, **bench.bare | bench.asymmetric)
    moments, axes = np.linalg.eigh(without_spin(made))
    axes[:, 2] *= np.linalg.det(axes)
    start = np.array([0.05, 0.0, 0.3])
    energy, square = moments @ start**2, np.sum((moments * start) ** 2)  # 2 E and H^2, with H^2 > 2 E I_2
    i1, i2, i3 = moments
    low, high = energy * i3 - square, square - energy * i1
    amplitude = np.sqrt([low / (i1 * (i3 - i1)), low / (i2 * (i3 - i2)), high / (i3 * (i3 - i1))])
    parameter = (i2 - i1) * low / ((i3 - i2) * high)
    plant = Plant(made, 1)
    plant.start(quaternion.IDENTITY, axes @ start, -made.wheel_axes.T @ axes @ start)
    path = advance(plant, 100.0, 1.0)
    sn, cn, dn, _ = ellipj(column(path, "time") * np.sqrt((i3 - i2) * high / (i1 * i2 * i3)), parameter)
    exact = (amplitude * np.stack([cn, sn, dn], axis=1)) @ axes.T
    error = float(np.abs(column(path, "omega_BN_B")[:, 0] - exact).max())
    return [Check("torque-free asymmetric body", "rate, 100 s (Jacobi)", error, 1e-7, "rad/s")]


def conservation(bench: Bench[P], parameters: P) -> list[Check]:
    """Momentum in N and energy of a turning body with spinning wheels, and its attitude by the exact equations, 100 s."""
    chosen, made = bench.made(parameters, bench.clamped, **bench.bare)
    body, plant, wheels = bench.exact(chosen), Plant(made, 1), len(made.wheel_joints)
    plant.start(quaternion.IDENTITY, bench.turning, np.resize(SPINNING, wheels))
    path = advance(plant, 100.0, 1.0)
    found = diagnose(made, column(path, "qpos"), column(path, "qvel"))
    momentum, energy, time = found.momentum_N[:, 0], found.energy[:, 0], column(path, "time")
    drift = float(np.linalg.norm(momentum - momentum[0], axis=-1).max() / np.linalg.norm(momentum[0]))
    gain = float(np.abs(energy - energy[0]).max() / energy[0])
    start = np.concatenate([quaternion.IDENTITY, bench.turning, np.resize(SPINNING, wheels)])
    idle = np.zeros(wheels or 3)
    exact = solve_ivp(lambda _, x: body.derivative(x, idle), (0, time[-1]), start, "DOP853", time, rtol=1e-11, atol=1e-12).y.T
    apart = np.degrees(quaternion.angle(column(path, "q_BN")[:, 0], quaternion.normalize(exact[:, ATTITUDE])))
    what = "free, wheels spinning" if wheels else "free, tumbling"
    return [
        Check(what, "change of momentum, 100 s", drift, 1e-9, "1"),
        Check(what, "change of energy, 100 s", gain, 1e-9, "1"),
        Check(what, "angle to exact equations", float(apart[-1]), 1e-4, "deg"),
    ]


def constant_torque(bench: Bench[P], parameters: P) -> list[Check]:
    """From rest about the axis of the greatest moment I of J - J_w W W': rate T t / I and angle T t^2 / 2 I, 100 s (Newton)."""
    _, made = bench.made(parameters, clamped=True, **bench.bare)
    moments, axes = np.linalg.eigh(without_spin(made))
    gain, axis = 1e-3, axes[:, 2]  # rad/s2
    plant = Plant(made, 1)
    path = advance(plant, 100.0, 1.0, torque_B=gain * moments[2] * axis)
    time = column(path, "time")
    rate = np.abs(column(path, "omega_BN_B")[:, 0] - gain * time[:, None] * axis).max() / (gain * time[-1])
    turned = quaternion.from_rotation_vector(0.5 * gain * time[:, None] ** 2 * axis)
    angle = np.degrees(quaternion.angle(column(path, "q_BN")[:, 0], turned)).max()
    return [
        Check("constant torque, principal axis", "rate, 100 s", float(rate), 1e-9, "1"),
        Check("constant torque, principal axis", "angle, 100 s", float(angle), 1e-5, "deg"),
    ]


def wheel_reaction(bench: Bench[P], parameters: P) -> list[Check]:
    """A motor that drives its wheel from rest pushes the body back: (J - J_w W W') omega = -w tau t while the sum of momenta is zero."""
    _, made = bench.made(parameters, clamped=True, **bench.bare)
    wheels, torque = len(made.wheel_joints), 0.3 * made.wheel_torque_limit
    plant = Plant(made, wheels)  # in each trial another wheel is driven
    path = advance(plant, 10.0, 1.0, torque * np.eye(wheels))
    expected = -column(path, "time")[:, None, None] * torque * np.linalg.solve(without_spin(made), made.wheel_axes).T
    error = float(np.abs(column(path, "omega_BN_B") - expected).max() / np.abs(expected).max())
    return [Check("reaction of a driven wheel", "rate, 10 s", error, 1e-9, "1")]


def spin_down(bench: Bench[P], parameters: P, coulomb: float, viscous: float, pattern: Array) -> list[Check]:
    """A wheel's speed under dry (N m), and under viscous (N m s/rad), friction alone against the closed forms.

    `pattern`, (wheels,), is one of speeds whose torques and momenta cancel, so that the body stays at rest.
    """
    checks = []
    for name, dry, drag in (("Coulomb", coulomb, 0.0), ("viscous", 0.0, viscous)):
        _, made = bench.made(parameters, **bench.bare | {"wheel_coulomb_nm": dry, "wheel_viscous_nms": drag})
        plant = Plant(made, 1)
        plant.start(quaternion.IDENTITY, np.zeros(3), SPEED * pattern)
        path = advance(plant, 15.0, 0.1)
        time = column(path, "time")
        exact = SPEED * np.exp(-drag * time / made.wheel_inertia) if drag else SPEED - dry / made.wheel_inertia * time
        speed = column(path, "omega_wheel")[:, 0] * pattern
        error = float(np.abs(speed / exact[:, None] - 1).max())
        checks.append(Check(f"{name} spin-down", "speed in 15 s", error, 1e-8, "1"))
    return checks


def friction(bench: Bench[P], parameters: P) -> list[Check]:
    """Spin-down under frictions that suit the wheels' inertia; in arrays without a pattern of equal speeds there is none to be checked."""
    _, made = bench.made(parameters, **bench.bare)
    pattern = null_space(made.wheel_axes)[:, 0]
    pattern /= np.abs(pattern).max()
    if np.abs(pattern).min() < 1.0 - 1e-9:
        return []
    return spin_down(bench, parameters, 5.0 * made.wheel_inertia, 0.06 * made.wheel_inertia, np.sign(pattern))


def gyroscopic_torque(bench: Bench[P], parameters: P) -> list[Check]:
    """-omega x W J_w omega_wheel on a turning body: the difference in acceleration between spinning and standing wheels."""
    instant = 1e-6  # s: what a single step of this length does is an acceleration
    _, made = bench.made(parameters, clamped=True, **bench.bare | {"step_s": instant})
    rate, speed = np.array([0.2, -0.3, 0.5]), np.array([300.0, -100.0, 200.0, 50.0])
    plant = Plant(made, 2)
    plant.start(quaternion.IDENTITY, rate, np.stack([speed, np.zeros(4)]))
    plant.advance(np.zeros((2, 4)), NO_TORQUE, 1)
    gain = (plant.truth().omega_BN_B - rate) / instant
    expected = -np.cross(rate, made.wheel_inertia * made.wheel_axes @ speed)
    error = np.linalg.norm(without_spin(made) @ (gain[0] - gain[1]) - expected) / np.linalg.norm(expected)
    return [Check("gyroscopic torque", f"of {torque_text(float(np.linalg.norm(expected)))}", float(error), 1e-4, "1")]


def torque_text(torque: float) -> str:
    """N m as a person reads it."""
    return f"{1e3 * torque:.3f} mN m" if torque < 0.1 else f"{torque:.3f} N m"


# of bodies with reaction wheels
WHEELED_CHECKS = (locked_inertia, torque_free_rotor, conservation, constant_torque, wheel_reaction, friction, gyroscopic_torque)
