"""What the plant must do by textbook physics, whoever wrote its engine: each check gives a figure and the tolerance that it must keep."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.special import ellipj, ellipk

from models import quaternion
from models.assembly import Assembly
from models.nacs import NacsParameters, compile_nacs
from sim.open_loop import altered, clamp_masses, take_stop_away
from sim.plant import Plant, Truth, diagnose

Array = NDArray[np.floating]

FREE: dict[str, object] = {"wheel_coulomb_nm": 0.0, "wheel_viscous_nms": 0.0, "bearing_viscous_nms": 0.0, "wheel_imbalance_um": 0.0}
WEIGHTLESS: dict[str, object] = FREE | {"gravity_m_s2": 0.0, "centre_of_mass_um": (0.0, 0.0, 0.0)}
STILL = np.array([1.0, -1.0, -1.0, 1.0])  # wheel pattern whose torques and momenta cancel in a pyramid: the body stays at rest
SPINNING = np.array([300.0, 280.0, -300.0, -290.0])  # rad/s
TURNING = np.array([0.05, -0.03, 0.08])  # rad/s
NO_TORQUE = np.zeros(3)


class Check(NamedTuple):
    """A figure that must not exceed its tolerance."""

    name: str
    measure: str  # what the figure is
    figure: float
    tolerance: float
    unit: str

    @property
    def passed(self) -> bool:
        """Whether it does not; a figure that is no number fails."""
        return self.figure <= self.tolerance


CheckFunction = Callable[[NacsParameters], list[Check]]


def _testbed(parameters: NacsParameters, changes: Mapping[str, object], clamped: bool = False) -> tuple[NacsParameters, Assembly]:
    """The plant with some parameters changed and without its tilt stop."""
    chosen = altered(parameters, **changes)
    made = compile_nacs(chosen)
    take_stop_away(made)
    if clamped:
        clamp_masses(made)
    return chosen, made


def _fly(plant: Plant, seconds: float, every_s: float, motor: Array | float = 0.0) -> list[Truth]:
    """Truth at the start and every `every_s` (a whole number of steps, one at least)."""
    steps = max(1, round(every_s / plant.step_s))
    path = [plant.truth()]
    while path[-1].time < seconds - 1e-9:
        plant.advance(np.broadcast_to(motor, (plant.trials, 4)), NO_TORQUE, steps)
        path.append(plant.truth())
    return path


def _column(path: list[Truth], name: str) -> Array:
    return np.array([getattr(truth, name) for truth in path])


def _without_spin(made: Assembly) -> Array:
    """J of what turns with the body when its wheels are free: J - J_w W W', (3, 3) kg m2."""
    return made.inertia - made.wheel_inertia * made.wheel_axes @ made.wheel_axes.T


def locked_wheel_inertia(parameters: NacsParameters) -> list[Check]:
    """Momentum of the whole at unit rates with wheels that stand still: the columns of the published J_B (eq. 26)."""
    chosen, made = _testbed(parameters, WEIGHTLESS)
    rest = Plant(made, 3).truth()
    moving = np.zeros_like(rest.qvel)
    moving[:, :3] = np.eye(3)
    found = diagnose(made, rest.qpos, moving).momentum_N.T
    error = float(np.abs(found - chosen.inertia).max() / np.abs(chosen.inertia).max())
    return [Check("locked-wheel inertia", "an element's error", error, 1e-9, "1")]


