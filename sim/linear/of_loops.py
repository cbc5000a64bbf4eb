"""Margins of the laws of a scenario's closed loops, believing that all is well or that a wheel has failed."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.dynamics.wheel_faults import WheelFault
from sim.bad_input import BadInput
from sim.controllers.tracking import TrackingLaw
from sim.linear.delays import late_commands
from sim.linear.flown_loop import flown_loop
from sim.linear.law_gain import Switches, allocation_gain, law_gain
from sim.linear.linear_model import LinearModel, Quantities
from sim.linear.linearize import linearize
from sim.linear.margins import Loop, Margins, SampledLoop
from sim.loop.body_parts import BodyEffectors
from sim.loop.build import build
from sim.scenario.one_body import Scenario

TORQUE = Quantities(("torque1", "torque2", "torque3"), ("N m",) * 3)


class Case(NamedTuple):
    """A loop in one of the situations that it may be in.

    Attributes:
      loop: its name.
      believed: mode that the law believes in, 0 being the healthy one.
      mode: mode that the plant is in.
      sampled: the loop itself; None: its law switches, and has no slope.
      told: who tells the law the state: `state`, as it is read without noise, or the filter with which the loop was flown.
    """

    loop: str
    believed: int
    mode: int
    sampled: Loop | None
    told: str = "state"

    @property
    def margins(self) -> list[Margins]:
        """Of axes 1 to 3 and of all; none of a law that switches."""
        return [] if self.sampled is None else self.sampled.margins()


def cases(scenario: Any, loop: str | None = None, at: float | None = None, flown: bool = False) -> list[Case]:
    """Loops of a scenario of one body, told the state as sensors read it without noise, with readings' and commands' delays; or as flown.

    Filters are no part of them unless they are flown. A law that is told the probabilities of modes is shown with each mode for certain:
    where it is so, where it is so and not yet believed, and where it is believed and not so.

    Args:
      scenario: of one body.
      loop: one of several; None: all.
      at: operating point, as of `linearize`.
      flown: as they are, filters included, found by how the law answers pulses of torque, all being well.

    Raises:
      BadInput: as `linearize`; if every law switches; a flight fails; loops are flown from their start alone, not `at` another point.
    """
    linearize(scenario, loop)  # says what cannot be
    names = scenario.loop_names if loop is None else (loop,)
    if flown and at is not None:
        raise BadInput(f"at {at:g} s: loops are flown from their start; leave it out, or `flown`")
    found = [case for name in names for case in _of_loop(scenario.singles()[name], name, at)]
    if all(case.sampled is None for case in found):
        raise BadInput(f"loop {found[0].loop}: its law switches at rest and has no slope; a boundary layer, or power = 1, gives it one")
    return [_as_flown(scenario.singles()[case.loop], case) for case in found if case.believed == case.mode == 0] if flown else found


def _as_flown(scenario: Scenario, case: Case) -> Case:
    return case if case.sampled is None else case._replace(sampled=flown_loop(scenario, case.loop), told=scenario.law.feedback)


def _of_loop(scenario: Scenario, name: str, at: float | None) -> list[Case]:
    model, wheels = linearize(scenario, at=at, sampled=True), scenario.plant.wheel_axes.shape[1]
    system, settings = build(scenario, np.zeros(1, dtype=np.int64)), scenario.law
    observer = scenario.observers.get(settings.feedback)
    told = observer is not None and bool(observer.mode_settings)
    faults = observer.faults(wheels) if observer is not None and told else (WheelFault.healthy(wheels),)
    law, effectors = system.law, system.effectors
    assert isinstance(law, TrackingLaw)
    assert isinstance(effectors, BodyEffectors)
    found = []
    for believed, mode in [(0, 0), *(case for i in np.arange(1, len(faults)).tolist() for case in ((i, i), (0, i), (i, 0)))]:
        modes = np.eye(len(faults))[believed] if told else None
        try:
            gain = -law_gain(law.controller, model.point, modes, settings.late_ticks)
        except Switches:
            return [Case(name, 0, 0, None)]
        found.append(Case(name, believed, mode, SampledLoop(_driven(model, effectors, faults[mode], modes, settings.late_ticks), gain)))
    return found


def _driven(
    model: LinearModel, effectors: BodyEffectors, fault: WheelFault, modes: NDArray[np.floating] | None, late_ticks: int
) -> LinearModel:
    """The plant under the torque that the law asks for."""
    wheels = effectors.wheels
    if wheels:
        inputs = np.zeros((wheels + 3, 3))
        inputs[:wheels] = (1.0 - fault.indicator)[:, None] * allocation_gain(effectors.allocation, wheels, modes)
    else:
        inputs = np.eye(3)
    return late_commands(model.through(inputs, TORQUE), late_ticks)
