"""A databank of integral actions: the record as candidates with integral action see it, so that their gains too are judged by conics."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from control.falsification import Evidence, Specification

Array = NDArray[np.floating]
Indices = NDArray[np.int64]


class DatabankMemory(NamedTuple):
    """What is remembered beside the record of candidates without integral action; leading axes: trial, axis, ..."""

    chosen: Indices  # (...,) 0: the running controller has no integral action; i: the i-th rate
    total: Array  # (...,) rad, integral of its error, time counted in 1 / lambda
    last: Array  # (..., 2) psi of the last tick
    washed: Array  # (..., rates, 2) psi without what is slower than each rate
    evidence: Evidence  # (..., rates)
    archive: Array  # (..., rates, capacity, 2, 3, 3)


@dataclass(frozen=True, eq=False)
class IntegralDatabank:
    """u = C_p (e + w int e dt) - C_d dy/dt with e = r - y and w one of a few rates C_I / C_p (Tsao, Brozenec & Safonov, eq. 5 to 8).

    For a given w the fictitious error is still linear in theta = (1/C_p, C_d/C_p): e~ = theta' psi_w with psi_w = s / (s + w) psi, by the
    backward rule as in `control.integral_control`. So each w has conics of its own, and theta is searched in each as without integral.

    Attributes:
      rates: w / lambda, positive.
      tick: lambda times the sampling time.
    """

    rates: tuple[float, ...]
    tick: float

    @cached_property
    def all_rates(self) -> Array:
        """Zero, then those of the databank, (1 + rates,)."""
        return np.array([0.0, *self.rates])

    def start(self, specification: Specification, shape: tuple[int, ...], capacity: int) -> DatabankMemory:
        """No evidence yet, and a controller without integral action."""
        wide = (*shape, len(self.rates))
        return DatabankMemory(
            chosen=np.zeros(shape, np.int64),
            total=np.zeros(shape),
            last=np.zeros((*shape, 2)),
            washed=np.zeros((*wide, 2)),
            evidence=specification.start(wide),
            archive=np.zeros((*wide, capacity, 2, 3, 3)),
        )

    def advanced(self, memory: DatabankMemory, error: Array) -> DatabankMemory:
        """With the running controller's integral of its error up to this tick; error (...,) rad."""
        return memory._replace(total=memory.total + np.where(memory.chosen > 0, self.tick * error, 0.0))

    def action(self, memory: DatabankMemory) -> Array:
        """What its integral adds to the error, (...,) rad."""
        return np.asarray(self.all_rates[memory.chosen] * memory.total)

    def record(self, memory: DatabankMemory, specification: Specification, effort: Array, rate: Array, position: Array) -> DatabankMemory:
        """Add a sample, as `Specification.record` does."""
        psi = np.stack([effort, rate], axis=-1)
        slow = 1.0 + self.tick * np.array(self.rates)[:, None]
        washed = (memory.washed + (psi - memory.last)[..., None, :]) / slow
        where = np.broadcast_to(position[..., None], washed.shape[:-1])
        evidence = specification.record(memory.evidence, washed[..., 0], washed[..., 1], where)
        return memory._replace(last=psi, washed=washed, evidence=evidence)

    def tests(self, memory: DatabankMemory, specification: Specification, plain: Array) -> Array:
        """Conics of every rate, (..., 1 + rates, 2, 3, 3); `plain` (..., 2, 3, 3) are those without integral action."""
        tests = replace(specification, effort_bound=1.0).tests(memory.evidence)  # whose bounds are by axis, not by rate
        tests[..., 1, 2, 2] = plain[..., None, 1, 2, 2]  # the effort is the same, washed or not
        return np.concatenate([plain[..., None, :, :, :], tests], axis=-4)

    def running(self, memory: DatabankMemory, every: Array) -> Array:
        """Those of the running controller, (..., 2, 3, 3), of all, (..., 1 + rates, 2, 3, 3)."""
        return np.take_along_axis(every, memory.chosen[..., None, None, None, None], axis=-4)[..., 0, :, :, :]

    def taken_over(self, memory: DatabankMemory, theta: Array, chosen: Indices, where: NDArray[np.bool_]) -> DatabankMemory:
        """With another controller, theta (..., 2), in the loop where `where`.

        Its integral is what it would be had the law been there all along, (theta' psi - theta' psi_w) / w: what it took to bear a steady
        disturbance is borne on (conditioned transfer, Hanus, Kinnaert & Henrotte 1987).
        """
        every = np.concatenate([memory.last[..., None, :], memory.washed], axis=-2)
        own = np.take_along_axis(every, chosen[..., None, None], axis=-2)[..., 0, :]
        rate = self.all_rates[chosen]
        total = np.sum(theta * (memory.last - own), axis=-1) / np.where(rate > 0.0, rate, 1.0)
        return memory._replace(chosen=np.where(where, chosen, memory.chosen), total=np.where(where, total, memory.total))
