"""Stability margins of a sampled loop: gain, phase, delay and disk margin, of each axis alone and of all alike."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from sim.linear.linear_model import LinearModel

Array = NDArray[np.floating]
ComplexArray = NDArray[np.complexfloating]

_FIXED = 1e-5  # poles that move by less when the gain does are out of the law's reach: momentum, modes that no torque excites
_OTHER_GAIN = 0.7
_LEAST, _MOST = 1e-3, 1e3  # gains between which a margin is looked for
_GAINS, _PULSATIONS, _BESIDE = 60, 600, 30
_SLOWEST = 1e-4  # rad/s, times the sampling period over 0.1 s


class Margins(NamedTuple):
    """How far a loop is from instability.

    Attributes:
      axis: `1`, `2`, `3`: one axis of the body changes while the other two loops are closed as they are; `all`: all change alike.
      stable: whether the loop is, as it is; if not, all else is NaN.
      gain_up: factor on the gain at which it becomes unstable; inf: none.
      gain_down: the same below one; 0: none.
      phase_deg: lag, or lead, at which it does.
      delay_s: delay at which it does.
      disk: alpha of the symmetric disk margin: gain by (1 + d/2) / (1 - d/2) with any complex |d| < alpha is borne; of `all` by each axis
        on its own at the same time (Seiler, Packard & Gahinet 2020, sec. III and V), which is a lower bound.
      crossover_rad_s: greatest pulsation at which the loop's gain is one.
    """

    axis: str
    stable: bool
    gain_up: float
    gain_down: float
    phase_deg: float
    delay_s: float
    disk: float
    crossover_rad_s: float


class Loop(ABC):
    """A sampled loop about three axes, known by what goes round it."""

    @property
    @abstractmethod
    def period_s(self) -> float:
        """Of its samples."""

    @abstractmethod
    def transfer(self, pulsation: Array, axes: list[int]) -> ComplexArray:
        """L at (k,) rad/s, (k, axes, axes), from the torque on some axes round to minus it, the other loops being closed."""

    @abstractmethod
    def gains(self, axes: list[int]) -> tuple[float, float]:
        """Factors on the gain of some axes, above one and below, at which the loop becomes unstable; inf and 0: none."""

    @property
    @abstractmethod
    def stable(self) -> bool:
        """Whether it is, as it is."""

    @cached_property
    def grid(self) -> Array:
        """Pulsations, rad/s, closer together where the plant rings."""
        slowest, fastest = _SLOWEST * 0.1 / self.period_s, np.pi / self.period_s
        ringing = self.ringing[(self.ringing > slowest) & (self.ringing < fastest)]
        beside = np.geomspace(1e-6, 0.1, _BESIDE)
        near = ringing[:, None] * (1.0 + np.concatenate([-beside, beside]))
        grid = np.unique(np.concatenate([np.geomspace(slowest, fastest, _PULSATIONS), near.ravel()]))
        return grid[grid <= fastest]

    @property
    def ringing(self) -> Array:
        """Pulsations of the plant's resonances, rad/s."""
        return np.zeros(0)

    def margins(self) -> list[Margins]:
        """Of axes 1 to 3 and of all."""
        return [*(self._margins(str(i + 1), [i]) for i in (0, 1, 2)), self._margins("all", [0, 1, 2])]

    def _margins(self, axis: str, axes: list[int]) -> Margins:
        if not self.stable:
            return Margins(axis, False, *[np.nan] * 6)
        phase, delay, crossover = self._phase(axes)
        return Margins(axis, True, *self.gains(axes), phase, delay, self._disk(axes), crossover)

    def loci(self, pulsation: Array, axes: list[int]) -> ComplexArray:
        """Eigenvalues of L by size, (k, axes)."""
        values = np.linalg.eigvals(self.transfer(pulsation, axes))
        return np.take_along_axis(values, np.argsort(np.abs(values), axis=-1), axis=-1)

    def _phase(self, axes: list[int]) -> tuple[float, float, float]:
        """Least phase, deg, and delay, s, that bring an eigenvalue of L to -1, and the greatest pulsation at which one has size one."""
        grid = self.grid
        larger = np.abs(self.loci(grid, axes)) > 1.0
        found = []
        for left, branch in np.argwhere(larger[1:] != larger[:-1]).tolist():

            def excess(pulsation: float, branch: int = branch) -> float:
                return float(np.log(np.abs(self.loci(np.array([pulsation]), axes)[0, branch])))

            pulsation = float(optimize.brentq(excess, grid[left], grid[left + 1], xtol=1e-12))
            lag = float(np.angle(-self.loci(np.array([pulsation]), axes)[0, branch]))
            found.append((abs(lag), (lag % (2.0 * np.pi)) / pulsation, pulsation))
        if not found:
            return np.inf, np.inf, np.nan
        phases, delays, pulsations = zip(*found, strict=True)
        return float(np.degrees(min(phases))), min(delays), max(pulsations)

    def _disk(self, axes: list[int]) -> float:
        """One over the peak of (S - T) / 2 = S - 1/2, in the largest singular value."""
        grid, one = self.grid, np.eye(len(axes))

        def size(pulsation: Array) -> Array:
            return np.linalg.norm(np.linalg.inv(one + self.transfer(pulsation, axes)) - one / 2.0, ord=2, axis=(-2, -1))

        sizes = size(grid)
        peak = int(np.argmax(sizes))
        low, high = grid[max(peak - 1, 0)], grid[min(peak + 1, len(grid) - 1)]
        best = optimize.minimize_scalar(lambda w: -float(size(np.array([w]))[0]), bounds=(low, high), method="bounded")
        return 1.0 / max(float(sizes[peak]), -float(best.fun))


