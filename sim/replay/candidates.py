"""The file of candidate controllers that a log is held against: gains or classes of one's own, and what is asked of them."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

from pydantic import Field, ValidationError, field_validator, model_validator

from control.antenna_pointing import AZIMUTH, ELEVATION
from models.sections import NonNegative, Positive, Section
from sim.bad_input import BadInput
from sim.scenario.validation import first_error
from sim.text import toml_text
from sim.text.names import WHAT_A_NAME_IS, is_a_name
from sim.user_code.candidates import METHODS
from sim.user_code.user_class import UserClass

AXES = {"x": 0, "y": 1, "z": 2, "azimuth": AZIMUTH, "elevation": ELEVATION}
MOST = 5_000  # candidates of a file

Gains = Positive | tuple[Positive, ...]
OrNone = NonNegative | tuple[NonNegative, ...]


class Gain(NamedTuple):
    """Gains of one candidate about one axis."""

    proportional: float  # N m/rad
    integral: float  # N m/(rad s)
    derivative: float  # N m s/rad
    of_error: bool  # whether the derivative is that of the error


def _each(value: float | tuple[float, ...]) -> tuple[float, ...]:
    return value if isinstance(value, tuple) else (value,)


class SpecificationSettings(Section):
    """What is asked of a controller; what is left out is that of the log's own unfalsified law, or of one with default settings."""

    pace_rad_s: Positive | None = Field(None, description="lambda, rad/s, in which the other frequencies count")
    zero: Positive = Field(0.3, description="z / lambda of both weights")
    error_bound: Positive | None = Field(None, description="M1, bound on |T_er| at high frequency")
    effort_limit_nm: Positive | None = Field(None, description="k2, bound on |T_ur| at high frequency, N m/rad; default J (zero lambda)^2")
    quantum_deg: NonNegative | None = Field(None, description="step of the angle sensor, or its noise")
    gate_quanta: NonNegative | None = Field(None, description="RMS angle, in those steps, from which on data count")


class GainSettings(Section):
    """A law by its gains, or by what they make of a rigid body; a list stands for a candidate each, all combined."""

    proportional_nm: Gains | None = Field(None, description="C_p, N m/rad")
    derivative_nms: OrNone | None = Field(None, description="C_d, N m s/rad")
    frequency_rad_s: Gains | None = Field(None, description="in place of C_p: natural frequency with the body's inertia, sqrt(C_p / J)")
    damping: OrNone | None = Field(None, description="in place of C_d: damping ratio, C_d / (2 sqrt(C_p J))")

    @model_validator(mode="after")
    def _said_once(self) -> GainSettings:
        for one, other in (("proportional_nm", "frequency_rad_s"), ("derivative_nms", "damping")):
            if (getattr(self, one) is None) == (getattr(self, other) is None):
                raise ValueError(f"{one}: give it or {other}, one of the two")
        return self

    @property
    def lists(self) -> tuple[tuple[float, ...], ...]:
        """C_p or frequency, C_d or damping, as lists."""
        first = self.proportional_nm if self.proportional_nm is not None else self.frequency_rad_s
        second = self.derivative_nms if self.derivative_nms is not None else self.damping
        assert first is not None
        assert second is not None
        return _each(first), _each(second)

    def pair(self, first: float, second: float, inertia: float) -> tuple[float, float]:
        """C_p and C_d with an inertia, kg m2, of a combination of `lists`."""
        proportional = first if self.proportional_nm is not None else inertia * first**2
        return proportional, second if self.derivative_nms is not None else 2.0 * second * (proportional * inertia) ** 0.5


class PdCandidate(GainSettings):
    """u = C_p (r - y) - C_d dy/dt (eq. 8)."""

    type: Literal["pd"]

    def gains(self, inertia: float) -> list[Gain]:
        """All combinations."""
        return [Gain(p, 0.0, d, False) for p, d in (self.pair(one, other, inertia) for one, other in itertools.product(*self.lists))]


class PidCandidate(GainSettings):
    """u = C_p e + C_I int e dt + C_d de/dt with e = r - y (eq. 5)."""

    type: Literal["pid"]
    integral_per_s: OrNone = Field(description="C_I / C_p, 1/s")
    derivative: Literal["error", "rate"] = Field("error", description="of the error, as in eq. 5, or of the measured rate, as in eq. 8")

    def gains(self, inertia: float) -> list[Gain]:
        """All combinations."""
        found = []
        for first, second, integral in itertools.product(*self.lists, _each(self.integral_per_s)):
            proportional, derivative = self.pair(first, second, inertia)
            found.append(Gain(proportional, proportional * integral, derivative, self.derivative == "error"))
        return found


class OwnCandidate(Section):
    """A class of the user's."""

    type: Literal["class"]
    law: str = Field(description="FILE.py:CLASS, its path relative to the folder of the candidates' file; run as code")


Candidate = Annotated[PdCandidate | PidCandidate | OwnCandidate, Field(discriminator="type")]


class Candidates(Section):
    """A file of candidates."""

    axes: tuple[Literal["x", "y", "z", "azimuth", "elevation"], ...] = Field((), description="body axes that they are for; default: all")
    specification: SpecificationSettings = SpecificationSettings()
    candidates: dict[str, Candidate]

    @field_validator("candidates")
    @classmethod
    def _some(cls, candidates: dict[str, Candidate]) -> dict[str, Candidate]:
        if not candidates:
            raise ValueError("there is none; give [candidates.NAME] with a type")
        for name in candidates:
            if not is_a_name(name):
                raise ValueError(f"{name[:40]!r} cannot be a name: {WHAT_A_NAME_IS}")
        count = sum(1 if isinstance(one, OwnCandidate) else len(one.gains(1.0)) for one in candidates.values())
        if count > MOST:
            raise ValueError(f"the lists make {count} candidates; at most {MOST} can be judged at once")
        return candidates

    def databank(self, inertia: float) -> dict[str, Gain]:
        """Gains about an axis of that inertia, kg m2, by the candidate's name; of several of a list each has its number."""
        found: dict[str, Gain] = {}
        for name, one in self.candidates.items():
            if not isinstance(one, OwnCandidate):
                several = one.gains(inertia)
                found |= {name if len(several) == 1 else f"{name}/{i + 1}": gain for i, gain in enumerate(several)}
        return found


def load(path: Path) -> tuple[Candidates, dict[str, UserClass]]:
    """A file, and the user's classes that it names, by the candidate's name; raises BadInput, one line."""
    label = f"--candidates {path}"
    data = toml_text.read(path, label)
    try:
        file = Candidates.model_validate(data)
    except ValidationError as invalid:
        raise BadInput(f"{label}: {first_error(invalid, data, Candidates)}") from None
    own = {name: one for name, one in file.candidates.items() if isinstance(one, OwnCandidate)}
    return file, {name: UserClass(str(path.parent / one.law), f"{label}: candidates.{name}.law", METHODS) for name, one in own.items()}
