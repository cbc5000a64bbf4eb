"""Spacecraft in formation, in one world: their parameters, each with its provenance, and the compilation of as many as there are."""

from __future__ import annotations

import colorsys
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

import mujoco
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from models.dynamics.attitude_by_rodrigues import AttitudeByRodrigues
from models.dynamics.state_layout import StateLayout
from models.plants import inertia as mass_geometry
from models.plants.assembly import Assembly, ImpossibleInertia, MassProperties, Prepared
from models.plants.provenance import known
from models.plants.register.kind import PlantKind
from models.plants.register.parameters import PlantParameters
from models.sections import Positive, Sextuple

Array = NDArray[np.floating]

MJCF = Path(__file__).with_name("formation.xml")


# kg m2 as [xx, yy, zz, xy, xz, yz] (Rososhansky 2017, table 4.2): no rigid body has any of them
PRINTED: tuple[Sextuple, ...] = (
    (1.0, 0.1, 0.9, 0.1, 0.1, 0.1),
    (1.5, 0.9, 2.0, 0.2, 0.3, 0.4),
    (0.8, 0.7, 1.1, 0.1, 0.2, 0.3),
    (1.2, 0.9, 1.4, 0.3, 0.7, 0.2),
    (0.9, 1.2, 1.2, 0.15, 0.3, 0.4),
    (1.1, 1.0, 1.3, 0.35, 0.45, 0.5),
)
SCALED = (1.0, 0.788, 0.831, 0.549, 0.850, 0.607)  # of products of inertia: 2 to 3 % below the greatest that a body can have
PHYSICAL: tuple[Sextuple, ...] = (
    (1.0, 1.0, 0.9, 0.1, 0.1, 0.1),
    *((xx, yy, zz, s * xy, s * xz, s * yz) for (xx, yy, zz, xy, xz, yz), s in zip(PRINTED[1:], SCALED[1:], strict=True)),
)
BELIEVED: tuple[Sextuple, ...] = tuple((xx, yy, zz, 0.0, 0.0, 0.0) for xx, yy, zz, *_ in PRINTED)  # table 4.3: without products
INERTIA_SETS = {"physical": PHYSICAL, "printed": PRINTED}


class FormationParameters(PlantParameters):
    """Every number of the spacecraft."""

    type: Literal["formation"] = "formation"
    inertia_kg_m2: Literal["physical", "printed"] | tuple[Sextuple, ...] = known(
        "physical",
        "of each agent about its centre of mass: a named set or rows [xx, yy, zz, xy, xz, yz]",
        "kg m2",
        "corrected (Rososhansky 2017, table 4.2): J1_yy 0.1 to 1.0, products of the others scaled; printed: as printed",
    )
    believed_inertia_kg_m2: Literal["diagonal", "published"] | tuple[Sextuple, ...] = known(
        "diagonal",
        "what their filters and control laws take it for: the diagonals of inertia_kg_m2, the published ones, or rows",
        "kg m2",
        "published (table 4.3): without products; J1_yy is the corrected one too, but for published",
    )
    repeat: Annotated[int, Field(ge=1, le=100)] = known(1, "how often the rows above are taken, one after the other", "-", "chosen")
    torque_limit_nm: Positive = known(0.1, "about each body axis", "N m", "published (sec. 4.3)")
    mass_kg: Positive = known(25.0, "of each", "kg", "chosen: no matter for attitude")
    apart_m: Positive = known(2.1, "from one to the next on their ring", "m", "chosen: so that a person sees each; no matter for attitude")
    step_s: Positive = known(0.01, "physics step (RK4)", "s", "published (sec. 4.3): its integration step")

    @cached_property
    def inertia(self) -> Array:
        """J of each agent, (agents, 3, 3) kg m2; physical or not."""
        return self._tensors(self.inertia_kg_m2)

    @cached_property
    def believed_inertia(self) -> Array:
        """J_m of their filters and laws, (agents, 3, 3) kg m2."""
        if self.believed_inertia_kg_m2 == "diagonal":
            return self.inertia * np.eye(3)
        return self._tensors(BELIEVED if self.believed_inertia_kg_m2 == "published" else self.believed_inertia_kg_m2)

    def _tensors(self, chosen: str | tuple[Sextuple, ...]) -> Array:
        rows = INERTIA_SETS[chosen] if isinstance(chosen, str) else chosen
        return np.tile(mass_geometry.tensor(np.array(rows)), (self.repeat, 1, 1))

    @property
    def agents(self) -> int:
        """How many."""
        return len(self.inertia)

    @property
    def centres_of_mass(self) -> Array:
        """Of each, (agents, 3) m: in the origin of its B."""
        return np.zeros((self.agents, 3))

    @property
    def printed(self) -> bool:
        """Whether they have the printed tensors, which no rigid bodies have."""
        return self.inertia_kg_m2 == "printed"

    @cached_property
    def places(self) -> Array:
        """On a ring that stands upright around the leader's place, the first above, (agents, 3) m."""
        angle = 2.0 * np.pi * np.arange(self.agents) / self.agents
        radius = 0.5 * self.apart_m / np.sin(np.pi / max(self.agents, 3))
        return radius * np.stack([np.sin(angle), np.zeros(self.agents), np.cos(angle)], axis=-1)

    def process(self, believed: bool = False) -> AttitudeByRodrigues:
        """Analytic model of all agents at once, true or as believed."""
        return AttitudeByRodrigues(self.believed_inertia if believed else self.inertia)


def colour(agent: int, agents: int) -> tuple[float, float, float]:
    """Of an agent in every picture, red, green, blue in 0..1."""
    return colorsys.hls_to_rgb(agent / agents, 0.58, 0.72)


