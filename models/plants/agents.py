"""Agents that slide in a plane: their unknown dynamics, each number with its provenance, and the compilation of agents.xml."""

from __future__ import annotations

from functools import cached_property
from itertools import cycle, islice
from pathlib import Path
from typing import Annotated, Literal

import mujoco
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from models.chebyshev_network import ChebyshevNetwork
from models.dynamics.planar_agent import PlanarAgent
from models.dynamics.planar_body import PlanarBody
from models.dynamics.state_layout import StateLayout
from models.plants.assembly import Assembly, MassProperties, Prepared
from models.plants.provenance import known
from models.plants.register.kind import PlantKind
from models.plants.register.parameters import PlantParameters
from models.sections import Positive

Array = NDArray[np.floating]

MJCF = Path(__file__).with_name("agents.xml")

Pair = tuple[float, float]


class AgentsParameters(PlantParameters):
    """Every number of the agents."""

    type: Literal["agents"] = "agents"
    agents: Annotated[int, Field(ge=1, le=1000)] = known(
        6, "how many; of lists that are shorter the numbers come over again", "1", "published (sec. 5.3)"
    )
    mass_kg: Positive = known(1.0, "of each agent", "kg", "published (eq. 5.1, 5.2: acceleration is force)")
    stiffness: float = known(4.0, "factor of the unknown dynamics", "N/m", "published (eq. 5.30)")
    h1: Annotated[tuple[float, ...], Field(min_length=1)] = known(
        (0.6, -0.2, 0.4, -0.3, 0.5, 0.5), "of each agent, of v1", "s/m", "published (table 5.1)"
    )
    h2: Annotated[tuple[float, ...], Field(min_length=1)] = known(
        (0.3, 0.4, -0.4, -0.7, -0.2, -0.5), "of each agent, of v2", "s/m", "published (table 5.1)"
    )
    position_m: Annotated[tuple[Pair, ...], Field(min_length=1)] = known(
        ((1.0, 0.5), (1.8, -0.2), (0.2, -1.2), (-0.1, 1.2), (-0.6, 1.8), (1.0, -1.7)),
        "of each agent at t = 0, at rest",
        "m",
        "published (table 5.2)",
    )
    step_s: Positive = known(
        0.002,
        "physics step (RK4), over which the force at its middle is held",
        "s",
        "chosen by measurement: docs/consensus.md",
    )

    @cached_property
    def start(self) -> Array:
        """[x, v] of every agent at t = 0, (agents, 4); places that come over again are turned about the origin by 1 rad each time."""
        places, number = np.array(self.position_m), np.arange(self.agents)
        turned = (number // len(places)).astype(float)
        along, across = places[number % len(places)].T
        cosine, sine = np.cos(turned), np.sin(turned)
        place = np.stack([cosine * along - sine * across, sine * along + cosine * across], axis=-1)
        return np.concatenate([place, np.zeros_like(place)], axis=-1)

    @cached_property
    def _speed_factors(self) -> tuple[Array, Array]:
        """h1 and h2 of every agent, (agents,) s/m."""
        return np.resize(np.array(self.h1), self.agents), np.resize(np.array(self.h2), self.agents)

    def unknown_force(self, state: Array, gain: Array) -> Array:
        """f_i of eq. 5.30, its two components multiplied by `gain`; [x, v] (..., agents, 4) and (..., 2) to (..., agents, 2) N."""
        h1, h2 = self._speed_factors
        first = state[..., 1] * np.sin(0.25 * np.pi + 0.5 * h1 * state[..., 2])
        second = state[..., 0] * np.cos(0.5 * h2 * state[..., 3])
        return self.stiffness * gain * np.stack([first, second], axis=-1)


def prepare_agents(parameters: AgentsParameters) -> Prepared:
    """Fill agents.xml with parameters."""
    spec = mujoco.MjSpec.from_file(str(MJCF))
    spec.option.timestep = parameters.step_s
    drawn = list(spec.bodies[1:])
    for extra in drawn[parameters.agents :]:
        spec.delete(extra)
    for number, like in islice(enumerate(cycle(drawn), 1), len(drawn), parameters.agents):
        body = spec.worldbody.add_body(name=f"agent_{number}")
        for name, axis in (("x", (1, 0, 0)), ("y", (0, 1, 0))):
            body.add_joint(spec.default, name=f"{name}_{number}", axis=axis)
        body.add_geom(spec.default, rgba=like.geoms[0].rgba)
    for body in spec.bodies[1:]:
        body.geoms[0].mass = parameters.mass_kg
    spec.keys[0].qpos = parameters.start[:, :2].ravel()

    def refuse(inertia: Array, centre_of_mass: Array) -> MassProperties:  # noqa: ARG001
        raise ValueError("agents that only slide have no inertia to change")

    return Prepared(spec, refuse)


def compile_agents(parameters: AgentsParameters | None = None) -> Assembly:
    """Compile the agents; they have neither an attitude nor wheels."""
    parameters = parameters or AgentsParameters()
    spec, refuse = prepare_agents(parameters)
    return Assembly(
        model=spec.compile(),
        draw=spec.compile,
        attitude_joints=(),
        wheel_joints=(),
        wheel_actuators=(),
        wheel_axes=np.zeros((3, 0)),
        wheel_torque_limit=np.inf,
        wheel_speed_limit=np.inf,
        wheel_inertia=0.0,
        inertia=np.zeros((3, 3)),
        centre_of_mass=np.zeros(3),
        wheel_friction=0.0,
        process=PlanarAgent(ChebyshevNetwork(), parameters.mass_kg),
        reassemble=refuse,
        keyframe="start",
    )


PLANT_KIND = PlantKind(
    parameters=AgentsParameters,
    says="agents in the plane with unknown dynamics",
    family="consensus",
    compile=compile_agents,
    prepare=prepare_agents,
    believed=lambda parameters, *_: PlanarBody(parameters.mass_kg),
    layout=lambda parameters: StateLayout.in_the_plane(parameters.agents),
)
