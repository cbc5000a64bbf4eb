"""An observer that learns in the loop: the joint filter of a scenario's settings, and its belief in the form of the other filters'."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimation.gaussian import Belief
from estimation.joint_unscented import JointUnscentedFilter
from estimation.state_space import StateSpace
from models.attitude.quaternion import IDENTITY
from models.dynamics.learned_torque import BodyWithLearnedTorque
from models.dynamics.measurement import WholeState
from models.dynamics.stacked_measurement import PartOfReading
from models.dynamics.state_layout import MOTION, WHEELS
from models.plants.register.entries import kind_of
from models.plants.register.parameters import BodyParameters
from sim.sensors.sensors import SensorSettings

Array = NDArray[np.floating]


class LearningMemory(NamedTuple):
    """What a learning filter keeps besides attitude and rate, as `Belief.memory`."""

    belief: Belief  # of [q, omega, W]
    learned: Array  # (1, trials, 3) N m in B, W phi at the estimate


@dataclass(frozen=True, eq=False)
class LearningObserver:
    """A joint filter as the only member of its bank; beliefs are (1, trials, ...), of attitude and rate alone."""

    filter: JointUnscentedFilter
    model: BodyWithLearnedTorque

    @property
    def space(self) -> StateSpace:
        """Error coordinates of its covariance."""
        return self.filter.space

    def initial(self, measurement: Array) -> Belief:
        """Belief after the first reading, (trials, 7 + wheels)."""
        return self._reduced(self.filter.initial(measurement[None]), np.nan_to_num(measurement[None, ..., WHEELS]))

    def step(self, belief: Belief, command: Array, measurement: Array, dt: float) -> Belief:
        """Belief after `dt` seconds of [motor torques, wheel speeds before], (trials, 2 wheels), and a reading, (trials, 7 + wheels)."""
        memory: LearningMemory = belief.memory
        after = self.filter.step(memory.belief, command[None], measurement[None], dt)
        before, speed = command[..., measurement.shape[-1] - 7 :], measurement[..., WHEELS]
        return self._reduced(after, np.where(np.isnan(speed), before, speed)[None])

    def _reduced(self, belief: Belief, speed: Array) -> Belief:
        """Attitude and rate, and the rest as what is remembered."""
        learned = self.model.torque(belief.mean[..., MOTION], belief.mean[..., MOTION.stop :], speed)  # attitude and rate, and the weights
        own = np.ascontiguousarray(belief.covariance[..., :6, :6])
        return belief._replace(mean=belief.mean[..., MOTION], covariance=own, memory=LearningMemory(belief, learned))


def learning_observer(settings: Any, parameters: BodyParameters, sensors: SensorSettings, tick_s: float) -> LearningObserver:
    """The observer that the settings stand for."""
    learnable = kind_of(parameters).learnable
    if learnable is None:
        raise ValueError(f"there is nothing to be learned of a plant of type {parameters.type!r}")
    model = BodyWithLearnedTorque(learnable.body(parameters), settings.basis(parameters.wheel_axes.shape[1]))
    q, r, _ = settings.numbers.scaled(sensors, tick_s)
    unit = np.array([4.0, 1.0, 1.0])  # a rotation vector is twice the quaternion's vector part
    state_noise, reading_noise = (np.diag(np.repeat((unit * each)[:2], 3)) for each in (q, r))
    joint = JointUnscentedFilter(
        process=model,
        process_noise=state_noise,
        parameter_noise=settings.walk(model.parameters) ** 2,
        measurement_noise=None,
        prior=np.concatenate([IDENTITY, np.zeros(3)]),
        prior_variance=np.repeat([1.0, settings.initial_rate_rad_s**2], 3),
        parameter_variance=np.full(model.parameters, settings.first_weight_nm**2),
        alpha=settings.alpha,
        beta=settings.beta,
        kappa=settings.kappa,
        fading=settings.fading.law,
        measurement=PartOfReading(WholeState(reading_noise, "rotation"), MOTION),  # wheel speeds are inputs
    )
    return LearningObserver(joint, model)
