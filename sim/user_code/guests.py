"""A researcher's own filters and controllers, named on the command line and flown beside the built-in ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from control.tracking import Controller, Estimate, Target
from estimation.gaussian import Belief, Detection
from estimation.state_space import Additive, Multiplicative, StateSpace
from models.attitude import quaternion
from models.dynamics.process import ProcessModel
from sim.bad_input import BadInput
from sim.estimators.filter_banks import Bank, Models
from sim.faults.kinds import DropOut
from sim.scenario.named_sections import RESERVED
from sim.sensors.sensors import SensorSettings
from sim.user_code.guest_file import UserClass

Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Setting:
    """What a user's class is constructed with, as its one argument.

    Attributes:
      process: analytic model of the plant as the paper writes it (`derivative`, `linearize`; see models/dynamics/process.py).
      process_with_drag: the same with the wheels' friction.
      variances: of a reading: small rotation about an axis (rad2), rate (rad2/s2), wheel speed (rad2/s2).
      wheels: number of wheels.
    """

    process: ProcessModel
    process_with_drag: ProcessModel
    variances: tuple[float, float, float]
    wheels: int

    @property
    def measurement_noise(self) -> Array:
        """R with the attitude as a rotation vector, (6 + wheels, 6 + wheels)."""
        return np.diag(np.repeat(self.variances, [3, 3, self.wheels]))


@dataclass(frozen=True)
class Guests:
    """What the user named, as FILE.py:CLASS; loaded anew in every process.

    Attributes:
      observers: filters that join the scenario's.
      controller: a control law in place of the scenario's.
    """

    observers: tuple[str, ...] = ()
    controller: str | None = None

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the filters; raises BadInput if a file cannot be loaded."""
        return tuple(UserClass(text, "--observer", ("initial", "step")).name for text in self.observers)

    @cached_property
    def law(self) -> str | None:
        """Name of the control law; raises BadInput if its file cannot be loaded."""
        return UserClass(self.controller, "--controller", ("step",)).name if self.controller else None

    @property
    def described(self) -> dict[str, Any]:
        """What a run's files say of them; nothing if there are none."""
        files = {**dict(zip(self.names, self.observers, strict=True)), **({self.law: self.controller} if self.law else {})}
        return {"guests": files} if files else {}

    def check(self, scenario: Any) -> None:
        """Rehearse on a small batch, with missing readings if the scenario has any; raises BadInput."""
        if not self.observers and not self.controller:
            return
        taken = [*scenario.observers, *RESERVED]
        for text, name in zip(self.observers, self.names, strict=True):
            if name in taken or "/" in name:
                raise BadInput(f"--observer {text}: {name!r} cannot be its name (taken or reserved); give the class another `name = '...'`")
            taken.append(name)
        parts = (
            Models.of(scenario.plant),
            scenario.sensors,
            scenario.plant.wheel_axes.shape[1],
        )
        gaps = scenario.sensors.dropout_probability > 0 or any(isinstance(fault, DropOut) for fault in scenario.faults)
        for bank in self.banks(*parts):
            assert isinstance(bank.filter, UserFilter)
            bank.filter.rehearse(gaps)
        law = self.control(*parts)
        if law is not None:
            law.rehearse()

    def banks(self, models: Models, sensors: SensorSettings, wheels: int) -> tuple[Bank, ...]:
        """The user's filters, one bank each."""
        setting = Setting(models.plain, models.with_drag, sensors.variances, wheels)
        return tuple(_bank(UserClass(text, "--observer", ("initial", "step")), setting) for text in self.observers)

    def control(self, models: Models, sensors: SensorSettings, wheels: int) -> UserLaw | None:
        """The user's control law, if there is one."""
        if self.controller is None:
            return None
        setting = Setting(models.plain, models.with_drag, sensors.variances, wheels)
        source = UserClass(self.controller, "--controller", ("step",))
        return UserLaw(source, source.construct(setting), setting)


class UserBelief(Belief):
    """A user's belief in the project's form, the original beside it."""

    own: Any
    tick: int


