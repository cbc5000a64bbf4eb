"""Controllers of a scenario: their settings in a file, and the laws that they stand for."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from control.allocation import Allocation, DirectTorque, PseudoInverseAllocation
from control.antenna_pointing import AXES, HELD, AntennaPointing
from control.disturbance_compensation import DisturbanceCompensation
from control.feed_forward import BodyModel
from control.mode_weighted_allocation import ModeWeightedAllocation
from control.output_feedback import OutputFeedback
from control.proportional_derivative import ProportionalDerivative
from control.sliding_mode import SlidingMode
from control.torque_limit import AxisLimited
from control.tracking import Controller, RememberingController
from control.unfalsified import COARSEST, UnfalsifiedController
from models.dynamics.wheel_faults import WheelFault
from models.plants.assembly import Assembly
from models.sections import NonNegative, Positive, Section

Array = NDArray[np.floating]

Gain = Positive | tuple[Positive, ...]


class PseudoInverseSettings(Section):
    """Least-squares sharing among all wheels."""

    type: Literal["pseudo-inverse"] = "pseudo-inverse"


class ModeWeightedSettings(Section):
    """Least-squares sharing weighted with the probable health of every wheel, with a latch."""

    type: Literal["mode-weighted"]
    latch_above: Annotated[float, Field(gt=0.5, lt=1)] = Field(
        0.7,
        description="probability of a mode that is then believed for good; the less a suspect wheel is used, the less evidence there is",
    )
    latch_ticks: Annotated[int, Field(ge=1, le=1_000_000)] = Field(10, description="ticks for which it must last")


AllocationSettings = Annotated[PseudoInverseSettings | ModeWeightedSettings, Field(discriminator="type")]


class LawSettings(Section, ABC):
    """What all laws can be told."""

    allocation: AllocationSettings = PseudoInverseSettings()
    feedback: str = Field(description="who tells the controller the state: an observer, `truth` or `measurement`")

    @property
    def gains(self) -> dict[str, float | tuple[float, ...]]:
        """The gains that can differ between modes, by key."""
        return {}

    @property
    def clipped_at_nm(self) -> float | None:
        """What the demand is clipped to about each body axis; None: by the drives alone."""
        return None

    @property
    def late_ticks(self) -> int:
        """Ticks from a decision to its torque."""
        return 0

    def check(self, where: str, tick_s: float) -> None:
        """Raise ValueError if the law cannot do with so few decisions; complaints begin with `where`."""

    @abstractmethod
    def controller(self, assembly: Assembly, tick_s: float) -> Controller | RememberingController:
        """The law with its limit, believing the plant's own inertia and wheels."""

    def allocator(self, assembly: Assembly, modes: tuple[WheelFault, ...]) -> Allocation:
        """How its torque is shared among the wheels; `modes` are those of the feedback observer."""
        if not assembly.wheel_joints:
            return DirectTorque()
        if isinstance(self.allocation, PseudoInverseSettings):
            return PseudoInverseAllocation(assembly.wheel_axes, assembly.wheel_torque_limit)
        health = np.stack([1.0 - mode.indicator for mode in modes])
        latch = (self.allocation.latch_above, self.allocation.latch_ticks)
        return ModeWeightedAllocation(assembly.wheel_axes, assembly.wheel_torque_limit, health, *latch)


class MemorylessSettings(LawSettings):
    """What laws without a memory have in common."""

    axis_limit_nm: Positive | None = Field(None, description="the demand is clipped to this about each body axis before it is allocated")
    compensate_learned: bool = Field(False, description="subtracts the torque that the feedback observer has learned")

    @property
    def clipped_at_nm(self) -> float | None:
        """The limit."""
        return self.axis_limit_nm

    @abstractmethod
    def law(self, model: BodyModel) -> Controller:
        """The law on its own."""

    def controller(self, assembly: Assembly, tick_s: float) -> Controller:  # noqa: ARG002
        """The law with its limit, believing the plant's own inertia and wheels."""
        law = self.law(BodyModel(assembly.inertia, assembly.wheel_inertia * assembly.wheel_axes))
        whole = DisturbanceCompensation(law) if self.compensate_learned else law
        return AxisLimited(whole, self.axis_limit_nm) if self.axis_limit_nm else whole


class PdSettings(MemorylessSettings):
    """Quaternion feedback on the tracking error; a list of gains has one for each mode of the feedback observer."""

    type: Literal["pd"]
    proportional_nm: Gain = Field(0.4, description="K_p")
    derivative_nms: Gain = Field(0.075, description="K_d")
    feed_forward: bool = Field(False, description="adds the torque that the model needs on the reference")

    @property
    def gains(self) -> dict[str, float | tuple[float, ...]]:
        """K_p and K_d."""
        return {"proportional_nm": self.proportional_nm, "derivative_nms": self.derivative_nms}

    def law(self, model: BodyModel) -> Controller:
        """The law on its own."""
        return ProportionalDerivative(self.proportional_nm, self.derivative_nms, model if self.feed_forward else None)


