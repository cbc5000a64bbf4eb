"""The twin as a plant that is stepped from outside: a controller of your own, in a notebook or another program, closes the loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nacs.errors import in_one_line
from nacs.nacs_error import NacsError
from nacs.scenarios import Source, named, user_code_of
from sim.campaign import cost
from sim.cli.in_words import in_words
from sim.loop.build import build
from sim.loop.closed_loop import Flight, Sensed
from sim.loop.recording import Recording
from sim.replay.log_columns import columns_of
from sim.scenario.named_sections import names_taken
from sim.scenario.surroundings import surroundings
from sim.user_code.laws import copied
from sim.user_code.real_numbers import real_numbers

if TYPE_CHECKING:
    import xarray

Array = NDArray[np.floating]


class Twin:
    """Many trials of a scenario at once, advanced a control tick at a time by whoever calls `step`.

    It is the loop that `nacs.run` lets run: the same plant, sensors, faults and random numbers. The scenario's own filters and law run
    along, so `estimate` and `torque` say what they make of it, and `step()` without a torque does as they say.

    >>> twin = nacs.Twin("nacs/fault-free", trials=64, seed=7)
    >>> for _ in range(20):
    ...     reading = twin.read()
    ...     twin.step(-0.05 * reading[:, :3] - 0.2 * reading[:, 4:7])
    >>> twin.truth.shape
    (64, 11)

    Args:
      scenario: as for `nacs.run`.
      trials: number of trials; default: the scenario's.
      seed: root seed; default: the scenario's.
      set: dotted keys to values, taken instead of what the scenario says.
      loop: which of several closed loops; default: the first.
      observers: filters of your own beside the scenario's.
      controller: a law of your own in place of the scenario's, for `torque` and `step()`.

    Raises:
      NacsError: bad input.
    """

    def __init__(
        self,
        scenario: Source = "nacs/fault-free",
        *,
        trials: int | None = None,
        seed: int | None = None,
        set: Mapping[str, Any] | None = None,  # as the command calls it
        loop: str | None = None,
        observers: Sequence[Any] = (),
        controller: Any = None,
    ) -> None:
        self._asked = scenario, set, trials
        self._user_code = user_code_of(observers, controller)
        self.name, self.scenario = named(scenario, set, trials, seed, self._user_code)
        self.loop = self.scenario.loop_names[0] if loop is None else loop
        if not isinstance(self.loop, str) or self.loop not in self.scenario.loop_names:
            raise NacsError(f"loop {loop!r}: no such loop; there are {', '.join(self.scenario.loop_names)}")
        with in_one_line():
            cost.check(self.scenario, self.scenario.run.trials)
            self._user_code.check(surroundings(self.scenario), names_taken(self.scenario))
            self.reading_names: tuple[str, ...] = tuple(columns_of(self.scenario).reading)
        self.reset()

    def reset(self, *, seed: int | None = None) -> Array:
        """Begin anew, and return the first reading.

        Args:
          seed: root seed from now on; default: as before, so that the same happens again.
        """
        if seed is not None:
            scenario, changes, trials = self._asked
            self.name, self.scenario = named(scenario, changes, trials, seed, self._user_code)
        with in_one_line():
            numbers = np.arange(self.scenario.run.trials)
            self._broken: str | None = None
            self._flight = Flight(build(self.scenario, numbers, self._user_code, loop=self.loop))
            self._now: Sensed | None = next(self._flight)
        return self.read()

    def read(self) -> Array:
        """What the sensors read at this tick, (trials, [agents,] components), NaN where nothing is read; `reading_names` names them."""
        return self._sensed.reading.copy()

    def step(self, torque: ArrayLike | None = None) -> Array:
        """Act for one control period, and return the next reading.

        Args:
          torque: on the body, in B, (trials, [agents,] 3) N m, or what broadcasts to it; of agents that move in a plane a force,
            (trials, agents, 2) N. Wheels, their limits and faults make of it what they can. None: what the scenario's law asks.

        Raises:
          NacsError: the last tick is over, the shape does not fit, a number is not finite, or every trial broke down.
        """
        if self._broken is not None:
            raise NacsError(f"an earlier step failed: {self._broken}; reset() begins anew", 3)
        now = self._sensed
        effort = None if torque is None else self._effort(torque, now.decision.effort.shape)
        self._broken = "it was interrupted"
        with in_one_line():
            try:
                self._now = self._flight.send(effort)
            except StopIteration:
                self._now = None
            except Exception as wrong:  # whatever it is, it is told in a line; the flight cannot go on
                self._broken = in_words(wrong)[1]
                raise
        self._broken = None
        if self._now is not None:
            return self.read()
        if self._flight.lost.failed.all():
            raise NacsError(f"every trial broke down; the first: {self._flight.lost.all[0]}", 3)
        return np.full(now.reading.shape, np.nan)

    @property
    def over(self) -> bool:
        """Whether the last tick has been acted upon."""
        return self._now is None

    @property
    def tick(self) -> int:
        """Number of this tick."""
        return self._sensed.tick

    @property
    def time(self) -> float:
        """Seconds since the start."""
        return self.tick * self.dt

    @property
    def dt(self) -> float:
        """Control period, s."""
        return self.scenario.run.tick_s

    @property
    def truth(self) -> Array:
        """True state, (trials, [agents,] n): of one body q_BN (scalar last), omega_BN_B rad/s and wheel speeds rad/s."""
        state: Array = self._sensed.truth.state.copy()
        return state

    @property
    def estimate(self) -> Any:
        """What the scenario's law acts on: of one body `.q_BN`, `.omega_BN_B`, `.omega_wheel`; of agents `.own`."""
        return copied(self._sensed.estimate)

    @property
    def torque(self) -> Array:
        """What the scenario's law asks for at this tick, (trials, [agents,] axes) N m or N."""
        return self._sensed.decision.effort.copy()

    @property
    def reference(self) -> dict[str, Array]:
        """What is to be followed at this tick, by name; empty if nothing is."""
        return {name: of[self.tick].copy() for name, of in self._flight.system.references.items()}

    @property
    def lost(self) -> NDArray[np.bool_]:
        """Trials that broke down, (trials,)."""
        return self._flight.lost.failed.copy()

    @property
    def recording(self) -> Recording:
        """What was recorded until now."""
        return self._flight.recording()

    @property
    def signals(self) -> xarray.Dataset:
        """What was recorded until now, as `Run.signals` has it; needs the extra `data`."""
        from sim.series.signals.dataset import dataset
        from sim.series.signals.of_recordings import signals_of

        with in_one_line():
            found: xarray.Dataset = dataset(signals_of(self.scenario, {self.loop: self.recording}).loops[self.loop])
            return found

    @property
    def _sensed(self) -> Sensed:
        if self._now is None:
            ticks = self.scenario.run.ticks
            raise NacsError(f"the flight of {ticks} ticks is over; reset() begins anew, set={{'run.ticks': N}} lasts longer")
        return self._now

    @staticmethod
    def _effort(torque: ArrayLike, shape: tuple[int, ...]) -> Array:
        try:
            effort = np.broadcast_to(real_numbers(torque), shape)
        except TypeError as wrong:
            raise NacsError(f"torque of shape {shape}: {wrong}") from None
        except ValueError:
            raise NacsError(f"torque: does not fit the shape {shape}") from None
        if not np.isfinite(effort).all():
            where = tuple(int(i) for i in np.argwhere(~np.isfinite(effort))[0])
            raise NacsError(f"torque is not finite: {effort[where]} at {where} of {shape}")
        return effort.copy()

    def __repr__(self) -> str:
        at = "over" if self.over else f"at {self.time:g} s"
        return f"<Twin of {self.name}: {self.scenario.run.trials} trials, loop {self.loop}, {at}>"
