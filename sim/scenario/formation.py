"""Scenario files of formations: what is in them, checked before anything runs."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationInfo, field_validator, model_validator

from control.communication_graph import CommunicationGraph
from control.formation_law import Gains
from models.attitude.modified_rodrigues import to_quaternion
from models.plants.inertia import why_impossible
from models.plants.register.entries import kind_of
from models.sections import Headline, NonNegative, Positive, Section
from sim.estimators.rodrigues_settings import ObserverSettings
from sim.faults.bodies import InertiaChange
from sim.faults.kinds import Fault, check_faults, renamed
from sim.faults.links import Cut
from sim.faults.parts import Parts
from sim.faults.readings import Bias, NoiseChange
from sim.plant.kinds import FormationSettings, check_tilt, filled
from sim.scenario.graph import FormationGraph
from sim.scenario.named_sections import WindowsOfAgents, beyond, check_name, check_windows
from sim.scenario.run import Published, RunSettings, check_steps
from sim.sensors.distribution import NoiseDistribution, NormalNoise

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
INSTANTS = 2000  # of the leader's motion that are held against what the plant can follow
RESERVED = ("truth", "leader", "all")


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


class IsolationSettings(Section):
    """Agents see those whom they hear, and name the one whose messages do not fit what they see."""

    deviation_rad: Positive = Field(1e-3, description="of an attitude relative to one's own as it is seen, about each axis")
    window_s: Positive = Field(0.2, description="over which residuals are summed")
    tail: Annotated[float, Field(gt=0, lt=0.5)] = Field(1e-8, description="probability of such a sum, of one agent, that names it")


class LoopSettings(Section):
    """One closed loop."""

    feedback: str = Field(description="truth, or an observer's name")
    watching: tuple[str, ...] = Field((), description="observers that do not close the loop")
    law: LawSettings = LawSettings()
    shadow: bool = Field(False, description="attitudes are taken of the set with |sigma| <= 1, and change over where it ends")


class FormationScenario(Section):
    """One scenario file of a formation."""

    family: ClassVar[str] = "formation"

    title: Headline
    source: Headline = Field(description="seed equation, table or figure that it comes from")
    run: RunSettings
    plant: FormationSettings
    graph: FormationGraph = FormationGraph()
    leader: LeaderSettings = LeaderSettings()
    start: StartSettings = StartSettings()
    reading_deviation: NonNegative = Field(1e-4, description="of each component of sigma, a reading")
    reading_distribution: NoiseDistribution = Field(NormalNoise(), description="of that noise, whose deviation is then its scale")
    observers: dict[str, ObserverSettings] = Field({}, description="by name")
    loops: dict[str, LoopSettings]
    faults: tuple[Fault, ...] = ()
    isolation: IsolationSettings | None = Field(None, description="whether a faulty agent is looked for; what it says changes no loop")
    phases: WindowsOfAgents = Field({}, description="windows of time with metrics of their own: [start, end] in s")
    published: Published | None = None

    @field_validator("loops")
    @classmethod
    def _some(cls, loops: dict[str, LoopSettings]) -> dict[str, LoopSettings]:
        if not loops:
            raise ValueError("no loop is flown")
        for name in loops:
            check_name(name, "a loop", ())
        return loops

    @field_validator("faults", mode="before")
    @classmethod
    def _older_names(cls, value: Any) -> Any:
        return renamed(value, cls.family)

    @model_validator(mode="after")
    def _fits_together(self, info: ValidationInfo) -> FormationScenario:
        agents = self.plant.agents
        if len(self.plant.believed_inertia) != agents:
            raise ValueError(f"plant: {agents} agents, but {len(self.plant.believed_inertia)} believed inertias")
        self.communication()
        known = ["truth", *self.observers, *(info.context or {}).get("guests", ())]
        for name, loop in self.loops.items():
            for observer in (loop.feedback, *loop.watching):
                if observer not in known:
                    raise ValueError(f"loops.{name}: there is no observer {observer!r}; there are {', '.join(known)}")
        for name in self.observers:
            check_name(name, "an observer", RESERVED)
        check_steps(self.run, self.plant.step_s, "plant.step_s")
        duration = self.run.ticks * self.run.tick_s
        if outside := beyond(self.phases, self.run):
            raise ValueError(f"{outside[0]}; --set phases={{}} drops all")
        check_windows(self.phases, self.run)
        check_tilt(self.plant, to_quaternion(self.starts), "start.mrp")
        check_tilt(self.plant, to_quaternion(self.leader.motion(np.linspace(0.0, duration, INSTANTS))[:, :3]), "leader")
        check_faults(self.faults, duration, self.parts)
        for number, fault in enumerate(self.faults):
            if isinstance(fault, InertiaChange):
                self._can_be_had(f"faults.{number} (inertia)", fault)
        return self

    def _can_be_had(self, label: str, fault: InertiaChange) -> None:
        """Raise ValueError if bodies with another inertia are none."""
        kind = kind_of(self.plant)
        if fault.add_kg_m2 is not None and kind.any_tensor(self.plant):
            return
        reassemble = kind.prepare(self.plant).reassemble
        for wholes, centres_of_mass in fault.wholes(self.plant.inertia, self.plant.centres_of_mass):
            carried = reassemble(wholes, centres_of_mass).moments[..., None] * np.eye(3)  # what is left beside wheels and masses
            for agent, (whole, own) in enumerate(zip(wholes, carried, strict=True), 1):
                named = fault.agents == "all" or agent in fault.agents
                if named and (reason := why_impossible(whole) or why_impossible(own)):
                    raise ValueError(f"{label}: no rigid body has the inertia of agent {agent}, {reason}")

    @property
    def loop_names(self) -> tuple[str, ...]:
        """Names of all closed loops."""
        return tuple(self.loops)

    def warnings(self) -> list[str]:
        """What may be meant but deserves a word, a line each."""
        said = kind_of(self.plant).warnings(self.plant) + filled(self.plant, self.run.ticks * self.run.tick_s)
        if any(loop.law.acceleration_sign > 0 for loop in self.loops.values()):
            said.append("loops: with acceleration_sign = 1 the estimates of the leader's acceleration run away")
        if any(_shared_bias(fault) for fault in self.faults):
            said.append("faults: a bias that all readings share is followed by every filter, since nothing tells it from an attitude")
        for fault in self.faults:
            if isinstance(fault, Cut) and len({j for i, j in fault.links if i == 0}) >= np.count_nonzero(self.communication().leader):
                said.append("faults: nobody sees the leader while all those links are cut")
        return said

    def communication(self) -> CommunicationGraph:
        """The graph; raises ValueError."""
        return self.graph.build(self.plant.agents)

    @property
    def parts(self) -> Parts:
        """What can fail; gains are those of the first loop's law."""
        return Parts(
            self.family,
            {"attitude": 3},
            self.plant.agents,
            self.wheels,
            messages=self.communication().ways,
            noise=self.reading_deviation,
            gains=next(iter(self.loops.values())).law.gains[:-1],
        )

    @property
    def wheels(self) -> int:
        """Of each agent."""
        return self.plant.wheel_axes.shape[1]

    @property
    def starts(self) -> Array:
        """Of each agent, sigma at t = 0, (agents, 3)."""
        return np.resize(np.array(self.start.mrp), (self.plant.agents, 3))


def _shared_bias(fault: Fault) -> bool:
    """Whether it adds the same to the readings of all agents."""
    size = fault.size if isinstance(fault, Bias) else fault.bias if isinstance(fault, NoiseChange) else None
    return size is not None and any(size.bounds()) and getattr(fault, "agents", "") == "all"
