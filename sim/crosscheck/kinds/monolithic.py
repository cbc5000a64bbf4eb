"""The cross-check's entry of the spacecraft without wheels; of what its thesis prints nothing can be told by the body's motion."""

from __future__ import annotations

from functools import partial

import numpy as np

from models.dynamics.wheeled_body import WheeledBody
from models.plants.monolithic import MonolithicParameters, compile_monolithic
from sim.crosscheck.bench import Bench
from sim.crosscheck.family import FAULTS, PlantFamily
from sim.crosscheck.kinds import free_body
from sim.crosscheck.model_variants import Model


def believed(parameters: MonolithicParameters) -> Model:
    """Rososhansky (2017), sec. 3.3: Euler's equations with J_m, which filters and control law believe."""
    return Model("believed", parameters.process(believed=True), "J_m: products of inertia left out")


def exact(parameters: MonolithicParameters) -> Model:
    """Euler's equations with the true tensor."""
    return Model("exact", parameters.process(), "")


BENCH: Bench[MonolithicParameters] = Bench(
    compile=compile_monolithic,
    exact=lambda parameters: parameters.process(),
    bare={},
    asymmetric={"inertia_kg_m2": "true"},
    turning=np.ones(3),  # as the scenarios start
)

MONOLITHIC: PlantFamily[MonolithicParameters] = PlantFamily(
    models={"believed": believed, "exact": exact},
    exact=lambda parameters: parameters.process(),
    whole=lambda parameters: WheeledBody(parameters.inertia, parameters.wheel_axes, 0.0),
    effects=(FAULTS,),
    checks=tuple(
        partial(check, BENCH)
        for check in (free_body.locked_inertia, free_body.torque_free_rotor, free_body.conservation, free_body.constant_torque)
    ),
)
