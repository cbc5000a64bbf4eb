"""The cross-check's entry of the free flyer with four wheels: its models, effects and checks, and what its paper prints wrongly."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from models.attitude import quaternion
from models.dynamics.state_layout import ATTITUDE, RATE
from models.plants.freeflyer import PLANT_KIND, FreeflyerParameters, compile_freeflyer
from sim.crosscheck.bench import Bench
from sim.crosscheck.divergence import passes
from sim.crosscheck.failure import Failure
from sim.crosscheck.family import FAULTS, PlantFamily, effects_of
from sim.crosscheck.kinds import free_body
from sim.crosscheck.model_variants import Model
from sim.crosscheck.open_loop import Flight, integrate

Array = NDArray[np.floating]

INSTANTS = (10.0, 100.0, 300.0, 500.0)  # s: it is slow
SECONDS, STEP_S = 60.0, 0.1  # of the motion along which printed kinematics are held against the change of the error
ERROR_LIMIT = 1e-4  # 1/s


def believed(parameters: FreeflyerParameters) -> Model:
    """Hill et al. (2021), eq. 3, 4 in seven states: wheel speeds are read; what the twin's filters believe."""
    return Model("believed", parameters.process(), "J_w / J left out (eq. 4)", reads_wheels=True)


def uncoupled(parameters: FreeflyerParameters) -> Model:
    """The same with the wheels' speeds as states that their motors alone change."""
    return Model("uncoupled", parameters.full_process(), "J_w / J left out (eq. 4)")


def exact(parameters: FreeflyerParameters) -> Model:
    """Rigid body and balanced wheels without any loss."""
    return Model("exact", parameters.full_process(coupled=True), "")


BENCH: Bench[FreeflyerParameters] = Bench(
    compile=compile_freeflyer,
    exact=lambda parameters: parameters.full_process(coupled=True),
    bare={"wheel_coulomb_nm": 0.0, "wheel_viscous_nms": 0.0},
    asymmetric={"inertia_kg_m2": (399.0, 377.0, 340.0, 0.0, 0.0, 0.0)},  # the published one has two equal moments
)


def error_kinematics(flight: Flight, bare: Array) -> list[Failure]:  # noqa: ARG001
    """Eq. 14 without the matrix deltaA, and eq. 35, which takes omega_e for the change of q_e: both against that change.

    Along a torque-free motion of the exact model and a frame D that turns evenly, 60 deg apart at the start. Right are
    omega_e = omega_b - deltaA omega_d and dq_e/dt = ([q_e x] + q_e4 I) omega_e / 2 (eq. A9).
    """
    body = exact(flight.scenario.plant).dynamics  # type: ignore[arg-type]
    wheels = flight.scenario.plant.wheel_axes.shape[1]
    steps = round(SECONDS / STEP_S)
    start = np.concatenate([quaternion.IDENTITY, [0.01, 0.01, 0.01], np.zeros(wheels)])
    path = integrate(body, start, np.zeros((steps + 1, wheels)), STEP_S)
    omega_d = np.array([0.0, 0.02, 0.05])  # rad/s in D
    turn = quaternion.from_rotation_vector(STEP_S * np.arange(steps + 1)[:, None] * omega_d)
    desired = quaternion.multiply(turn, quaternion.from_rotation_vector(np.array([0.0, 0.0, np.pi / 3])))
    error = quaternion.multiply(path[:, ATTITUDE], quaternion.inverse(desired))
    change = (error[2:] - error[:-2]) / (2.0 * STEP_S)
    error, omega_b = error[1:-1], path[1:-1, RATE]
    omega_e = omega_b - (quaternion.attitude_matrix(error) @ omega_d[:, None])[..., 0]
    right = _apart(change, error, omega_e)
    without_matrix = _apart(change, error, omega_b - omega_d)
    as_it_is = np.linalg.norm(change[:, :3] - omega_e, axis=-1)
    return [
        Failure(
            variant, f"change of {part} in {SECONDS:g} s", float(right.max()), float(printed.max()), ERROR_LIMIT, "1/s",
            float(passes(printed, ERROR_LIMIT, STEP_S)), remark,
        )
        for variant, part, printed, remark in (
            ("printed-error-rate", "q_e", without_matrix, "eq. 14 subtracts rates that are resolved in two frames"),
            ("printed-surface", "q_e 1:3", as_it_is, "eq. 35 takes omega_e for the change of q_e, which is half of it"),
        )
    ]  # fmt: skip


def _apart(change: Array, error: Array, omega_e: Array) -> Array:
    """Length of what the kinematics of the vector part leave of its change, (instants,) 1/s."""
    return np.linalg.norm(change[:, :3] - 0.5 * (quaternion.xi(error) @ omega_e[..., None])[:, :3, 0], axis=-1)


FREEFLYER: PlantFamily[FreeflyerParameters] = PlantFamily(
    models={"believed": believed, "uncoupled": uncoupled, "exact": exact},
    exact=lambda parameters: parameters.full_process(coupled=True),
    whole=lambda parameters: parameters.full_process(coupled=True),
    effects=(
        *effects_of(PLANT_KIND),
        FAULTS,
    ),
    checks=tuple(partial(check, BENCH) for check in free_body.WHEELED_CHECKS),
    failures=(error_kinematics,),
    instants=INSTANTS,
)
