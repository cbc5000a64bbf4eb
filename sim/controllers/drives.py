"""How a demanded torque comes to act on the bodies of a formation: of itself, or through the drives of reaction wheels."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from control.allocation import PseudoInverseAllocation
from control.tracking import Estimate
from models.plants.formation_nacs import FormationNacsParameters
from models.plants.nacs import NacsParameters
from sim.faults.formation import FormationFaults
from sim.formation_randomness import Blocks, FormationStream
from sim.plant.formation import AgentsTruth
from sim.randomness import Trials
from sim.sensors.sensors import SENSOR_SETS

Array = NDArray[np.floating]

TACHOMETER = SENSOR_SETS["bench"]  # how the drives' monitor outputs are read
_UNUSED = Estimate(np.zeros(4), np.zeros(3), np.zeros(0))  # sharing by least squares looks at nobody's state


class Stored(NamedTuple):
    """Momentum that wheels hold relative to their body, (trials, agents, 3) N m s in B."""

    true: Array
    read: Array  # from tachometers


class Given(NamedTuple):
    """What is done to a plant for a tick."""

    wheel: Array  # (trials, agents wheels) N m on wheels
    body: Array  # (trials, agents, 3) N m on bodies, from outside


class Effectors(Protocol):
    """What stands between a law and the bodies."""

    def stored(self, truth: AgentsTruth) -> Stored | None:
        """What wheels hold at a tick; None without wheels. To be called once a tick."""
        ...

    def give(self, tick: int, torque: Array, outside: Array) -> Given:
        """Carry out a demanded torque, (trials, agents, 3) N m, beside one from `outside`, N m. To be called once a tick."""
        ...


class DirectTorques:
    """Torques act on the bodies of themselves."""

    def stored(self, truth: AgentsTruth) -> None:  # noqa: ARG002
        """There are no wheels."""
        return

    def give(self, tick: int, torque: Array, outside: Array) -> Given:  # noqa: ARG002
        """The torque as it is."""
        return Given(np.zeros((len(torque), 0)), torque + outside)


class Drives:
    """Four wheels of each testbed with the drives of `models/plants/nacs.py`, and the air that flows round it.

    A demand is shared by least squares, scaled as a whole where a drive's current would not do, rounded to the set-point's steps; the
    drive adds its noise, and what a failure leaves of that turns the wheel.
    """

    def __init__(self, testbed: NacsParameters, agents: int, faults: FormationFaults, seed: int, trials: Trials, dt: float) -> None:
        self._testbed, self._faults = testbed, faults
        self._allocation = PseudoInverseAllocation(testbed.wheel_axes, testbed.torque_limit)
        self._step = 2.0 * testbed.torque_limit / 2**testbed.command_bits if testbed.command_bits else 0.0
        wheels = testbed.wheel_axes.shape[1]
        self._noise = Blocks(seed, trials, FormationStream.DRIVE, (agents, wheels))
        self._misread = Blocks(seed, trials, FormationStream.TACHOMETER, (agents, wheels))
        self._gusts = Blocks(seed, trials, FormationStream.AIR, (agents, 3))
        self._fade = float(np.exp(-dt / testbed.air_torque_correlation_s))
        self._air: Array | None = None

    def stored(self, truth: AgentsTruth) -> Stored:
        """Of the speeds that wheels have, and that their drives' monitor outputs say."""
        wheels = self._testbed.wheel_axes.shape[1]
        speed = truth.omega_wheel.reshape(len(truth.omega_wheel), -1, wheels)
        step, most = TACHOMETER.wheel_step_rad_s, TACHOMETER.wheel_full_scale_rad_s
        read = np.clip(step * np.round((speed + TACHOMETER.wheel_noise_rad_s * self._misread.tick()) / step), -most, most)
        return Stored(self._momentum(speed), self._momentum(read))

    def _momentum(self, speed: Array) -> Array:
        return self._testbed.wheel_inertia_kg_m2 * (self._testbed.wheel_axes @ speed[..., None])[..., 0]

    def give(self, tick: int, torque: Array, outside: Array) -> Given:
        """Torques of motors on wheels; the bodies feel their reaction."""
        shared, _ = self._allocation.step(torque, _UNUSED, self._allocation.start(()))
        told = self._step * np.round(shared / self._step) if self._step else shared
        wheel = self._faults.wheels[tick] * (told + self._testbed.drive_torque_noise_nm * self._noise.tick())
        return Given(wheel.reshape(len(wheel), -1), outside + self._blow())

    def _blow(self) -> Array:
        """Torque of the air, a first-order Gauss-Markov process (Gelb 1974, sec. 3.6), (trials, agents, 3) N m."""
        white = self._testbed.air_torque_nm * self._gusts.tick()
        self._air = white if self._air is None else self._fade * self._air + np.sqrt(1.0 - self._fade**2) * white
        return self._air


def effectors(plant: object, agents: int, faults: FormationFaults, seed: int, trials: Trials, dt: float) -> Effectors:
    """Those of a kind of plant."""
    if isinstance(plant, FormationNacsParameters):
        return Drives(plant.testbed, agents, faults, seed, trials, dt)
    return DirectTorques()
