"""The cross-check of a plant without an entry of its own: what its filters believe, and a rigid body with balanced wheels."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from models.dynamics.rigid_body import RigidBody
from models.dynamics.wheeled_body import WheeledBody
from models.plants.assembly import Assembly
from models.plants.register.entries import KINDS, kind_of
from models.plants.register.kind import PlantKind
from models.plants.register.parameters import BodyParameters
from sim.crosscheck.bench import Bench, Check, without_spin
from sim.crosscheck.family import FAULTS, PlantFamily, effects_of
from sim.crosscheck.kinds import free_body
from sim.crosscheck.model_variants import Model
from sim.crosscheck.open_loop import Dynamics


def standard_family(kind: PlantKind[Any]) -> PlantFamily[Any]:
    """A plant's family by its entry in the register of plants alone."""
    bare = {name: value for values in kind.effects.values() for name, value in values.items()}
    bench: Bench[Any] = Bench(compile=kind.compile, exact=exact, bare=bare, asymmetric={})
    checks = (free_body.locked_inertia, _torque_free_rotor, free_body.conservation, free_body.constant_torque, _wheel_reaction)
    return PlantFamily(
        models={"believed": believed, "exact": lambda parameters: Model("exact", exact(parameters), "")},
        exact=exact,
        whole=_whole,
        effects=(*effects_of(kind), FAULTS),
        checks=tuple(_on(bench, check) for check in checks),
    )


def believed(parameters: BodyParameters) -> Model:
    """What the plant's filters believe."""
    kind = kind_of(parameters)
    reads = bool(parameters.wheel_axes.shape[1]) and "wheels" not in kind.layout(parameters).places
    return Model("believed", kind.believed(parameters, False, None), "what is believed", reads_wheels=reads)


def exact(parameters: BodyParameters) -> Dynamics:
    """A rigid body with balanced wheels without any loss, or under torques on it where there are none."""
    if parameters.wheel_axes.shape[1]:
        return _whole(parameters)
    return RigidBody(parameters.inertia, np.eye(3), np.zeros((3, 0)))


def _whole(parameters: BodyParameters) -> WheeledBody:
    made = _compiled(parameters.type, parameters.model_dump_json())
    return WheeledBody(made.inertia, made.wheel_axes, made.wheel_inertia, coupled=True)


@lru_cache(maxsize=1)
def _compiled(kind: str, said: str) -> Assembly:
    """Asked for its mass properties alone: checks alter what they compile."""
    return KINDS[kind].compile(KINDS[kind].parameters.model_validate_json(said))


def _on(bench: Bench[Any], check: Callable[[Bench[Any], Any], list[Check]]) -> Callable[[Any], list[Check]]:
    return lambda parameters: check(bench, parameters)


def _torque_free_rotor(bench: Bench[Any], parameters: Any) -> list[Check]:
    """Where there are three different moments, since nothing is known here of a body that has them."""
    _, made = bench.made(parameters, **bench.bare)
    if np.diff(np.linalg.eigvalsh(without_spin(made))).min() < free_body.ASYMMETRIC * np.trace(made.inertia):
        return []
    return free_body.torque_free_rotor(bench, parameters)


def _wheel_reaction(bench: Bench[Any], parameters: Any) -> list[Check]:
    return free_body.wheel_reaction(bench, parameters) if parameters.wheel_axes.shape[1] else []
