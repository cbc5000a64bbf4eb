"""The parts of a closed loop: what each is asked for at a tick, and what it answers.

Arrays have axes (trials, ...) for one body and (trials, agents, ...) for several; no part of the loop looks behind the trials.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from estimation.gaussian import Belief, LostDefiniteness
from estimation.state_space import StateSpace
from models.plants.assembly import Assembly

Array = NDArray[np.floating]
AnyArray = NDArray[np.floating] | NDArray[np.bool_]
Flags = NDArray[np.bool_]
Thresholds = tuple[float, float] | None


class Truth(Protocol):
    """What is so, at one instant."""

    @property
    def state(self) -> Array:
        """State of the analytic models, (trials, [agents,] n)."""
        ...


class Plant(Protocol):
    """The truth: many trials stepped as one."""

    assembly: Assembly
    trials: int
    step_s: float

    def truth(self) -> Truth:
        """The present state."""
        ...

    def advance(self, wheel_torque: Array, push: Any, steps: int) -> None:
        """Advance by whole physics steps; raises SimulationFailed, after which the trials that did not fail are advanced."""
        ...

    def put_back(self, where: Flags) -> None:
        """Put some trials, (trials,), back to their start, where they do no harm."""
        ...


class Sensors(Protocol):
    """What is read of the truth; NaN where nothing is."""

    def rest(self) -> Array:
        """What counts as read until something has been read, (trials, [agents,] m)."""
        ...

    def read(self, tick: int, truth: Any, past: Array) -> Array:
        """Reading at a tick, (trials, [agents,] m); `past` holds the true states of ticks 0 to `tick`, (ticks, trials, ...)."""
        ...


class Estimator(Protocol):
    """One filter, or several stepped as one; what it remembers is handed in and out."""

    @property
    def names(self) -> tuple[str, ...]:
        """One a member."""
        ...

    @property
    def thresholds(self) -> tuple[Thresholds, ...]:
        """On, off of each member's fault detector."""
        ...

    @property
    def space(self) -> StateSpace:
        """Error coordinates of its covariance."""
        ...

    def initial(self, reading: Array) -> Any:
        """Belief after the first reading."""
        ...

    def step(self, belief: Any, known: Any, reading: Array, dt: float) -> Any:
        """Belief after `dt` seconds of what is `known` of the inputs, and a reading; raises LostDefiniteness."""
        ...

    def summary(self, belief: Any) -> Belief:
        """Its moments and statistics, (members, trials, [agents,] ...)."""
        ...

    def put_back(self, where: Flags, first: Any, belief: Any) -> Any:
        """The belief with the `first` one in some trials, (trials,)."""
        ...

    def rewind(self) -> None:
        """Take the last step's random numbers again at the next one."""
        ...

    def blame(self, failure: LostDefiniteness) -> tuple[int, str]:
        """Which trial, by position, a step broke down in, and what broke down."""
        ...


class Feedback(Protocol):
    """Who tells the control law the state."""

    def __call__(self, tick: int, beliefs: tuple[Any, ...], truth: Any, reading: Array, held: Array) -> Any:
        """What the law acts on; `held` is the last reading without its gaps."""
        ...


class Network(Protocol):
    """What each agent hears of the others."""

    def carry(self, tick: int, sent: Array | None) -> Any:
        """Messages that are there at a tick."""
        ...


class Decision(NamedTuple):
    """What a law decides at a tick."""

    effort: Array  # (trials, [agents,] axes) N m or N on each body
    memory: Any  # of the law, after it
    notes: dict[str, Any]  # what is worth recording besides


class Law(Protocol):
    """A control law, of one body or of each of several agents."""

    def start(self, estimate: Any) -> Any:
        """Memory before the first tick, whose estimate it is."""
        ...

    def says(self, tick: int, estimate: Any, memory: Any) -> Array | None:
        """What leader and agents send to their neighbours, (trials, 1 + agents, n); None: nothing."""
        ...

    def decide(self, tick: int, estimate: Any, messages: Any, memory: Any) -> Decision:
        """What is to act on the bodies."""
        ...


class ActuatorOutput(NamedTuple):
    """What allocation, drives and their faults make of a decision."""

    wheel: Array  # torques of motors on wheels, (trials, wheels) N m
    push: Any  # on bodies from outside, (trials, [agents,] 3) N m; or a force of motion and time
    known: Any  # what filters are told of it
    memory: Any  # of the allocation
    notes: dict[str, Any]  # what is worth recording besides


class Effectors(Protocol):
    """What stands between a law and the bodies."""

    def rest(self) -> ActuatorOutput:
        """Nothing given yet."""
        ...

    def give(self, tick: int, decision: Decision, estimate: Any, held: Array, before: ActuatorOutput, lost: Flags) -> ActuatorOutput:
        """Carry out a decision; `before` is what was given the tick before, `lost` are trials (trials,) that are given up."""
        ...


class Loss(Protocol):
    """Which trials are given up."""

    def judge(self, lost: Flags, truth: Any) -> Flags:
        """Trials that are lost, (trials,), of those that were `lost` before and the truth."""
        ...


class Snapshot(NamedTuple):
    """All of a tick."""

    truth: Any
    reading: Array
    beliefs: tuple[Any, ...]
    estimate: Any
    messages: Any
    memory: Any  # of the law, before the decision
    decision: Decision
    given: ActuatorOutput
    lost: Flags  # (trials,) given up: nothing of them counts but the truth
    failed: Flags  # (trials,) broken down: not even the truth counts


Kept = Callable[[int, Snapshot], dict[str, AnyArray]]


class Silence:
    """No network: one body, or agents that see each other."""

    def carry(self, tick: int, sent: Array | None) -> None:  # noqa: ARG002
        """Nothing is heard."""
        return
