"""The drawn testbed is a mass model: it weighs what the plant weighs, of materials that there are, and no part cuts into another."""

from __future__ import annotations

import itertools
import math
import runpy
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from models.attitude.quaternion import from_rotation_vector
from models.plants.formation_nacs import compile_testbeds
from models.plants.nacs import BALANCE_MASSES, MJCF, TILT_LIMIT_DEG, WHEELS, NacsParameters, compile_nacs
from models.plants.wheels import pyramid

DOCS = Path(__file__).parents[1] / "docs"
MASS = runpy.run_path(str(DOCS / "mass.py"))
PLANT = NacsParameters()
TOUCHING = 2e-5  # m: parts that are joined may cut into each other by so much
RINGS = ("plate_rim", "pedestal_wall", "pedestal_bumper", "bearing_cup")  # MuJoCo takes a mesh for its convex hull: looked at in pieces
PIECES = 48


def spec() -> mujoco.MjSpec:
    return mujoco.MjSpec.from_file(str(MJCF))


def floating() -> list[Any]:
    return list(MASS["floating"](spec()))


def weighed() -> Any:
    return MASS["weigh"](spec(), [geom.name for geom in floating()])


@cache
def by_part() -> dict[str, Any]:
    parts: dict[str, list[str]] = {}
    for geom in floating():
        parts.setdefault(MASS["part_of"](geom.name), []).append(geom.name)
    return {part: MASS["weigh"](spec(), names) for part, names in parts.items()}


# mass -------------------------------------------------------------------------------------------------------------------------


def test_a_drawing_is_weighed_as_by_hand():
    """Box of 1.2 kg and cylinder of 0.5 kg, about a point beside both; the paint and what is not asked for weigh nothing."""
    drawing = mujoco.MjSpec.from_string("""
      <mujoco><compiler inertiafromgeom="false"/><worldbody><body name="bus" pos="0 0 1" quat="0 1 0 0">
        <joint name="bearing" type="ball"/><inertial pos="0 0 0" mass="9" diaginertia="1 1 1"/>
        <geom name="box" type="box" size="0.1 0.05 0.03" pos="0.2 0 -0.1" density="1000"/>
        <geom name="mark" type="box" size="1 1 1" density="700"/>
        <body name="arm" pos="0 0.3 0"><joint name="arm"/><inertial pos="0 0 0" mass="9" diaginertia="1 1 1"/>
          <geom name="rod" type="cylinder" size="0.02 0.1" mass="0.5"/></body>
      </body></worldbody><keyframe><key/></keyframe></mujoco>""")
    got = MASS["weigh"](drawing, ["box", "rod"])
    box = 1.2 * (np.diag([0.05**2 + 0.03**2, 0.1**2 + 0.03**2, 0.1**2 + 0.05**2]) / 3.0)
    box += 1.2 * np.array([[0.01, 0.0, 0.02], [0.0, 0.05, 0.0], [0.02, 0.0, 0.04]])  # at (0.2, 0, -0.1)
    across, along = 0.5 * (0.02**2 / 4 + 0.1**2 / 3), 0.5 * 0.02**2 / 2
    rod = np.diag([across + 0.5 * 0.09, across, along + 0.5 * 0.09])  # at (0, 0.3, 0)
    assert got.mass == pytest.approx(1.7, rel=1e-9)
    assert got.volume == pytest.approx(0.0012 + np.pi * 0.02**2 * 0.2, rel=1e-9)
    np.testing.assert_allclose(got.centre, [1.2 * 0.2 / 1.7, 0.5 * 0.3 / 1.7, -1.2 * 0.1 / 1.7], rtol=0, atol=1e-9)
    np.testing.assert_allclose(got.inertia, box + rod, rtol=0, atol=1e-9)


