"""The testbed as Rerun draws it: every visual geom of the MuJoCo scene logged once, and its ghosts that show what observers believe."""

from __future__ import annotations

import colorsys
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from models import quaternion
from models.assembly import Assembly
from sim.palette import OBSERVER_COLORS

Array = NDArray[np.floating]
Colour = tuple[int, int, int]

PLANE, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH = 0, 2, 3, 4, 5, 6, 7  # mjtGeom
VISIBLE_GROUPS = 3  # MuJoCo's viewer shows groups 0 to 2; 3 holds what only collides
DEFAULT_RGBA = (0.5, 0.5, 0.5, 1.0)  # MuJoCo's, which gives way to a material
TEXTURE_ROLE_RGB = 1  # mjTEXROLE_RGB
FLOOR_TILES = 3  # along each edge: a studio floor, however large the plane of the physics is
TEXELS = 64  # enough for a chequer or a solar cell, and small in the file

AXES: tuple[Colour, ...] = ((238, 84, 72), (92, 200, 110), (92, 148, 255))  # x, y, z
PALE_AXES: tuple[Colour, ...] = ((255, 178, 170), (178, 240, 190), (184, 208, 255))
TOTAL: Colour = (255, 92, 205)  # total momentum
REFERENCE: Colour = (255, 236, 150)
TRUTH: Colour = (236, 240, 247)
SPARE: tuple[Colour, ...] = ((240, 215, 90), (255, 120, 160), (130, 225, 110), (120, 170, 255))  # observers without a colour of their own

GHOST_OFFSET = np.array([0.26, -0.34, 0.0])  # m in the lab: the ghost floats beside the testbed, square to the camera's line of sight
GHOST_LABEL = np.array([0.0, 0.0, 0.31])  # m in the lab, from the pivot of a ghost
ABOVE = np.array([0.0, 0.0, 0.275])  # m in the lab, from the pivot: clear of the CubeSat, where the total momentum is seen
AXIS_LENGTH = 0.22  # m
BORESIGHT = np.array([0.0, 0.0, -0.40])  # m in B: a pointer out of the top, whose tip draws a trace
SIDES = 48  # of a cylinder
EDGE = 0.0005  # m, radius of a wire


class Shape(NamedTuple):
    """Geoms of one type in the frame of one body."""

    kind: int  # mjtGeom
    size: Array  # (n, 3) m, as MuJoCo's geom_size
    position: Array  # (n, 3) m
    quaternion: Array  # (n, 4) scalar last, geom to body


def observer_colours(observers: Iterable[str]) -> dict[str, Colour]:
    """The hue that each observer has in every picture, light enough for a dark background."""
    colours: dict[str, Colour] = {}
    for i, name in enumerate(observers):
        colours[name] = SPARE[i % len(SPARE)]
        if code := OBSERVER_COLORS.get(name):
            hue, _, saturation = colorsys.rgb_to_hls(*(int(code[k : k + 2], 16) / 255.0 for k in (1, 3, 5)))
            red, green, blue = colorsys.hls_to_rgb(hue, 0.72, min(1.0, 1.3 * saturation))
            colours[name] = (round(255 * red), round(255 * green), round(255 * blue))
    return colours


def wheel_colours(assembly: Assembly) -> list[Colour]:
    """Colours of the wheels, brightened for thin lines: those of their first coloured geom."""
    scene = assembly.scene
    colours = []
    for joint in assembly.wheel_joints:
        body = scene.joint(joint).bodyid[0]
        geoms = [g for g in visible_geoms(scene) if scene.geom_bodyid[g] == body]
        vivid = max((_rgba(scene, g)[:3] for g in geoms), key=lambda c: colorsys.rgb_to_hsv(*c)[1], default=np.full(3, 0.8))
        r, g, b = (round(255 * float(c)) for c in vivid)
        colours.append((r, g, b))
    return colours


def visible_geoms(scene: Any) -> NDArray[np.int64]:
    """Geoms that a person looks at."""
    return np.flatnonzero(scene.geom_group < VISIBLE_GROUPS)


def floating_body(assembly: Assembly) -> int:
    """Body whose attitude is q_BN."""
    return int(assembly.model.joint(assembly.attitude_joints[0]).bodyid[0])


def lab_of_N(assembly: Assembly) -> Array:
    """Quaternion, scalar last, from N to the lab: how the floating body is mounted."""
    return _scalar_last(assembly.model.body_quat[floating_body(assembly)])


