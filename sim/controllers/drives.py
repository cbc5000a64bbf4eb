"""How a demanded torque comes to act on the bodies of a formation: of itself, or through the drives of reaction wheels."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from control.allocation import PseudoInverseAllocation
from control.tracking import Estimate
from models.plants.assembly import Assembly
from models.plants.register.entries import kind_of
from models.plants.register.kind import AirTorque, DriveErrors
from models.plants.register.parameters import SeveralParameters
from sim.faults.timeline import Timeline
from sim.plant.formation import AgentsTruth
from sim.randomness import RandomStream, Stream, Trials
from sim.sensors.sensors import SENSOR_SETS

Array = NDArray[np.floating]

TACHOMETER = SENSOR_SETS["bench"]  # how the drives' monitor outputs are read
_UNUSED = Estimate(np.zeros(4), np.zeros(3), np.zeros(0))  # sharing by least squares looks at nobody's state


class WheelMomentum(NamedTuple):
    """Momentum that wheels hold relative to their body, (trials, agents, 3) N m s in B."""

    true: Array
    read: Array  # from tachometers


class ActuatorOutput(NamedTuple):
    """What is done to a plant for a tick."""

    wheel: Array  # (trials, agents wheels) N m on wheels
    body: Array  # (trials, agents, 3) N m on bodies, from outside


class Effectors(Protocol):
    """What stands between a law and the bodies."""

    def stored(self, truth: AgentsTruth) -> WheelMomentum | None:
        """What wheels hold at a tick; None without wheels. To be called once a tick."""
        ...

    def give(self, tick: int, torque: Array, outside: Array | float) -> ActuatorOutput:
        """Carry out a demanded torque, (trials, agents, 3) N m, beside one from `outside`, N m. To be called once a tick."""
        ...


class DirectTorques:
    """Torques act on the bodies of themselves."""

    def stored(self, truth: AgentsTruth) -> None:  # noqa: ARG002
        """There are no wheels."""
        return

    def give(self, tick: int, torque: Array, outside: Array | float) -> ActuatorOutput:  # noqa: ARG002
        """The torque as it is."""
        return ActuatorOutput(np.zeros((len(torque), 0)), torque + outside)


class Drives:
    """Wheels of each body with their drives, and the air that flows round it.

    A demand is shared by least squares, scaled as a whole where a drive's current would not do, rounded to the set-point's steps; the
    drive adds its noise, and what a failure leaves of that turns the wheel.
    """

    def __init__(
        self, assembly: Assembly, errors: DriveErrors, air: AirTorque, faults: Timeline, seed: int, trials: Trials, dt: float
    ) -> None:
        self._assembly, self._errors, self._air_torque, self._faults = assembly, errors, air, faults
        self._allocation = PseudoInverseAllocation(assembly.wheel_axes, assembly.wheel_torque_limit)
        self._step = 2.0 * assembly.wheel_torque_limit / 2**errors.command_bits if errors.command_bits else 0.0
        agents, wheels = len(assembly.attitude_joints), assembly.wheel_axes.shape[1]
        self._noise = RandomStream(seed, trials, Stream.AGENTS_DRIVE, (agents, wheels))
        self._misread = RandomStream(seed, trials, Stream.AGENTS_TACHOMETER, (agents, wheels))
        self._gusts = RandomStream(seed, trials, Stream.AGENTS_AIR, (agents, 3))
        self._fade = float(np.exp(-dt / air.correlation_s))
        self._air: Array | None = None

    def stored(self, truth: AgentsTruth) -> WheelMomentum:
        """Of the speeds that wheels have, and that their drives' monitor outputs say."""
        wheels = self._assembly.wheel_axes.shape[1]
        speed = truth.omega_wheel.reshape(len(truth.omega_wheel), -1, wheels)
        step, most = TACHOMETER.wheel_step_rad_s, TACHOMETER.wheel_full_scale_rad_s
        read = np.clip(step * np.round((speed + TACHOMETER.wheel_noise_rad_s * self._misread.tick()) / step), -most, most)
        return WheelMomentum(self._momentum(speed), self._momentum(read))

    def _momentum(self, speed: Array) -> Array:
        return self._assembly.wheel_inertia * (self._assembly.wheel_axes @ speed[..., None])[..., 0]

    def give(self, tick: int, torque: Array, outside: Array | float) -> ActuatorOutput:
        """Torques of motors on wheels; the bodies feel their reaction."""
        shared, _ = self._allocation.step(torque, _UNUSED, self._allocation.start(()))
        told = self._step * np.round(shared / self._step) if self._step else shared
        wheel = self._faults.given(tick, told + self._errors.torque_noise_nm * self._noise.tick())
        return ActuatorOutput(wheel.reshape(len(wheel), -1), outside + self._blow())

    def _blow(self) -> Array:
        """Torque of the air, a first-order Gauss-Markov process (Gelb 1974, sec. 3.6), (trials, agents, 3) N m."""
        white = self._air_torque.deviation_nm * self._gusts.tick()
        self._air = white if self._air is None else self._fade * self._air + np.sqrt(1.0 - self._fade**2) * white
        return self._air


def effectors(plant: SeveralParameters, assembly: Assembly, faults: Timeline, seed: int, trials: Trials, dt: float) -> Effectors:
    """Those of a plant: the drives of its wheels, or of themselves."""
    if not assembly.wheel_joints:
        return DirectTorques()
    kind = kind_of(plant)
    errors = kind.drives(plant) if kind.drives else DriveErrors()
    air = kind.air(plant) if kind.air else AirTorque(0.0, 1.0)
    return Drives(assembly, errors, air, faults, seed, trials, dt)
