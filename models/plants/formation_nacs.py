"""NACS testbeds in formation, in one room: what differs between them, with provenance, and their compilation in one world."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

import mujoco
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from models.dynamics.attitude_by_rodrigues import AttitudeByRodrigues
from models.dynamics.state_layout import StateLayout
from models.plants.assembly import Assembly, ImpossibleInertia, Prepared
from models.plants.formation import colour
from models.plants.nacs import TILT_LIMIT_DEG, WHEELS, NacsParameters, air_torque, drive_errors, held_masses, prepare_nacs
from models.plants.provenance import known
from models.plants.register.kind import PlantKind
from models.plants.register.parameters import PlantParameters
from models.sections import Positive

Array = NDArray[np.floating]

ROOM = Path(__file__).with_name("formation_nacs.xml")

Vector3 = tuple[float, float, float]

ALONE = ("floor", "north", "east")  # what a testbed has of a room of its own
# geoms in the colour of their testbed
ACCENTS = ("plate_rim", "pedestal_foot", "cubesat_top_1", "cubesat_top_2", "cubesat_top_3", "cubesat_top_4")
RAISED = 0.40  # tangent of the angle at which the ring is looked down on, from the south
NACS_RIM_SHARE = 0.0055  # half width of the ring of nacs.xml as a share of its radius
RIM = (0.1695, 0.026)  # m, radius, and half width of the ring as a share of it, instead of 166.1 mm and 0.0055: seen from across the room


class FormationNacsParameters(PlantParameters):
    """Every number of the testbeds beyond that of a single one."""

    type: Literal["formation-nacs"] = "formation-nacs"
    testbed: NacsParameters = Field(NacsParameters(), description="what they have in common: every parameter of models/plants/nacs.py")
    inertia_scale: tuple[Positive, ...] = known(
        (1.0, 0.97, 1.03, 0.985, 1.02, 0.96),
        "of each testbed's inertia on that of testbed.inertia_kg_m2, which their filters and laws take it for",
        "-",
        "chosen: units built alike, weighed to some per cent",
    )
    centre_of_mass_um: tuple[Vector3, ...] = known(
        ((0.5, -0.4, 1.0), (-0.9, 0.6, 1.6), (0.7, 1.1, 0.8), (-0.3, -1.2, 2.0), (1.3, 0.2, 1.2), (-1.0, -0.7, 0.6)),
        "of each testbed in B from its centre of rotation, in place of testbed.centre_of_mass_um",
        "um",
        "chosen: each balanced by itself, slightly bottom-heavy (Chesi et al. 2014 reach a few um)",
    )
    repeat: Annotated[int, Field(ge=1, le=100)] = known(1, "how often the rows above are taken, one after the other", "-", "chosen")
    torque_limit_nm: Positive = known(
        0.02, "about each body axis", "N m", "chosen: about all three at once the pyramid's drives can give 0.0207 N m at 2 A"
    )
    apart_m: Annotated[float, Field(ge=0.4)] = known(
        0.95, "from one to the next on their ring", "m", "chosen: plates of 0.33 m pass each other; no matter for attitude"
    )

    @model_validator(mode="after")
    def _rows_fit(self) -> FormationNacsParameters:
        scales, offsets = len(self.inertia_scale), len(self.centre_of_mass_um)
        if not offsets or scales != offsets:
            raise ValueError(f"inertia_scale is of {scales} testbeds, centre_of_mass_um of {offsets}; both need one row for each")
        for number, one in enumerate(self.testbeds[:scales]):
            try:
                prepare_nacs(one)
            except ImpossibleInertia as impossible:
                raise ValueError(f"testbed {number + 1}: {impossible}") from None
        return self

    @cached_property
    def testbeds(self) -> tuple[NacsParameters, ...]:
        """Parameters of each testbed."""
        moments, common = self.testbed.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]], self.testbed.model_dump()
        return self.repeat * tuple(
            NacsParameters.model_validate(common | {"inertia_kg_m2": tuple((scale * moments).tolist()), "centre_of_mass_um": offset})
            for scale, offset in zip(self.inertia_scale, self.centre_of_mass_um, strict=True)
        )

    @cached_property
    def inertia(self) -> Array:
        """J of each testbed with wheels locked, about its centre of rotation, (agents, 3, 3) kg m2; physical or not."""
        scale = np.tile(self.inertia_scale, self.repeat)
        return scale[:, None, None] * self.testbed.inertia

    @cached_property
    def centres_of_mass(self) -> Array:
        """Of each testbed from its centre of rotation, (agents, 3) m in B."""
        return np.tile(1e-6 * np.array(self.centre_of_mass_um), (self.repeat, 1))

    @cached_property
    def believed_inertia(self) -> Array:
        """What filters and laws take every body for, (agents, 3, 3) kg m2: the published tensor without the wheels' spinning part."""
        return np.tile(self.testbed.inertia - self._spinning, (self.agents, 1, 1))

    @cached_property
    def _spinning(self) -> Array:
        axes = self.testbed.wheel_axes
        return self.testbed.wheel_inertia_kg_m2 * axes @ axes.T

    @property
    def agents(self) -> int:
        """How many."""
        return self.repeat * len(self.inertia_scale)

    @property
    def step_s(self) -> float:
        """Physics step."""
        return self.testbed.step_s

    @property
    def wheel_axes(self) -> Array:
        """Spin axes in B of each testbed's wheels, (3, 4)."""
        return self.testbed.wheel_axes

    @cached_property
    def places(self) -> Array:
        """Of their centres of rotation, on a ring clockwise from the north, (agents, 3) m in the lab."""
        angle = 2.0 * np.pi * (np.arange(self.agents) + 0.5) / self.agents
        radius = 0.5 * self.apart_m / np.sin(np.pi / self.agents) if self.agents > 1 else 0.0
        return np.stack([radius * np.cos(angle), -radius * np.sin(angle), np.ones(self.agents)], axis=-1)

    def process(self, believed: bool = False) -> AttitudeByRodrigues:
        """Analytic model of all bodies at once, true or as believed; its command carries what the wheels hold."""
        return AttitudeByRodrigues(self.believed_inertia if believed else self.inertia - self._spinning)


