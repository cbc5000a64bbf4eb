"""Where the bodies of a formation are in Rerun: what every such scene has, and free spacecraft with a ghost of their leader amidst them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
import rerun as rr
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from models.attitude import modified_rodrigues
from models.plants.assembly import Assembly
from models.plants.formation import colour
from sim.rerun.blueprint import UP
from sim.rerun.geoms import drawn, visible_geoms
from sim.rerun.sink import entity
from sim.series.formation import FormationFlight
from sim.series.palette import AXES, REFERENCE, Colour

Array = NDArray[np.floating]
Rows = NDArray[np.int64]
Still = tuple[str, Any]  # path and what is logged there once
Moving = tuple[str, Rows, Any]  # path, ticks of its rows, columns

ROWS_MOST, RATE_MOST_HZ = 4000, 10.0  # poses in the file
LINK: Colour = (90, 220, 160)
LINK_LEADER: Colour = (255, 226, 120)
QUALITY_S = 1.0  # over which the share of messages that came is reckoned
AXIS, LEADER_AXIS = 0.75, 1.0  # m
HALF_ANGLE = np.radians(27.5)  # of the viewer's field of view, up and down
MOST_LABELS = 12


class Scene(Protocol):
    """A formation as it is seen."""

    @property
    def members(self) -> str:
        """What they are called."""
        ...

    @property
    def eye(self) -> dict[str, Any]:
        """From where they are seen."""
        ...

    def still(self) -> Iterator[Still]:
        """What does not move."""
        ...

    def motion(self, position: int) -> Iterator[Moving]:
        """What moves, of the recorded trial at that position."""
        ...


def rows_of(flown: FormationFlight) -> Rows:
    """Ticks whose poses are kept."""
    ticks = len(flown.leader)
    return np.arange(0, ticks, max(1, int(np.ceil(ticks / ROWS_MOST)), round(1.0 / (RATE_MOST_HZ * flown.dt))))


def shades(agents: int) -> list[Colour]:
    """Colour of each agent, as bytes."""
    coloured = (colour(int(number), agents) for number in np.arange(agents))
    return [(int(255 * red), int(255 * green), int(255 * blue)) for red, green, blue in coloured]


def links(flown: FormationFlight, position: int, ends: Array, thickness: float = 1.0) -> Iterator[Moving]:
    """Lines between `ends` of the leader and all agents, (1 + agents, 3) m, that fade as fewer messages come."""
    rows = rows_of(flown)
    came = uniform_filter1d(flown.channels["messages/received"][:, position].astype(float), max(1, round(QUALITY_S / flown.dt)), axis=0)[
        rows
    ]
    for (receiver, sender), weight, quality in zip(flown.ways, flown.weights, came.T, strict=True):
        if sender - 1 > receiver:  # of the two messages of a link one draws it
            continue
        base = np.array(LINK if sender else LINK_LEADER)
        strength = np.clip(quality * (0.35 + 0.65 * weight), 0.0, 1.0)
        colours = np.concatenate([np.tile(base, (len(rows), 1)), 255.0 * strength[:, None]], axis=-1).astype(np.uint8)
        packed = np.array([int.from_bytes(bytes(c), "big") for c in colours], dtype=np.uint32)
        strip = np.broadcast_to(ends[[sender, receiver + 1]], (len(rows), 2, 3))
        radii = np.where(strength > 0.02, thickness * (0.008 + 0.016 * strength), 0.0)
        yield f"world/links/{sender}-{receiver + 1}", rows, rr.LineStrips3D.columns(strips=list(strip), colors=packed, radii=radii)


@dataclass(frozen=True)
class FreeScene:
    """Spacecraft on an upright ring around the place of their leader.

    Attributes:
      assembly: all of them.
      flown: loop that is shown.
    """

    assembly: Assembly
    flown: FormationFlight

    @property
    def members(self) -> str:
        """What they are called."""
        return "spacecraft"

    @cached_property
    def eye(self) -> dict[str, Any]:
        """From the front and a little above."""
        distance = 0.98 * (float(np.max(np.linalg.norm(self.flown.places, axis=-1))) + 1.1) / np.tan(HALF_ANGLE)
        return {"position": (0.28 * distance, -distance, 0.16 * distance), "look_target": (0.0, 0.0, 0.0), "eye_up": UP}

    def still(self) -> Iterator[Still]:
        """Geoms under their bodies, axes, the leader's ghost."""
        scene, places = self.assembly.scene, self.flown.places
        yield "world", rr.ViewCoordinates.RIGHT_HAND_Z_UP
        for geom in visible_geoms(scene):
            body, own = scene.body(int(scene.geom_bodyid[geom])).name, scene.geom(int(geom)).name
            yield f"world/{entity(body)}/{rr.escape_entity_path_part(own.rpartition('/')[2])}", drawn(scene, int(geom))
        triad = rr.Arrows3D(vectors=AXIS * np.eye(3), colors=AXES, radii=0.018)
        for body in self.assembly.attitude_joints:
            yield f"world/{entity(body)}/axes", triad
        yield "world/leader/axes", rr.Arrows3D(vectors=LEADER_AXIS * np.eye(3), colors=AXES, radii=0.022)
        ghost = {"fill_mode": "MajorWireframe", "colors": [REFERENCE]}
        yield "world/leader/bus", rr.Boxes3D(half_sizes=[[0.21, 0.21, 0.27]], radii=0.008, **ghost)
        wings = rr.Boxes3D(half_sizes=[[0.17, 0.30, 0.008]] * 2, centers=[[0, 0.65, 0], [0, -0.65, 0]], radii=0.006, **ghost)
        yield "world/leader/wings", wings
        if len(places) <= MOST_LABELS:
            outward = places * (1.0 + 0.95 / np.linalg.norm(places, axis=-1, keepdims=True))
            labels = [f"{i + 1}" for i in range(len(places))]
            yield "world/labels", rr.Points3D(outward, labels=labels, colors=shades(len(places)), radii=0.004)

    def motion(self, position: int) -> Iterator[Moving]:
        """Bodies, the ghost and the links."""
        flown, rows = self.flown, rows_of(self.flown)
        attitude = flown.channels["truth/q_BN"][rows, position]
        for agent, place in enumerate(flown.places):
            pose = rr.Transform3D.columns(translation=np.broadcast_to(place, (len(rows), 3)), quaternion=attitude[:, agent])
            yield f"world/{entity(f'craft_{agent + 1}/hull')}", rows, pose
        leader = modified_rodrigues.to_quaternion(flown.leader[rows, :3])
        yield "world/leader", rows, rr.Transform3D.columns(translation=np.zeros((len(rows), 3)), quaternion=leader)
        yield from links(flown, position, np.concatenate([np.zeros((1, 3)), flown.places]))
