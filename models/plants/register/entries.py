"""The register of plants: every module of `models/plants` that has a PLANT_KIND, in the order of the modules' names."""

from __future__ import annotations

import pkgutil
from importlib import import_module
from types import MappingProxyType
from typing import Any

import models.plants
from models.plants.register.kind import PlantKind
from models.plants.register.parameters import Parameters


def _found() -> dict[str, PlantKind[Any]]:
    """Kinds by type; the package is walked once, when this module is imported."""
    kinds: dict[str, PlantKind[Any]] = {}
    for name in sorted(module.name for module in pkgutil.iter_modules(models.plants.__path__)):
        full = f"{models.plants.__name__}.{name}"
        kind = getattr(import_module(full), "PLANT_KIND", None)
        if kind is None:
            continue
        if kind.type in kinds:
            raise ValueError(f"{full}: there is a plant of type {kind.type!r} already")
        kinds[kind.type] = kind
    return kinds


KINDS = MappingProxyType(_found())


def kind_of(parameters: Parameters) -> PlantKind[Any]:
    """The entry of a plant."""
    return KINDS[parameters.type]
