"""Observers of a closed loop: the filters that a scenario's settings stand for, those of one kind stepped as one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from estimation.adaptive_unscented import AdaptiveUnscentedFilter
from estimation.choice import choose
from estimation.extended_kalman import ExtendedFilter
from estimation.gaussian import Belief, Detection, LostDefiniteness, no_detection
from estimation.interacting_multiple_model import InteractingMultipleModel
from estimation.nis_switching import SwitchedGain
from estimation.particle import ParticleFilter
from estimation.proposals import PROPOSALS, ConstantNoise
from estimation.resampling import SCHEMES
from estimation.stacking import stack, stackable
from estimation.state_space import Additive, Multiplicative, Signed, StateSpace
from estimation.unscented import UnscentedFilter, euler
from models.attitude.quaternion import IDENTITY
from models.dynamics.measurement import MeasurementModel, WholeState
from models.dynamics.process import ProcessModel, predict, predict_euler, runge_kutta
from models.dynamics.stacked_measurement import PartOfReading
from models.dynamics.state_layout import MOTION
from models.dynamics.vector_part_measurement import VectorPart
from models.dynamics.wheel_faults import WheelFault
from models.plants.register.entries import kind_of
from models.plants.register.parameters import BodyParameters
from sim.estimators.learning_observer import LearningObserver, learning_observer
from sim.estimators.learning_settings import Learning
from sim.estimators.particle_draws import ParticleDraws
from sim.estimators.particle_observer import ParticleObserver
from sim.estimators.settings import Aukf, ExtendedSettings, Imm, Mekf, ObserverSettings, Pf, Ukf
from sim.randomness import Trials
from sim.sensors.sensors import SensorSettings

Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Models:
    """Analytic models of the plant that a filter can be built on."""

    plain: ProcessModel  # as the paper writes it
    with_drag: ProcessModel  # knows the wheels' friction
    parameters: BodyParameters

    @classmethod
    def of(cls, parameters: BodyParameters) -> Models:
        """Models of a plant."""
        believed = kind_of(parameters).believed
        return cls(believed(parameters, False, None), believed(parameters, True, None), parameters)

    def believing(self, wheel_drag: bool, fault: WheelFault | None) -> ProcessModel:
        """The model that believes in a fault of the wheels, or none."""
        if fault is None:
            return self.with_drag if wheel_drag else self.plain
        return kind_of(self.parameters).believed(self.parameters, wheel_drag, fault)

    @property
    def speeds_are_states(self) -> bool:
        """Whether the wheel speeds are estimated; otherwise they are read and taken as known."""
        return "wheels" in kind_of(self.parameters).layout(self.parameters).places


class Observer(Protocol):
    """A filter as the loop sees it."""

    @property
    def space(self) -> StateSpace:
        """Error coordinates of its covariance."""
        ...

    def initial(self, measurement: Array) -> Belief:
        """Belief after the first reading, (trials, n)."""
        ...

    def step(self, belief: Belief, command: Array, measurement: Array, dt: float) -> Belief:
        """Belief after `dt` seconds of `command`, (trials, wheels), and a reading, (trials, n)."""
        ...


@dataclass(frozen=True, eq=False)
class FilterBank:
    """Observers of one kind, stepped as one; beliefs are (members, trials, ...).

    Attributes:
      names: one a member.
      filter: steps them all.
      thresholds: on, off of each member's fault detector.
      speeds_are_states: whether they estimate the wheel speeds; otherwise these are read and are inputs beside the torques.
      whole: whether they are told all that is known and read, and take from it what they need.
    """

    names: tuple[str, ...]
    filter: Observer
    thresholds: tuple[tuple[float, float] | None, ...]
    speeds_are_states: bool = True
    whole: bool = False

    @property
    def space(self) -> StateSpace:
        """Error coordinates of its covariance."""
        return self.filter.space

    def initial(self, reading: Array) -> Belief:
        """Belief after the first reading, (trials, 7 + wheels)."""
        return self.filter.initial(reading)

    def step(self, belief: Belief, known: Array, reading: Array, dt: float) -> Belief:
        """Belief after `dt` seconds of what is known of the drives, (trials, 2 wheels) or (trials, 3), and a reading."""
        return self.filter.step(belief, self.inputs(known), reading, dt)

    def summary(self, belief: Belief) -> Belief:
        """The belief as it is."""
        return belief

    def put_back(self, where: NDArray[np.bool_], first: Belief, belief: Belief) -> Belief:
        """The first belief in some trials, (trials,)."""
        whole, nothing = belief.detection, no_detection(np.zeros((1, len(where))))
        parts: Belief = choose(where[None], first._replace(detection=nothing), belief._replace(detection=nothing))
        own = first.detection
        history = tuple(  # of filters that are stacked each has its own, without an axis of members
            choose(where[(None,) * (now.ndim - 2)], then, now) for then, now in zip(own.history, whole.history, strict=True)
        )
        statistic, declared = (choose(where[None], *pair) for pair in ((own.statistic, whole.statistic), (own.declared, whole.declared)))
        return parts._replace(detection=Detection(statistic, declared, history))

    def rewind(self) -> None:
        """Take the last step's random numbers again at the next one."""
        if isinstance(self.filter, ParticleObserver):
            self.filter.draws.rewind()

    def blame(self, failure: LostDefiniteness) -> tuple[int, str]:
        """The trial and the filter whose covariance it is."""
        member, trial = failure.where[-2:]
        return trial, f"{self.names[member]}: its innovation covariance lost definiteness"

    def inputs(self, known: Array) -> Array:
        """What drives its model, of commanded torques and read speeds of the wheels (trials, 2 wheels)."""
        return known[..., : known.shape[-1] // 2] if self.speeds_are_states and not self.whole else known


@dataclass(frozen=True, eq=False)
class Alone:
    """A filter as the only member of its bank."""

    filter: Observer

    @property
    def space(self) -> StateSpace:
        """Error coordinates of its covariance."""
        return self.filter.space

    def initial(self, measurement: Array) -> Belief:
        """Belief (1, trials, ...) after the first reading, (trials, n)."""
        return self.filter.initial(measurement[None])

    def step(self, belief: Belief, command: Array, measurement: Array, dt: float) -> Belief:
        """Belief after `dt` seconds of `command`, (trials, r), and a reading, (trials, n)."""
        return self.filter.step(belief, command[None], measurement[None], dt)


GaussianFilter = ExtendedFilter | UnscentedFilter | AdaptiveUnscentedFilter | InteractingMultipleModel
Single = GaussianFilter | ParticleObserver | LearningObserver


def build_filter(settings: ExtendedSettings | Imm, models: Models, sensors: SensorSettings, wheels: int) -> GaussianFilter | ParticleFilter:
    """The filter that the settings stand for."""
    if not isinstance(settings, Imm):
        return _single(settings, models, sensors, wheels, None)
    members = tuple(_member(settings.filter, models, sensors, wheels, fault) for fault in settings.faults(wheels))
    limits = (settings.declare_above, settings.withdraw_below)
    return InteractingMultipleModel(members, settings.matrix, settings.start, settings.floor, *limits)


def _member(
    settings: ExtendedSettings, models: Models, sensors: SensorSettings, wheels: int, fault: WheelFault
) -> ExtendedFilter | UnscentedFilter:
    """A filter with the model of a mode."""
    single = _single(settings, models, sensors, wheels, fault)
    assert isinstance(single, ExtendedFilter | UnscentedFilter)
    return single


def _single(
    settings: ExtendedSettings, models: Models, sensors: SensorSettings, wheels: int, fault: WheelFault | None
) -> ExtendedFilter | UnscentedFilter | AdaptiveUnscentedFilter | ParticleFilter:
    """A filter with one model of the wheels."""
    tuning = settings.numbers
    q, r, layer = tuning.scaled(sensors)
    multiplicative = isinstance(settings, Mekf) or (isinstance(settings, Ukf) and settings.coordinates == "multiplicative")
    counts = [3 if multiplicative else 4, 3, wheels if models.speeds_are_states else 0]
    unit = np.array([4.0, 1.0, 1.0]) if multiplicative else np.ones(3)  # a rotation vector is twice the quaternion's vector part
    by_vector = isinstance(settings, Aukf | Pf) and settings.measured == "vector"
    space: StateSpace = Multiplicative() if multiplicative else Signed() if by_vector else Additive()
    noise_of_reading = np.diag(np.repeat(unit * r, counts))
    read: MeasurementModel = VectorPart(noise_of_reading) if by_vector else WholeState(noise_of_reading, space.attitude)
    if not models.speeds_are_states:
        read = PartOfReading(read, MOTION)  # wheel speeds are inputs
    common: dict[str, Any] = {
        "process": models.believing(tuning.wheel_drag, fault),
        "process_noise": np.diag(np.repeat(unit * q, counts)),
        "measurement_noise": None,
        "measurement": read,
        "prior": np.concatenate([IDENTITY, np.zeros(sum(counts[1:]))]),
        "prior_variance": np.repeat([1.0, settings.initial_rate_rad_s**2, 1e4], counts),
        "space": space,
    }
    explicit = settings.discretization == "euler"
    noise = tuning.matched.law if tuning.matched else ConstantNoise.of(common["process_noise"])
    if isinstance(settings, Pf):
        return ParticleFilter(
            **common | {"process_noise": noise},
            particles=settings.particles,
            proposal=PROPOSALS[settings.proposal],
            resampling=SCHEMES[settings.resampling],
            threshold=settings.threshold,
            roughening=settings.roughening,
            integrate=euler if explicit else runge_kutta,
        )
    if isinstance(settings, Ukf):
        common |= {"alpha": settings.alpha, "beta": settings.beta, "kappa": settings.kappa}
        unscented = UnscentedFilter(**common, integrate=euler if explicit else runge_kutta)
        if isinstance(settings, Aukf):
            return AdaptiveUnscentedFilter(unscented, noise, settings.fading.law)
        return unscented
    return ExtendedFilter(**common, gain=settings.law(np.repeat(layer, counts)), prediction=predict_euler if explicit else predict)


def build_filter_banks(
    observers: dict[str, ObserverSettings],
    models: Models,
    sensors: SensorSettings,
    wheels: int,
    seed: int = 0,
    trials: Trials | None = None,
) -> tuple[FilterBank, ...]:
    """All observers of a scenario, those of one kind together; random numbers of particle filters are those of the given trials."""
    groups: list[list[tuple[str, Single]]] = []
    for name, settings in observers.items():
        if isinstance(settings, Learning):
            groups.append([(name, learning_observer(settings, models.parameters, sensors))])
            continue
        single = build_filter(settings, models, sensors, wheels)
        if isinstance(single, ParticleFilter):
            if trials is None:
                raise ValueError(f"{name}: a particle filter needs random numbers, those of numbered trials")
            numbers = ParticleDraws.of_a_filter(name, seed, trials, single.particles, single.size, single.roughening > 0.0)
            groups.append([(name, ParticleObserver(single, numbers))])
            continue
        for group in groups:
            first = group[0][1]
            if isinstance(first, ExtendedFilter) and isinstance(single, ExtendedFilter) and stackable(first, single):
                group.append((name, single))
                break
        else:
            groups.append([(name, single)])
    return tuple(
        FilterBank(
            names=tuple(name for name, _ in group),
            filter=_as_one([single for _, single in group]),
            thresholds=tuple(thresholds_of(single) for _, single in group),
            speeds_are_states=models.speeds_are_states,
            whole=isinstance(group[0][1], LearningObserver),
        )
        for group in groups
    )


def _as_one(group: list[Single]) -> Observer:
    """Filters of one kind; those that are no extended ones come alone."""
    if alike := [single for single in group if isinstance(single, ExtendedFilter)]:
        return stack(alike)
    return group[0] if isinstance(group[0], ParticleObserver | LearningObserver) else Alone(group[0])


def thresholds_of(single: Single) -> tuple[float, float] | None:
    """Statistic above which a filter declares a fault and below which it withdraws it, if it does."""
    if isinstance(single, InteractingMultipleModel):
        return single.declare_above, single.withdraw_below
    gain = getattr(single, "gain", None)
    return gain.thresholds if isinstance(gain, SwitchedGain) else None