@dataclass(frozen=True, eq=False)
class SampledLoop(Loop):
    """u = -K y around a sampled plant without direct feedthrough.

    Attributes:
      plant: from the torque asked for to what the law is told, delays included.
      gain: K, (3, p).
    """

    plant: LinearModel
    gain: Array

    def __post_init__(self) -> None:
        if self.plant.dt is None or self.plant.D.any():
            raise ValueError("margins are of a sampled loop without direct feedthrough")

    @property
    def period_s(self) -> float:
        """Of its samples."""
        return float(self.plant.dt or 0.0)

    @cached_property
    def ringing(self) -> Array:
        """Pulsations of the plant's resonances, rad/s."""
        return np.abs(self.plant.rates.imag)

    @cached_property
    def stable(self) -> bool:
        """Whether all poles that a gain can move decay."""
        return bool(self.radius(np.ones(3)) < 1.0)

    def closed(self, factors: Array) -> Array:
        """Matrix of the closed loop with gains by `factors`, (..., 3), on the axes; (..., n, n)."""
        return self.plant.A - self.plant.B @ (factors[..., :, None] * (self.gain @ self.plant.C))

    @cached_property
    def fixed(self) -> ComplexArray:
        """Poles that do not decay and that no gain moves: wheels exchange momentum with the body and cannot change the whole's."""
        here, there = (np.linalg.eigvals(self.closed(np.full(3, factor))) for factor in (1.0, _OTHER_GAIN))
        stays = np.abs(here[:, None] - there).min(axis=-1) < _FIXED
        return here[stays & (np.abs(np.abs(here) - 1.0) < _FIXED)]

    def radius(self, factors: Array) -> Array:
        """Greatest modulus of a pole with gains by `factors`, (..., 3); (...,). Fixed ones are left out."""
        poles = np.linalg.eigvals(self.closed(factors))
        left_out = (np.abs(poles[..., None] - self.fixed) < _FIXED).any(axis=-1)
        radius: Array = np.max(np.where(left_out, 0.0, np.abs(poles)), axis=-1)
        return radius

    def transfer(self, pulsation: Array, axes: list[int]) -> ComplexArray:
        """L at (k,) rad/s, (k, axes, axes), from the torque on some axes round to it, the other loops being closed."""
        others = np.ones(3)
        others[axes] = 0.0
        seen = self.gain[axes] @ self.plant.C
        part = replace(self.plant, A=self.closed(others), B=self.plant.B[:, axes], C=seen, D=np.zeros((len(axes), len(axes))))
        return part.response(pulsation)

    def gains(self, axes: list[int]) -> tuple[float, float]:
        """Where a pole leaves the unit circle."""
        return self._gain(axes, _MOST), self._gain(axes, _LEAST)

    def _gain(self, axes: list[int], end: float) -> float:
        """The first factor on the gain of some axes, on the way from one to `end`, that makes the loop unstable."""
        share = np.isin(np.arange(3), axes)

        def beyond(factor: Array | float) -> Array:
            return self.radius(np.where(share, np.asarray(factor)[..., None], 1.0)) - 1.0

        factors = np.geomspace(1.0, end, _GAINS)
        unstable = np.flatnonzero(beyond(factors) > 0.0)
        if not len(unstable):
            return np.inf if end > 1.0 else 0.0
        return float(optimize.bisect(beyond, *factors[[unstable[0] - 1, unstable[0]]], xtol=1e-9))
