"""Delays of readings and commands as states of a linear model: exact of a sampled one, by Padé's approximation of a continuous one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, signal

from sim.bad_input import BadInput
from sim.linear.linear_model import LinearModel, Quantities

Array = NDArray[np.floating]

ORDER = 3  # of Padé's approximation: half a degree of phase at w tau = 2.6

MOST_STAGES = 200  # each holds all outputs of a tick


def late_readings(model: LinearModel, age_s: float) -> LinearModel:
    """The model whose outputs are `age_s` seconds old.

    Sampled: exact, between two samples as the twin's sensors have it, by interpolation. Continuous: Padé's approximation of order 3.
    """
    if age_s == 0.0:
        return model
    if model.dt is None:
        return _behind(model, _pade(age_s, len(model.C)))
    ticks, share = divmod(age_s / model.dt, 1.0)
    if share > 1.0 - 1e-9:
        ticks, share = ticks + 1.0, 0.0
    stages = int(ticks) + (share > 1e-9)
    if stages > MOST_STAGES:
        late = f"readings that are {age_s:g} s late are {stages} control periods behind"
        raise BadInput(f"sensors.latency_s: {late}, a sampled model holds at most {MOST_STAGES}; a continuous one needs none of it")
    return _behind(model, _chain(len(model.C), stages, share if share > 1e-9 else 0.0))


def late_commands(model: LinearModel, ticks: int) -> LinearModel:
    """The sampled model whose inputs act `ticks` samples late."""
    if ticks == 0 or model.dt is None:
        return model
    a, b, c, _ = _chain(model.B.shape[1], ticks, 0.0)
    n, late = len(model.A), len(a)
    names = Quantities(
        tuple(f"{name}_late{i + 1}" for i in np.arange(ticks) for name in model.input.names), tuple(model.input.units) * ticks
    )
    return replace(
        model,
        A=np.block([[model.A, model.B @ c], [np.zeros((late, n)), a]]),
        B=np.vstack([np.zeros_like(model.B), b]),
        C=np.hstack([model.C, model.D @ c]),
        D=np.zeros_like(model.D),
        state=model.state + names,
        drift=np.concatenate([model.drift, np.zeros(late)]),
    )


def _behind(model: LinearModel, delay: tuple[Array, Array, Array, Array]) -> LinearModel:
    """The model with a delay of all its outputs behind it."""
    a, b, c, d = delay
    n, late, outputs = len(model.A), len(a), len(model.C)
    stages = late // outputs
    names = Quantities(
        tuple(f"{name}_late{i + 1}" for i in np.arange(stages) for name in model.output.names), tuple(model.output.units) * stages
    )
    return replace(
        model,
        A=np.block([[model.A, np.zeros((n, late))], [b @ model.C, a]]),
        B=np.vstack([model.B, b @ model.D]),
        C=np.hstack([d @ model.C, c]),
        D=d @ model.D,
        state=model.state + names,
        drift=np.concatenate([model.drift, np.zeros(late)]),
    )


def _chain(width: int, stages: int, share: float) -> tuple[Array, Array, Array, Array]:
    """Samples of a vector handed on from stage to stage; what comes out lies `share` of the way from the last but one to the last."""
    one = np.eye(width)
    a = np.kron(np.eye(stages, k=-1), one)
    b = np.vstack([one, np.zeros((width * (stages - 1), width))])
    weights = np.zeros(stages + 1)
    weights[stages] = share if share else 1.0
    weights[stages - 1] += (1.0 - share) if share else 0.0
    c, d = np.kron(weights[None, 1:], one), weights[0] * one
    return a, b, c, d


def _pade(age_s: float, width: int) -> tuple[Array, Array, Array, Array]:
    """exp(-s tau) of each of `width` outputs (Golub & Van Loan 2013, sec. 9.3, of the exponential), states stage by stage."""
    i = np.arange(ORDER + 1)
    ratios = (ORDER - i[:-1]) / ((2 * ORDER - i[:-1]) * i[1:])
    tail = np.cumprod([1.0, *ratios])
    denominator = (tail * age_s**i)[::-1]
    numerator = (tail * (-age_s) ** i)[::-1]
    a, b, c, d = signal.tf2ss(numerator, denominator)
    scale = age_s ** np.arange(ORDER)  # stages of like size, in the output's unit
    turn = np.diag(scale / scale[-1])
    a, b, c = linalg.inv(turn) @ a @ turn, linalg.inv(turn) @ b, c @ turn
    one = np.eye(width)
    return np.kron(a, one), np.kron(b, one), np.kron(c, one), np.kron(d, one)
