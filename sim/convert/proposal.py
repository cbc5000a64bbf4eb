"""A map that is proposed from the names of columns and from physics, as TOML with its evidence, and what neither could decide."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.dynamics.state_layout import WHEELS
from sim.bad_input import BadInput
from sim.convert import evidence
from sim.convert.column_names import Found, Named, named
from sim.convert.evidence import CLOCKS, ORDERS, Driving, Turning, Verdict
from sim.convert.map_file import LogMap, TimeMap, checked
from sim.convert.mapped import seconds
from sim.convert.source import Source
from sim.convert.units import UNITS
from sim.replay.log_columns import LogColumns
from sim.text.toml_text import written

Array = NDArray[np.floating]

AMPLE = 1e6  # s; a clock that begins beyond it counts from somewhere else than the flight
ROW = "rows"  # unit of a clock that counts them
NAMED_ORDERS = {
    tuple("xyzw"): "scalar-last",
    tuple("xyzs"): "scalar-last",
}  # by the labels of four columns, in the order they are listed in
MOST_TRIED = 12  # columns that may be rates, three each
PERIODS = (2e-4, 20.0)  # s, between which a log's period is taken to be


@dataclass
class Part:
    """One table of the map, with what speaks for it."""

    key: str
    says: dict[str, Any] | str
    because: list[str] = field(default_factory=list)

    def toml(self) -> str:
        """Its lines; one that is a word belongs before the first table."""
        remarks = "".join(f"# {line}\n" for line in self.because)
        if isinstance(self.says, str):
            return f"{remarks}{self.key} = {written(self.says)}\n"
        return f"[{self.key}]\n{remarks}" + "".join(f"{key} = {written(value)}\n" for key, value in self.says.items())


@dataclass
class Proposal:
    """What is proposed, part by part.

    Attributes:
      parts: tables and words of the map.
      open: what could not be decided.
    """

    parts: list[Part] = field(default_factory=list)
    open: list[str] = field(default_factory=list)

    def toml(self, path: str) -> str:
        """The map as a file, ready to be saved."""
        words = [part for part in self.parts if isinstance(part.says, str)]
        tables = [part for part in self.parts if not isinstance(part.says, str)]
        undecided = "".join(f"# - {line}\n" for line in self.open) or "# - nothing\n"
        head = f"# Proposed for {path} by its columns' names and by what fits; misfits: 0 alike, 1 unrelated.\n# Not decided:\n{undecided}"
        return "\n".join([head, *([] if not words else ["".join(part.toml() for part in words)]), *(part.toml() for part in tables)])

    def map(self) -> LogMap:
        """The same, checked."""
        return checked(tomllib.loads(self.toml("")), "proposal")


def proposed(source: Source, log: LogColumns, inertia: Any, scenario: str | None) -> Proposal:
    """A map for a file.

    Args:
      source: the file.
      log: columns that the log of the plant needs.
      inertia: of the plant's wheels, kg m2.
      scenario: whose plant it is; None: the NACS as published.

    Raises:
      BadInput: of several agents there is nothing to propose; or nothing looks like a clock.
    """
    if not log.unit_quaternion:
        raise BadInput(f"--inspect: knows logs of one body, not of {log.plant}; docs/convert.md shows the map of several")
    return _Inspection(source, log, inertia, scenario, named(source.columns)).proposal()


@dataclass
class _Inspection:
    """A file that is looked through."""

    source: Source
    log: LogColumns
    inertia: Any
    scenario: str | None
    names: Named

    def proposal(self) -> Proposal:
        """Clock, attitudes and rates first, since they tell each other; then the wheels."""
        out = Proposal()
        if self.scenario is not None:
            out.parts.append(Part("scenario", self.scenario))
        if self.names.trial is not None:
            out.parts.append(Part("trial", self.names.trial, ["by its name"]))
        column, said = self._clock()
        attitude, rate = self._attitude(out), self._first("rate", out)
        verdict = None
        clocks = dict(CLOCKS) if said is None else {said: UNITS["time"][said]}
        if column is None and attitude is not None and rate is not None:
            clocks = self._rows(attitude, rate)
        if attitude is not None and clocks:
            rate, verdict = self._turning(column, clocks, attitude, [rate] if rate is not None else self._unnamed(column, attitude))
        clock = self._say_clock(out, column, said, verdict, attitude, rate)
        self._say_attitude(out, attitude, verdict)
        self._say_rate(out, rate, verdict)
        self._say_wheels(out, column, clock)
        for key in ("truth_attitude", "truth_rate", "truth_wheels"):
            if self.names.groups.get(key):
                like = ", ".join(self.names.groups[key][0].columns)
                out.open.append(f"{key}: {like} look like it; say so as of {key.removeprefix('truth_')} to have errors")
        return out

    def _rows(self, attitude: Found, rate: Found) -> dict[str, float]:
        """The clock that rows themselves are, if there is no other: their period by the turns, with rates in the unit of their names."""
        found = evidence.period(self._stack(attitude.columns), self._stack(rate.columns), rate.unit or "rad/s")
        return {} if found is None else {ROW: found}

    def _turning(
        self, column: str | None, clocks: dict[str, float], attitude: Found, rates: list[Found]
    ) -> tuple[Found | None, Verdict | None]:
        """Of some columns that may be the rates those that fit the attitudes best, and how; a single one is taken if nothing tells."""
        q = self._stack(attitude.columns)
        stamps = np.arange(len(q), dtype=float) if column is None else self._stamps(column)
        orders = (NAMED_ORDERS[attitude.labels],) if attitude.labels in NAMED_ORDERS else ORDERS
        judged: list[tuple[Found, Verdict]] = []
        for rate in rates:
            omega = self._stack(rate.columns)
            if not len(stamps) == len(q) == len(omega):
                continue
            verdict = evidence.turning(stamps, q, omega, clocks, orders)
            if verdict is None:  # the names may be wrong
                verdict = evidence.turning(stamps, q, omega, clocks if column is None else CLOCKS)
            if verdict is not None:
                judged.append((rate, verdict))
        if not judged:
            return (rates[0] if len(rates) == 1 and rates[0].labels else None), None
        return min(judged, key=lambda one: one[1].misfit)

    def _unnamed(self, column: str | None, attitude: Found) -> list[Found]:
        """Three neighbouring columns each, of those whose names say nothing."""
        taken = {column, self.names.trial, *attitude.columns}
        taken |= {name for groups in self.names.groups.values() for found in groups for name in found.columns}
        names = list(self.source.columns)
        threes = [tuple(names[i : i + 3]) for i, _ in enumerate(names[:-2])]
        free = [three for three in threes if not taken & set(three) and len({len(self.source.columns[name]) for name in three}) == 1]
        return [Found(three, (), None) for three in free[:MOST_TRIED]]

    def _clock(self) -> tuple[str | None, str | None]:
        """Column of the time stamps and the unit that its name says; by name, or the first that ticks as a clock does."""
        if self.names.clock is not None:
            name, unit = self.names.clock
            return name, "ns" if name == "log_time" and unit is None else unit
        known = {name for groups in self.names.groups.values() for found in groups for name in found.columns}
        known |= {name for four in evidence.unit_quaternions(self._numbers) for name in four}
        return next((name for name, values in self._numbers.items() if name not in known and evidence.ticks(values)), None), None

    @property
    def _numbers(self) -> dict[str, Array]:
        """All columns of the file."""
        return {name: self.source.numbers(name) for name in self.source.columns}

    def _stamps(self, column: str) -> Array:
        """Stamps from the first one on, in their own unit."""
        return seconds(self.source.whole(column), TimeMap(column=column, offset="first"))

    def _stack(self, columns: tuple[str, ...]) -> Array:
        return np.stack([self.source.numbers(name) for name in columns], axis=-1)

    def _first(self, key: str, out: Proposal) -> Found | None:
        """The first group of columns that look like a quantity by their names; others are told."""
        found = self.names.groups.get(key, [])
        for other in found[1:]:
            out.open.append(f"{key}: {', '.join(other.columns)} look like it too")
        return found[0] if found else None

    def _attitude(self, out: Proposal) -> Found | None:
        if (found := self._first("attitude", out)) is not None:
            return found
        like = evidence.unit_quaternions(self._numbers)
        return Found(like[0], (), None) if like else None

    def _say_clock(
        self, out: Proposal, column: str | None, said: str | None, verdict: Verdict | None, attitude: Found | None, rate: Found | None
    ) -> str:
        """The table `time`; its unit."""
        if column is None:
            hz, why = 10.0, "a guess"
            if verdict is not None and rate is not None:
                dt = self._rows(attitude, rate)[ROW] if attitude is not None else np.nan
                hz, why = float(f"{1.0 / dt:.4g}"), f"what turns give with rates in {verdict.best.unit}"
                others = [f"{hz * UNITS['rate'][unit] / UNITS['rate'][verdict.best.unit]:.4g} with {unit}" for unit in evidence.RATE_UNITS]
                out.open.append(f"time.rate_hz, rate.unit: {', '.join(others)}; put in the nominal rate")
            else:
                out.open.append("time.rate_hz: there is no clock, and no turn is seen beside the rates")
            out.parts.append(Part("time", {"rate_hz": hz}, [f"no column looks like a clock; rate_hz is {why}"]))
            return "s"
        because = [] if self.names.clock is None else ["column: by its name"]
        unit = said or "s"
        if verdict is not None:
            unit = verdict.best.clock
            because.append(f"unit: {'as its name says, and ' if unit == said else ''}turns from attitude to attitude fit the rates")
            if said not in (None, unit):
                because.append(f"its name says {said}, which does not fit")
        elif said is None:
            step = float(np.median(np.diff(self._stamps(column))))
            fitting = [name for name in CLOCKS if PERIODS[0] <= step * UNITS["time"][name] <= PERIODS[1]]
            unit = fitting[0] if fitting else "s"
            because.append(f"unit: a guess, by a period of {step * UNITS['time'][unit]:g} s")
            out.open.append(f"time.unit: {' or '.join(fitting) or 'none'} would make a likely period")
        else:
            because.append("unit: by its name")
        first = float(self.source.numbers(column)[0])
        away = abs(first) * UNITS["time"][unit] > AMPLE
        if away:
            because.append(f"offset: it begins at {first:g} {unit}")
        out.parts.append(Part("time", {"column": column, "unit": unit, "offset": "first" if away else 0.0}, because))
        return unit

    def _say_attitude(self, out: Proposal, found: Found | None, verdict: Verdict | None) -> None:
        if found is None:
            out.parts.append(Part("attitude", "none", ["no columns look like a quaternion, by name or by length"]))
            return
        because = ["columns: by their names" if found.labels else "columns: their squares add up to one"]
        named_order = NAMED_ORDERS.get(found.labels)
        order, direction = named_order or "scalar-last", "q_BN"
        if verdict is None:
            because.append(f"order: {'by the names' if named_order else 'a guess'}; direction: a guess; turns do not tell")
            out.open.append(f"attitude: {'' if named_order else 'order and '}direction; no turn is seen beside the rates")
        else:
            best: Turning = verdict.best
            order, direction = best.order, best.direction
            because.append(f"order, direction: turns fit the rates, misfit {verdict.misfit:.2g}; the next reading has {verdict.next:.2g}")
            if named_order and order != named_order:
                because.append("the names say another order, which does not fit")
        length = evidence.scale(self._stack(found.columns))
        more = {} if length == 1.0 else {"unit": 1.0 / length}
        says = {"columns": list(found.columns), "order": order, "direction": direction, "world": "NED", "body": "FRD", **more}
        out.parts.append(Part("attitude", says, because))
        out.open.append("attitude.world, .body, rate.body: rates fit attitudes about whatever axes; NED and FRD are the twin's own")

    def _say_rate(self, out: Proposal, found: Found | None, verdict: Verdict | None) -> None:
        if found is None:
            out.parts.append(Part("rate", "none", ["no three columns are named as rates are, or fit the attitudes"]))
            return
        because = ["columns: by their names" if found.labels else "columns: of those without a telling name they fit the attitudes best"]
        columns, sign, unit = found.columns, [1, 1, 1], found.unit or "rad/s"
        if verdict is None:
            because.append(f"unit: {'by the names' if found.unit else 'a guess'}; turns do not tell")
            if not found.unit:
                out.open.append("rate.unit: no name says it, and no turn is seen beside the rates")
        else:
            best: Turning = verdict.best
            columns, sign, unit = tuple(found.columns[i] for i in best.axes), list(best.signs), best.unit
            because.append(f"unit, order, signs: turns fit them with a misfit of {verdict.misfit:.2g}")
            if found.unit not in (None, unit):
                because.append(f"the names say {found.unit}, which does not fit")
            for other in verdict.alike[:3]:
                out.open.append(f"attitude, rate: {_in_words(other, found)} fits as well")
            if len(verdict.alike) > 3:
                out.open.append(f"attitude, rate: and {len(verdict.alike) - 3} more")
        out.parts.append(Part("rate", {"columns": list(columns), "unit": unit, "sign": sign, "body": "FRD"}, because))

    def _say_wheels(self, out: Proposal, column: str | None, clock: str) -> None:
        wheels, command = self._first("wheels", out), self._first("command", out)
        needed = len(self.log.layout.names[WHEELS])
        if not needed:
            out.parts.append(_drives(command, len(self.log.known), None, out))
            return
        verdict = None
        if wheels is not None and command is not None and column is not None and len(wheels.columns) == len(command.columns):
            time, speeds = self._stamps(column) * UNITS["time"][clock], self._stack(wheels.columns)
            if len(time) == len(speeds):
                verdict = evidence.driving(time, speeds, self._stack(command.columns), self.inertia)
        if wheels is None or len(wheels.columns) != needed:
            seen = "no columns are named as wheel speeds are" if wheels is None else f"{', '.join(wheels.columns)}: the plant has {needed}"
            out.parts.append(Part("wheels", "none", [seen]))
            out.open.append(f"wheels: {seen}; a body without wheels is said by scenario")
        else:
            unit, because = wheels.unit or "rad/s", ["columns: by their names"]
            if verdict is not None:
                unit = verdict.best.unit
                because.append(f"unit: speeds change as commands say, misfit {verdict.misfit:.2g}; the next reading has {verdict.next:.2g}")
                if wheels.unit not in (None, unit):
                    because.append(f"the names say {wheels.unit}, which does not fit")
            else:
                because.append(f"unit: {'by the names' if wheels.unit else 'a guess'}; commands do not tell")
                if not wheels.unit:
                    out.open.append("wheels.unit: no name says it, and no command is seen beside the speeds")
            out.parts.append(Part("wheels", {"columns": list(wheels.columns), "unit": unit}, because))
            out.open.append("wheels: which is which, and their sign about the axes of W; conventions.md has the axes")
        out.parts.append(_drives(command, needed, verdict, out))


def _drives(command: Found | None, needed: int, verdict: Verdict | None, out: Proposal) -> Part:
    """The part `command`."""
    if command is None or len(command.columns) != needed:
        seen = "no columns are named as torques are" if command is None else f"{', '.join(command.columns)}: {needed} are needed"
        out.open.append(f"command: {seen}; none stands for no torque at all")
        return Part("command", "none", [seen])
    because, columns, unit, sign = ["columns: by their names"], command.columns, command.unit or "N m", (1,) * needed
    if verdict is None:
        because.append(f"unit: {'by the names' if command.unit else 'a guess'}; wheel speeds do not tell")
        if not command.unit:
            out.open.append("command.unit: no name says it, and no wheel is seen to follow")
    else:
        best: Driving = verdict.best
        columns, unit, sign = tuple(command.columns[i] for i in best.commands), best.torque, best.signs
        because.append(f"unit, order, signs: wheel speeds follow them with a misfit of {verdict.misfit:.2g}")
        if command.unit not in (None, unit):
            because.append(f"the names say {command.unit}, which does not fit")
    return Part("command", {"columns": list(columns), "unit": unit, "sign": list(sign)}, because)


def _in_words(other: Turning, found: Found) -> str:
    """Another reading, in one line."""
    rates = ", ".join(f"{'-' if sign < 0 else ''}{found.columns[i]}" for i, sign in zip(other.axes, other.signs, strict=True))
    return f"{other.order} {other.direction} with rates {rates} in {other.unit}, time in {other.clock},"
