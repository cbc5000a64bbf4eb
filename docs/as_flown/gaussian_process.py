"""Gaussian processes that stand for a simulator: smooth part, linear part and noise (Rasmussen & Williams 2006, ch. 2 and 5)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

Array = NDArray[np.floating]

LENGTH = (1.0, 1.0)  # mean and deviation of a length's logarithm beforehand; inputs are in [-1, 1]
BOUNDS = {"length": (-1.6, 4.0), "smooth": (-4.0, 2.0), "linear": (-4.0, 2.0), "noise": (-5.0, 1.0)}


class Hyperparameters(NamedTuple):
    """Of a kernel, for outputs that are standardised."""

    lengths: Array  # (inputs,)
    smooth: float  # standard deviation of the smooth part
    linear: float  # of a slope
    noise: float  # of what is no function of the inputs

    @classmethod
    def of_logarithms(cls, logs: Array) -> Hyperparameters:
        """From logarithms (inputs + 3,)."""
        values = np.exp(logs)
        return cls(values[:-3], float(values[-3]), float(values[-2]), float(values[-1]))


class GaussianProcess(NamedTuple):
    """One kernel for some outputs, conditioned on what was simulated.

    Attributes:
      inputs: where, (points, inputs) in [-1, 1].
      hyperparameters: of the kernel.
      mean: of each output, (outputs,).
      scale: of each output, (outputs,).
      factor: Cholesky factor of the kernel's matrix, (points, points).
      weights: its inverse times the standardised outputs, (points, outputs).
    """

    inputs: Array
    hyperparameters: Hyperparameters
    mean: Array
    scale: Array
    factor: Array
    weights: Array

    def at(self, inputs: Array) -> tuple[Array, Array]:
        """Mean (n, outputs) and variance (n, outputs) of the function, without noise, at inputs (n, inputs)."""
        across = smooth_part(inputs, self.inputs, self.hyperparameters) + linear_part(inputs, self.inputs, self.hyperparameters)
        h = self.hyperparameters
        own = h.smooth**2 + h.linear**2 * (1.0 + np.sum(inputs**2, axis=-1))
        left = np.maximum(own - np.sum(across * cho_solve((self.factor, True), across.T).T, axis=-1), 0.0)
        return self.mean + self.scale * (across @ self.weights), self.scale**2 * left[:, None]

    def left_out(self) -> tuple[Array, Array]:
        """What is predicted of each point by all others, less what was simulated, and its standard deviation; (points, outputs) each.

        Rasmussen & Williams eq. 5.12; the deviation includes the noise.
        """
        inverse = np.diag(cho_solve((self.factor, True), np.eye(len(self.inputs))))[:, None]
        return -self.scale * self.weights / inverse, self.scale / np.sqrt(inverse)


def smooth_part(one: Array, other: Array, h: Hyperparameters) -> Array:
    """Squared exponential of scaled distances, (n, m)."""
    a, b = one / h.lengths, other / h.lengths
    squares = np.sum(a**2, axis=-1)[:, None] + np.sum(b**2, axis=-1) - 2.0 * a @ b.T
    return h.smooth**2 * np.exp(-0.5 * np.maximum(squares, 0.0))


def linear_part(one: Array, other: Array, h: Hyperparameters) -> Array:
    """Of a constant and slopes that are normal beforehand, (n, m)."""
    return h.linear**2 * (1.0 + one @ other.T)


def condition(inputs: Array, outputs: Array, hyperparameters: Hyperparameters) -> GaussianProcess:
    """The process given outputs (points, outputs) at inputs (points, inputs)."""
    mean, scale = outputs.mean(axis=0), outputs.std(axis=0)
    factor = _factor(inputs, hyperparameters)
    return GaussianProcess(inputs, hyperparameters, mean, scale, factor, cho_solve((factor, True), (outputs - mean) / scale))


def fit(inputs: Array, outputs: Array) -> GaussianProcess:
    """The process whose hyperparameters are most probable, with one kernel for all outputs (points, outputs)."""
    standard = (outputs - outputs.mean(axis=0)) / outputs.std(axis=0)
    count = inputs.shape[1]
    start = np.r_[np.full(count, LENGTH[0]), 0.0, -0.7, -1.5]
    bounds = [BOUNDS["length"]] * count + [BOUNDS["smooth"], BOUNDS["linear"], BOUNDS["noise"]]
    found = minimize(objective, start, args=(inputs, standard), jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 80})
    return condition(inputs, outputs, Hyperparameters.of_logarithms(found.x))


def objective(logs: Array, inputs: Array, standard: Array) -> tuple[float, Array]:
    """Minus the logarithm of the hyperparameters' posterior, but for a constant, and its gradient.

    Args:
      logs: logarithms of the hyperparameters, (inputs + 3,).
      inputs: (points, inputs).
      standard: outputs with mean zero and deviation one, (points, outputs).
    """
    h = Hyperparameters.of_logarithms(logs)
    factor = _factor(inputs, h)
    weights, inverse = cho_solve((factor, True), standard), cho_solve((factor, True), np.eye(len(inputs)))
    many = standard.shape[1]
    apart = (logs[:-3] - LENGTH[0]) / LENGTH[1]
    value = 0.5 * np.sum(standard * weights) + many * np.sum(np.log(np.diag(factor))) + 0.5 * np.sum(apart**2)
    pull = many * inverse - weights @ weights.T
    smooth, linear = smooth_part(inputs, inputs, h), linear_part(inputs, inputs, h)
    by_smooth = pull * smooth
    moments = by_smooth.sum(axis=1) @ inputs**2 - np.sum(inputs * (by_smooth @ inputs), axis=0)
    gradient = np.r_[moments / h.lengths**2 + apart / LENGTH[1], np.sum(by_smooth), np.sum(pull * linear), h.noise**2 * np.trace(pull)]
    return float(value), gradient


def _factor(inputs: Array, h: Hyperparameters) -> Array:
    kernel = smooth_part(inputs, inputs, h) + linear_part(inputs, inputs, h) + h.noise**2 * np.eye(len(inputs))
    return np.tril(cho_factor(kernel, lower=True)[0])
