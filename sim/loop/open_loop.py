"""The loop of one body with nobody to close it: plant, drives, faults and sensors, acted upon from outside and set back at will."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from control.allocation import Allocation, DirectTorque, PseudoInverseAllocation
from control.tracking import Estimate, Target
from models.dynamics.state_layout import ATTITUDE, RATE, WHEELS
from sim.bad_input import BadInput
from sim.faults.effects import AGE, FRICTION, LOCKED
from sim.loop.body import build_body
from sim.loop.body_parts import MASSES, BodyChange, BodyEffectors
from sim.loop.variants import Variants
from sim.parts import Array, Decision, Flags
from sim.plant.batch import Plant, SimulationFailed, Truth
from sim.randomness import Trials
from sim.scenario.files import AnyScenario
from sim.scenario.one_body import Scenario
from sim.sensors.sensors import Sensors


class Instant(NamedTuple):
    """All of an open loop at a tick that its scenario and trials do not settle."""

    tick: int
    physics: Array  # (trials, n) MuJoCo's state
    held: Array  # (trials, m) last reading without its gaps, before this tick's
    failed: Flags  # (trials,)
    past: Array  # (ticks, trials, n) true states of the ticks before; of no tick where no reading is late


class OpenLoop:
    """Trials of a scenario of one body without filters, law and recorder: truth and reading at a tick, then torques for a period.

    It has the numbers of a `Flight` of the same scenario, to the bit, where that shares torques among the wheels by the pseudo-inverse.

    Attributes:
      scenario: the one loop of it, without observers.
      ticks: of it.
      dt: control period, s.
      plant: the truth.
      wheels: how many it has.
      target: what the scenario's reference asks for at every tick and at the end of the last, (ticks + 1, ...).
      tick: number of this one.
      truth: what is so.
      reading: what is read, (trials, m), NaN where nothing is, and everywhere after the last tick.
      held: the same with the last reading in place of gaps.
      failed: trials in which the physics broke down, (trials,); they rest at their start.

    Args:
      scenario: of one body.
      trials: numbers of the trials, (trials,).
      loop: which of several closed loops, since one may be spared the faults; default: the first.
      variants: plant, sensors, faults and start of each trial where they differ.

    Raises:
      BadInput: several agents.
    """

    plant: Plant
    tick: int
    truth: Truth
    reading: Array
    held: Array
    failed: Flags

    def __init__(self, scenario: AnyScenario, trials: Trials, loop: str | None = None, variants: Variants | None = None) -> None:
        self.scenario, self._trials = single_body(scenario, loop), trials
        self._variants = variants.of_loop(self.scenario) if variants else None
        self.ticks, self.dt = self.scenario.run.ticks, self.scenario.run.tick_s
        self.target: Target = self.scenario.reference.at(self.dt * np.arange(self.ticks + 1))
        self._build()
        faults = self._change.faults
        self._changes = [tick for tick in range(self.ticks) if faults.changes_at(tick, LOCKED, FRICTION, *MASSES)]
        late = self._sensors.noise.age is not None or AGE in faults.tracks
        self._past: Array = np.full((self.ticks if late else 0, *self.truth.state.shape), np.nan)
        self._sense(self._sensors.rest())

    def act(self, torque_B: ArrayLike = 0.0, wheel: ArrayLike = 0.0) -> None:
        """Act for one control period, and sense the next tick.

        Args:
          torque_B: on the body, shared among the wheels, N m; must broadcast to (trials, 3).
          wheel: besides, of each motor on its wheel, N m; must broadcast to (trials, wheels), and be zero where there is none.

        Raises:
          IndexError: the last tick is over.
        """
        if self.over:
            raise IndexError(f"the flight of {self.ticks} ticks is over; run.ticks = N lasts longer")
        estimate = self.estimate
        asked = np.broadcast_to(np.asarray(torque_B, dtype=float), (len(self._trials), 3))
        shared, _ = self._allocation.step(asked, estimate, self._rest.memory)
        decision = Decision(shared + np.asarray(wheel, dtype=float), None, {})
        given = self._effectors.give(self.tick, decision, estimate, self.held, self._rest, self.failed)
        self._change(self.tick)
        motors, push = given.wheel, given.push
        if self.failed.any():
            motors, push = (np.where(self.failed[:, None], 0.0, one) for one in (motors, push))
            self.plant.put_back(self.failed)
        try:
            self.plant.advance(motors, push, self._steps)
        except SimulationFailed as broken:
            self.failed = self.failed | np.isin(np.arange(len(self._trials)), list(broken.causes))
            self.plant.put_back(self.failed)
        self.tick += 1
        self._sense(self.held)

    def restart(self, where: Flags) -> None:
        """Put some trials, (trials,), back to their start at this tick: noise, faults and reference go on as they are."""
        self.plant.put_back(where)
        self.failed = self.failed & ~where
        self._sense(np.where(where[:, None], self._sensors.rest(), self._before))

    @property
    def estimate(self) -> Estimate:
        """What a law can act on that has no filter: the last readings."""
        return Estimate(self.held[:, ATTITUDE], self.held[:, RATE], self.held[:, WHEELS])

    @property
    def asked(self) -> Target:
        """What the reference asks for at this tick."""
        return Target(*(part[self.tick] for part in self.target))

    @property
    def over(self) -> bool:
        """Whether the last tick has been acted upon."""
        return self.tick >= self.ticks

    @property
    def instant(self) -> Instant:
        """All that is needed to be here again; copies."""
        return Instant(self.tick, self.plant.physics, self._before.copy(), self.failed.copy(), self._past[: self.tick].copy())

    @instant.setter
    def instant(self, instant: Instant) -> None:
        done, due = ([change for change in self._changes if change < tick] for tick in (self.tick, instant.tick))
        if done != due:
            self._build()  # what faults have made of the plant is made anew
            for change in due:
                self._change(change)
        self.plant.physics = instant.physics
        self.tick, self.failed = instant.tick, instant.failed.copy()
        self._past[: self.tick] = instant.past
        self._sense(instant.held)

    def _build(self) -> None:
        """All parts as at the start."""
        system = build_body(self.scenario, self._trials, variants=self._variants)
        self.plant, self._sensors = cast(Plant, system.plant), cast(Sensors, system.sensors)
        self._change, effectors = cast(BodyChange, system.change), cast(BodyEffectors, system.effectors)
        assembly, shares = self.plant.assembly, effectors.wheels > 0
        self._allocation: Allocation = (
            PseudoInverseAllocation(assembly.wheel_axes, assembly.wheel_torque_limit) if shares else DirectTorque()
        )
        self.wheels = effectors.wheels
        self._effectors = replace(effectors, allocation=DirectTorque())  # what is to be given is shared before
        self._rest = self._effectors.rest()
        self._steps = round(self.dt / self.plant.step_s)
        self.tick, self.failed = 0, np.zeros(len(self._trials), dtype=bool)
        self.truth = self.plant.truth()

    def _sense(self, before: Array) -> None:
        """Truth and reading of this tick; `before` is what was held until now."""
        self.truth, self._before = self.plant.truth(), before
        if self.over:
            self.reading = np.full(before.shape, np.nan)
        else:
            if len(self._past):
                self._past[self.tick] = self.truth.state
            self.reading = self._sensors.read(self.tick, self.truth, self._past)
        self.held = np.where(np.isnan(self.reading), before, self.reading)


def single_body(scenario: Any, loop: str | None = None) -> Scenario:
    """A loop of a scenario of one body as a scenario of its own, without observers; default: the first.

    Raises:
      BadInput: several agents, or no such loop.
    """
    if scenario.family != Scenario.family:
        raise BadInput("this scenario has several agents; one of a single body is needed, such as nacs/fault-free")
    singles: dict[str, Scenario] = scenario.singles()
    name = loop or scenario.loop_names[0]
    if name not in singles:
        raise BadInput(f"loop {name!r}: no such loop; there are {', '.join(singles)}")
    return singles[name].model_copy(update={"observers": {}})
