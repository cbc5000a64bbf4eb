"""What filters and controllers need of a model of the plant, and its discretisation by the classical Runge-Kutta method."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]


class Linearization(NamedTuple):
    """A model at one state: its derivative and how that changes with the state."""

    derivative: Array  # (..., n)
    jacobian: Array  # (..., n, n)


class ProcessModel(Protocol):
    """A continuous-time model dx/dt = f(x, u) with its Jacobian; every array may have leading batch axes."""

    def derivative(self, state: Array, command: Array) -> Array:
        """f(x, u): (..., n) and (..., r) to (..., n)."""
        ...

    def linearize(self, state: Array, command: Array) -> Linearization:
        """f(x, u) and df/dx: (..., n) and (..., r) to (..., n) and (..., n, n)."""
        ...


class Prediction(NamedTuple):
    """State after a step, and its sensitivity to the state before."""

    state: Array  # (..., n)
    transition: Array  # (..., n, n)


def runge_kutta(process: ProcessModel, state: Array, command: Array, dt: float) -> Array:
    """State (..., n) after `dt` seconds of constant command, by the classical 4th-order method."""
    return runge_kutta_along(lambda at: process.derivative(at, command), state, dt)


def runge_kutta_along(slope: Callable[[Array], Array], state: Array, dt: float) -> Array:
    """The same of any derivative, (..., n) to (..., n), of the state alone."""
    k1 = slope(state)
    k2 = slope(state + 0.5 * dt * k1)
    k3 = slope(state + 0.5 * dt * k2)
    k4 = slope(state + dt * k3)
    return state + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def predict_euler(process: ProcessModel, state: Array, command: Array, dt: float) -> Prediction:
    """One explicit Euler step, x + dt f and I + dt df/dx: what papers mean when they say no more than 'discretised'."""
    here = process.linearize(state, command)
    return Prediction(state + dt * here.derivative, np.eye(state.shape[-1]) + dt * here.jacobian)


def predict(process: ProcessModel, state: Array, command: Array, dt: float) -> Prediction:
    """Runge-Kutta step of the state and, along with it, of the variational equation dPhi/dt = (df/dx) Phi."""
    half = 0.5 * dt
    k1, a1 = process.linearize(state, command)
    k2, a2 = process.linearize(state + half * k1, command)
    k3, a3 = process.linearize(state + half * k2, command)
    k4, a4 = process.linearize(state + dt * k3, command)
    f2 = a2 + half * (a2 @ a1)
    f3 = a3 + half * (a3 @ f2)
    f4 = a4 + dt * (a4 @ f3)
    transition = np.eye(state.shape[-1]) + dt / 6.0 * (a1 + 2.0 * (f2 + f3) + f4)
    return Prediction(state + dt / 6.0 * (k1 + 2.0 * (k2 + k3) + k4), transition)