def torque_free_rotor(parameters: NacsParameters) -> list[Check]:
    """Euler's asymmetric body against Jacobi's elliptic functions (Landau & Lifshitz, Mechanics, sec. 37), 100 s.

    Wheels that stand still relative to N keep doing so without friction; the rest is a body of inertia J - J_w W W'.
    """
    _, made = _testbed(parameters, WEIGHTLESS)
    if np.diff(np.linalg.eigvalsh(_without_spin(made))).min() < 1e-4 * np.trace(made.inertia):  # not asymmetric: take the published one
        _, made = _testbed(parameters, WEIGHTLESS | {"inertia_kg_m2": "hypothesis"})
    moments, axes = np.linalg.eigh(_without_spin(made))
    axes[:, 2] *= np.linalg.det(axes)
    start = np.array([0.05, 0.0, 0.3])
    energy, square = moments @ start**2, np.sum((moments * start) ** 2)  # 2 E and H^2, with H^2 > 2 E I_2
    i1, i2, i3 = moments
    low, high = energy * i3 - square, square - energy * i1
    amplitude = np.sqrt([low / (i1 * (i3 - i1)), low / (i2 * (i3 - i2)), high / (i3 * (i3 - i1))])
    parameter = (i2 - i1) * low / ((i3 - i2) * high)
    plant = Plant(made, 1)
    plant.start(quaternion.IDENTITY, axes @ start, -made.wheel_axes.T @ axes @ start)
    path = _fly(plant, 100.0, 1.0)
    sn, cn, dn, _ = ellipj(_column(path, "time") * np.sqrt((i3 - i2) * high / (i1 * i2 * i3)), parameter)
    exact = (amplitude * np.stack([cn, sn, dn], axis=1)) @ axes.T
    error = float(np.abs(_column(path, "omega_BN_B")[:, 0] - exact).max())
    return [Check("torque-free asymmetric body", "rate, 100 s (Jacobi)", error, 1e-7, "rad/s")]


def conservation(parameters: NacsParameters) -> list[Check]:
    """Momentum in N and energy of a turning body with spinning wheels, and its attitude by the exact equations, 100 s."""
    chosen, made = _testbed(parameters, WEIGHTLESS)
    body, plant = chosen.process(coupled=True), Plant(made, 1)
    plant.start(quaternion.IDENTITY, TURNING, SPINNING)
    path = _fly(plant, 100.0, 1.0)
    found = diagnose(made, _column(path, "qpos"), _column(path, "qvel"))
    momentum, energy, time = found.momentum_N[:, 0], found.energy[:, 0], _column(path, "time")
    drift = float(np.linalg.norm(momentum - momentum[0], axis=-1).max() / np.linalg.norm(momentum[0]))
    gain = float(np.abs(energy - energy[0]).max() / energy[0])
    start = np.concatenate([quaternion.IDENTITY, TURNING, SPINNING])
    exact = solve_ivp(lambda _, x: body.derivative(x, np.zeros(4)), (0, time[-1]), start, "DOP853", time, rtol=1e-11, atol=1e-12).y.T
    apart = np.degrees(quaternion.angle(_column(path, "q_BN")[:, 0], quaternion.normalize(exact[:, :4])))
    return [
        Check("free, wheels spinning", "change of momentum, 100 s", drift, 1e-9, "1"),
        Check("free, wheels spinning", "change of energy, 100 s", gain, 1e-9, "1"),
        Check("free, wheels spinning", "angle to exact equations", float(apart[-1]), 1e-4, "deg"),
    ]


def pendulum(parameters: NacsParameters) -> list[Check]:
    """Period about x of a low centre of mass, amplitude 1 deg, against the elliptic integral (Landau & Lifshitz, Mechanics, sec. 11)."""
    offset, amplitude = 2e-3, np.radians(1.0)
    diagonal = (*np.diag(parameters.inertia), 0.0, 0.0, 0.0)  # without products a planar motion stays planar
    planar = FREE | {"gravity_m_s2": 9.80665, "centre_of_mass_um": (0.0, 0.0, 1e6 * offset), "inertia_kg_m2": diagonal}
    chosen, made = _testbed(parameters, planar | {"balance_position_mm": (0.0, 0.0, 0.0)})
    plant = Plant(made, 1)
    plant.start(quaternion.from_rotation_vector(np.array([amplitude, 0.0, 0.0])), np.zeros(3), np.zeros(4))
    path = _fly(plant, 20.0, 0.01)
    tilt, time = 2 * np.arctan2(_column(path, "q_BN")[:, 0, 0], _column(path, "q_BN")[:, 0, 3]), _column(path, "time")
    falling = np.flatnonzero((tilt[:-1] > 0) & (tilt[1:] <= 0))
    crossing = time[falling] + np.diff(time)[falling] * tilt[falling] / (tilt[falling] - tilt[falling + 1])
    small = 2 * np.pi * np.sqrt(_without_spin(made)[0, 0] / (chosen.mass_kg * 9.80665 * offset))
    exact = small * 2 / np.pi * ellipk(np.sin(amplitude / 2) ** 2)
    error = float(np.abs(np.diff(crossing).mean() / exact - 1)) if len(crossing) > 1 else np.nan
    return [Check("pendulum", f"period of {exact:.4f} s", error, 1e-4, "1")]  # a balance mass sags by 3 um: 1.3e-5


