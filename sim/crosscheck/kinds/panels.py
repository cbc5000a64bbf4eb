"""What sprung panels must do by textbook physics: their modes, their answer to a torque, and what ringing keeps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from models.attitude import quaternion
from models.dynamics.wheeled_body import WheeledBody
from models.plants.assembly import Assembly
from models.plants.flexible import PANELS, compile_flexible
from models.plants.flexible_parameters import FlexibleParameters
from sim.crosscheck.bench import Bench, Check, advance, column
from sim.crosscheck.kinds.free_body import SPINNING
from sim.plant.batch import Plant, diagnose

Array = NDArray[np.floating]

STIFFER = 1e12  # panels so much heavier to turn about their hinges stay where they are
SMALL = 1e-3  # rad, of panels that ring
PERIODS = 10
SAMPLES = 100  # a period
ALIKE, OPPOSITE = np.array([1.0, 1.0]), np.array([1.0, -1.0])


def lock_panels(assembly: Assembly) -> None:
    """Fix the panels to the hub: their hinges get so much inertia of their own that springs and hub do not move them."""
    model = assembly.model
    for name in PANELS:
        dof = int(model.joint(name).dofadr[0])
        model.dof_armature[dof] = STIFFER * model.body_inertia[model.body(name).id].max()


def hold_hub(assembly: Assembly) -> None:
    """Fix the hub in N, as a test stand would."""
    model = assembly.model
    first = int(model.joint(assembly.attitude_joints[0]).dofadr[0])
    scale = float(np.abs(assembly.inertia).max())
    model.dof_armature[first : first + 6] = STIFFER * max(scale, float(model.body_mass.sum()))


def rigid_body(parameters: FlexibleParameters) -> WheeledBody:
    """Exact equations of the plant with its panels locked."""
    return WheeledBody(parameters.inertia, parameters.wheel_axes, parameters.wheel_inertia_kg_m2, coupled=True)


BENCH: Bench[FlexibleParameters] = Bench(
    compile=compile_flexible,
    exact=rigid_body,
    bare={"wheel_coulomb_nm": 0.0, "wheel_viscous_nms": 0.0},
    asymmetric={},
    clamp=lock_panels,
    clamped=True,
)


def _straight(bench: Bench[FlexibleParameters], parameters: FlexibleParameters) -> tuple[FlexibleParameters, Assembly]:
    """The plant without products of inertia, so that what turns about the hinges' axis goes on doing so."""
    return bench.made(parameters, **bench.bare, inertia_kg_m2=(*np.diag(parameters.inertia), 0.0, 0.0, 0.0))


def _ringing(made: Assembly, shape: Array, mode: float) -> float:
    """Frequency, rad/s, of panels let go at SMALL times `shape`, (2,) rad, by their passages through zero; `mode` is about it."""
    address = [int(made.model.joint(name).qposadr[0]) for name in PANELS]
    made.model.key_qpos[made.model.keyframe(made.keyframe).id, address] = SMALL * shape
    period = 2.0 * np.pi / mode
    path = advance(Plant(made, 1), PERIODS * period, period / SAMPLES)
    angle, time = column(path, "qpos")[:, 0, address] @ shape, column(path, "time")
    falling = np.flatnonzero((angle[:-1] > 0) & (angle[1:] <= 0))
    if len(falling) < 2:
        return np.nan
    crossing = time[falling] + np.diff(time)[falling] * angle[falling] / (angle[falling] - angle[falling + 1])
    return float(2.0 * np.pi / np.diff(crossing).mean())


def modes(bench: Bench[FlexibleParameters], parameters: FlexibleParameters) -> list[Check]:
    """Frequencies of the panels: hub held, hub free, and panels opposite to each other, which push the hub aside.

    sqrt(k / m22); that over sqrt(1 - m12^2 / (m11 m22)) with free wheels (Likins 1970); sqrt(k / (I - 2 S^2 / m)) with I and S second
    and first moment of a panel about its hinge and m the mass of all.
    """
    channel = parameters.linear_channel(0)
    second = parameters.panel_mass_kg * parameters.panel_length_m**2 / 3.0
    first = parameters.panel_mass_kg * parameters.panel_length_m / 2.0
    opposite = float(np.sqrt(parameters.spring / (second - 2.0 * first**2 / parameters.mass_kg)))
    checks = []
    for name, shape, build, mode in (
        ("hub held", ALIKE, hold_hub, channel.held_frequency),
        ("hub free", ALIKE, bench.free, channel.free_frequency),
        ("panels opposite", OPPOSITE, bench.free, opposite),
    ):
        made = _straight(bench, parameters)[1]
        build(made)
        found = _ringing(made, shape, mode)
        measure = f"frequency of {mode / (2.0 * np.pi):.4f} Hz"
        checks.append(Check(f"mode, {name}", measure, float(abs(found / mode - 1.0)), 1e-5, "1"))
    return checks


def held_torque(bench: Bench[FlexibleParameters], parameters: FlexibleParameters) -> list[Check]:
    """Hub and panels under a torque about the hinge axis that is switched on and held, against the linear model, five periods."""
    chosen, made = _straight(bench, parameters)
    channel = chosen.linear_channel(0)
    plant, period = Plant(made, 1), 2.0 * np.pi / channel.free_frequency
    torque = SMALL * channel.stiffness[1, 1]
    path = advance(plant, 5.0 * period, period / 50.0, torque_B=np.array([torque, 0.0, 0.0]))
    time = column(path, "time")
    sampled, state = channel.sampled(float(time[1])), [np.zeros(4)]
    for _ in time[1:]:
        state.append(sampled.transition @ state[-1] + sampled.input * torque)
    exact = np.array(state)
    hub = quaternion.to_rotation_vector(column(path, "q_BN")[:, 0])[:, 0]
    panel = column(path, "qpos")[:, 0, [int(made.model.joint(name).qposadr[0]) for name in PANELS]].mean(axis=-1)
    what = "held torque about the hinges"
    return [
        Check(what, "angle of the hub", float(np.abs(hub - exact[:, 0]).max() / np.abs(exact[:, 0]).max()), 1e-4, "1"),
        Check(what, "angle of the panels", float(np.abs(panel - exact[:, 1]).max() / np.abs(exact[:, 1]).max()), 1e-4, "1"),
    ]


def ringing_keeps(bench: Bench[FlexibleParameters], parameters: FlexibleParameters) -> list[Check]:
    """Momentum in N, and energy with that of the springs, of a turning body with spinning wheels and ringing panels, 100 s."""
    _, made = bench.made(parameters, **bench.bare)
    made.model.key_qpos[made.model.keyframe(made.keyframe).id, [int(made.model.joint(name).qposadr[0]) for name in PANELS]] = [0.05, 0.02]
    plant = Plant(made, 1)
    plant.start(quaternion.IDENTITY, bench.turning, SPINNING)
    path = advance(plant, 100.0, 1.0)
    found = diagnose(made, column(path, "qpos"), column(path, "qvel"))
    momentum, energy = found.momentum_N[:, 0], found.energy[:, 0]
    drift = float(np.linalg.norm(momentum - momentum[0], axis=-1).max() / np.linalg.norm(momentum[0]))
    gain = float(np.abs(energy - energy[0]).max() / energy[0])
    return [
        Check("panels ringing", "change of momentum, 100 s", drift, 1e-9, "1"),
        Check("panels ringing", "change of energy, 100 s", gain, 1e-6, "1"),
    ]


PANEL_CHECKS = (modes, held_torque, ringing_keeps)
