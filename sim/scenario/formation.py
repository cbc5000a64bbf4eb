"""Scenario files of formations: what is in them, checked before anything runs."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationInfo, field_validator, model_validator

from control.communication_graph import CommunicationGraph
from control.formation_law import Gains
from models.plants.inertia import why_impossible
from models.plants.register.entries import kind_of
from models.sections import NonNegative, Ordinal, Positive, Section
from sim.estimators.rodrigues_settings import ObserverSettings
from sim.faults.formation import AddedInertia, ConstantCommand, Cut, Fault, OtherGains, Readings, WheelFailure
from sim.plant.kinds import FormationSettings
from sim.scenario.run import Published, RunSettings

Array = NDArray[np.floating]


# sigma at t = 0 (Rososhansky 2017, table 4.1)
_TWO, _THREE = 2.0**0.5, 3.0**0.5
STARTS: tuple[tuple[float, float, float], ...] = (
    (0.0, 1.0, _THREE),
    (-0.4, -0.4, -0.4 * _TWO),
    (1.4 * _THREE, 1.4, 0.0),
    (-0.6 * _THREE, 0.0, -0.6),
    (1.5, 1.5 * _TWO, 1.5),
    (-1.2, -1.2, -1.2 * _TWO),
)
RESERVED = ("truth", "leader", "all")


class GraphSettings(Section):
    """Links; the published ring if none are given (Rososhansky 2017, sec. 4.3)."""

    links: tuple[tuple[Ordinal, Ordinal, Positive], ...] = ((1, 2, 0.4), (1, 6, 0.6), (2, 3, 0.6), (3, 4, 0.6), (4, 5, 0.8), (5, 6, 0.6))
    leader: tuple[tuple[Ordinal, Positive], ...] = Field(((1, 0.5), (6, 0.5)), description="who sees it")
    when_lost: Literal["hold", "skip"] = Field("hold", description="a message that does not come: the last one holds, or counts nothing")


class LeaderSettings(Section):
    """sigma_0 = radius [cos rate t, sin rate t, height]."""

    radius: float = 0.2
    rate_rad_s: float = 0.2
    height: float = _THREE

    def motion(self, time: Array) -> Array:
        """[sigma, its rate, its second derivative] at (...,) s, (..., 9)."""
        turn, zero = self.rate_rad_s * time, np.zeros_like(time)
        cosine, sine, w = np.cos(turn), np.sin(turn), self.rate_rad_s
        parts = [cosine, sine, zero + self.height, -w * sine, w * cosine, zero, -(w**2) * cosine, -(w**2) * sine, zero]
        return self.radius * np.stack(parts, axis=-1)


class StartSettings(Section):
    """State at t = 0: at rest."""

    mrp: tuple[tuple[float, float, float], ...] = Field(
        STARTS, min_length=1, description="sigma of each agent, over again if there are more"
    )


class LawSettings(Section):
    """Gains of the law and of the filter of the leader's acceleration."""

    k1: NonNegative = 0.5
    k2: NonNegative = 15.0
    k3: NonNegative = 20.0
    gamma: NonNegative = 10.0
    lambda_: NonNegative = Field(2.0, alias="lambda")
    acceleration_gain: NonNegative = 10.0
    acceleration_sign: Literal[-1, 1] = Field(-1, description="+1: as eq. 4.10 is printed")

    @property
    def gains(self) -> Gains:
        """Of the law."""
        return Gains(self.k1, self.k2, self.k3, self.gamma, self.lambda_)


class LoopSettings(Section):
    """One closed loop."""

    feedback: str = Field(description="truth, or an observer's name")
    watching: tuple[str, ...] = Field((), description="observers that do not close the loop")
    law: LawSettings = LawSettings()
    shadow: bool = Field(False, description="attitudes are taken of the set with |sigma| <= 1, and change over where it ends")