def spin_down(parameters: NacsParameters) -> list[Check]:
    """A wheel's speed under dry, and under viscous, friction alone against the closed forms."""
    checks = []
    for name, coulomb, viscous in (("Coulomb", 1e-4, 0.0), ("viscous", 0.0, 1e-6)):
        _, made = _testbed(parameters, WEIGHTLESS | {"wheel_coulomb_nm": coulomb, "wheel_viscous_nms": viscous})
        plant, start = Plant(made, 1), 100.0
        plant.start(quaternion.IDENTITY, np.zeros(3), start * STILL)
        path = _fly(plant, 15.0, 0.1)
        time = _column(path, "time")
        exact = start * np.exp(-viscous * time / made.wheel_inertia) if viscous else start - coulomb / made.wheel_inertia * time
        speed = _column(path, "omega_wheel")[:, 0] * STILL
        error = float(np.abs(speed / exact[:, None] - 1).max())
        checks.append(Check(f"{name} spin-down", "speed in 15 s", error, 1e-8, "1"))
    return checks


def back_emf(parameters: NacsParameters) -> list[Check]:
    """Full torque until the supply voltage is used up, then torque = K (V - K omega) / R, up to the no-load speed V / K."""
    chosen, made = _testbed(parameters, WEIGHTLESS)
    K, R, top, limit = chosen.motor_constant_nm_a, chosen.winding_resistance_ohm, chosen.no_load_speed, made.wheel_torque_limit
    bend, decay = max(0.0, top - limit * R / K**2), made.wheel_inertia * R / K**2
    turn = bend * made.wheel_inertia / limit
    path = _fly(Plant(made, 1), turn + 30 * decay, 0.01, limit * STILL)
    after = _column(path, "time") - turn
    exact = np.where(after < 0, bend + limit / made.wheel_inertia * after, top - (top - bend) * np.exp(-np.maximum(after, 0) / decay))
    speed = (_column(path, "omega_wheel")[:, 0] * STILL).mean(axis=-1)
    return [
        Check("back-EMF", "way to the speed limit", float(np.abs(speed - exact).max() / top), 1e-3, "1"),
        Check("back-EMF", f"speed limit of {top:.1f} rad/s", float(abs(speed[-1] / top - 1)), 1e-9, "1"),
    ]


def gyroscopic_torque(parameters: NacsParameters) -> list[Check]:
    """-omega x W J_w omega_wheel on a turning body: the difference in acceleration between spinning and standing wheels."""
    instant = 1e-6  # s: what a single step of this length does is an acceleration
    _, made = _testbed(parameters, WEIGHTLESS | {"step_s": instant}, clamped=True)
    rate, speed = np.array([0.2, -0.3, 0.5]), np.array([300.0, -100.0, 200.0, 50.0])
    plant = Plant(made, 2)
    plant.start(quaternion.IDENTITY, rate, np.stack([speed, np.zeros(4)]))
    plant.advance(np.zeros((2, 4)), NO_TORQUE, 1)
    gain = (plant.truth().omega_BN_B - rate) / instant
    expected = -np.cross(rate, made.wheel_inertia * made.wheel_axes @ speed)
    error = np.linalg.norm(_without_spin(made) @ (gain[0] - gain[1]) - expected) / np.linalg.norm(expected)
    return [Check("gyroscopic torque", f"of {1e3 * np.linalg.norm(expected):.3f} mN m", float(error), 1e-4, "1")]


NACS_CHECKS: tuple[CheckFunction, ...] = (
    locked_wheel_inertia,
    torque_free_rotor,
    conservation,
    pendulum,
    spin_down,
    back_emf,
    gyroscopic_torque,
)