def prepare_formation(parameters: FormationParameters) -> Prepared:
    """All agents with their tensors, not yet compiled; MuJoCo refuses to compile those of the printed set."""
    spec = mujoco.MjSpec()
    spec.copy_during_attach = True
    one = mujoco.MjSpec.from_file(str(MJCF))
    spec.modelname = one.modelname
    spec.compiler.degree, spec.compiler.autolimits = 0, 1
    for field in ("timestep", "integrator", "gravity", "disableflags", "enableflags"):
        setattr(spec.option, field, getattr(one.option, field))
    spec.option.timestep = parameters.step_s
    spec.memory = 2**20 + 2**17 * parameters.agents
    moments, axes = mass_geometry.principal(parameters.inertia)
    for number, place in enumerate(parameters.places):
        body = spec.worldbody.add_frame(pos=place).attach_body(one.body("hull"), f"craft_{number + 1}/", "")
        body.mass, body.ipos, body.inertia, body.iquat = parameters.mass_kg, np.zeros(3), moments[number], axes[number]
        body.fullinertia = np.full(6, np.nan)
        body.explicitinertial = True
        for geom in ("band", "antenna"):
            spec.geom(f"craft_{number + 1}/{geom}").rgba = [*colour(number, parameters.agents), 1.0]
    rest = np.tile([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (parameters.agents, 1))
    rest[:, :3] = parameters.places
    spec.add_key(name="rest", qpos=rest.ravel())
    _light(spec, parameters)

    def reassemble(inertia: Array, centre_of_mass: Array) -> MassProperties:
        moments, axes = mass_geometry.principal(inertia)
        return MassProperties("craft_1/hull", np.full(inertia.shape[:-2], parameters.mass_kg), centre_of_mass, moments, axes)

    return Prepared(spec, reassemble)


def _light(spec: mujoco.MjSpec, parameters: FormationParameters) -> None:
    extent = float(np.max(np.linalg.norm(parameters.places, axis=-1))) + 1.0
    spec.stat.center, spec.stat.extent = [0.0, 0.0, 0.0], extent
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 1920, 1280
    spec.visual.global_.azimuth, spec.visual.global_.elevation, spec.visual.global_.fovy = 90.0, -8.0, 36.0
    spec.visual.quality.offsamples, spec.visual.map.znear, spec.visual.map.zfar = 8, 0.005, 40.0
    spec.visual.headlight.ambient, spec.visual.headlight.diffuse = [0.26, 0.27, 0.30], [0.32, 0.32, 0.34]
    sun = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    spec.worldbody.add_light(name="key", pos=[-4, -6, 5], dir=[0.5, 0.7, -0.5], diffuse=[0.85, 0.82, 0.78], type=sun)
    spec.worldbody.add_light(name="rim", pos=[5, 4, -3], dir=[-0.7, -0.55, 0.4], diffuse=[0.20, 0.22, 0.28], type=sun, castshadow=False)


def compile_formation(parameters: FormationParameters | None = None) -> Assembly:
    """Compile the formation.

    The printed set is carried by valid bodies with the same principal axes, compiled, whose moments are then overwritten: MuJoCo's
    equations take any tensor. A body compiled with equal moments would have no axes of its own, so these have three different ones.

    Raises:
      ImpossibleInertia: no rigid body has an agent's tensor, and it is not of the printed set.
    """
    parameters = parameters or FormationParameters()
    printed = parameters.printed
    for number, tensor in enumerate(parameters.inertia):
        if not printed and (reason := mass_geometry.why_impossible(tensor)):
            raise ImpossibleInertia(
                f'inertia_kg_m2 of agent {number + 1}: no rigid body has it, {reason}; "printed" carries the printed ones'
            )

    names = tuple(f"craft_{number + 1}/hull" for number, _ in enumerate(parameters.places))

    def compiled(visual: bool) -> mujoco.MjModel:
        spec = prepare_formation(parameters).spec
        spec.compiler.discardvisual = not visual
        moments = [spec.body(name).inertia.copy() for name in names]
        for name in names if printed else []:
            spec.body(name).inertia = [1.0, 0.9, 0.8]
        model = spec.compile()
        for name, values in zip(names, moments, strict=True):
            model.body_inertia[model.body(name).id] = values
        mujoco.mj_setConst(model, mujoco.MjData(model))
        return model

    return Assembly(
        model=compiled(visual=False),
        draw=lambda: compiled(visual=True),
        attitude_joints=names,
        wheel_joints=(),
        wheel_actuators=(),
        wheel_axes=np.zeros((3, 0)),
        wheel_torque_limit=parameters.torque_limit_nm,
        wheel_speed_limit=np.inf,
        wheel_inertia=0.0,
        inertia=parameters.inertia,
        centre_of_mass=parameters.centres_of_mass,
        wheel_friction=0.0,
        process=parameters.process(),
        reassemble=prepare_formation(parameters).reassemble,
        keyframe="rest",
    )


def _warnings(parameters: FormationParameters) -> list[str]:
    return ["plant.inertia_kg_m2: no rigid body has the printed tensors; they are flown all the same"] if parameters.printed else []


PLANT_KIND = PlantKind(
    parameters=FormationParameters,
    says="spacecraft in formation under torques on their bodies",
    family="formation",
    compile=compile_formation,
    prepare=prepare_formation,
    believed=lambda parameters, *_: parameters.process(believed=True),
    layout=lambda parameters: StateLayout.by_rodrigues(parameters.agents),
    any_tensor=lambda parameters: parameters.printed,
    warnings=_warnings,
)