class SlidingModeSettings(MemorylessSettings):
    """Sliding mode on rate and quaternion error; a list of gains has one for each mode of the feedback observer."""

    type: Literal["sliding-mode"]
    slope_rad_s: Gain = Field(description="lambda: rate error per unit of quaternion error on the surface")
    reaching_rad_s2: Gain = Field(description="K: deceleration towards the surface, each axis")
    boundary_layer_rad_s: NonNegative = Field(0.0, description="within it the law is linear; 0: a pure switch")

    @property
    def gains(self) -> dict[str, float | tuple[float, ...]]:
        """Lambda and K."""
        return {"slope_rad_s": self.slope_rad_s, "reaching_rad_s2": self.reaching_rad_s2}

    def law(self, model: BodyModel) -> Controller:
        """The law on its own."""
        return SlidingMode(self.slope_rad_s, self.reaching_rad_s2, model, self.boundary_layer_rad_s)


class OutputFeedbackSettings(MemorylessSettings):
    """Backstepping on an observer's rate for a body without rate gyro (Rososhansky 2017, eq. 3.12, its Greek letters derived anew)."""

    type: Literal["output-feedback"]
    k1_rad_s: Positive = Field(0.05, description="rate asked for a unit of quaternion error (to the power a)")
    k2_per_s: Positive = Field(15.0, description="how fast that rate is approached")
    gamma_per_s: NonNegative = Field(2.0, description="gain of the observer that the law is made for; 0 leaves its correction out")
    kappa: NonNegative = Field(10.0, description="another")
    power: Annotated[float, Field(gt=0.5, le=1)] = Field(1.0, description="a: linear at one, as printed; in finite time below")
    shortest: bool = Field(False, description="turn to the nearer of q and -q, which are one attitude; as printed to q_4 = 1")

    def law(self, model: BodyModel) -> Controller:
        """The law on its own."""
        return OutputFeedback(model, self.k1_rad_s, self.k2_per_s, self.gamma_per_s, self.kappa, self.power, self.shortest)


class UnfalsifiedSettings(LawSettings):
    """Azimuth and elevation by PD laws that are replaced when data falsify them; body y held by a fixed PD."""

    type: Literal["unfalsified"]
    pace_rad_s: Positive = Field(1.0, description="lambda, in which all frequencies of the design count")
    inertia_error: Annotated[float, Field(gt=-1)] = Field(-0.1, description="of the inertia believed: J^ = (1 + error) J")
    frequency: Positive = Field(0.05, description="natural frequency of the first controller / lambda")
    damping: Positive = Field(1.0, description="of the first controller")
    frozen: bool = Field(False, description="keep the first controller whatever the data say")
    gate_quanta: NonNegative = Field(20.0, description="RMS angle, in steps of the sensor, from which on data count")
    quantum_deg: NonNegative = Field(0.001, description="step of the angle sensor")
    error_bound: Positive = Field(2.25, description="M1 of the weight W1 on the error")
    archive: Annotated[int, Field(ge=4, le=100_000)] = Field(40, description="past tests kept")
    candidates: Literal["pd", "pid"] = Field("pd", description="whether laws with integral action are candidates too")
    integrals: tuple[Positive, ...] = Field((0.01, 0.02, 0.05), description="of those: C_I / C_p over lambda")
    delay_ticks: Annotated[int, Field(ge=0, le=100_000)] = Field(0, description="from a decision to its torque")

    @property
    def late_ticks(self) -> int:
        """Its delay."""
        return self.delay_ticks

    def check(self, where: str, tick_s: float) -> None:
        """Raise ValueError if the tick does not follow the design's frequencies."""
        if self.pace_rad_s * tick_s > COARSEST:
            raise ValueError(f"{where}.pace_rad_s: {self.pace_rad_s:g} rad/s needs run.tick_s at most {COARSEST / self.pace_rad_s:g} s")

    def controller(self, assembly: Assembly, tick_s: float) -> AntennaPointing:
        """The law, believing an inertia that is off by the given error."""
        moments = np.diag(assembly.inertia)
        believed = (1.0 + self.inertia_error) * moments
        channels = UnfalsifiedController(
            inertia=believed[AXES],
            pace=self.pace_rad_s,
            tick_s=tick_s,
            quantum=float(np.radians(self.quantum_deg)),
            gate=self.gate_quanta,
            error_bound=self.error_bound,
            effort_limit=moments[AXES] * (0.3 * self.pace_rad_s) ** 2,
            frequency=self.frequency,
            damping=self.damping,
            capacity=self.archive,
            frozen=self.frozen,
            integrals=self.integrals if self.candidates == "pid" else (),
        )
        stiffness = moments[HELD] * (0.2 * self.pace_rad_s) ** 2
        return AntennaPointing(channels, stiffness, 2.0 * 0.7 * np.sqrt(stiffness * moments[HELD]), self.delay_ticks)


ControlSettings = Annotated[PdSettings | SlidingModeSettings | OutputFeedbackSettings | UnfalsifiedSettings, Field(discriminator="type")]
