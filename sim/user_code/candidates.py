"""A user's own candidate controller: not flown, but asked what reference a recorded torque and motion would have been its answer to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.user_code.user_class import UserClass

Array = NDArray[np.floating]

METHODS = ("reference",)
_TICKS, _TRIALS = 40, 3  # of the made-up record
_SAME = 1e-6  # share of its size by which what ought to be equal may differ


class AxisSetting(NamedTuple):
    """What a user's candidate is constructed with, as its one argument.

    Attributes:
      tick_s: sampling time, s.
      axis: 0, 1 or 2, of the body.
      inertia: of the body about that axis, kg m2.
    """

    tick_s: float
    axis: int
    inertia: float


@dataclass(frozen=True, eq=False)
class UserCandidate:
    """A class with `reference(torque, angle, rate)`, a causal left inverse of its law.

    All three are (ticks, trials): N m on the body, rad and rad/s, the angle counted from where the record begins; so is what it returns,
    the reference in rad under which its law gives that torque. If the class has `torque(reference, angle, rate)` too, the one must undo
    the other.
    """

    source: UserClass

    def reference(self, setting: AxisSetting, torque: Array, angle: Array, rate: Array) -> Array:
        """Its fictitious reference, (ticks, trials) rad, after a rehearsal; raises BadInput with the line of the file that is to blame."""
        self._rehearse(setting)
        return self._asked(setting, torque, angle, rate)

    def _asked(self, setting: AxisSetting, torque: Array, angle: Array, rate: Array) -> Array:
        own = self.source.construct(setting)
        return self._answer(own.reference, "reference", torque, angle, rate)

    def _answer(self, method: Any, name: str, *told: Array) -> Array:
        with self.source.blamed(name):
            found = np.array(method(*(part.copy() for part in told)), dtype=float)
        if found.shape != told[0].shape:
            raise self.source.complaint(name, f"gives shape {found.shape}, needs (ticks, trials) = {told[0].shape}")
        if not np.isfinite(found).all():
            raise self.source.complaint(name, f"is not finite at tick {int(np.argwhere(~np.isfinite(found))[0, 0])}")
        return found

    def _rehearse(self, setting: AxisSetting) -> None:
        """Complain if it looks ahead, mixes trials, or does not undo its own law."""
        time = setting.tick_s * np.arange(_TICKS)[:, None]
        phase = np.arange(_TRIALS)
        angle = 0.1 * np.sin(3.0 * time / time[-1] + phase) - 0.1 * np.sin(phase)
        rate = 0.3 / time[-1] * np.cos(3.0 * time / time[-1] + phase)
        torque = 0.01 * setting.inertia * np.cos(11.0 * time / time[-1] + phase)
        record = torque, angle, rate
        whole, half = self._asked(setting, *record), slice(_TICKS // 2)
        size = _SAME * float(np.max(np.abs(whole), initial=1e-12))
        if np.max(np.abs(self._asked(setting, *(part[half] for part in record)) - whole[half])) > size:
            raise self.source.complaint("reference", "looks ahead: its first half changes with what comes later; it must be causal")
        if np.max(np.abs(self._asked(setting, *(part[:, 1:2] for part in record)) - whole[:, 1:2])) > size:
            raise self.source.complaint("reference", "a trial comes out differently among others than alone; the last axis is trials")
        own = self.source.construct(setting)
        if callable(law := getattr(own, "torque", None)):
            again = self._answer(law, "torque", whole, angle, rate)
            off = float(np.max(np.abs(again - torque)))
            if off > _SAME * float(np.max(np.abs(torque))):
                raise self.source.complaint(
                    "reference", f"is not the inverse of torque: the law gives a torque that is off by {off:.2g} N m under it"
                )