def test_the_drawn_parts_weigh_what_the_plant_weighs():
    """Mass to 0.1 %, J_B to 1.7 %, its products to 0.5 % of the least moment, the centre of mass to what one balance mass can shift it."""
    parts = weighed()
    assert parts.mass == pytest.approx(PLANT.mass_kg, rel=1e-3)
    reach = 0.04 * PLANT.balance_mass_kg / PLANT.mass_kg  # 0.6 mm
    assert np.abs(parts.centre - PLANT.centre_of_mass).max() < reach
    np.testing.assert_allclose(np.diag(parts.inertia), np.diag(PLANT.inertia), rtol=0.017)
    least = np.diag(PLANT.inertia).min()
    np.testing.assert_allclose(parts.inertia, PLANT.inertia, rtol=0, atol=0.017 * least)
    np.testing.assert_allclose(parts.inertia[[0, 0, 1], [1, 2, 2]], PLANT.inertia[[0, 0, 1], [1, 2, 2]], rtol=0, atol=0.005 * least)


@pytest.mark.parametrize(("names", "mass", "moments"), [
    (WHEELS, PLANT.wheel_mass_kg, (PLANT.wheel_transverse_inertia_kg_m2, PLANT.wheel_inertia_kg_m2)),
    (BALANCE_MASSES, PLANT.balance_mass_kg, (2.7e-6, 2.7e-6)),
], ids=["wheels", "balance masses"])  # fmt: skip
def test_what_moves_by_itself_is_drawn_with_its_own_mass_and_moments(names, mass, moments):
    bare = spec()
    bare.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    for body in bare.bodies:
        body.explicitinertial = False
    drawn, plant = bare.compile(), compile_nacs().model
    for name in names:
        assert drawn.body(name).mass[0] == pytest.approx(mass, rel=1e-12)
        np.testing.assert_allclose(np.sort(drawn.body(name).inertia)[[0, 2]], moments, rtol=0.01)  # J_w is published, the disc is not
        np.testing.assert_allclose(
            drawn.body(name).inertia, plant.body(name).inertia[np.argsort(-plant.body(name).inertia)][::-1], rtol=0.01
        )


def test_the_materials_are_there_in_this_world():
    """From honeycomb and hollow electronics to brass; nothing that floats is drawn without a mass but paint."""
    for geom in floating():
        assert 300.0 <= MASS["density"](geom) <= 8600.0, geom.name
    paint = [geom.name for body in spec().bodies for geom in body.geoms if geom.name.startswith(MASS["PAINT"])]
    assert paint == ["mark_x", "mark_y", *(f"spoke_{number}" for number in range(1, 5))]


def test_the_drawing_is_no_part_of_the_dynamics():
    heavy = spec()
    for geom in heavy.geoms:
        geom.mass, geom.density = np.nan, 5e4
    one, other = mujoco.MjModel.from_xml_path(str(MJCF)), heavy.compile()
    for field in ("body_mass", "body_inertia", "body_ipos", "body_iquat", "body_subtreemass", "dof_invweight0"):
        np.testing.assert_array_equal(getattr(one, field), getattr(other, field), err_msg=field)


def test_the_page_has_the_table():
    text = (DOCS / "physics.md").read_text(encoding="utf-8")
    assert MASS["TABLE"] in text, "print it anew: python docs/mass.py"


@pytest.mark.parametrize(
    ("instead", "least"), [("as drawn", 3.6e-3), ("on the plate", 6.0e-3), ("batteries inside", 6.8e-3), ("solid plate", 9.8e-3)]
)
def test_what_does_not_fit_needs_more_than_the_published_second_moment_along_z(instead, least):
    """Parts above the pivot with first and second moments f, s need s + f^2 / m of the whole, if all else, m, lies at one depth."""
    low = {"hemisphere of the bearing", "2 battery packs, hangers", "4 counterweights on rods"}
    outside = {"its neck", "plate, rim, brackets", "3 balance masses", "their rails and steppers", "their electronics, cables"}
    above = np.zeros(3)
    for part, got in by_part().items():
        if part in low:
            continue
        m, f, s = got.mass, -got.mass * got.centre[2], 0.5 * (got.inertia[0, 0] + got.inertia[1, 1] - got.inertia[2, 2])
        if instead == "on the plate" and part not in outside:
            f, s = f + 0.024 * m, s + 0.048 * f + 0.024**2 * m
        if instead == "solid plate" and part == "plate, rim, brackets":
            m = 2700 * 0.006 * (np.pi * 0.165**2 - 0.1**2)
            f, s = 0.033 * m, 0.033**2 * m
        above += (m, f, s)
    if instead == "batteries inside":
        above += 0.224 * np.array([1.0, 0.09, 0.09**2])
    mass, first, second = above
    published = 0.5 * (PLANT.inertia[0, 0] + PLANT.inertia[1, 1] - PLANT.inertia[2, 2])
    needed = second + first**2 / (PLANT.mass_kg - mass)
    assert needed == pytest.approx(least, rel=0.02)
    assert (needed < published) == (instead == "as drawn")


