"""Prints the table in docs/physics.md of what the drawn testbed weighs, part by part: python docs/mass.py."""

from __future__ import annotations

from collections.abc import Container
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from models.plants.inertia import point_mass
from models.plants.nacs import MJCF, NacsParameters

Array = NDArray[np.floating]

UP = np.array([1.0, -1.0, -1.0])  # B to the picture, whose z points up, and back
PAINT = ("mark", "spoke")  # of geoms that weigh nothing
PARTS = {  # part, the first words of its geoms' names, and where its mass comes from
    "hemisphere of the bearing": (("bearing_ball",), "steel of 45 mm, bored to 5/9"),
    "its neck": (("bearing_neck",), "aluminium"),
    "plate, rim, brackets": (("plate", "bracket"), "sandwich: skins of 0.3 mm, 6 mm honeycomb; aluminium"),
    "CubeSat: rails, decks, top": (
        ("cubesat", "wheel_deck", "upper_deck", "motherboard_standoff", "computer_standoff"),
        "angles and drilled sheet",
    ),
    "motherboard": (("motherboard",), "estimated"),
    "4 drives": (("drive",), "estimated: 7 g each, in the size of a module ESCON 24/2"),
    "2 power supplies": (("power_supply",), "estimated: converters to 12 V and 5 V"),
    "on-board computer": (("computer",), "estimated: board of a Raspberry Pi 3A+, 29 g"),
    "IMU": (("imu",), "estimated: VN-100 on a carrier"),
    "4 wheels": (("wheel",), "`wheel_mass_kg`"),
    "4 motors and their mount": (("motor", "wheel_mount"), "estimated: flat motors of 20 mm, 18 g each; aluminium"),
    "2 battery packs, hangers": (("battery",), "estimated: two cells 18650 of 48 g and a holder each"),
    "3 balance masses": (("balance_x", "balance_y", "balance_z"), "`balance_mass_kg`: brass, 18 mm"),
    "their rails and steppers": (("rail", "stepper"), "channels of aluminium; estimated: 13 g each"),
    "their electronics, cables": (("balance_board", "balance_driver", "balance_standoff", "cable"), "estimated"),
    "4 counterweights on rods": (("counterweight",), "brass of 32 mm on steel of 6 mm"),
}


class Mass(NamedTuple):
    """Mass properties of some parts.

    Attributes:
      mass: kg.
      volume: m3.
      centre: of mass, from the centre of rotation, (3,) m in B.
      inertia: about the centre of rotation, (3, 3) kg m2 in B.
    """

    mass: float
    volume: float
    centre: Array
    inertia: Array


def floating(spec: mujoco.MjSpec) -> list[Any]:
    """Geoms of the floating part that are drawn with a mass: no paint, nothing that only collides."""
    bodies = [body for body in spec.bodies if body.name != "world"]
    return [geom for body in bodies for geom in body.geoms if geom.group < 3 and not geom.name.startswith(PAINT)]


def part_of(name: str) -> str:
    """Part that a geom belongs to: of all first words that fit its name, the longest decide."""
    fitting = {word: part for part, (words, _) in PARTS.items() for word in words if name.startswith(word)}
    return fitting[max(fitting, key=len)]


def weigh(spec: mujoco.MjSpec, names: Container[str]) -> Mass:
    """Mass properties of geoms of these names, as MuJoCo computes them from shapes and densities in the model's keyframe."""
    mass, first, second = _moments(spec, names, None)
    volume, _, _ = _moments(spec, names, 1.0)
    return Mass(mass, volume, first / mass, second)


def _moments(spec: mujoco.MjSpec, names: Container[str], density: float | None) -> tuple[float, Array, Array]:
    """Mass, first moment and inertia about the centre of rotation, of some geoms, as they are or all of one density."""
    bare = spec.copy()
    bare.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    bare.compiler.boundmass, bare.compiler.boundinertia = 1e-12, 1e-14  # a moving body of which nothing is weighed must not be without
    for body in bare.bodies:
        body.explicitinertial, body.mass, body.inertia, body.fullinertia = False, 0.0, np.zeros(3), np.full(6, np.nan)
    for geom in bare.geoms:
        if geom.name not in names:
            geom.mass = 0.0
        elif density is not None:
            geom.mass, geom.density = np.nan, density
    model = bare.compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    bodies = slice(model.body("bus").id, None)
    place = UP * (data.xipos[bodies] - data.body("bus").xpos)
    turn = UP[:, None] * data.ximat[bodies].reshape(-1, 3, 3)
    mass = model.body_mass[bodies]
    own = turn @ (model.body_inertia[bodies][:, :, None] * turn.swapaxes(-1, -2))
    return float(mass.sum()), mass @ place, (own + point_mass(mass, place)).sum(axis=0)


def density(geom: Any) -> float:
    """Mean density of a drawn geom, kg/m3; a mass is given to boxes and cylinders only."""
    if np.isnan(geom.mass):
        return float(geom.density)
    volume = {
        mujoco.mjtGeom.mjGEOM_BOX: lambda size: 8.0 * np.prod(size),
        mujoco.mjtGeom.mjGEOM_CYLINDER: lambda size: 2.0 * np.pi * size[0] ** 2 * size[1],
    }[geom.type]
    return float(geom.mass / volume(geom.size))


def row(title: str, mass: Mass, source: str) -> str:
    """Line of the table."""
    xx, yy, zz = 1e3 * np.diag(mass.inertia)
    xy, xz, yz = 1e3 * mass.inertia[[0, 0, 1], [1, 2, 2]]
    numbers = f"{1e3 * mass.mass:.0f} | {mass.mass / mass.volume:.0f} | {-1e3 * mass.centre[2]:z.1f}"
    return f"| {title} | {numbers} | {xx:.2f}, {yy:.2f}, {zz:.2f} | {xy:z.2f}, {xz:z.2f}, {yz:z.2f} | {source} |"


def table() -> str:
    """Every part, their sum, and the plant."""
    spec, plant = mujoco.MjSpec.from_file(str(MJCF)), NacsParameters()
    geoms: dict[str, list[str]] = {part: [] for part in PARTS}
    for geom in floating(spec):
        geoms[part_of(geom.name)].append(geom.name)
    rows = [row(part, weigh(spec, geoms[part]), source) for part, (_, source) in PARTS.items()]
    everything = weigh(spec, [name for names in geoms.values() for name in names])
    asked = Mass(plant.mass_kg, np.nan, plant.centre_of_mass, plant.inertia)
    lines = [
        "| part | g | kg/m3 | height of its centre, mm | J_xx, J_yy, J_zz, 1e-3 kg m2 | J_xy, J_xz, J_yz | from |",
        "|---|---|---|---|---|---|---|",
        *rows,
        row("**sum of the parts**", everything, ""),
        row("**the plant**", asked, "`mass_kg`, `centre_of_mass_um`, `inertia_kg_m2`").replace("nan", ""),
    ]
    return "\n".join(lines)


TABLE = table()

if __name__ == "__main__":
    print(TABLE)
