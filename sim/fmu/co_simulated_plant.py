"""What an FMU of the plant does, whatever the version of the standard: named numbers in and out, steps, and states to return to."""

from __future__ import annotations

import json
from collections.abc import Callable
from copy import deepcopy
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any, Literal, NamedTuple
from uuid import NAMESPACE_URL, UUID, uuid5

import numpy as np

from models.dynamics.state_layout import ATTITUDE, RATE, WHEELS
from sim.bad_input import BadInput
from sim.loop.open_loop import Instant, OpenLoop, single_body
from sim.parts import Array
from sim.scenario import files
from sim.scenario.files import AnyScenario
from sim.text.one_line import one_line

SCENARIO_FILE = "scenario.json"  # among the resources of an FMU
# these say what the flight is, or which past it looks back on; all other parameters may change while it lasts
FIXED = ("run.seed", "run.ticks", "plant.step_s", "sensors.latency_s", "sensors.jitter_s")
TOLERANCE = 1e-6  # of a tick, by which a communication step may miss a whole number of them


class Variable(NamedTuple):
    """A number that an FMU shows."""

    name: str
    role: Literal["input", "output", "fixed", "tunable"]
    whole: bool  # an integer
    meaning: str
    get: Callable[[], Any]
    set: Callable[[Any], None] | None