# place ------------------------------------------------------------------------------------------------------------------------


def drawn() -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The testbed as it is drawn, its rings cut into boxes and capsules, each named after its ring."""
    whole, cut = mujoco.MjModel.from_xml_path(str(MJCF)), spec()
    for name in RINGS:
        number = whole.geom(name).id
        mesh = whole.geom_dataid[number]
        start, count = whole.mesh_vertadr[mesh], whole.mesh_vertnum[mesh]
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, whole.geom_quat[number])
        vertices = whole.mesh_vert[start : start + count] @ turn.reshape(3, 3).T + whole.geom_pos[number]
        radius, height = np.hypot(*vertices.T[:2]), vertices[:, 2]
        low, high, inner, outer = height.min(), height.max(), radius.min(), radius.max()
        body = cut.body("bus" if whole.geom_bodyid[number] else "world")
        for piece in range(PIECES):
            angle = 2 * np.pi * piece / PIECES
            middle = 0.5 * (inner + outer) * np.array([math.cos(angle), math.sin(angle)])
            wide = math.tan(np.pi / PIECES) * inner
            made = body.add_geom(name=f"{name}:{piece}", pos=[*middle, 0.5 * (low + high)], group=2, contype=0, conaffinity=0, mass=0)
            about_z, lying = np.array([math.cos(angle / 2), 0, 0, math.sin(angle / 2)]), np.array([1.0, -1.0, 0.0, 0.0]) / math.sqrt(2)
            turned = np.zeros(4)
            if name == "pedestal_bumper":
                made.type, made.size = mujoco.mjtGeom.mjGEOM_CAPSULE, [0.5 * (high - low), wide, 0]
                mujoco.mju_mulQuat(turned, about_z, lying)
            else:
                made.type, made.size = mujoco.mjtGeom.mjGEOM_BOX, [0.5 * (outer - inner), wide, 0.5 * (high - low)]
                turned = about_z
            made.quat = turned
        cut.delete(cut.geom(name))
    model = cut.compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    return model, data


def solids(model: mujoco.MjModel, floats: bool) -> list[int]:
    """Geoms that are drawn and no paint, of what floats or of what stands."""
    room = (*MASS["PAINT"], "floor", "north", "east")
    return [
        i
        for i in range(model.ngeom)
        if model.geom_group[i] < 3 and bool(model.geom_bodyid[i]) == floats and not model.geom(i).name.startswith(room)
    ]


def cuts(model: mujoco.MjModel, data: mujoco.MjData, pairs: Iterable[tuple[int, int]]) -> Iterator[tuple[str, str, float]]:
    """Pairs of solids that cut into each other, and by how many millimetres; pieces of one ring, and of the hose, are one part."""
    for one, other in pairs:
        names = model.geom(one).name, model.geom(other).name
        if len({name.partition(":")[0].rstrip("12") if "hose" in name else name.partition(":")[0] for name in names}) == 2:
            apart = mujoco.mj_geomDistance(model, data, one, other, 1e-3, None)
            if apart < -TOUCHING:
                yield *names, round(1e3 * apart, 3)


@pytest.mark.parametrize("place", [0.0, 0.04, -0.04])
def test_no_part_cuts_into_another_wherever_the_balance_masses_are(place):
    model, data = drawn()
    for name in BALANCE_MASSES:
        data.joint(name).qpos[0] = place
    mujoco.mj_forward(model, data)
    assert not list(cuts(model, data, itertools.combinations(solids(model, True), 2)))


@pytest.mark.parametrize("tilt_deg", [0.0, 15.0, 30.0])
def test_what_floats_clears_what_stands_up_to_the_tilt_stop(tilt_deg):
    model, data = drawn()
    found: list[Any] = []
    for heading in np.radians(np.arange(0.0, 360.0, 30.0)):
        x, y, z, w = from_rotation_vector(np.radians(tilt_deg) * np.array([np.cos(heading), np.sin(heading), 0.0]))
        data.joint("bearing").qpos[:] = w, x, y, z
        mujoco.mj_forward(model, data)
        found += cuts(model, data, itertools.product(solids(model, True), solids(model, False)))
    assert not found


def test_no_part_of_the_pedestal_cuts_into_another():
    model, data = drawn()
    assert not list(cuts(model, data, itertools.combinations(solids(model, False), 2)))


def test_the_plate_meets_the_bumper_at_the_tilt_limit():
    """What stops the body is the contact of two other geoms: the drawn ones touch where those do, to a tenth of a millimetre."""
    model, data = drawn()
    half = math.radians(TILT_LIMIT_DEG) / 2
    data.joint("bearing").qpos[:] = math.cos(half), math.sin(half), 0.0, 0.0
    mujoco.mj_forward(model, data)
    plates = [i for i in solids(model, True) if model.geom(i).name.startswith("plate")]
    bumper = [i for i in solids(model, False) if model.geom(i).name.startswith("pedestal_bumper")]
    gap = min(mujoco.mj_geomDistance(model, data, *pair, 0.01, None) for pair in itertools.product(plates, bumper))
    assert 0.0 <= gap < 1e-4
    one, other = model.geom("plate").id, model.geom("tilt_stop").id
    assert abs(mujoco.mj_geomDistance(model, data, one, other, 0.01, None)) < 1e-6


def test_the_search_finds_wheels_that_cut_into_each_other():
    """Hubs 20 mm from the axis, where rims of 43 mm under 45 deg overlap by 1.4 mm."""
    near = spec()
    for name in WHEELS:
        near.body(name).pos[:2] *= 20.0 / 21.5
    model = near.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    wheels = [model.geom(name).id for name in WHEELS]
    found = list(cuts(model, data, itertools.combinations(wheels, 2)))
    assert len(found) == 4
    assert min(apart for *_, apart in found) < -0.5


def test_the_imu_is_where_it_measures():
    model = compile_nacs().scene
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.geom("imu_box").xpos, data.site("imu").xpos, rtol=0, atol=1e-12)


def test_motors_sit_behind_their_wheels_at_any_cant():
    for elevation in (45.0, 30.0):
        model = compile_nacs(NacsParameters(wheel_elevation_deg=elevation)).scene
        axes = pyramid(np.pi / 4, np.radians(elevation)).T
        for number, axis in enumerate(axes, start=1):
            motor, wheel = model.geom(f"motor_{number}"), model.body(f"wheel_{number}")
            np.testing.assert_allclose(wheel.pos - motor.pos, 0.0111 * axis, rtol=0, atol=1e-12)
            turn = np.zeros(9)
            mujoco.mju_quat2Mat(turn, motor.quat)
            np.testing.assert_allclose(turn.reshape(3, 3)[:, 2], axis, rtol=0, atol=1e-9)


def test_a_ring_about_the_plate_is_wider_in_formation_and_as_high():
    def ring(model: mujoco.MjModel, name: str) -> tuple[float, float]:
        mesh = model.geom_dataid[model.geom(name).id]
        start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        along, *across = model.mesh_vert[start : start + count].T
        return float(np.hypot(*across).max()), float(along.max())

    outer, height = ring(compile_nacs().scene, "plate_rim")
    wider, same = ring(compile_testbeds().scene, "testbed_1/plate_rim")
    assert outer == pytest.approx(0.167, abs=1e-4)
    assert wider == pytest.approx(0.1739, abs=1e-4)
    assert same == pytest.approx(height, rel=1e-3)
