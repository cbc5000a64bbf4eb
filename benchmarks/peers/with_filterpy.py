"""Filters of filterpy on the twin's analytic model, trial by trial."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np
from filterpy.kalman import (  # type: ignore[import-untyped]  # has no types
    ExtendedKalmanFilter,
    IMMEstimator,
    KalmanFilter,
    MerweScaledSigmaPoints,
    UnscentedKalmanFilter,
)
from numpy.typing import NDArray

from benchmarks.peers.conversation import Arrays, answer
from models.dynamics.process import ProcessModel, predict, runge_kutta
from models.dynamics.rigid_body import RigidBody
from models.dynamics.wheel_faults import WheelFault
from models.dynamics.wheeled_body import WheeledBody

Array = NDArray[np.floating]


def residual(reading: Array, predicted: Array) -> Array:
    """Reading minus prediction, the quaternion of either sign."""
    sign = np.where(reading[:4] @ predicted[:4] < 0, -1.0, 1.0)
    return np.concatenate([sign * reading[:4], reading[4:]]) - predicted


class Extended(ExtendedKalmanFilter):  # type: ignore[misc]  # has no types
    """filterpy's EKF, told the model and that the whole state is read."""

    def __init__(self, process: ProcessModel, asked: Arrays, reading: Array) -> None:
        super().__init__(dim_x=len(reading), dim_z=len(reading))
        self.process, self.dt, self.eye = process, float(asked["dt"]), np.eye(len(reading))
        self.x, self.P, self.Q, self.R = reading.copy(), asked["R"].copy(), asked["Q"], asked["R"]

    def predict_x(self, u: Array) -> None:
        """The twin's Runge-Kutta step with its transition matrix."""
        self.x, self.F = predict(self.process, self.x, u, self.dt)

    def update(self, z: Array) -> None:
        """Correct, and scale the quaternion to unit length."""
        super().update(z, HJacobian=lambda _: self.eye, Hx=lambda x: x, residual=residual)
        self.x[:4] /= np.linalg.norm(self.x[:4])


def body(asked: Arrays, wheel_coulomb: float = 0.0) -> WheeledBody:
    """The model as the twin's filter has it."""
    return WheeledBody(asked["inertia"], asked["wheel_axes"], float(asked["wheel_inertia"]), wheel_coulomb=wheel_coulomb)


def extended(asked: Arrays, reading: Array) -> Extended:
    """One EKF."""
    return Extended(body(asked), asked, reading)


def scaled(x: Array) -> Array:
    """The state with its quaternion of unit length."""
    return np.concatenate([x[:4] / np.linalg.norm(x[:4]), x[4:]])


class Unscented(UnscentedKalmanFilter):  # type: ignore[misc]  # has no types
    """filterpy's UKF, told the model and that the whole state is read; quaternions of points and means are scaled to unit length."""

    def __init__(self, process: ProcessModel, asked: Arrays, reading: Array) -> None:
        n, dt = len(reading), float(asked["dt"])

        def move(x: Array, dt: float, u: Array) -> Array:
            return runge_kutta(process, scaled(x), u, dt)

        points = MerweScaledSigmaPoints(n, alpha=1.0, beta=2.0, kappa=0.0)
        super().__init__(n, n, dt, hx=lambda x: x, fx=move, points=points, residual_z=residual, x_mean_fn=lambda x, w: scaled(w @ x))
        self.x, self.P, self.Q, self.R = reading.copy(), asked["R"].copy(), asked["Q"], asked["R"]

    def predict(self, u: Array) -> None:
        """Command by position, as the others have it."""
        super().predict(u=u)

    def update(self, z: Array) -> None:
        """Correct, and scale the quaternion to unit length."""
        super().update(z)
        self.x[:4] /= np.linalg.norm(self.x[:4])


def rigid_body(asked: Arrays, *floating: int) -> RigidBody:
    """Seven states: the speeds of the wheels are known; `floating` ones have no power."""
    axes = asked["wheel_axes"]
    return RigidBody(asked["inertia"], WheelFault.floating(4, *floating).on_body(axes).torque_map, axes * float(asked["wheel_inertia"]))


def unscented(asked: Arrays, reading: Array) -> Unscented:
    """One UKF."""
    return Unscented(body(asked), asked, reading)


def unscented_7(asked: Arrays, reading: Array) -> Unscented:
    """One UKF of attitude and rate."""
    return Unscented(rigid_body(asked), asked, reading)


def mixed(pair: list[KalmanFilter]) -> IMMEstimator:
    """Two modes, equally probable at the start."""
    return IMMEstimator(pair, [0.5, 0.5], np.array([[0.98, 0.02], [0.02, 0.98]]))


def interacting(asked: Arrays, reading: Array) -> IMMEstimator:
    """Two EKFs, one of which knows the wheels' dry friction."""
    return mixed([Extended(body(asked, coulomb), asked, reading) for coulomb in (0.0, float(asked["wheel_coulomb"]))])


def interacting_7(asked: Arrays, reading: Array) -> IMMEstimator:
    """Two UKFs of attitude and rate, one of which believes that a wheel floats."""
    return mixed([Unscented(process, asked, reading) for process in (rigid_body(asked), rigid_body(asked, 1))])


def follow(make: Callable[[Arrays, Array], ExtendedKalmanFilter], asked: Arrays) -> Arrays:
    """Follow the readings (ticks, trials, n) under the commands (ticks, trials, wheels); the estimates, (ticks, trials, n)."""
    readings, commands = asked["readings"], asked["commands"]
    means, seconds = readings.copy(), 0.0
    for trial in range(readings.shape[1]):
        one = make(asked, readings[0, trial])
        start = time.process_time()
        for k in range(1, len(readings)):
            one.predict(commands[k, trial])
            one.update(readings[k, trial])
            means[k, trial] = one.x
        seconds += time.process_time() - start
    return {"seconds": np.array(seconds), "means": means}


if __name__ == "__main__":
    answer({make.__name__: partial(follow, make) for make in (extended, unscented, unscented_7, interacting, interacting_7)})
