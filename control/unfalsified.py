"""Unfalsified adaptive control: proportional-derivative gains that are replaced when the record falsifies them."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from control.candidate_controllers import CandidateSearch, Choice
from control.falsification import Evidence, Specification, energy, values
from control.integral_databank import DatabankMemory, IntegralDatabank

Array = NDArray[np.floating]
Flags = NDArray[np.bool_]

COARSEST = 0.5  # lambda times a tick; tests of a record sampled more coarsely mean nothing


class Memory(NamedTuple):
    """All that the controller remembers; leading axes: trial, axis, ..."""

    tick: int  # samples so far
    theta: Array  # (..., 2) (J^ lambda^2 / C_p, lambda C_d / C_p)
    origin: Array  # (...,) rad, the attitude of rest that y is counted from
    evidence: Evidence
    archive: Array  # (..., capacity, 2, 3, 3) past tests
    archived: NDArray[np.int64]  # (...,) how many
    databank: DatabankMemory | None = None  # of candidates with integral action, if there are any


class Events(NamedTuple):
    """What happened in a step."""

    score: Array  # (..., 2) error and effort test over the integral of y^2; falsified where >= 0, 0 while the gate is shut
    falsified: Flags  # (...,) the running controller failed a test that was due
    switched: Flags  # (...,) it was replaced
    from_grid: Flags  # (...,) by a point of the grid, since no intersection was fit


@dataclass(frozen=True, eq=False)
class UnfalsifiedController:
    """u = C_p (r - y) - C_d dy/dt with gains that switch when falsified (Tsao, Brozenec & Safonov, eq. 8-12).

    The seed leaves open when tests are made, how many past ones are kept and that sensor noise at rest, where r = 0, falsifies
    everything: here the tests begin when the integral of y^2 exceeds (gate quanta)^2 / lambda, are evaluated every 5 / lambda s, or at
    once when one exceeds 10 times the integral of y^2, and are archived every 1 / lambda s; a full archive loses every second test
    of its older half.

    Attributes:
      inertia: J^ believed, kg m2, a number or (axes,).
      pace: lambda, rad/s, the unit of every frequency of the design.
      tick_s: sampling time.
      quantum: step of the position sensor, rad.
      gate: quanta; 0 tests from the first sample on.
      zero: z / lambda of both weights.
      error_bound: M1.
      effort_limit: k2, N m/rad, a number or (axes,); None stands for J^ (zero lambda)^2.
      frequency: natural frequency of the first controller / lambda.
      damping: of the first controller, with inertia J^.
      capacity: tests archived.
      lower, upper: box of theta = (1/C_p, C_d/C_p) in rad/(N m) and s (the seed's constraints 1 and 2).
      frozen: keep the first controller; tests are made and reported all the same.
      integrals: C_I / C_p over lambda of candidates with integral action; empty: candidates are proportional and derivative alone.
    """

    inertia: float | Array
    pace: float
    tick_s: float
    quantum: float
    gate: float = 20.0
    zero: float = 0.3
    error_bound: float = 2.25
    effort_limit: float | Array | None = None
    frequency: float = 0.05
    damping: float = 1.0
    capacity: int = 40
    lower: tuple[float, float] = (5e-6, 0.0)
    upper: tuple[float, float] = (1e4, 1e4)
    search: CandidateSearch = field(default_factory=CandidateSearch)
    frozen: bool = False
    integrals: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not (np.all(np.asarray(self.inertia) > 0) and self.pace > 0 and self.tick_s > 0 and self.frequency > 0):
            raise ValueError("unfalsified control: inertia, pace, tick_s and frequency must be positive")
        if self.pace * self.tick_s > COARSEST:
            raise ValueError(f"unfalsified control: pace * tick_s = {self.pace * self.tick_s:g} is too coarse; need at most {COARSEST}")
        if self.capacity < 4 or self.gate < 0 or self.quantum < 0:
            raise ValueError("unfalsified control: need capacity >= 4, gate >= 0 and quantum >= 0")

    @cached_property
    def specification(self) -> Specification:
        """What a controller must do, without units."""
        limit = self.stiffness * self.zero**2 if self.effort_limit is None else np.asarray(self.effort_limit)
        return Specification(self.zero, self.error_bound, limit / self.stiffness, self.pace * self.tick_s)

    @cached_property
    def databank(self) -> IntegralDatabank | None:
        """Candidates with integral action, if there are any."""
        return IntegralDatabank(self.integrals, self.pace * self.tick_s) if self.integrals else None

    @property
    def stiffness(self) -> Array:
        """J^ lambda^2, the unit of torque a radian, N m/rad."""
        return np.asarray(self.inertia) * self.pace**2

    def start(self, shape: tuple[int, ...], origin: float | Array = 0.0) -> Memory:
        """At rest at `origin` rad under the first controller; trials and axes as `shape`, the last one matching `inertia`."""
        theta = np.array([self.frequency**-2.0, 2.0 * self.damping / self.frequency])
        return Memory(
            tick=0,
            theta=np.broadcast_to(theta, (*shape, 2)).copy(),
            origin=np.broadcast_to(np.asarray(origin, float), shape).copy(),
            evidence=self.specification.start(shape),
            archive=np.zeros((*shape, self.capacity, 2, 3, 3)),
            archived=np.zeros(shape, np.int64),
            databank=self.databank.start(self.specification, shape, self.capacity) if self.databank else None,
        )

    def gains(self, memory: Memory) -> tuple[Array, Array]:
        """C_p N m/rad and C_d N m s/rad, (...,)."""
        proportional = self.stiffness / memory.theta[..., 0]
        return proportional, proportional * memory.theta[..., 1] / self.pace

    def integral(self, memory: Memory) -> Array:
        """C_I / C_p of the running controllers, 1/s, (...,)."""
        if self.databank is None or memory.databank is None:
            return np.zeros(memory.archived.shape)
        return np.asarray(self.pace * self.databank.all_rates[memory.databank.chosen])

    def step(self, memory: Memory, reference: Array, position: Array, rate: Array) -> tuple[Array, Memory, Events]:
        """Torque (...,) N m, memory and events of one tick; reference and position rad, rate rad/s, all (...,) and finite."""
        proportional, derivative = self.gains(memory)
        error, bank, beside = reference - position, self.databank, memory.databank
        if bank is not None and beside is not None:
            beside = bank.advanced(beside, error)
            error = error + bank.action(beside)
        torque = proportional * error - derivative * rate
        heard = torque / self.stiffness, rate / self.pace, position - memory.origin
        evidence = self.specification.record(memory.evidence, *heard)
        tests = plain = self.specification.tests(evidence)
        every = plain[..., None, :, :, :]
        if bank is not None and beside is not None:
            beside = bank.record(beside, self.specification, *heard)
            every = bank.tests(beside, self.specification, plain)
            tests = bank.running(beside, every)
        spent = energy(tests)
        is_open = spent > (self.gate * self.quantum) ** 2
        score = values(tests, memory.theta) / np.where(is_open, spent, np.inf)[..., None]
        worst = np.max(score, axis=-1)
        due = self._every(5.0, memory.tick)
        falsified = is_open & (worst >= (0.0 if due else 10.0))
        theta, chosen, switched, from_grid = self._replace(memory, every, falsified)
        archive, archived = memory.archive, memory.archived
        keeps = self._every(1.0, memory.tick) and not self.frozen
        if bank is not None and beside is not None:
            beside = bank.taken_over(beside, theta, chosen, switched)
            if keeps:
                each, count = np.broadcast_to(archived[..., None], beside.archive.shape[:-4]), is_open[..., None]
                beside = beside._replace(archive=_keep(beside.archive, each, every[..., 1:, :, :, :], count)[0])
        if keeps:
            archive, archived = _keep(archive, archived, plain, is_open)
        after = Memory(memory.tick + 1, theta, memory.origin, evidence, archive, archived, beside)
        return torque, after, Events(score, falsified, switched, from_grid)

    def _every(self, interval: float, tick: int) -> bool:
        """Whether a tick ends an interval, given in units of 1 / lambda."""
        return (tick + 1) % max(1, round(interval / (self.pace * self.tick_s))) == 0

    def _replace(self, memory: Memory, every: Array, falsified: Flags) -> tuple[Array, NDArray[np.int64], Flags, Flags]:
        """New theta and integral action where falsified, by tests (..., 1 + rates, 2, 3, 3); a loop over events, which are few."""
        theta, switched, from_grid = memory.theta, np.zeros(falsified.shape, bool), np.zeros(falsified.shape, bool)
        chosen = np.zeros(falsified.shape, np.int64) if memory.databank is None else memory.databank.chosen
        if self.frozen or not falsified.any():
            return theta, chosen, switched, from_grid
        theta, chosen = theta.copy(), chosen.copy()
        unit = np.stack([self.stiffness, np.full_like(self.stiffness, self.pace)], axis=-1)
        unit = np.broadcast_to(unit, theta.shape)
        for where in map(tuple, np.argwhere(falsified)):
            archives = memory.archive[where][None]
            if memory.databank is not None:
                archives = np.concatenate([archives, memory.databank.archive[where]])
            box = self.lower * unit[where], self.upper * unit[where]
            choices = [
                self.search.nearest(theta[where], tests, past[: memory.archived[where]], *box)
                for tests, past in zip(every[where], archives, strict=True)
            ]
            rates = (0.0, *self.integrals)  # by Routh, J^ s^3 + C_d s^2 + C_p s + w C_p is stable for C_d / J^ > w
            choices = [c if c is not None and c.theta[1] > w * c.theta[0] else None for c, w in zip(choices, rates, strict=True)]
            best = _best(choices, theta[where], int(chosen[where]))
            if best is not None:
                choice, chosen[where] = best
                theta[where], switched[where], from_grid[where] = choice.theta, True, choice.from_grid
        return theta, chosen, switched, from_grid


def _best(choices: list[Choice | None], theta: Array, present: int) -> tuple[Choice, int] | None:
    """Of the choices by integral action the one nearest to theta (2,), and which it is: none of the grid if another is there.

    Among equals the present integral action stays, then the least.
    """
    ranked = [
        (choice.from_grid, float(np.sum((choice.theta / theta - 1.0) ** 2)), i != present, i, choice)
        for i, choice in enumerate(choices)
        if choice is not None
    ]
    if not ranked:
        return None
    *_, index, choice = min(ranked, key=lambda one: one[:-1])
    return choice, index


def _keep(archive: Array, archived: NDArray[np.int64], tests: Array, wanted: Flags) -> tuple[Array, NDArray[np.int64]]:
    """Archive with `tests` (..., 2, 3, 3) added where wanted; where it was full, thinned before."""
    capacity = archive.shape[-4]
    half = capacity // 2
    thin = np.concatenate([np.arange(0, half, 2), np.arange(half, capacity)])
    full = wanted & (archived == capacity)
    if full.any():
        thinned = np.concatenate([archive[..., thin, :, :, :], archive[..., len(thin) :, :, :, :]], axis=-4)
        archive = np.where(full[..., None, None, None, None], thinned, archive)
        archived = np.where(full, len(thin), archived)
    slot = wanted[..., None] & (np.arange(capacity) == archived[..., None])
    return np.where(slot[..., None, None, None], tests[..., None, :, :, :], archive), archived + wanted
