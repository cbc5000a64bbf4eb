"""Analytic models under test, and those of the NACS by name: the paper's equations, the exact ones, and those wrong as printed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.dynamics.state_layout import MOTION, WHEELS
from models.plants.nacs import NacsParameters
from sim.crosscheck.open_loop import Dynamics, Flight, altered, integrate

Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Model:
    """An analytic model under test.

    Attributes:
      name: by which it is chosen.
      dynamics: its equations.
      difference: what in them is not as in the exact coupled equations, in a few words; empty if they are these.
      reads_wheels: it has no wheel speeds among its states; they are an input, as read at every tick.
      hidden: further states behind those of the plant, which are zero at the start.
    """

    name: str
    dynamics: Dynamics
    difference: str
    reads_wheels: bool = False
    hidden: int = 0

    def predict(
        self, flight: Flight, ticks: int, substeps: int = 1, euler: bool = False, read: Array | None = None, held: bool = True
    ) -> Array:
        """What it makes of the first `ticks` of a flight's commands, from the flight's own start, as `integrate` does.

        Args:
          flight: what was flown.
          ticks: how far.
          substeps: integration steps a tick.
          euler: explicit Euler instead of Runge-Kutta.
          read: wheel speeds that it reads, (ticks, trials, wheels) rad/s; None: the flight's.
          held: a reading stays what it is for a tick, as on board; else speeds change evenly from one to the next.

        Returns:
          States of the plant (ticks, trials, n); wheel speeds are those that it reads, where it does.
        """
        start, inputs, tick_s = flight.states[0], flight.command[:ticks], flight.scenario.run.tick_s
        if self.reads_wheels:
            speeds = flight.states[:ticks, ..., WHEELS] if read is None else read
            path = self._reading(start[..., MOTION], inputs, speeds, tick_s, substeps, euler, held)
            return np.concatenate([path, speeds], axis=-1)
        size = start.shape[-1]
        if self.hidden:
            start = np.concatenate([start, np.zeros((*start.shape[:-1], self.hidden))], axis=-1)
        return integrate(self.dynamics, start, inputs, tick_s, substeps, euler)[..., :size]

    def _reading(self, start: Array, command: Array, speeds: Array, tick_s: float, substeps: int, euler: bool, held: bool) -> Array:
        """Seven states, (ticks, trials, 7)."""
        if held:
            return integrate(self.dynamics, start, np.concatenate([command, speeds], axis=-1), tick_s, substeps, euler)
        middle = (np.arange(substeps) + 0.5) / substeps  # of every step, in ticks
        between = speeds[:-1, None] + middle[:, None, None] * (speeds[1:, None] - speeds[:-1, None])
        between = np.concatenate([between.reshape(-1, *speeds.shape[1:]), speeds[-1:]])
        inputs = np.concatenate([np.repeat(command, substeps, axis=0)[: len(between)], between], axis=-1)
        return integrate(self.dynamics, start, inputs, tick_s / substeps, 1, euler)[::substeps]


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
