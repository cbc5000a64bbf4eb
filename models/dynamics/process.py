"""What filters and controllers need of a model of the plant, and its discretisation by the classical Runge-Kutta method.

A turning body (`BodyModel`) that turns far in a step takes it in quarters, so that its attitude is as good as that of a slow one. A model
with a stiff part (`StiffModel`) hands that over as a constant slope over the step, found in closed form.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from models.dynamics.state_layout import RATE

Array = NDArray[np.floating]


FAR = 0.3  # rad a step: up to there the attitude's error is below 1.2e-6 rad
FARTHEST = 100.0  # rad a step: what turns faster is no estimate
QUARTERS = (0.25, 0.25, 0.25, 0.25)


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


class BodyModel(ProcessModel, Protocol):
    """A model whose state begins with [q_BN, omega_BN_B]."""

    turns: bool


class Held(NamedTuple):
    """Mean slope of a stiff part over a step, and how it changes with some of the state before."""

    slope: Array  # (..., n)
    by_state: Array  # (..., n, k) with the components of the state at `columns`; empty if that was not asked for
    columns: slice


class StiffModel(ProcessModel, Protocol):
    """A model with a part that an explicit step would overshoot."""

    @property
    def smooth(self) -> ProcessModel:
        """All else; the model itself if there is no such part."""
        ...

    def held(self, state: Array, slope: Array, dt: float, jacobian: Array | None = None) -> Held:
        """The stiff part over `dt` seconds, if all else begins with `slope` (..., n), which changes with the state by `jacobian`."""
        ...


class Prediction(NamedTuple):
    """State after a step, and its sensitivity to the state before."""

    state: Array  # (..., n)
    transition: Array  # (..., n, n)


def runge_kutta(process: ProcessModel, state: Array, command: Array, dt: float) -> Array:
    """State (..., n) after `dt` seconds of constant command, by the classical 4th-order method."""
    after = _step(process, state, command, dt)
    if (fast := _turns_far(process, state, dt)).any():
        finer = state
        for part in QUARTERS:
            finer = runge_kutta(process, finer, command, part * dt)
        after = np.where(fast[..., None], finer, after)
    return after


def _step(process: ProcessModel, state: Array, command: Array, dt: float) -> Array:
    smooth, stiff = _parts(process)
    k1 = smooth.derivative(state, command)
    held = stiff.held(state, k1, dt).slope if stiff else 0.0
    k1 = k1 + held
    k2 = smooth.derivative(state + 0.5 * dt * k1, command) + held
    k3 = smooth.derivative(state + 0.5 * dt * k2, command) + held
    k4 = smooth.derivative(state + dt * k3, command) + held
    return state + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def runge_kutta_along(slope: Callable[[Array], Array], state: Array, dt: float) -> Array:
    """The same of any derivative, (..., n) to (..., n), of the state alone."""
    k1 = slope(state)
    k2 = slope(state + 0.5 * dt * k1)
    k3 = slope(state + 0.5 * dt * k2)
    k4 = slope(state + dt * k3)
    return state + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def predict_euler(process: ProcessModel, state: Array, command: Array, dt: float) -> Prediction:
    """One explicit Euler step, x + dt f and I + dt df/dx: what papers mean when they say no more than 'discretised'."""
    smooth, stiff = _parts(process)
    slope, jacobian = smooth.linearize(state, command)
    transition = np.eye(state.shape[-1]) + dt * jacobian
    if stiff:
        held = stiff.held(state, slope, dt, jacobian)
        slope = slope + held.slope
        transition[..., held.columns] += dt * held.by_state
    return Prediction(state + dt * slope, transition)


def predict(process: ProcessModel, state: Array, command: Array, dt: float) -> Prediction:
    """Runge-Kutta step of the state and, along with it, of the variational equation dPhi/dt = (df/dx) Phi."""
    predicted = _predicted(process, state, command, dt)
    if (fast := _turns_far(process, state, dt)).any():
        finer = Prediction(state, np.eye(state.shape[-1]))
        for part in QUARTERS:
            moved = predict(process, finer.state, command, part * dt)
            finer = Prediction(moved.state, moved.transition @ finer.transition)
        predicted = Prediction(
            np.where(fast[..., None], finer.state, predicted.state), np.where(fast[..., None, None], finer.transition, predicted.transition)
        )
    return predicted


def _predicted(process: ProcessModel, state: Array, command: Array, dt: float) -> Prediction:
    smooth, stiff = _parts(process)
    half = 0.5 * dt
    k1, a1 = smooth.linearize(state, command)
    held = stiff.held(state, k1, dt, a1) if stiff else None
    more = held.slope if held else 0.0
    k1 = k1 + more
    k2, a2 = smooth.linearize(state + half * k1, command)
    k2 = k2 + more
    k3, a3 = smooth.linearize(state + half * k2, command)
    k3 = k3 + more
    k4, a4 = smooth.linearize(state + dt * k3, command)
    f2 = a2 + half * (a2 @ a1)
    f3 = a3 + half * (a3 @ f2)
    f4 = a4 + dt * (a4 @ f3)
    transition = np.eye(state.shape[-1]) + dt / 6.0 * (a1 + 2.0 * (f2 + f3) + f4)
    if held:  # a constant slope through the middle of the step, up to the third order of dt
        transition[..., held.columns] += dt * (held.by_state + half * (a2 @ (held.by_state + dt / 3.0 * (a3 @ held.by_state))))
    return Prediction(state + dt / 6.0 * (k1 + 2.0 * (k2 + k3) + k4 + more), transition)


def _turns_far(process: ProcessModel, state: Array, dt: float) -> NDArray[np.bool_]:
    """Where a body turns so far in a step that Runge-Kutta's error would show, and not beyond all measure; (...,)."""
    if not getattr(process, "turns", False):
        return np.zeros((), dtype=bool)
    square = dt**2 * np.vecdot(state[..., RATE], state[..., RATE])
    return (square > FAR**2) & (square < FARTHEST**2)


def _parts(process: ProcessModel) -> tuple[ProcessModel, StiffModel | None]:
    """What can be stepped explicitly, and the model itself if it has a stiff part besides."""
    smooth = getattr(process, "smooth", process)
    return smooth, None if smooth is process else cast("StiffModel", process)
