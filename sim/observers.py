"""Observers of a closed loop: the filters that a scenario's settings stand for, those of one kind stepped as one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from estimation.extended_kalman import ExtendedFilter
from estimation.gaussian import Belief
from estimation.interacting_multiple_model import InteractingMultipleModel
from estimation.nis_switching import SwitchedGain
from estimation.stacking import stack, stackable
from estimation.state_space import Additive, Multiplicative, StateSpace
from estimation.unscented import UnscentedFilter, euler
from models.nacs import NacsParameters
from models.process import ProcessModel, predict, predict_euler, runge_kutta
from models.quaternion import IDENTITY
from models.wheel_faults import WheelFault
from models.wheeled_body import WheeledBody
from sim.observer_settings import ExtendedSettings, Imm, Mekf, ObserverSettings, Ukf
from sim.plants import Parameters
from sim.sensors import SensorSettings

Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Models:
    """Analytic models of the plant that a filter can be built on."""

    plain: ProcessModel  # as the paper writes it
    with_drag: ProcessModel  # knows the wheels' friction
    parameters: Parameters

    @classmethod
    def of(cls, parameters: Parameters) -> Models:
        """Models of a plant."""
        return cls(believed(parameters, False), believed(parameters, True), parameters)

    @property
    def speeds_are_states(self) -> bool:
        """Whether the wheel speeds are estimated; otherwise they are read and taken as known."""
        return isinstance(self.plain, WheeledBody)


def believed(parameters: Parameters, wheel_drag: bool, fault: WheelFault | None = None) -> ProcessModel:
    """A plant's analytic model with the wheels' friction or without, and with a fault of the wheels or none."""
    if isinstance(parameters, NacsParameters):
        return parameters.process(wheel_drag=wheel_drag, fault=fault)
    return parameters.process(fault)  # wheel speeds are read, whatever slows them


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
class Bank:
    """Observers of one kind, stepped as one; beliefs are (members, trials, ...).

    Attributes:
      names: one a member.
      filter: steps them all.
      thresholds: on, off of each member's fault detector.
      speeds_are_states: whether they estimate the wheel speeds; otherwise these are read and are inputs beside the torques.
    """

    names: tuple[str, ...]
    filter: Observer
    thresholds: tuple[tuple[float, float] | None, ...]
    speeds_are_states: bool = True

    def inputs(self, known: Array) -> Array:
        """What drives its model, of commanded torques and read speeds of the wheels (trials, 2 wheels)."""
        return known[..., : known.shape[-1] // 2] if self.speeds_are_states else known

    def measured(self, reading: Array) -> Array:
        """What it takes for a measurement of a reading (trials, 7 + wheels)."""
        return reading if self.speeds_are_states else reading[..., :7]


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


GaussianFilter = ExtendedFilter | UnscentedFilter | InteractingMultipleModel


def build_filter(settings: ObserverSettings, models: Models, sensors: SensorSettings, wheels: int) -> GaussianFilter:
    """The filter that the settings stand for."""
    if not isinstance(settings, Imm):
        return _single(settings, models, sensors, wheels, None)
    members = tuple(_single(settings.filter, models, sensors, wheels, fault) for fault in settings.faults(wheels))
    limits = (settings.declare_above, settings.withdraw_below)
    return InteractingMultipleModel(members, settings.matrix, settings.start, settings.floor, *limits)


def _single(
    settings: ExtendedSettings, models: Models, sensors: SensorSettings, wheels: int, fault: WheelFault | None
) -> ExtendedFilter | UnscentedFilter:
    """A filter with one model of the wheels."""
    tuning = settings.numbers
    q, r, layer = tuning.scaled(sensors)
    multiplicative = isinstance(settings, Mekf) or (isinstance(settings, Ukf) and settings.coordinates == "multiplicative")
    counts = [3 if multiplicative else 4, 3, wheels if models.speeds_are_states else 0]
    # a rotation vector is twice the quaternion's vector part
    unit = np.array([4.0, 1.0, 1.0]) if multiplicative else np.ones(3)
    if fault is None:
        process = models.with_drag if tuning.wheel_drag else models.plain
    else:
        process = believed(models.parameters, tuning.wheel_drag, fault)
    common: dict[str, Any] = {
        "process": process,
        "process_noise": np.diag(np.repeat(unit * q, counts)),
        "measurement_noise": np.diag(np.repeat(unit * r, counts)),
        "prior": np.concatenate([IDENTITY, np.zeros(sum(counts[1:]))]),
        "prior_variance": np.repeat([1.0, 1.0, 1e4], counts),
        "space": Multiplicative() if multiplicative else Additive(),
    }
    explicit = settings.discretization == "euler"
    if isinstance(settings, Ukf):
        common |= {"alpha": settings.alpha, "beta": settings.beta, "kappa": settings.kappa}
        return UnscentedFilter(**common, integrate=euler if explicit else runge_kutta)
    return ExtendedFilter(**common, gain=settings.law(np.repeat(layer, counts)), prediction=predict_euler if explicit else predict)


def build_banks(observers: dict[str, ObserverSettings], models: Models, sensors: SensorSettings, wheels: int) -> tuple[Bank, ...]:
    """All observers of a scenario, those of one kind together."""
    groups: list[list[tuple[str, GaussianFilter]]] = []
    for name, settings in observers.items():
        single = build_filter(settings, models, sensors, wheels)
        for group in groups:
            first = group[0][1]
            if isinstance(first, ExtendedFilter) and isinstance(single, ExtendedFilter) and stackable(first, single):
                group.append((name, single))
                break
        else:
            groups.append([(name, single)])
    return tuple(
        Bank(
            names=tuple(name for name, _ in group),
            filter=stack(alike) if (alike := [f for _, f in group if isinstance(f, ExtendedFilter)]) else Alone(group[0][1]),
            thresholds=tuple(thresholds_of(single) for _, single in group),
            speeds_are_states=models.speeds_are_states,
        )
        for group in groups
    )


def thresholds_of(single: GaussianFilter) -> tuple[float, float] | None:
    """Statistic above which a filter declares a fault and below which it withdraws it, if it does."""
    if isinstance(single, InteractingMultipleModel):
        return single.declare_above, single.withdraw_below
    gain = getattr(single, "gain", None)
    return gain.thresholds if isinstance(gain, SwitchedGain) else None
