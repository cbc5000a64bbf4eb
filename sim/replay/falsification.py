"""Which candidate controllers a flight log falsifies: the theorem of Tsao, Brozenec & Safonov (sec. 2) for data of another controller."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from control.falsification import Specification
from control.integral_control import IntegralControl
from control.unfalsified import COARSEST
from control.verdict import NEVER, Verdict, judge
from models.plants.assembly import Assembly
from sim.bad_input import BadInput
from sim.controllers.settings import UnfalsifiedSettings
from sim.replay.axis_record import AxisRecord, axis_records
from sim.replay.candidates import Candidates, Gain, SpecificationSettings
from sim.replay.flight_log import FlightLog
from sim.scenario.one_body import Scenario
from sim.sensors.sensors import SensorSettings
from sim.user_code.candidates import AxisSetting, UserCandidate
from sim.user_code.user_class import UserClass

Array = NDArray[np.floating]

TESTS = ("error", "effort")


class Asked(NamedTuple):
    """What is asked of the controllers of an axis, nothing left out."""

    pace: float  # lambda, rad/s
    zero: float  # z / lambda
    error_bound: float  # M1
    effort_limit: float  # k2, N m/rad
    quantum: float  # rad
    gate: float  # quanta

    @classmethod
    def of(cls, settings: SpecificationSettings, law: Any, sensors: SensorSettings, inertia: float) -> Asked:
        """What the file says, else what the log's law asks if it is an unfalsified one, else what such a law asks by default.

        Args:
          settings: of the file.
          law: of the log's loop.
          sensors: of the log's scenario, for a law that names no quantum.
          inertia: of the body about the axis, kg m2.
        """
        own = law if isinstance(law, UnfalsifiedSettings) else UnfalsifiedSettings(type="unfalsified", feedback="measurement")
        if own is law:
            quantum = float(np.radians(own.quantum_deg))
        else:
            quantum = max(sensors.attitude_resolution_rad, 2.0 * sensors.attitude_noise_rad)
        pace = own.pace_rad_s if settings.pace_rad_s is None else settings.pace_rad_s
        limit = settings.effort_limit_nm
        return cls(
            pace=pace,
            zero=settings.zero,
            error_bound=own.error_bound if settings.error_bound is None else settings.error_bound,
            effort_limit=inertia * (settings.zero * pace) ** 2 if limit is None else limit,
            quantum=quantum if settings.quantum_deg is None else float(np.radians(settings.quantum_deg)),
            gate=own.gate_quanta if settings.gate_quanta is None else settings.gate_quanta,
        )


@dataclass(frozen=True, eq=False)
class AxisVerdict:
    """What a block of a log's trials says of the candidates of one axis.

    Attributes:
      loop: whose flight it was.
      axis: 0, 1, 2.
      trials: numbers, (trials,).
      asked: of the controllers.
      names: of the candidates, (candidates,).
      verdict: of (candidates, trials).
      record: what was judged by.
    """

    loop: str
    axis: int
    trials: NDArray[np.int64]
    asked: Asked
    names: tuple[str, ...]
    verdict: Verdict
    record: AxisRecord

    def when(self, tick: NDArray[np.int64]) -> Array:
        """Seconds from the log's first row to ticks (...), NaN for never."""
        return np.where(tick == NEVER, np.nan, self.record.time[tick])

    def rows(self) -> Iterator[dict[str, Any]]:
        """A row a trial and candidate."""
        first, worst = self.when(self.verdict.first), self.when(self.verdict.worst)
        for i, name in enumerate(self.names):
            for j, trial in enumerate(self.trials):
                row: dict[str, Any] = {"loop": self.loop, "axis": "xyz"[self.axis], "trial": int(trial), "candidate": name}
                row |= {"falsified": bool(self.verdict.falsified[i, j]), "told": bool(np.isfinite(self.verdict.ratio[i, j]).any())}
                for k, test in enumerate(TESTS):
                    row |= {f"{test}_ratio": _number(self.verdict.ratio[i, j, k]), f"{test}_worst_s": _number(worst[i, j, k])}
                    row |= {f"{test}_falsified_s": _number(first[i, j, k])}
                yield row


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def falsify(
    label: str,
    log: FlightLog,
    scenario: Scenario,
    assembly: Assembly,
    file: Candidates,
    own: dict[str, UserClass],
    axes: Iterable[int],
) -> tuple[list[AxisVerdict], tuple[str, ...]]:
    """Judge all candidates by a block of a log, axis by axis, and say what is to be said of it.

    Args:
      label: of the log, for complaints.
      log: of one body.
      scenario: of the log's loop.
      assembly: its plant.
      file: the candidates, and what is asked of them.
      own: the user's classes among them.
      axes: 0, 1, 2.

    Raises:
      BadInput: what is asked needs a finer sampling, a user's class is at fault, or the log has no angles.
    """
    records, notes = axis_records(label, log, assembly)
    found = []
    for axis in axes:
        record, inertia = records[axis], float(assembly.inertia[axis, axis])
        asked = Asked.of(file.specification, scenario.law, scenario.sensors, inertia)
        if asked.pace * log.dt > COARSEST:
            raise BadInput(
                f"{label}: has a row every {log.dt:g} s, which is too coarse for specification.pace_rad_s = {asked.pace:g}; "
                f"ask for at most {COARSEST / log.dt:.3g} rad/s"
            )
        bank = file.databank(inertia)
        angle = record.angle - record.angle[0]
        setting = AxisSetting(log.dt, axis, inertia)
        users = [UserCandidate(source).reference(setting, record.torque, angle, record.rate) - angle for source in own.values()]
        stiffness = inertia * asked.pace**2
        specification = Specification(asked.zero, asked.error_bound, asked.effort_limit / stiffness, asked.pace * log.dt)
        errors = _errors(list(bank.values()), users, record, log.dt)
        verdict = judge(specification, errors, record.torque / stiffness, angle, (asked.gate * asked.quantum) ** 2)
        found.append(AxisVerdict(log.loop, axis, log.trials, asked, (*bank, *own), verdict, record))
    return found, notes


def _errors(bank: list[Gain], users: list[Array], record: AxisRecord, tick_s: float) -> Iterator[Array]:
    """Fictitious errors r~ - y tick by tick, (candidates, trials) rad: those of the databank, then the users'."""
    gains = [np.array(part)[:, None] for part in zip(*bank, strict=True)] or [np.zeros((0, 1))] * len(Gain._fields)
    law = IntegralControl(gains[0], gains[1], gains[2], gains[3].astype(bool), tick_s)
    memory = law.start((len(bank), record.torque.shape[1]))
    theirs = np.stack(users, axis=1) if users else np.zeros((len(record.time), 0, record.torque.shape[1]))
    for torque, rate, beside in zip(record.torque, record.rate, theirs, strict=True):
        error, memory = law.error(memory, torque, rate)
        yield np.concatenate([error, beside])
