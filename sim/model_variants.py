"""Named analytic models of the NACS: the papers' equations, the exact ones, and those that cannot be right as printed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.nacs import NacsParameters
from sim.open_loop import Dynamics, altered

Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Model:
    """An analytic model under test.

    Attributes:
      name: by which it is chosen.
      dynamics: its equations.
      difference: what in them is not as in the exact coupled equations, in a few words; empty if they are these.
    """

    name: str
    dynamics: Dynamics
    difference: str


@dataclass(frozen=True)
class OppositeCommand:
    """A model that takes eq. 27's result for the u of eq. 9: the body is pushed the wrong way, and so are the wheels."""

    dynamics: Dynamics

    def derivative(self, state: Array, command: Array) -> Array:
        """dx/dt under the opposite torques; (..., n) and (..., wheels) to (..., n)."""
        return self.dynamics.derivative(state, -command)


def eq9_10(parameters: NacsParameters) -> Model:
    """McCafferty-Leroux et al. (2024), eq. 9 and 10 with the signs that physics demands: what the twin's filters believe."""
    return Model("eq9-10", parameters.process(), "rate coupling left out (eq. 10)")


def exact(parameters: NacsParameters) -> Model:
    """Rigid body and balanced wheels without any loss: eq. 9 and 10 with the rate coupling that eq. 10 leaves out."""
    return Model("exact", parameters.process(coupled=True), "")


def printed_inertia(parameters: NacsParameters) -> Model:
    """Exact equations with J_yy = 0.172994 kg m2 (eq. 26 as printed)."""
    return Model("printed-inertia", altered(parameters, inertia_kg_m2="printed").process(coupled=True), "J_yy = 0.172994 (eq. 26)")


def printed_gyroscopic_sign(parameters: NacsParameters) -> Model:
    """Exact equations with +omega x H (eq. 24 as printed)."""
    return Model("printed-gyroscopic-sign", parameters.process(coupled=True, gyroscopic_sign=1.0), "+omega x H (eq. 24)")


def printed_control_sign(parameters: NacsParameters) -> Model:
    """Exact equations fed with eq. 27 as the u of eq. 9 (as printed)."""
    return Model("printed-control-sign", OppositeCommand(parameters.process(coupled=True)), "u of eq. 27 in eq. 9")


NACS_MODELS: dict[str, Callable[[NacsParameters], Model]] = {
    "eq9-10": eq9_10,
    "exact": exact,
    "printed-inertia": printed_inertia,
    "printed-gyroscopic-sign": printed_gyroscopic_sign,
    "printed-control-sign": printed_control_sign,
}