class FormationScenario(Section):
    """One scenario file of a formation."""

    family: ClassVar[str] = "formation"

    title: str
    source: str = Field(description="seed equation, table or figure that it comes from")
    run: RunSettings
    plant: FormationSettings
    graph: GraphSettings = GraphSettings()
    leader: LeaderSettings = LeaderSettings()
    start: StartSettings = StartSettings()
    reading_deviation: NonNegative = Field(1e-4, description="of each component of sigma, a reading")
    observers: dict[str, ObserverSettings] = Field({}, description="by name")
    loops: dict[str, LoopSettings]
    faults: tuple[Fault, ...] = ()
    phases: dict[str, tuple[NonNegative, Positive]] = Field({}, description="windows of time with metrics of their own: [start, end] in s")
    published: Published | None = None

    @field_validator("loops")
    @classmethod
    def _some(cls, loops: dict[str, LoopSettings]) -> dict[str, LoopSettings]:
        if not loops:
            raise ValueError("no loop is flown")
        return loops

    @model_validator(mode="after")
    def _fits_together(self, info: ValidationInfo) -> FormationScenario:
        agents = self.plant.agents
        if len(self.plant.believed_inertia) != agents:
            raise ValueError(f"plant: {agents} agents, but {len(self.plant.believed_inertia)} believed inertias")
        numbers = [n for i, j, _ in self.graph.links for n in (i, j)] + [n for n, _ in self.graph.leader]
        if beyond := [n for n in numbers if n > agents]:
            raise ValueError(f"graph: there is no agent {beyond[0]}; there are {agents}")
        try:
            graph = self.communication()
        except ValueError as complaint:
            raise ValueError(f"graph: {complaint}") from None
        known = ["truth", *self.observers, *(info.context or {}).get("guests", ())]
        for name, loop in self.loops.items():
            for observer in (loop.feedback, *loop.watching):
                if observer not in known:
                    raise ValueError(f"loops.{name}: there is no observer {observer!r}; there are {', '.join(known)}")
        if taken := [name for name in self.observers if name in RESERVED]:
            raise ValueError(f"observers: {taken[0]!r} means something else")
        if abs(self.run.tick_s / self.plant.step_s - max(1, round(self.run.tick_s / self.plant.step_s))) > 1e-9:
            raise ValueError(f"run.tick_s = {self.run.tick_s:g} is not a whole number of physics steps of {self.plant.step_s:g} s")
        duration = self.run.ticks * self.run.tick_s
        for name, (start, end) in self.phases.items():
            if not start < end <= duration * (1 + 1e-9):
                raise ValueError(f"phases.{name}: [{start:g}, {end:g}] s is not inside the run of {duration:g} s")
        linked = {(int(a) + 1, int(b)) for a, b in graph.ways}
        for number, fault in enumerate(self.faults):
            label = f"faults.{number} ({fault.kind})"
            if fault.start_s >= duration:
                raise ValueError(f"{label}: begins at {fault.start_s:g} s, the run ends at {duration:g} s")
            if isinstance(fault, ConstantCommand | WheelFailure | OtherGains):
                most = 0 if fault.agents == "all" else max(fault.agents, default=0)
                if most > agents:
                    raise ValueError(f"{label}: there is no agent {most}; there are {agents}")
            if isinstance(fault, WheelFailure) and fault.wheel > self.wheels:
                raise ValueError(f"{label}: there is no wheel {fault.wheel}; each agent has {self.wheels}")
            if isinstance(fault, Cut):
                for i, j in fault.links:
                    if (j, i) not in linked and (i, j) not in linked:
                        raise ValueError(f"{label}: there is no link {i}-{j}")
            if isinstance(fault, AddedInertia):
                self._can_be_had(label, fault)
        return self

    def _can_be_had(self, label: str, fault: AddedInertia) -> None:
        """Raise ValueError if bodies with more inertia are none."""
        kind = kind_of(self.plant)
        if kind.any_tensor(self.plant):
            return
        wholes = self.plant.inertia + np.diag(fault.add_kg_m2)
        moments = kind.prepare(self.plant).reassemble(wholes, self.plant.centres_of_mass).moments
        carried = moments[..., None] * np.eye(3)  # what is left for each body that carries wheels and masses
        for agent, (whole, own) in enumerate(zip(wholes, carried, strict=True)):
            if reason := why_impossible(whole) or why_impossible(own):
                raise ValueError(f"{label}: no rigid body has the inertia of agent {agent + 1}, {reason}")

    @property
    def loop_names(self) -> tuple[str, ...]:
        """Names of all closed loops."""
        return tuple(self.loops)

    def warnings(self) -> list[str]:
        """What may be meant but deserves a word, a line each."""
        said = kind_of(self.plant).warnings(self.plant)
        if any(loop.law.acceleration_sign > 0 for loop in self.loops.values()):
            said.append("loops: with acceleration_sign = 1 the estimates of the leader's acceleration run away")
        if any(isinstance(fault, Readings) and np.abs(fault.bias) > 0 for fault in self.faults):
            said.append("faults: a bias that all readings share is followed by every filter, since nothing tells it from an attitude")
        for fault in self.faults:
            if isinstance(fault, Cut) and len({j for i, j in fault.links if i == 0}) >= len(self.graph.leader):
                said.append("faults: nobody sees the leader while all those links are cut")
        return said

    def communication(self) -> CommunicationGraph:
        """The graph; raises ValueError."""
        return CommunicationGraph.of(self.plant.agents, self.graph.links, self.graph.leader)

    @property
    def wheels(self) -> int:
        """Of each agent."""
        return self.plant.wheel_axes.shape[1]

    @property
    def starts(self) -> Array:
        """Of each agent, sigma at t = 0, (agents, 3)."""
        return np.resize(np.array(self.start.mrp), (self.plant.agents, 3))