class CoSimulatedPlant:
    """One trial of a scenario of one body: torques are held over a communication step, readings and truth are those at its end.

    A parameter that is set takes effect at the next step or look: the plant is made anew with it and put where the old one was.

    Attributes:
      title: of the scenario.
      dt: control period, s, of which a communication step is a whole multiple.
      end: time of the last tick, s.
      variables: all numbers that are shown.
    """

    def __init__(self, said: dict[str, Any]) -> None:
        """`said` is a checked scenario as its file would say it."""
        self._said = said
        scenario = self._scenario({})
        single_body(scenario)
        self.title, self.dt, self.end = scenario.title, scenario.run.tick_s, scenario.run.tick_s * (scenario.run.ticks - 1)
        self._said_numbers = _numbers(said)
        self._parameters = dict(self._said_numbers)
        self._open: OpenLoop | None = None
        self._as_set = False  # whether it was made with the parameters as they are set
        self._outputs: list[float] | None = None
        self._wheels = scenario.plant.wheel_axes.shape[1]
        self._inputs = [0.0] * (3 + self._wheels)
        self.variables = (*self._asked(), *self._told(), *self._settings(scenario))

    @classmethod
    def read(cls, resources: str | Path) -> CoSimulatedPlant:
        """From the resources of an FMU; the standard allows a URI."""
        return cls(json.loads((Path(str(resources).removeprefix("file://")) / SCENARIO_FILE).read_text(encoding="utf-8")))

    @property
    def identity(self) -> UUID:
        """The same for the same scenario."""
        return uuid5(NAMESPACE_URL, json.dumps(self._said, sort_keys=True))

    @property
    def loop(self) -> OpenLoop:
        """Plant and sensors with the parameters as they are set."""
        if self._open is None or not self._as_set:
            before, self._open = self._open, OpenLoop(self._scenario(self._changed()), np.arange(1))
            if before is not None and before.tick > 0:
                self._open.instant = before.instant
            self._as_set, self._outputs = True, None
        return self._open

    @property
    def time(self) -> float:
        """Seconds since the start."""
        return self.loop.tick * self.dt

    def step(self, size: float) -> None:
        """Act by the inputs for `size` seconds.

        Raises:
          BadInput: it is no whole number of ticks, goes beyond the last, an input is not finite, or the physics broke down.
        """
        ticks = round(size / self.dt)
        if ticks < 1 or abs(size / self.dt - ticks) > TOLERANCE:
            raise BadInput(f"step of {size:g} s: must be a whole number of ticks of {self.dt:g} s")
        if not all(map(isfinite, self._inputs)):
            raise BadInput(f"torque is not finite: {self._inputs}")
        loop = self.loop
        if loop.tick + ticks > loop.ticks:
            raise BadInput(f"the flight of {loop.ticks} ticks of {self.dt:g} s is over; a greater run.ticks lasts longer")
        torque, wheel = np.array([self._inputs[:3]]), np.array([self._inputs[3:]]) if self._wheels else 0.0
        for _ in range(ticks):
            loop.act(torque, wheel)
        self._outputs = None
        if loop.failed.any():
            raise BadInput(f"the physics broke down before t = {loop.tick * self.dt:g} s")

    def state(self) -> dict[str, Any]:
        """All that is needed to be here again, as JSON has it."""
        return {
            "parameters": list(self._parameters.values()),
            "inputs": list(self._inputs),
            "instant": {name: part if isinstance(part, int) else part.tolist() for name, part in self.loop.instant._asdict().items()},
        }

    def return_to(self, state: dict[str, Any]) -> None:
        """Be where `state` was taken, in this FMU or another of the same scenario."""
        parameters = dict(zip(self._parameters, state["parameters"], strict=True))
        if parameters != self._parameters:
            self._open = None
            self._parameters.update(parameters)
        self._inputs[:] = state["inputs"]
        loop, now = self.loop, state["instant"]
        body = loop.truth.state.shape
        loop.instant = Instant(
            now["tick"],
            np.array(now["physics"]),
            np.array(now["held"]),
            np.array(now["failed"], dtype=bool),
            np.array(now["past"], dtype=float).reshape(-1, *body),
        )
        self._outputs = None

    def _scenario(self, changes: dict[str, Any]) -> Any:
        return files.check(deepcopy(self._said), "FMU", changes)

    def _changed(self) -> dict[str, Any]:
        """Dotted keys of the scenario whose numbers are set to others."""
        own, now, changes = self._said_numbers, self._parameters, dict[str, Any]()
        for key, place in (which for which in own if now[which] != own[which]):
            changes[key] = now[key, None] if place is None else [value for (name, _), value in now.items() if name == key]
        return changes

    def _asked(self) -> list[Variable]:
        """Torques."""
        names = [(f"torque_B[{i}]", "N m on the body about this axis of B, shared among the wheels") for i in (1, 2, 3)]
        names += [(f"torque_wheel[{i + 1}]", "N m of this motor on its wheel, besides") for i in range(self._wheels)]
        return [Variable(name, "input", False, what, partial(self._inputs.__getitem__, i), partial(self._inputs.__setitem__, i))
                for i, (name, what) in enumerate(names)]  # fmt: skip

    def _told(self) -> list[Variable]:
        """Readings, truth and reference."""
        body = [("q", 4, "q_BN, scalar last"), ("omega", 3, "rad/s, omega_BN_B"), ("wheel", self._wheels, "rad/s relative to the body")]
        groups = [(f"reading.{name}", size, f"{what}, as read; NaN where nothing is read") for name, size, what in body]
        groups += [(f"truth.{name}", size, f"{what}, true") for name, size, what in body]
        groups += [("reference.q", 4, "q_DN, scalar last"), ("reference.omega", 3, "rad/s, omega_DN_D"), ("reference.alpha", 3, "rad/s2")]
        names = [(f"{name}[{i + 1}]", what) for name, size, what in groups for i in range(size)]
        return [Variable(name, "output", False, what, partial(self._output, i), None) for i, (name, what) in enumerate(names)]

    def _output(self, place: int) -> float:
        if self._outputs is None:
            loop = self.loop
            state, reading = loop.truth.state[0], loop.reading[0]
            parts: list[Array] = [one[part] for one in (reading, state) for part in (ATTITUDE, RATE, WHEELS)]
            self._outputs = np.concatenate([*parts, *loop.asked]).tolist()
        return self._outputs[place]

    def _settings(self, scenario: AnyScenario) -> list[Variable]:
        """Every number of run, plant and sensors."""
        meanings = {f"plant.{name}": f"{unit}; {meaning}" for name, _, unit, meaning, _ in scenario.plant.table()}
        return [
            Variable(
                key if place is None else f"{key}[{place + 1}]",
                "fixed" if key in FIXED else "tunable",
                isinstance(value, int),
                one_line(meanings.get(key, key), 200),
                partial(self._parameters.__getitem__, (key, place)),
                partial(self._set, (key, place)),
            )
            for (key, place), value in self._parameters.items()
        ]

    def _set(self, which: tuple[str, int | None], value: Any) -> None:
        if which[0] in FIXED and self._open is not None and self._open.tick > 0:
            raise BadInput(f"{which[0]}: is fixed, set it before the first step")
        own = self._said_numbers[which]
        self._parameters[which] = own if f"{own:.16g}" == f"{value:.16g}" else value  # start values are written with 16 digits
        self._as_set, self._outputs = False, None


def _numbers(said: dict[str, Any]) -> dict[tuple[str, int | None], Any]:
    """Numbers of run, plant and sensors that an FMU lets change: by dotted key, and place in a list."""
    found: dict[tuple[str, int | None], Any] = {(f"run.{key}", None): said["run"][key] for key in ("seed", "ticks")}
    for section in ("plant", "sensors"):
        for key, value in said[section].items():
            entries = [(None, value)] if not isinstance(value, list) else list(enumerate(value))
            if all(isinstance(one, int | float) and not isinstance(one, bool) for _, one in entries):
                found |= {(f"{section}.{key}", place): one for place, one in entries}
    return found
