"""What filters and controllers need of a model of the plant, and its discretisation by the classical Runge-Kutta method.

A model that says so (`BodyModel`) is a turning body: its attitude is then moved in closed form along the rates of the stages, so that
fast turns stay on the sphere; and a body that turns far in a step takes it in quarters. One that is stiff (`StiffModel`) hands over what
makes it so as a constant slope over the step.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from models.attitude.step import rotation, rotation_sensitivity, turned, turned_sensitivity
from models.dynamics.state_layout import ATTITUDE, RATE

Array = NDArray[np.floating]


FAR = 0.4  # rad a step: an error of some 1e-6 rad
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

    turns: bool  # whether dq/dt is that of the rate, so that the attitude can be moved in closed form


class StiffModel(ProcessModel, Protocol):
    """A model with a part that an explicit step would overshoot."""

    @property
    def smooth(self) -> ProcessModel:
        """All else."""
        ...

    def held(self, state: Array, slope: Array, dt: float) -> Array:
        """Mean slope (..., n) of the stiff part over `dt` seconds, if all else begins with `slope`."""
        ...

    def held_sensitivity(self, state: Array, here: Linearization, dt: float) -> Linearization:
        """The same and how it changes with the state, all else being linearised there."""
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
    half = 0.5 * dt
    k1 = smooth.derivative(state, command)
    held = stiff.held(state, k1, dt) if stiff else 0.0
    k1 = k1 + held
    second = state + half * k1
    k2 = smooth.derivative(second, command) + held
    third = state + half * k2
    k3 = smooth.derivative(third, command) + held
    fourth = state + dt * k3
    after = state + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + smooth.derivative(fourth, command) + held)
    if getattr(smooth, "turns", False):
        after[..., ATTITUDE] = turned(state[..., ATTITUDE], rotation(_rates(state, second, third, fourth), dt))
    return after


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
    here = smooth.linearize(state, command)
    if stiff:
        held = stiff.held_sensitivity(state, here, dt)
        here = Linearization(here.derivative + held.derivative, here.jacobian + held.jacobian)
    return Prediction(state + dt * here.derivative, np.eye(state.shape[-1]) + dt * here.jacobian)


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
    half, one = 0.5 * dt, np.eye(state.shape[-1])
    here = smooth.linearize(state, command)
    held = stiff.held_sensitivity(state, here, dt) if stiff else Linearization(np.zeros(()), np.zeros(()))
    k1, f1 = here.derivative + held.derivative, here.jacobian + held.jacobian
    second, by_second = state + half * k1, one + half * f1
    k2, a2 = smooth.linearize(second, command)
    k2, f2 = k2 + held.derivative, a2 @ by_second + held.jacobian
    third, by_third = state + half * k2, one + half * f2
    k3, a3 = smooth.linearize(third, command)
    k3, f3 = k3 + held.derivative, a3 @ by_third + held.jacobian
    fourth, by_fourth = state + dt * k3, one + dt * f3
    k4, a4 = smooth.linearize(fourth, command)
    k4, f4 = k4 + held.derivative, a4 @ by_fourth + held.jacobian
    after = state + dt / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
    transition = one + dt / 6.0 * (f1 + 2.0 * (f2 + f3) + f4)
    if getattr(smooth, "turns", False):
        rates = _rates(state, second, third, fourth)
        turn = rotation(rates, dt)
        by_state = rotation_sensitivity(rates, _rows(one, by_second, by_third, by_fourth), dt)
        after[..., ATTITUDE] = turned(state[..., ATTITUDE], turn)
        transition[..., ATTITUDE, :] = turned_sensitivity(after[..., ATTITUDE], turn, by_state, ATTITUDE)
    return Prediction(after, transition)


def _turns_far(process: ProcessModel, state: Array, dt: float) -> NDArray[np.bool_]:
    """Where a body turns so far in a step that Runge-Kutta's error would show, and not beyond all measure; (...,)."""
    if not getattr(process, "turns", False):
        return np.zeros((), dtype=bool)
    turn = dt * np.sqrt(np.vecdot(state[..., RATE], state[..., RATE]))
    return (turn > FAR) & (turn < FARTHEST)


def _parts(process: ProcessModel) -> tuple[ProcessModel, StiffModel | None]:
    """What can be stepped explicitly, and the model itself if it has a stiff part besides."""
    smooth = getattr(process, "smooth", process)
    return smooth, None if smooth is process else cast("StiffModel", process)


def _rates(*states: Array) -> tuple[Array, Array, Array, Array]:
    first, second, third, fourth = (state[..., RATE] for state in states)
    return first, second, third, fourth


def _rows(*matrices: Array) -> tuple[Array, Array, Array, Array]:
    first, second, third, fourth = (matrix[..., RATE, :] for matrix in matrices)
    return first, second, third, fourth
