"""A linear time-invariant model with names and units: A, B, C, D, in continuous time or sampled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, signal

Array = NDArray[np.floating]
ComplexArray = NDArray[np.complexfloating]

_AT_ONCE = 1e-6  # a sampled pole of less is one of a delay
_NO_ZERO = 1e3  # times the greatest pole: beyond it a zero is one at infinity


class Quantities(NamedTuple):
    """What the components of a vector are."""

    names: tuple[str, ...]
    units: tuple[str, ...]

    def chosen(self, which: Sequence[int]) -> Quantities:
        """Some of them."""
        return Quantities(tuple(self.names[i] for i in which), tuple(self.units[i] for i in which))

    def __add__(self, other: object) -> Quantities:
        if not isinstance(other, Quantities):
            return NotImplemented
        return Quantities(self.names + other.names, self.units + other.units)


@dataclass(frozen=True, eq=False)
class LinearModel:
    """dx/dt = A x + B u + drift, y = C x + D u; sampled, the next x is A x + B u + drift. All are deviations from an operating point.

    `scipy.signal.StateSpace` comes from `state_space()`; in an environment that has python-control it is `control.ss(m.A, m.B, m.C, m.D)`,
    or `control.ss(m.A, m.B, m.C, m.D, m.dt)` of a sampled one.

    Attributes:
      A: (n, n).
      B: (n, m).
      C: (p, n).
      D: (p, m).
      state: names and units of x.
      input: of u.
      output: of y.
      dt: sampling period, s; None: continuous.
      drift: what x does at the operating point itself, (n,); zero at an equilibrium.
      point: true state at the operating point: q_BN, omega_BN_B rad/s, wheel speeds rad/s, (N,).
    """

    A: Array
    B: Array
    C: Array
    D: Array
    state: Quantities
    input: Quantities
    output: Quantities
    dt: float | None
    drift: Array
    point: Array

    @property
    def poles(self) -> ComplexArray:
        """Eigenvalues of A, rad/s, or of a sampled model on the z plane; by size."""
        return _by_size(linalg.eigvals(self.A))

    @property
    def rates(self) -> ComplexArray:
        """Poles in rad/s, also of a sampled model: log z / dt; those of its delays, z = 0, are minus infinity."""
        if self.dt is None:
            return self.poles
        moving = np.abs(self.poles) > _AT_ONCE
        rates = np.full(len(moving), -np.inf, dtype=complex)
        rates[moving] = np.log(self.poles[moving].astype(complex)) / self.dt
        return rates

    def zeros(self, output: str, input: str) -> ComplexArray:  # the field's word
        """Zeros of one channel, from an input to an output, by their names; raises ValueError for a name that there is not."""
        row, column = _place(self.output.names, output, "output"), _place(self.input.names, input, "input")
        n = len(self.A)
        pencil = np.block([[self.A, self.B[:, [column]]], [self.C[[row]], self.D[[row]][:, [column]]]])
        moving = np.zeros((n + 1, n + 1))
        moving[:n, :n] = np.eye(n)
        top, bottom = linalg.eigvals(pencil, moving, homogeneous_eigvals=True)
        finite = np.abs(top) < _NO_ZERO * (1.0 + np.max(np.abs(self.poles))) * np.abs(bottom)
        return _by_size(top[finite] / bottom[finite])

    def state_space(self) -> Any:
        """The same as a `scipy.signal.StateSpace`."""
        matrices = self.A, self.B, self.C, self.D
        return signal.StateSpace(*matrices) if self.dt is None else signal.StateSpace(*matrices, dt=self.dt)

    def response(self, pulsation: Array) -> ComplexArray:
        """Frequency response at (k,) rad/s, (k, p, m)."""
        s = 1j * np.asarray(pulsation, dtype=float)
        point = s if self.dt is None else np.exp(s * self.dt)
        solved = np.linalg.solve(point[:, None, None] * np.eye(len(self.A)) - self.A, self.B)
        return np.asarray(self.C @ solved + self.D, dtype=complex)

    def arrays(self) -> dict[str, Any]:
        """Everything by name, as it is written to a file; `dt` of a continuous model is zero."""
        return {
            **{name: getattr(self, name) for name in ("A", "B", "C", "D", "drift", "point")},
            "dt": 0.0 if self.dt is None else self.dt,
            **{
                f"{vector}_{key}": np.array(getattr(getattr(self, vector), key), dtype=str)
                for vector in ("state", "input", "output")
                for key in ("names", "units")
            },
        }

    def through(self, inputs: Array, named: Quantities) -> LinearModel:
        """The same under inputs v of which its own are `inputs` v, (m, k)."""
        return replace(self, B=self.B @ inputs, D=self.D @ inputs, input=named)

    def seen(self, which: Sequence[int]) -> LinearModel:
        """The same with some of its outputs."""
        return replace(self, C=self.C[list(which)], D=self.D[list(which)], output=self.output.chosen(which))


def _by_size(values: ComplexArray) -> ComplexArray:
    """Sorted by modulus, conjugates the upper one first."""
    return values[np.lexsort((-values.imag, np.round(np.abs(values), 9)))]


def _place(names: tuple[str, ...], name: str, what: str) -> int:
    if name not in names:
        raise ValueError(f"{what} {name!r}: there is none; there are {', '.join(names)}")
    return names.index(name)
