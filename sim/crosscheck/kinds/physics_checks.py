"""What the plant must do by textbook physics, whoever wrote its engine: each check gives a figure and the tolerance that it must keep."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ellipk

from models.attitude import quaternion
from models.plants.assembly import Assembly
from models.plants.nacs import BALANCE_MASSES, NacsParameters, compile_nacs
from sim.crosscheck.bench import Bench, Check, advance, column, without_spin
from sim.crosscheck.kinds import free_body
from sim.plant.batch import Plant

Array = NDArray[np.floating]

FREE: dict[str, Any] = {"wheel_coulomb_nm": 0.0, "wheel_viscous_nms": 0.0, "bearing_viscous_nms": 0.0, "wheel_imbalance_um": 0.0}
WEIGHTLESS: dict[str, Any] = FREE | {"gravity_m_s2": 0.0, "centre_of_mass_um": (0.0, 0.0, 0.0)}
STILL = np.array([1.0, -1.0, -1.0, 1.0])  # wheel pattern whose torques and momenta cancel in a pyramid: the body stays at rest
OUT_OF_REACH_M = 10.0  # where the tilt stop is put when nothing shall touch it
STIFFER = 1e4  # balance masses so much stiffer, heavier and better damped give by less than 1e-12 m

CheckFunction = Callable[[NacsParameters], list[Check]]


def take_stop_away(assembly: Assembly) -> None:
    """Put the tilt stop out of reach: open loop, a body that nothing holds goes round and round."""
    assembly.model.geom("tilt_stop").pos[2] -= OUT_OF_REACH_M


def clamp_masses(assembly: Assembly) -> None:
    """Fix the balance masses to their rails: all of the rails' drives is scaled alike, so that the step still resolves them."""
    model = assembly.model
    for name in BALANCE_MASSES:
        dof, servo = model.joint(name).dofadr[0], model.actuator(name).id
        model.dof_armature[dof] *= STIFFER
        model.dof_damping[dof] *= STIFFER
        model.actuator_gainprm[servo] *= STIFFER
        model.actuator_biasprm[servo] *= STIFFER


def _compiled(parameters: NacsParameters) -> Assembly:
    return compile_nacs(parameters)


BENCH: Bench[NacsParameters] = Bench(
    compile=_compiled,
    exact=lambda parameters: parameters.process(coupled=True),
    bare=WEIGHTLESS,
    asymmetric={"inertia_kg_m2": "hypothesis"},
    free=take_stop_away,
    clamp=clamp_masses,
)


def locked_wheel_inertia(parameters: NacsParameters) -> list[Check]:
    """The published J_B (eq. 26), column by column."""
    return free_body.locked_inertia(BENCH, parameters)


def torque_free_rotor(parameters: NacsParameters) -> list[Check]:
    """Euler's asymmetric body."""
    return free_body.torque_free_rotor(BENCH, parameters)


def conservation(parameters: NacsParameters) -> list[Check]:
    """Momentum and energy, and the attitude by the exact equations."""
    return free_body.conservation(BENCH, parameters)


def gyroscopic_torque(parameters: NacsParameters) -> list[Check]:
    """Of spinning wheels on a turning body."""
    return free_body.gyroscopic_torque(BENCH, parameters)


def spin_down(parameters: NacsParameters) -> list[Check]:
    """Dry and viscous friction of the wheels' bearings."""
    return free_body.spin_down(BENCH, parameters, 1e-4, 1e-6, STILL)


def pendulum(parameters: NacsParameters) -> list[Check]:
    """Period about x of a low centre of mass, amplitude 1 deg, against the elliptic integral (Landau & Lifshitz, Mechanics, sec. 11)."""
    offset, amplitude = 2e-3, np.radians(1.0)
    diagonal = (*np.diag(parameters.inertia), 0.0, 0.0, 0.0)  # without products a planar motion stays planar
    planar = FREE | {"gravity_m_s2": 9.80665, "centre_of_mass_um": (0.0, 0.0, 1e6 * offset), "inertia_kg_m2": diagonal}
    chosen, made = BENCH.made(parameters, **planar, balance_position_mm=(0.0, 0.0, 0.0))
    plant = Plant(made, 1)
    plant.start(quaternion.from_rotation_vector(np.array([amplitude, 0.0, 0.0])), np.zeros(3), np.zeros(4))
    path = advance(plant, 20.0, 0.01)
    tilt, time = 2 * np.arctan2(column(path, "q_BN")[:, 0, 0], column(path, "q_BN")[:, 0, 3]), column(path, "time")
    falling = np.flatnonzero((tilt[:-1] > 0) & (tilt[1:] <= 0))
    crossing = time[falling] + np.diff(time)[falling] * tilt[falling] / (tilt[falling] - tilt[falling + 1])
    small = 2 * np.pi * np.sqrt(without_spin(made)[0, 0] / (chosen.mass_kg * 9.80665 * offset))
    exact = small * 2 / np.pi * ellipk(np.sin(amplitude / 2) ** 2)
    error = float(np.abs(np.diff(crossing).mean() / exact - 1)) if len(crossing) > 1 else np.nan
    return [Check("pendulum", f"period of {exact:.4f} s", error, 1e-4, "1")]  # a balance mass sags by 3 um: 1.3e-5


def back_emf(parameters: NacsParameters) -> list[Check]:
    """Full torque until the supply voltage is used up, then torque = K (V - K omega) / R, up to the no-load speed V / K."""
    chosen, made = BENCH.made(parameters, **WEIGHTLESS)
    K, R, top, limit = chosen.motor_constant_nm_a, chosen.winding_resistance_ohm, chosen.no_load_speed, made.wheel_torque_limit
    bend, decay = max(0.0, top - limit * R / K**2), made.wheel_inertia * R / K**2
    turn = bend * made.wheel_inertia / limit
    path = advance(Plant(made, 1), turn + 30 * decay, 0.01, limit * STILL)
    after = column(path, "time") - turn
    exact = np.where(after < 0, bend + limit / made.wheel_inertia * after, top - (top - bend) * np.exp(-np.maximum(after, 0) / decay))
    speed = (column(path, "omega_wheel")[:, 0] * STILL).mean(axis=-1)
    return [
        Check("back-EMF", "way to the speed limit", float(np.abs(speed - exact).max() / top), 1e-3, "1"),
        Check("back-EMF", f"speed limit of {top:.1f} rad/s", float(abs(speed[-1] / top - 1)), 1e-9, "1"),
    ]


NACS_CHECKS: tuple[CheckFunction, ...] = (
    locked_wheel_inertia,
    torque_free_rotor,
    conservation,
    pendulum,
    spin_down,
    back_emf,
    gyroscopic_torque,
)