def prepare_testbeds(parameters: FormationNacsParameters) -> Prepared:
    """All testbeds in their room, not yet compiled.

    Raises:
      ImpossibleInertia: no rigid body has what is left of a testbed's tensor for its bus.
    """
    spec = mujoco.MjSpec.from_file(str(ROOM))
    spec.copy_during_attach = True
    prepared = [prepare_nacs(testbed) for testbed in parameters.testbeds]
    for field in ("timestep", "integrator", "tolerance", "gravity", "cone", "disableflags", "enableflags"):
        setattr(spec.option, field, getattr(prepared[0].spec.option, field))
    spec.memory = 2**20 + 2**20 * parameters.agents
    for number, (one, place) in enumerate(zip(prepared, parameters.places, strict=True)):
        child = one.spec
        _strip(child)
        child.memory = spec.memory
        shade = [*colour(number, parameters.agents), 1.0]
        for name in ACCENTS:
            child.geom(name).rgba = shade
        _widen(child.mesh("plate_rim"))
        spec.attach(child, prefix=f"testbed_{number + 1}/", frame=spec.worldbody.add_frame(pos=[place[0], place[1], 0.0]))
    spec.add_key(name="level", qpos=np.tile([1.0] + 10 * [0.0], parameters.agents))
    _furnish(spec, parameters)
    return Prepared(spec, prepared[0].reassemble)


def _widen(rim: mujoco.MjsMesh) -> None:
    """Make the ring about a plate one of `RIM`, of the same height."""
    radius, share = RIM
    _, _, height = rim.scale * NACS_RIM_SHARE
    rim.make_supertorus(96, share, 0.1, 1.0)
    rim.scale = [radius, radius, height / share]


