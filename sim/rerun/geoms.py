"""Geoms of a MuJoCo model as Rerun archetypes."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from models.attitude import quaternion

Array = NDArray[np.floating]

PLANE, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH = 0, 2, 3, 4, 5, 6, 7  # mjtGeom
VISIBLE_GROUPS = 3  # MuJoCo's viewer shows groups 0 to 2; 3 holds what only collides
DEFAULT_RGBA = (0.5, 0.5, 0.5, 1.0)  # MuJoCo's, which gives way to a material
TEXTURE_ROLE_RGB = 1  # mjTEXROLE_RGB
FLOOR_TILES = 3  # along each edge: a studio floor, however large the plane of the physics is
TEXELS = 64  # enough for a chequer or a solar cell, and small in the file
SIDES = 48  # of a cylinder
EDGE = 0.0005  # m, radius of a wire


class Shape(NamedTuple):
    """Geoms of one type in the frame of one body."""

    kind: int  # mjtGeom
    size: Array  # (n, 3) m, as MuJoCo's geom_size
    position: Array  # (n, 3) m
    quaternion: Array  # (n, 4) scalar last, geom to body


def visible_geoms(scene: Any) -> NDArray[np.int64]:
    """Geoms that a person looks at."""
    return np.flatnonzero(scene.geom_group < VISIBLE_GROUPS)


def rotate(q: Array, vector: Array) -> Array:
    """Body-frame vectors in the frame that `q` leads to; (..., 4), (..., 3)."""
    return (quaternion.attitude_matrix(q).swapaxes(-1, -2) @ vector[..., None])[..., 0]


def scalar_last(wxyz: Array) -> Array:
    """MuJoCo's quaternions as Rerun wants them; (..., 4)."""
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


def drawn(scene: Any, geom: int) -> Any:
    """Archetype of one geom in the frame of its body."""
    kind, size = int(scene.geom_type[geom]), scene.geom_size[geom]
    position, turn = np.array(scene.geom_pos[geom]), scalar_last(scene.geom_quat[geom])
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
    return solid(shape, _bytes(rgba))


def _bytes(rgba: Array) -> tuple[int, ...]:
    return tuple(int(c) for c in np.round(255 * np.clip(rgba, 0.0, 1.0)))


def solid(shape: Shape, colour: tuple[int, ...]) -> Any:
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


def edges(shape: Shape, colour: tuple[int, ...], size: float = 1.0) -> Any:
    """Wire frame of boxes or cylinders; the wire is thicker on a plant of larger `size`."""
    look = {"centers": shape.position, "quaternions": shape.quaternion, "colors": [colour], "fill_mode": "MajorWireframe"}
    if shape.kind == BOX:
        return rr.Boxes3D(half_sizes=shape.size, radii=size * EDGE, **look)
    return rr.Cylinders3D(lengths=2 * shape.size[:, 1], radii=shape.size[:, 0], line_radii=size * EDGE, **look)


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
    corners = np.stack([scene.mesh_face[face].ravel(), scene.mesh_facenormal[face].ravel()], axis=-1)
    different, triangles = np.unique(corners, axis=0, return_inverse=True)  # normals may differ between the faces of a vertex
    return rr.Mesh3D(
        vertex_positions=scene.mesh_vert[vertex][different[:, 0]] @ to_body + position,
        vertex_normals=scene.mesh_normal[normal][different[:, 1]] @ to_body,
        triangle_indices=triangles.reshape(-1, 3),
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