def to_lab(q_BN: Array, mount: Array) -> Array:
    """Body-to-lab quaternion of q_BN, scalar last; (..., 4)."""
    return quaternion.multiply(q_BN, mount)


def rotate(q: Array, vector: Array) -> Array:
    """Body-frame vectors in the frame that `q` leads to; (..., 4), (..., 3)."""
    return (quaternion.attitude_matrix(q).swapaxes(-1, -2) @ vector[..., None])[..., 0]


def body_path(scene: Any, body: int) -> str:
    """Entity of a body: flat, so that each carries its own pose in the lab."""
    return f"world/{rr.escape_entity_path_part(scene.body(body).name) if body else 'lab'}"


def log_scene(stream: Any, prefix: str, assembly: Assembly, colours: dict[str, Colour]) -> None:
    """Log once what does not change: geoms under their bodies, axes, and two ghosts of the floating body for each observer."""
    scene = assembly.scene

    def static(path: str, *what: Any) -> None:
        stream.log(f"{prefix}{path}", *what, static=True)

    static("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    for geom in visible_geoms(scene):
        name = scene.geom(geom).name or f"geom_{geom}"
        static(f"{body_path(scene, int(scene.geom_bodyid[geom]))}/{rr.escape_entity_path_part(name)}", _drawn(scene, int(geom)))
    body = body_path(scene, floating_body(assembly))
    static(f"{body}/axes", _triad(AXIS_LENGTH, AXES, 0.0022))
    static(f"{body}/boresight", rr.LineStrips3D([[0.6 * BORESIGHT, BORESIGHT]], colors=[(*TRUTH, 150)], radii=0.0008))
    static("world/trail", rr.Points3D.from_fields(colors=[TRUTH], radii=0.002))
    static("world/reference/axes", _triad(1.2 * AXIS_LENGTH, (REFERENCE,) * 3, 0.001))
    static("world/reference/boresight", rr.Points3D([BORESIGHT], colors=[REFERENCE], radii=0.006))
    static("world/momentum", rr.Arrows3D.from_fields(colors=[TOTAL], radii=0.0035))
    for joint, colour in zip(assembly.wheel_joints, wheel_colours(assembly), strict=True):
        wheel = body_path(scene, int(scene.joint(joint).bodyid[0]))
        static(f"{wheel}/momentum", rr.Arrows3D.from_fields(colors=[colour], radii=0.0026))
    shapes = _floating_shapes(scene, floating_body(assembly))
    for shape in _outline(shapes):  # an X-ray picture for the view of the wheels
        static(f"{body}/outline/{_NAMES[shape.kind]}", _edges(shape, (*TRUTH, 110)))
    for name, colour in colours.items():
        part = rr.escape_entity_path_part(name)
        static(f"world/labels/{part}", rr.Points3D.from_fields(colors=[colour], radii=0.0004))
        static(f"world/estimate/{part}/axes", _triad(AXIS_LENGTH, AXES, 0.0022))
        for shape in shapes:
            static(f"world/estimate/{part}/{_NAMES[shape.kind]}", _solid(shape, (*colour, 38)))
        for shape in _outline(shapes):
            for ghost in ("estimate", "magnified"):
                static(f"world/{ghost}/{part}/edges_of_{_NAMES[shape.kind]}", _edges(shape, (*colour, 200)))


_NAMES = {SPHERE: "spheres", CAPSULE: "capsules", ELLIPSOID: "ellipsoids", CYLINDER: "cylinders", BOX: "boxes"}


def _triad(length: float, colours: tuple[Colour, ...], radius: float) -> Any:
    return rr.Arrows3D(vectors=length * np.eye(3), colors=colours, radii=radius)


def _scalar_last(wxyz: Array) -> Array:
    return np.roll(wxyz, -1, axis=-1)


def _rgba(scene: Any, geom: int) -> Array:
    """Colour of a geom as MuJoCo would draw it, a texture by its mean; (4,) in 0..1."""
    own, material = scene.geom_rgba[geom], scene.geom_matid[geom]
    if material < 0 or not np.allclose(own, DEFAULT_RGBA):
        return np.array(own, dtype=float)
    rgba = np.array(scene.mat_rgba[material], dtype=float)
    texture = _texture(scene, geom)
    if texture is not None:
        rgba[:3] *= texture.mean(axis=(0, 1))[:3] / 255.0
    return rgba


def _texture(scene: Any, geom: int) -> NDArray[np.uint8] | None:
    """Thinned-out image of a geom's texture, (h, w, channels), if its material has one."""
    material = scene.geom_matid[geom]
    texture = scene.mat_texid[material, TEXTURE_ROLE_RGB] if material >= 0 else -1
    if texture < 0:
        return None
    h, w, channels = scene.tex_height[texture], scene.tex_width[texture], scene.tex_nchannel[texture]
    start = scene.tex_adr[texture]
    image = scene.tex_data[start : start + h * w * channels].reshape(h, w, channels)
    return np.ascontiguousarray(image[:: max(1, h // TEXELS), :: max(1, w // TEXELS)])


def _drawn(scene: Any, geom: int) -> Any:
    """Archetype of one geom in the frame of its body."""
    kind, size = int(scene.geom_type[geom]), scene.geom_size[geom]
    position, turn = np.array(scene.geom_pos[geom]), _scalar_last(scene.geom_quat[geom])
    rgba, image = _rgba(scene, geom), _texture(scene, geom)
    if kind == MESH:
        return _mesh(scene, geom, position, turn, rgba)
    if image is not None and kind in (BOX, PLANE):
        repeat = np.maximum(scene.mat_texrepeat[scene.geom_matid[geom]], 1.0)
        if kind == PLANE:  # keeps the tiles of MuJoCo's floor, but only those about the middle
            size, repeat = np.append(size[:2] / repeat * FLOOR_TILES, 0.0), np.full(2, FLOOR_TILES)
        return _textured_box(size, repeat.astype(int), position, turn, image)
    if kind == PLANE:
        kind, size = BOX, np.array([*np.minimum(size[:2], 1.5), 1e-4])
    shape = Shape(kind, size[None], position[None], turn[None])
    return _solid(shape, _bytes(rgba))


def _bytes(rgba: Array) -> tuple[int, ...]:
    return tuple(int(c) for c in np.round(255 * np.clip(rgba, 0.0, 1.0)))


def _solid(shape: Shape, colour: tuple[int, ...]) -> Any:
    """Archetype of many geoms of one type and colour; cylinders as meshes, since Rerun's own have few sides."""
    look = {"quaternions": shape.quaternion, "colors": [colour], "fill_mode": "Solid"}
    if shape.kind == CYLINDER:
        return _cylinders(shape, colour)
    if shape.kind == BOX:
        return rr.Boxes3D(half_sizes=shape.size, centers=shape.position, **look)
    if shape.kind == CAPSULE:  # Rerun's capsules begin at their origin, MuJoCo's are centred there
        start = shape.position - rotate(shape.quaternion, shape.size[:, 1:2] * np.array([0.0, 0.0, 1.0]))
        return rr.Capsules3D(lengths=2 * shape.size[:, 1], radii=shape.size[:, 0], translations=start, **look)
    half = np.repeat(shape.size[:, :1], 3, axis=1) if shape.kind == SPHERE else shape.size
    return rr.Ellipsoids3D(half_sizes=half, centers=shape.position, **look)


def _edges(shape: Shape, colour: tuple[int, ...]) -> Any:
    """Wire frame of boxes or cylinders."""
    look = {"centers": shape.position, "quaternions": shape.quaternion, "colors": [colour], "fill_mode": "MajorWireframe"}
    if shape.kind == BOX:
        return rr.Boxes3D(half_sizes=shape.size, radii=EDGE, **look)
    return rr.Cylinders3D(lengths=2 * shape.size[:, 1], radii=shape.size[:, 0], line_radii=EDGE, **look)


def _cylinders(shape: Shape, colour: tuple[int, ...]) -> Any:
    """A mesh of cylinders: each a wall and two lids, whose rims have vertices of their own for the sake of sharp edges."""
    angle = 2.0 * np.pi * np.arange(SIDES) / SIDES
    rim = np.stack([np.cos(angle), np.sin(angle), np.zeros(SIDES)], axis=-1)
    up = np.array([0.0, 0.0, 1.0])
    unit = np.concatenate([rim - up, rim + up, rim - up, rim + up])
    normal = np.concatenate([rim, rim, np.broadcast_to(-up, rim.shape), np.broadcast_to(up, rim.shape)])
    i = np.arange(SIDES)
    j, fan = np.roll(i, -1), np.arange(1, SIDES - 1)
    wall = [np.stack([i, j, j + SIDES], axis=-1), np.stack([i, j + SIDES, i + SIDES], axis=-1)]
    lids = [np.stack([0 * fan, fan + 1, fan], axis=-1) + 2 * SIDES, np.stack([0 * fan, fan, fan + 1], axis=-1) + 3 * SIDES]
    triangles = np.concatenate([*wall, *lids])
    stretched = unit * shape.size[:, None, [0, 0, 1]]
    count = len(shape.size)
    return rr.Mesh3D(
        vertex_positions=(rotate(shape.quaternion[:, None], stretched) + shape.position[:, None]).reshape(-1, 3),
        vertex_normals=rotate(shape.quaternion[:, None], np.broadcast_to(normal, stretched.shape)).reshape(-1, 3),
        triangle_indices=(triangles + len(unit) * np.arange(count)[:, None, None]).reshape(-1, 3),
        albedo_factor=colour,
    )


def _mesh(scene: Any, geom: int, position: Array, turn: Array, rgba: Array) -> Any:
    mesh = scene.geom_dataid[geom]
    vertex = slice(scene.mesh_vertadr[mesh], scene.mesh_vertadr[mesh] + scene.mesh_vertnum[mesh])
    normal = slice(scene.mesh_normaladr[mesh], scene.mesh_normaladr[mesh] + scene.mesh_normalnum[mesh])
    face = slice(scene.mesh_faceadr[mesh], scene.mesh_faceadr[mesh] + scene.mesh_facenum[mesh])
    to_body = quaternion.attitude_matrix(turn)  # rows times A(q) turn them into the body's frame
    corner = scene.mesh_vert[vertex][scene.mesh_face[face]].reshape(-1, 3)  # normals differ between the faces of a vertex
    return rr.Mesh3D(
        vertex_positions=corner @ to_body + position,
        vertex_normals=scene.mesh_normal[normal][scene.mesh_facenormal[face]].reshape(-1, 3) @ to_body,
        triangle_indices=np.arange(len(corner)).reshape(-1, 3),
        albedo_factor=_bytes(rgba),
    )


def _textured_box(size: Array, repeat: NDArray[np.int64], position: Array, turn: Array, image: NDArray[np.uint8]) -> Any:
    """A box (or its upper side, if it has no height) of tiles that each show the whole image."""
    vertices, normals, texels, triangles = [], [], [], []
    sides = [(axis, sign) for axis in range(3) for sign in (-1.0, 1.0)] if size[2] > 0 else [(2, 1.0)]
    for axis, sign in sides:
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for i in range(repeat[0]):
            for j in range(repeat[1]):
                for a, b in ((0, 0), (1, 0), (1, 1), (0, 1)):
                    point, normal = np.zeros(3), np.zeros(3)
                    point[axis], normal[axis] = sign * size[axis], sign
                    point[u] = size[u] * (2.0 * (i + a) / repeat[0] - 1.0)
                    point[v] = size[v] * (2.0 * (j + b) / repeat[1] - 1.0)
                    vertices.append(point)
                    normals.append(normal)
                    texels.append((float(a), float(b)))
                first = len(vertices) - 4
                turned = [(0, 1, 2), (0, 2, 3)] if sign > 0 else [(0, 2, 1), (0, 3, 2)]
                triangles += [tuple(first + k for k in triangle) for triangle in turned]
    to_body = quaternion.attitude_matrix(turn)
    return rr.Mesh3D(
        vertex_positions=np.array(vertices) @ to_body + position,
        vertex_normals=np.array(normals) @ to_body,
        vertex_texcoords=np.array(texels),
        triangle_indices=np.array(triangles),
        albedo_texture=image,
    )


def _floating_shapes(scene: Any, root: int) -> list[Shape]:
    """Simple geoms of the floating body and all that it carries, at home, by type, in the frame of that body."""
    found: dict[int, list[tuple[Array, Array, Array]]] = {}
    for geom in visible_geoms(scene):
        body, kind = int(scene.geom_bodyid[geom]), int(scene.geom_type[geom])
        if kind not in _NAMES:
            continue
        position, turn = np.array(scene.geom_pos[geom]), _scalar_last(scene.geom_quat[geom])
        while body not in (root, 0):
            mount = _scalar_last(scene.body_quat[body])
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
