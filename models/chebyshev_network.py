"""Chebyshev network: a function of several inputs as a weighted sum of Chebyshev polynomials of each input alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

Array = NDArray[np.floating]


@dataclass(frozen=True)
class ChebyshevNetwork:
    """One layer, linear in its weights: y = W phi(X), phi = (1, T1(X1) ... TN(X1), T1(X2) ... TN(Xn)) (Rososhansky 2017, eq. 2.42, 5.6).

    There are no products of different inputs, so it cannot represent them; polynomials of inputs beyond 1 grow like the N-th power.

    Attributes:
      inputs: n.
      outputs: rows of W.
      order: N, of the highest polynomial.
    """

    inputs: int = 4
    outputs: int = 2
    order: int = 3

    def __post_init__(self) -> None:
        if min(self.inputs, self.outputs, self.order) < 1:
            raise ValueError(f"inputs = {self.inputs}, outputs = {self.outputs}, order = {self.order}: need 1 or more of each")

    @property
    def terms(self) -> int:
        """Entries of phi, n N + 1."""
        return self.inputs * self.order + 1

    @property
    def size(self) -> int:
        """Entries of W."""
        return self.outputs * self.terms

    def basis(self, inputs: Array) -> Array:
        """phi; (..., inputs) to (..., terms)."""
        return self._flat(chebyshev.chebvander(inputs, self.order)[..., 1:], 1.0)

    def slope(self, inputs: Array) -> Array:
        """Slope d phi / dX, which has one input in each row but the first; (..., inputs) to (..., terms, inputs)."""
        derivative = np.zeros((self.order, self.order))  # of each polynomial, as a series of the lower ones
        derivative[:] = chebyshev.chebder(np.eye(self.order + 1))[:, 1:]
        each = chebyshev.chebvander(inputs, self.order - 1) @ derivative
        own = np.repeat(np.eye(self.inputs), self.order, axis=0)
        return self._flat(each, 0.0)[..., None] * np.concatenate([np.zeros((1, self.inputs)), own])

    def output(self, weights: Array, inputs: Array) -> Array:
        """W phi; weights row by row (..., outputs x terms) and (..., inputs) to (..., outputs)."""
        return self.weigh(weights, self.basis(inputs))

    def weigh(self, weights: Array, basis: Array) -> Array:
        """W phi of a phi that is known; (..., outputs x terms) and (..., terms) to (..., outputs)."""
        rows = weights.reshape(*weights.shape[:-1], self.outputs, self.terms)
        return np.einsum("...ij,...j->...i", rows, basis)

    def _flat(self, each: Array, first: float) -> Array:
        """A constant and the polynomials of all inputs in one row; (..., inputs, order) to (..., terms)."""
        out = np.empty((*each.shape[:-2], self.terms))
        out[..., 0] = first
        out[..., 1:] = each.reshape(*each.shape[:-2], self.terms - 1)
        return out