@dataclass(frozen=True, eq=False)
class UserFilter:
    """A user's filter as the loop sees it: beliefs are (1, trials, ...), what it does not say is NaN."""

    source: UserClass
    own: Any
    setting: Setting
    space: StateSpace

    def initial(self, measurement: Array) -> UserBelief:
        """Belief after the first reading, (trials, n)."""
        with self.source.blamed("initial"):
            own = self.own.initial(measurement.copy())
        return self._adapt(own, measurement, "initial", 0)

    def step(self, belief: Belief, command: Array, measurement: Array, dt: float) -> UserBelief:
        """Belief after `dt` seconds of `command`, (trials, wheels), and a reading, (trials, n)."""
        assert isinstance(belief, UserBelief)
        with self.source.blamed("step", f" (at tick {belief.tick + 1})"):
            own = self.own.step(belief.own, command.copy(), measurement.copy(), dt)
        return self._adapt(own, measurement, "step", belief.tick + 1)

    def rehearse(self, gaps: bool) -> None:
        """Fly a few ticks of three trials, also apart from each other, and with missing readings if there are to be `gaps`."""
        _same_in_any_company(self.source, lambda which: self._fly(which, gaps))

    def _fly(self, which: slice, gaps: bool) -> Array:
        fresh = UserFilter(self.source, self.source.construct(self.setting), self.setting, self.space)
        reading, command = _readings(self.setting.wheels)[which], np.full((3, self.setting.wheels), 1e-3)[which]
        belief = fresh.initial(reading)
        for lost in (slice(0), slice(0, 4), slice(4, 7), slice(7, None), slice(None)) if gaps else (slice(0), slice(0)):
            seen = reading.copy()
            seen[:, lost] = np.nan
            belief = fresh.step(belief, command, seen, 0.1)
        if gaps:
            fresh.initial(seen)
        return belief.mean[0]

    def _adapt(self, own: Any, measurement: Array, method: str, tick: int) -> UserBelief:
        trials, n = measurement.shape
        mean = self._part(own, "mean", measurement.shape, method, None)
        if not np.isfinite(mean).all():
            which = int(np.flatnonzero(~np.isfinite(mean).all(axis=-1))[0])
            raise self.source.complaint(method, f"mean is not finite at tick {tick} (row {which} of {trials}); a missing reading is NaN")
        e = n if isinstance(self.space, Additive) else n - 1
        read = np.sum(~np.isnan(measurement), axis=-1, dtype=float)
        statistic, declared = self._part(own, "statistic", (trials,), method), self._part(own, "declared", (trials,), method, 0.0)
        belief = UserBelief(
            mean=mean[None],
            covariance=self._part(own, "covariance", (trials, e, e), method)[None],
            innovation=self._part(own, "innovation", (trials, e), method)[None],
            nis=self._part(own, "nis", (trials,), method)[None],
            log_likelihood=np.full((1, trials), np.nan),
            dof=self._part(own, "dof", (trials,), method, read)[None],
            detection=Detection(statistic[None], declared[None] > 0.0, ()),
        )
        belief.own, belief.tick = own, tick
        return belief

    def _part(self, own: Any, name: str, shape: tuple[int, ...], method: str, default: Any = np.nan) -> Array:
        """One array of a belief; all but the mean may be left out, and broadcast."""
        value = getattr(own, name, None)
        if value is None:
            if default is None:
                raise self.source.complaint(method, f"returned {type(own).__name__} without `{name}`")
            value = default
        try:
            array = np.array(value, dtype=float)
            array = array if name == "mean" else np.array(np.broadcast_to(array, shape))
        except (TypeError, ValueError):
            array = np.zeros(0)
        if array.shape != shape:
            raise self.source.complaint(method, f"{name} has shape {np.shape(value)}, needs {shape} of numbers")
        return array


@dataclass(frozen=True, eq=False)
class UserLaw:
    """A user's control law as the loop sees it."""

    source: UserClass
    own: Controller
    setting: Setting

    def step(self, estimate: Estimate, target: Target) -> Array:
        """Torque on the body, (trials, 3) N m in B."""
        with self.source.blamed("step"):
            torque = np.array(self.own.step(estimate, target), dtype=float)
        if torque.shape != estimate.omega_BN_B.shape:
            raise self.source.complaint("step", f"torque has shape {torque.shape}, needs {estimate.omega_BN_B.shape}")
        if not np.isfinite(torque).all():
            raise self.source.complaint("step", f"torque is not finite: {torque[~np.isfinite(torque).all(axis=-1)][0]} N m")
        return torque

    def rehearse(self) -> None:
        """Ask for the torque of three trials, also apart from each other."""
        x, target = _readings(self.setting.wheels), Target(quaternion.IDENTITY, np.full(3, 1e-3), np.full(3, 1e-4))

        def fly(which: slice) -> Array:
            fresh = UserLaw(self.source, self.source.construct(self.setting), self.setting)
            return fresh.step(Estimate(x[which, :4], x[which, 4:7], x[which, 7:]), target)

        _same_in_any_company(self.source, fly)


def _bank(source: UserClass, setting: Setting) -> Bank:
    """A user's filter, its first belief telling in which coordinates its covariance is and whether it declares faults."""
    own, reading = source.construct(setting), _readings(setting.wheels)
    with source.blamed("initial"):
        first: Any = source.construct(setting).initial(reading.copy())
    covariance: Any = getattr(first, "covariance", None)
    space = Additive() if np.shape(covariance)[-1:] == reading.shape[-1:] else Multiplicative()
    limits = None
    if getattr(first, "declared", None) is not None:
        with source.blamed("", " (thresholds must be two numbers: on, off)"):
            on, off = map(float, getattr(own, "thresholds", (np.nan, np.nan)))
        limits = (on, off)
    return Bank((source.name,), UserFilter(source, own, setting, space), (limits,))


def _readings(wheels: int) -> Array:
    """Three readings that differ, (3, 7 + wheels)."""
    turn = np.array([[0.01, -0.02, 0.03], [0.1, 0.2, -0.1], [-0.3, 0.1, 0.2]])
    return np.concatenate([quaternion.from_rotation_vector(turn), 0.1 * turn[:, ::-1], 5.0 * (turn @ np.ones((3, wheels)))], axis=-1)


def _same_in_any_company(source: UserClass, fly: Callable[[slice], Array]) -> None:
    """Complain if a trial comes out differently alone than among others; what draws random numbers is not judged."""
    together, again, alone = fly(slice(None)), fly(slice(None)), fly(slice(1, 2))
    if np.array_equal(together, again) and not np.allclose(together[1:2], alone, rtol=1e-6, atol=1e-12):
        raise source.complaint("step", "a trial comes out differently among others than alone; the first axis is trials, work on the last")