def _strip(child: mujoco.MjSpec) -> None:
    """Take from a testbed what its room has once for all, and sensors that nobody reads."""
    for element in (
        *child.sensors,
        *child.keys,
        *child.worldbody.lights,
        *child.worldbody.cameras,
        *(child.geom(name) for name in ALONE),
        child.material("floor"),
        child.texture("floor"),
        child.texture("sky"),
    ):
        child.delete(element)


def _furnish(spec: mujoco.MjSpec, parameters: FormationNacsParameters) -> None:
    """Walls but in the south, and a floor, as far out as the ring needs; a camera from the south, where no testbed of six hides another."""
    ring = float(np.max(np.linalg.norm(parameters.places[:, :2], axis=-1)))
    half, height = ring + 0.9, 2.1
    spec.geom("floor").size = [half, half, 0.1]
    for name, pos, size in (
        ("wall_north", [half, 0, 0.5 * height], [0.02, half, 0.5 * height]),
        ("wall_west", [0, half, 0.5 * height], [half, 0.02, 0.5 * height]),
        ("wall_east", [0, -half, 0.5 * height], [half, 0.02, 0.5 * height]),
    ):
        wall = spec.worldbody.add_geom(spec.find_default("visual"), name=name, pos=pos, size=size, material="wall")
        wall.type = mujoco.mjtGeom.mjGEOM_BOX
    spec.stat.center, spec.stat.extent, spec.stat.meansize = [0.0, 0.0, 0.95], ring + 0.45, 0.05
    away = 2.7 * ring + 1.3
    spec.worldbody.add_camera(name="overview", pos=[-away, 0.0, 0.64 + RAISED * away], xyaxes=[0.0, -1.0, 0.0, RAISED, 0.0, 1.0], fovy=30.0)


def compile_testbeds(parameters: FormationNacsParameters | None = None) -> Assembly:
    """Compile the room; raises ImpossibleInertia as `prepare_testbeds` does."""
    parameters = parameters or FormationNacsParameters()
    spec, reassemble = prepare_testbeds(parameters)
    prefixes = _prefixes(parameters)
    wheels = tuple(prefix + wheel for prefix in prefixes for wheel in WHEELS)

    def draw() -> mujoco.MjModel:
        return prepare_testbeds(parameters).spec.compile()

    spec.compiler.discardvisual = True
    one = parameters.testbed
    return Assembly(
        model=spec.compile(),
        draw=draw,
        attitude_joints=tuple(prefix + "bearing" for prefix in prefixes),
        wheel_joints=wheels,
        wheel_actuators=wheels,
        wheel_axes=one.wheel_axes,
        wheel_torque_limit=one.torque_limit,
        wheel_speed_limit=one.no_load_speed,
        wheel_inertia=one.wheel_inertia_kg_m2,
        inertia=parameters.inertia,
        centre_of_mass=parameters.centres_of_mass,
        wheel_friction=one.wheel_coulomb_nm,
        process=parameters.process(),
        reassemble=reassemble,
        keyframe="level",
    )


def _prefixes(parameters: FormationNacsParameters) -> tuple[str, ...]:
    """With which the names of each testbed's parts begin."""
    return tuple(f"testbed_{number + 1}/" for number, _ in enumerate(parameters.places))


PLANT_KIND = PlantKind(
    parameters=FormationNacsParameters,
    says="air-bearing testbeds in formation",
    family="formation",
    compile=compile_testbeds,
    prepare=prepare_testbeds,
    believed=lambda parameters, *_: parameters.process(believed=True),
    layout=lambda parameters: StateLayout.by_rodrigues(parameters.agents),
    drives=lambda parameters: drive_errors(parameters.testbed),
    air=lambda parameters: air_torque(parameters.testbed),
    tilt_limit_deg=TILT_LIMIT_DEG,
    no_load_speed=lambda parameters: parameters.testbed.no_load_speed,
    filled_s=lambda parameters: min(testbed.filled_s for testbed in parameters.testbeds),
    holds=lambda parameters: {
        name: place for prefix in _prefixes(parameters) for name, place in held_masses(parameters.testbed, prefix).items()
    },
)
