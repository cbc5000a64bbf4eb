"""Tsao, Brozenec & Safonov, eq. 12: the conic of the error's test with its printed signs, against the norms that it stands for."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from control import conics
from control.falsification import Specification, energy
from sim.crosscheck.failure import Failure
from sim.crosscheck.open_loop import Flight

Array = NDArray[np.floating]

SPECIFICATION = Specification(zero=0.3, error_bound=2.25, effort_bound=0.09, tick=0.1)
SAMPLES = 400
THETA = np.array([[0.0, 0.0], [100.0, 20.0], [400.0, 40.0], [25.0, 15.0]])  # no error at all, and three controllers
LIMIT = 1e-9  # of the integral of y^2


def conic_signs(flight: Flight, bare: Array) -> list[Failure]:  # noqa: ARG001
    """||w1 * (r~ - y)||^2 - ||r~||^2 with r~ = theta' psi + y (eq. 10, 11) against theta' A theta - 2 theta' B + C (eq. 12).

    Along the answer of a double integrator to two pulses, without units; printed are B = -int psi y and C = +int y^2.
    """
    tick = SPECIFICATION.tick
    effort = np.where(np.arange(SAMPLES) < 40, 1.0, 0.0) - np.where(np.arange(SAMPLES) // 40 == 5, 1.0, 0.0)
    rate = tick * np.cumsum(effort)
    position = tick * np.cumsum(rate)
    evidence = SPECIFICATION.start(())
    for sample in zip(effort, rate, position, strict=True):
        evidence = SPECIFICATION.record(evidence, *map(np.asarray, sample))
    right = SPECIFICATION.tests(evidence)[0]
    printed = right.copy()
    printed[:2, 2], printed[2, :] = -right[:2, 2], -right[2, :]
    spent = float(energy(SPECIFICATION.tests(evidence)))
    b_0, b_1, a_1 = SPECIFICATION.weight
    wanted = np.stack([effort, rate], axis=-1) @ THETA.T  # r~ - y of each theta, (samples, thetas)
    weighted = signal.lfilter([b_0, b_1], [1.0, a_1], wanted, axis=0)
    norms = tick * (np.sum(weighted**2, axis=0) - np.sum((wanted + position[:, None]) ** 2, axis=0))
    errors = [float(np.abs(conics.value(conic, THETA) - norms).max() / spent) for conic in (right, printed)]
    return [
        Failure(
            "printed-conic-signs", "eq. 12 to eq. 10, 11", errors[0], errors[1], LIMIT, "1", np.nan,
            "with B and C_e as printed even theta = 0, which makes no error, is falsified",
        )
    ]  # fmt: skip
