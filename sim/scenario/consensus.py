"""Scenario files of consensus tracking: agents with unknown dynamics, who sees whom, the law, and how each loop learns."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field, ValidationInfo, field_validator, model_validator

from control.communication_graph import CommunicationGraph
from control.terminal_sliding_mode import TerminalSlidingMode
from models.plants.agents import AgentsParameters
from models.sections import Headline, NonNegative, Positive, Section
from sim.estimators.learner_settings import Adaptive, LoopSettings, Marginalised, TuningSettings
from sim.faults.kinds import Fault, check_faults, renamed
from sim.faults.parts import Parts
from sim.faults.readings import DropOut
from sim.scenario.graph import ConsensusGraph
from sim.scenario.named_sections import check_name
from sim.scenario.run import Published, RunSettings, check_steps
from sim.sensors.distribution import NoiseDistribution, NormalNoise

CROWD = 400  # trial particles of a marginalised filter that take about a minute for 20 s


class LeaderSettings(Section):
    """The virtual leader goes round a circle, radius (cos, sin)(rate t)."""

    radius_m: NonNegative = 0.5
    rate_rad_s: float = 1.0


class LawSettings(Section):
    """Eq. 5.17-5.26; none of the numbers is printed, and these give the commands of fig. 5.5 at t = 0 on all twelve axes."""

    proportional: NonNegative = Field(4.0, description="K1")
    terminal: NonNegative = Field(2.0, description="K2")
    slope: NonNegative = Field(1.0, description="L1")
    terminal_slope: NonNegative = Field(0.5, description="L2")
    exponent: Annotated[float, Field(gt=0, le=1)] = 0.6
    bound_n: NonNegative = Field(1.0, description="phi_i")
    width: Positive = Field(0.02, description="eps")

    def build(self) -> TerminalSlidingMode:
        """The law."""
        return TerminalSlidingMode(
            self.proportional, self.terminal, self.slope, self.terminal_slope, self.exponent, self.bound_n, self.width
        )


class SensorSettings(Section):
    """Every agent reads its own position and speed at every tick."""

    position_std_m: NonNegative = 1e-4
    speed_std_m_s: NonNegative = 1e-4
    distribution: NoiseDistribution = Field(NormalNoise(), description="of the noise, whose deviations are then its scale")


class ConsensusScenario(Section):
    """One scenario file of consensus tracking."""

    family: ClassVar[str] = "consensus"

    title: Headline
    source: Headline
    run: RunSettings
    plant: AgentsParameters = AgentsParameters()
    graph: ConsensusGraph = ConsensusGraph()
    leader: LeaderSettings = LeaderSettings()
    control: LawSettings = LawSettings()
    sensors: SensorSettings = SensorSettings()
    tuning: TuningSettings = TuningSettings()
    disturbance: tuple[float, float] = Field((0.1, 0.5), description="amplitude, N, and rate per agent number, rad/s, at first (eq. 5.31)")
    faults: tuple[Fault, ...] = ()
    loops: dict[str, LoopSettings]
    published: Published | None = None

    @field_validator("loops")
    @classmethod
    def _named(cls, loops: dict[str, Any]) -> dict[str, Any]:
        if not loops:
            raise ValueError("there is no loop to fly")
        for name in loops:
            check_name(name, "a loop", ("truth", "leader", "loop"))
        return loops

    @field_validator("faults", mode="before")
    @classmethod
    def _older_names(cls, value: Any) -> Any:
        return renamed(value, cls.family)

    @model_validator(mode="after")
    def _fits_together(self, info: ValidationInfo) -> ConsensusScenario:
        self.communication()
        duration = self.run.ticks * self.run.tick_s
        known = ["truth", *(info.context or {}).get("guests", ())]
        for name, loop in self.loops.items():
            if loop.feedback is not None and loop.feedback not in known:
                raise ValueError(f"loops.{name}.feedback: there is no filter {loop.feedback!r}; there are {', '.join(known)}")
            if isinstance(loop, Adaptive):
                check_steps(self.run, loop.tick_s, f"loops.{name}.tick_s", "ticks of its own")
        check_steps(self.run, self.plant.step_s, "plant.step_s")
        check_faults(self.faults, duration, self.parts)
        sampled = [name for name, loop in self.loops.items() if isinstance(loop, Marginalised)]
        for number, fault in enumerate(self.faults):
            if sampled and isinstance(fault, DropOut) and fault.earliest_start < self.run.tick_s:
                where = f"faults.{number} (drop-out): begins at {fault.earliest_start:g} s"
                raise ValueError(f"{where}, but the particles of loop {sampled[0]} begin with a reading; let it begin later")
        return self

    def communication(self) -> CommunicationGraph:
        """The graph; raises ValueError."""
        return self.graph.build(self.plant.agents)

    @property
    def parts(self) -> Parts:
        """What can fail."""
        return Parts(
            self.family,
            {"position": 2, "speed": 2},
            self.plant.agents,
            axes=2,
            messages=self.communication().ways,
            noise=(self.sensors.position_std_m, self.sensors.speed_std_m_s),
            disturbance=np.column_stack([np.tile(self.disturbance, (self.plant.agents, 1)), np.arange(1, self.plant.agents + 1)]),
        )

    @property
    def loop_names(self) -> tuple[str, ...]:
        """Names of all closed loops."""
        return tuple(self.loops)

    def warnings(self) -> list[str]:
        """What may be meant but deserves a word, a line each."""
        slow = [name for name, loop in self.loops.items() if isinstance(loop, Marginalised)]
        work = sum(loop.particles for loop in self.loops.values() if isinstance(loop, Marginalised)) * self.run.trials
        if work * self.run.ticks * self.plant.agents > CROWD * 2000 * 6:
            return [f"{', '.join(slow)}: {work} trials x particles of {self.plant.agents} agents take minutes; fewer --trials are quicker"]
        return []
