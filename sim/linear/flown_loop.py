"""A loop as it is flown, with its filter: known by how the law answers a pulse of torque."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from sim.bad_input import BadInput
from sim.linear.margins import ComplexArray, Loop
from sim.loop.body_parts import BodyEffectors
from sim.loop.build import build
from sim.loop.closed_loop import Flight
from sim.scenario.one_body import Scenario

Array = NDArray[np.floating]

_BEFORE, _AFTER = 50, 400  # ticks for a filter to settle, and for an answer to die out
_PULSE = 1e-4  # N m for a tick, by the inertia in 0.02 kg m2: too little to wake a detector of faults
_DIED_OUT = 1e-3  # of the greatest answer, in the last tenth
_REAL = 1e-6
_LEAST = 0.01  # a lower gain is as good as none: answers end somewhere
SMOOTH_SENSORS = {"gyro_resolution_rad_s": 0.0, "wheel_bits": 0, "attitude_resolution_rad": 0.0}
SMOOTH_PLANT = {"command_bits": 0, "wheel_coulomb_nm": 0.0}


@dataclass(frozen=True, eq=False)
class FlownLoop(Loop):
    """The law's answers T = -(1 + L)^-1 L to pulses on each axis while all loops are closed, and so L.

    Attributes:
      answers: torque asked for k ticks after a pulse of 1 N m, (ticks, 3 asked, 3 pulses).
      dt: control period, s.
    """

    answers: Array
    dt: float

    @property
    def period_s(self) -> float:
        """Of its samples."""
        return self.dt

    @cached_property
    def stable(self) -> bool:
        """Whether the answers die out."""
        sizes = np.abs(self.answers)
        return bool(sizes[-len(sizes) // 10 :].max() < _DIED_OUT * sizes.max())

    def transfer(self, pulsation: Array, axes: list[int]) -> ComplexArray:
        """L of some axes, the other loops being closed: (1 + T)^-1 - 1 of these axes."""
        turned = np.exp(-1j * np.asarray(pulsation)[:, None] * self.dt * np.arange(len(self.answers)))
        sensitivity = np.eye(3) + np.tensordot(turned, self.answers, axes=1)
        return np.asarray(np.linalg.inv(sensitivity[:, axes][:, :, axes]) - np.eye(len(axes)), dtype=complex)

    def gains(self, axes: list[int]) -> tuple[float, float]:
        """Where an eigenvalue of L crosses the negative real axis, g L = -1."""
        grid = self.grid
        loci = self.loci(grid, axes)
        crossings = [*loci[-1][np.abs(loci[-1].imag) < _REAL * np.abs(loci[-1])].real]  # half the sampling rate, where all is real
        for left, branch in np.argwhere((loci[1:].imag > 0.0) != (loci[:-1].imag > 0.0)).tolist():

            def height(pulsation: float, branch: int = branch) -> float:
                return float(self.loci(np.array([pulsation]), axes)[0, branch].imag)

            if height(grid[left]) * height(grid[left + 1]) < 0.0:
                pulsation = float(optimize.brentq(height, grid[left], grid[left + 1], xtol=1e-13))
                there = self.loci(np.array([pulsation]), axes)[0, branch]
                crossings += [there.real] if abs(there.imag) < _REAL * abs(there) else []  # else two have changed places
        factors = np.array([-1.0 / real for real in crossings if real < 0.0])
        return float(np.min(factors[factors > 1.0], initial=np.inf)), float(
            np.max(factors[(factors < 1.0) & (factors > _LEAST)], initial=0.0)
        )


def flown_loop(scenario: Scenario, name: str) -> FlownLoop:
    """Fly a loop four times with the same noise, three of them with a pulse of torque about an axis each, which no filter is told of.

    Resolutions, dry friction and faults, which are not linear, are switched off; noise, by which filters weigh their readings, is not.

    Raises:
      BadInput: a trial was lost.
    """
    smooth = {key: value for key, value in SMOOTH_PLANT.items() if hasattr(scenario.plant, key)}
    run = scenario.run.model_copy(update={"ticks": _BEFORE + _AFTER, "trials": 4})
    plant = type(scenario.plant).model_validate(scenario.plant.model_dump() | smooth)  # type: ignore[attr-defined]
    sensors = scenario.sensors.model_copy(update=SMOOTH_SENSORS)
    quiet = scenario.model_copy(update={"run": run, "plant": plant, "sensors": sensors, "faults": ()})
    system = build(quiet, np.zeros(4, dtype=np.int64))  # one trial four times over
    effectors = system.effectors
    assert isinstance(effectors, BodyEffectors)
    pulse = _PULSE * float(np.trace(scenario.plant.inertia)) / 0.06
    motors = -np.linalg.pinv(scenario.plant.wheel_axes) if effectors.wheels else np.eye(3)
    unheard = effectors.drive_noise.copy()  # what the drives do beside what they are told: no filter knows of it
    unheard[_BEFORE, 1:] += pulse * motors.T
    flight = Flight(replace(system, effectors=replace(effectors, drive_noise=unheard)))
    asked = [sensed.decision.effort.copy() for sensed in flight]
    if flight.lost:
        raise BadInput(f"loop {name}: {flight.lost.all[0]}; its margins cannot be flown")
    answers = np.array(asked[_BEFORE:])
    return FlownLoop(((answers[:, 1:] - answers[:, :1]) / pulse).swapaxes(-1, -2), quiet.run.tick_s)
