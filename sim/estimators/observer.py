"""What all observers of one body can be told in a file, and what a closed loop asks of their settings."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.dynamics.wheel_faults import WheelFault
from models.sections import Section
from sim.estimators.believed import Models
from sim.estimators.tunings import LEAST_VARIANCE, TUNINGS, Tuning
from sim.sensors.sensors import SensorSettings

Array = NDArray[np.floating]


class Place(NamedTuple):
    """Where a filter is to work."""

    models: Models
    sensors: SensorSettings
    wheels: int
    tick_s: float


class ObserverBase(Section, ABC):
    """Settings of an observer; each class with a `type` is one more kind that a file can name.

    Attributes:
      learns: whether it learns the plant's unmodelled torque.
      declares: whether it declares faults.
    """

    learns: ClassVar[bool] = False
    declares: ClassVar[bool] = False
    kinds: ClassVar[list[type[ObserverBase]]] = []

    tuning: str | Tuning

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        """Join the register."""
        super().__pydantic_init_subclass__(**kwargs)
        if "type" in cls.__annotations__:
            cls.kinds.append(cls)

    @property
    def numbers(self) -> Tuning:
        """The tuning, by name or as given."""
        return TUNINGS[self.tuning] if isinstance(self.tuning, str) else self.tuning

    @property
    def mode_settings(self) -> tuple[Any, ...]:
        """Modes of operation that it tells apart, the healthy one first; none if it has one model."""
        return ()

    def faults(self, wheels: int) -> tuple[WheelFault, ...]:
        """What is wrong with the wheels in each of its modes; of one with a single model nothing."""
        return (WheelFault.healthy(wheels),)

    def check(self, where: str, wheels: int) -> None:  # noqa: ARG002
        """Raise ValueError, beginning with `where`, if no innovation covariance could be inverted."""
        noise = self.numbers.measurement_noise
        if not isinstance(noise, str) and min(noise) < LEAST_VARIANCE:
            raise ValueError(
                f"{where}.tuning.measurement_noise: {min(noise):g} makes the innovation covariance singular; needs {LEAST_VARIANCE:g}"
            )

    def warnings(self, where: str, wheel_axes: Array, tick_s: float) -> list[str]:  # noqa: ARG002
        """What may be meant but deserves a word, a line each."""
        return self.numbers.warnings(f"{where}.tuning", tick_s)

    @abstractmethod
    def build(self, place: Place) -> Any:
        """The filter that the settings stand for."""
