"""The picture of the flexible spacecraft: everything that flexible.xml draws, brought to the size of the plant."""

from __future__ import annotations

from collections.abc import Collection

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]

DRAWN = np.array([2.5, 2.0, 12.0])  # m in the file: width of a panel, offset of its hinge (size of the bus), length of a panel
LOOKS = frozenset({"comsat", "cubesat"})  # first words of names of geoms that belong to one look only
SHOWN = 2  # group of what a person looks at


def draw_to_size(spec: mujoco.MjSpec, panels: Collection[str], size: Array, look: str) -> None:
    """Scale bodies, geoms, meshes and cameras, and leave only what belongs to the chosen look.

    Args:
      spec: flexible.xml, changed in place; inertials are left alone.
      panels: bodies that are scaled in width and length; the hub and all on it scale with the offset of the hinges, the rest with the span.
      size: width of a panel, offset of its hinge and length of it, (3,) m.
      look: one of LOOKS.
    """
    panel, span = size / DRAWN, float(size[1:].sum() / DRAWN[1:].sum())
    hub = float(panel[1])
    for geom in list(spec.geoms):
        if geom.name.partition("_")[0] in LOOKS - {look}:
            spec.delete(geom)
            continue
        factor = panel if geom.parent.name in panels else np.full(3, span if geom.parent.name == "world" else hub)
        geom.pos = geom.pos * factor
        geom.fromto = geom.fromto * np.tile(factor, 2)
        geom.size = geom.size * (factor if geom.type == mujoco.mjtGeom.mjGEOM_BOX else factor[1])
        geom.group = SHOWN
    for mesh in spec.meshes:
        mesh.scale = mesh.scale * hub
    for body in spec.bodies:
        body.pos = body.pos * hub
    for site in spec.sites:
        site.size = site.size * hub
    for camera in spec.cameras:
        camera.pos = camera.pos * (hub if camera.name == "wheels" else span)
    spec.stat.extent *= span
    spec.stat.meansize *= hub
