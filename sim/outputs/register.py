"""The register of outputs: every module of `sim/outputs` that has an OUTPUT, in the order of the modules' names."""

from __future__ import annotations

import pkgutil
from importlib import import_module
from types import MappingProxyType

import sim.outputs
from sim.outputs.output import Output


def _found() -> dict[str, Output]:
    """Outputs by key; the package is walked once, when this module is imported."""
    found: dict[str, Output] = {}
    for name in sorted(module.name for module in pkgutil.iter_modules(sim.outputs.__path__) if module.name != "register"):
        output = getattr(import_module(f"{sim.outputs.__name__}.{name}"), "OUTPUT", None)
        if output is None:
            continue
        if output.key in found or output.file in {other.file for other in found.values()}:
            raise ValueError(f"sim.outputs.{name}: there is an output {output.key!r} or a file {output.file!r} already")
        found[output.key] = output
    return found


OUTPUTS = MappingProxyType(_found())
