"""The testbed as Rerun draws it: every visual geom of the MuJoCo scene logged once, and its ghosts that show what observers believe."""

from __future__ import annotations

from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from models.attitude import quaternion
from models.plants.assembly import Assembly
from sim.rerun.geoms import BOX, CAPSULE, CYLINDER, ELLIPSOID, SPHERE, Shape, drawn, edges, rotate, scalar_last, solid, visible_geoms
from sim.series.palette import AXES, REFERENCE, TOTAL, TRUTH, Colour, wheel

Array = NDArray[np.floating]

OUTLINE: Colour = (112, 122, 138)

GHOST_OFFSET = np.array([0.26, -0.34, 0.0])  # m in the lab: the ghost floats beside the testbed, square to the camera's line of sight
GHOST_LABEL = np.array([0.0, 0.0, 0.31])  # m in the lab, from the pivot of a ghost
ABOVE = np.array([0.0, 0.0, 0.275])  # m in the lab, from the pivot: clear of the CubeSat, where the total momentum is seen
AXIS_LENGTH = 0.22  # m
EXTENT, FLOATING = 0.68, 0.44  # m: of the testbed, as its MJCF gives it, and of what floats of it
CENTRE = np.array([0.0, 0.0, 1.07])  # m, of the testbed
BORESIGHT = np.array([0.0, 0.0, -0.40])  # m in B: a pointer out of the top, whose tip draws a trace


def size_of(assembly: Assembly) -> float:
    """How much larger a plant is than the testbed, for which all lengths above are chosen; one without a stand is all floating."""
    return float(assembly.scene.stat.extent) / (EXTENT if stands(assembly) else FLOATING)


def stands(assembly: Assembly) -> bool:
    """Whether the floating body is borne above the ground."""
    return bool(np.any(assembly.model.body_pos[floating_body(assembly)]))


def floating_body(assembly: Assembly) -> int:
    """Body whose attitude is q_BN."""
    return int(assembly.model.joint(assembly.attitude_joints[0]).bodyid[0])


def lab_of_N(assembly: Assembly) -> Array:
    """Quaternion, scalar last, from N to the lab: how the floating body is mounted."""
    return scalar_last(assembly.model.body_quat[floating_body(assembly)])


def boresight(assembly: Assembly) -> Array:
    """Tip of the pointer out of the top of a plant, (3,) m in B, whose z may point down or up."""
    up = np.sign(rotate(lab_of_N(assembly), np.array([0.0, 0.0, 1.0]))[2])
    return -up * size_of(assembly) * BORESIGHT


def to_lab(q_BN: Array, mount: Array) -> Array:
    """Body-to-lab quaternion of q_BN, scalar last; (..., 4)."""
    return quaternion.multiply(q_BN, mount)


def body_path(scene: Any, body: int) -> str:
    """Entity of a body: flat, so that each carries its own pose in the lab."""
    return f"world/{rr.escape_entity_path_part(scene.body(body).name) if body else 'lab'}"


def log_scene(stream: Any, prefix: str, assembly: Assembly, colours: dict[str, Colour]) -> None:
    """Log once what does not change: geoms under their bodies, axes, and two ghosts of the floating body for each observer."""
    scene, size = assembly.scene, size_of(assembly)

    def static(path: str, *what: Any) -> None:
        stream.log(f"{prefix}{path}", *what, static=True)

    static("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    for geom in visible_geoms(scene):
        name = scene.geom(geom).name or f"geom_{geom}"
        static(f"{body_path(scene, int(scene.geom_bodyid[geom]))}/{rr.escape_entity_path_part(name)}", drawn(scene, int(geom)))
    body = body_path(scene, floating_body(assembly))
    static(f"{body}/axes", triad(size * AXIS_LENGTH, AXES, size * 0.0022))
    tip = boresight(assembly)
    static(f"{body}/boresight", rr.LineStrips3D([[0.6 * tip, tip]], colors=[(*TRUTH, 150)], radii=size * 0.0008))
    static("world/trail", rr.Points3D.from_fields(colors=[TRUTH], radii=size * 0.002))
    static("world/reference/axes", triad(size * 1.2 * AXIS_LENGTH, (REFERENCE,) * 3, size * 0.001))
    static("world/reference/boresight", rr.Points3D([tip], colors=[REFERENCE], radii=size * 0.006))
    static("world/momentum", rr.Arrows3D.from_fields(colors=[TOTAL], radii=size * 0.0035))
    for number, joint in enumerate(assembly.wheel_joints):
        path = body_path(scene, int(scene.joint(joint).bodyid[0]))
        static(f"{path}/momentum", rr.Arrows3D.from_fields(colors=[wheel(number)], radii=size * 0.0026))
    shapes = _floating_shapes(scene, floating_body(assembly))
    for shape in _outline(shapes):  # an X-ray picture for the view of the wheels
        static(f"{body}/outline/{_NAMES[shape.kind]}", edges(shape, OUTLINE, size))
    for name, colour in colours.items():
        part = rr.escape_entity_path_part(name)
        static(f"world/labels/{part}", rr.Points3D.from_fields(colors=[colour], radii=size * 0.0004))
        static(f"world/estimate/{part}/axes", triad(size * AXIS_LENGTH, AXES, size * 0.0022))
        for shape in shapes:
            static(f"world/estimate/{part}/{_NAMES[shape.kind]}", solid(shape, (*colour, 38)))
        for shape in _outline(shapes):
            for ghost in ("estimate", "magnified"):
                static(f"world/{ghost}/{part}/edges_of_{_NAMES[shape.kind]}", edges(shape, (*colour, 200), size))


_NAMES = {SPHERE: "spheres", CAPSULE: "capsules", ELLIPSOID: "ellipsoids", CYLINDER: "cylinders", BOX: "boxes"}


def triad(length: float, colours: tuple[Colour, ...], radius: float) -> Any:
    """Three axes as arrows."""
    return rr.Arrows3D(vectors=length * np.eye(3), colors=colours, radii=radius)


def _floating_shapes(scene: Any, root: int) -> list[Shape]:
    """Simple geoms of the floating body and all that it carries, at home, by type, in the frame of that body.

    Those that only collide are among them: they stand for meshes, as a whole disc does for a plate that is drawn with its openings.
    """
    found: dict[int, list[tuple[Array, Array, Array]]] = {}
    for geom in range(scene.ngeom):
        body, kind = int(scene.geom_bodyid[geom]), int(scene.geom_type[geom])
        if kind not in _NAMES:
            continue
        position, turn = np.array(scene.geom_pos[geom]), scalar_last(scene.geom_quat[geom])
        while body not in (root, 0):
            mount = scalar_last(scene.body_quat[body])
            position, turn = scene.body_pos[body] + rotate(mount, position), quaternion.multiply(turn, mount)
            body = int(scene.body_parentid[body])
        if body == root:
            found.setdefault(kind, []).append((np.array(scene.geom_size[geom]), position, turn))
    return [Shape(kind, *(np.array(part) for part in zip(*items, strict=True))) for kind, items in found.items()]


def _outline(shapes: list[Shape]) -> list[Shape]:
    """Those shapes that are large enough to make the outline."""
    largest = max((float(s.size.max()) for s in shapes), default=0.0)
    kept = []
    for shape in shapes:
        large = shape.size.max(axis=1) > 0.28 * largest
        if shape.kind in (BOX, CYLINDER) and large.any():
            kept.append(Shape(shape.kind, shape.size[large], shape.position[large], shape.quaternion[large]))
    return kept
