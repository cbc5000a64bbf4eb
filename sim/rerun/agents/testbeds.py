"""Testbeds in formation as Rerun draws them: in one room, with spinning wheels, links above them, their leader's ghost amidst."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from models.attitude import modified_rodrigues, quaternion
from models.plants.assembly import Assembly
from models.plants.formation_nacs import RAISED
from models.plants.nacs import WHEELS
from sim.plant.batch import diagnose
from sim.rerun.agents.formation_scene import HALF_ANGLE, MOST_LABELS, Moving, Rows, Still, links, rows_of, shades
from sim.rerun.blueprint import UP
from sim.rerun.geoms import drawn, visible_geoms
from sim.rerun.scene import lab_of_N, to_lab, triad
from sim.rerun.sink import entity
from sim.series.channels import Curve
from sim.series.formation import FormationFlight
from sim.series.palette import AXES, REFERENCE, wheel
from sim.units import RPM

Array = NDArray[np.floating]

AXIS, ARROW = 0.24, 0.22  # m: of the axes, of the longest momentum of a wheel
LINKS_ABOVE, LABEL_ABOVE = np.array([0.0, 0.0, 0.34]), np.array([0.0, 0.0, 0.46])  # m in the lab, from centres of rotation
AIM = (0.24, 0.42)  # m along the axis out of the top: where a pointer begins and ends


@dataclass(frozen=True)
class RoomScene:
    """Testbeds on a ring, seen from the south.

    Attributes:
      assembly: all of them.
      flown: loop that is shown.
    """

    assembly: Assembly
    flown: FormationFlight

    @property
    def members(self) -> str:
        """What they are called."""
        return "testbeds"

    @cached_property
    def eye(self) -> dict[str, Any]:
        """So far away that the whole ring is in sight."""
        ring = float(np.max(np.linalg.norm(self.flown.places[:, :2], axis=-1)))
        flat = (0.8 * ring + 0.52) / np.tan(HALF_ANGLE)
        target = (0.0, 0.0, 0.76)
        position = (-flat, 0.0, target[2] + RAISED * flat)
        return {"position": position, "look_target": target, "eye_up": UP}

    @property
    def _middle(self) -> Array:
        """Of the ring, (3,) m: the place of the leader."""
        return np.array([0.0, 0.0, self.flown.places[0, 2]])

    @property
    def _momentum(self) -> float:
        """Length drawn per rad/s of a wheel, m s."""
        return ARROW / max(float(np.max(np.abs(self.flown.channels["truth/wheel_speed"]))), 1e-9)

    def still(self) -> Iterator[Still]:
        """The room and the pedestals, geoms under their bodies, axes, the leader's ghost."""
        scene, own = self.assembly.scene, shades(len(self.flown.places))
        yield "world", rr.ViewCoordinates.RIGHT_HAND_Z_UP
        for geom in visible_geoms(scene):
            body, name = int(scene.geom_bodyid[geom]), scene.geom(int(geom)).name
            path = f"{entity(scene.body(body).name)}/{entity(name.rpartition('/')[2])}" if body else f"room/{entity(name)}"
            yield f"world/{path}", drawn(scene, int(geom))
        for number, joint in enumerate(self.assembly.wheel_joints):
            yield f"world/{entity(joint)}/momentum", rr.Arrows3D.from_fields(colors=[wheel(number % len(WHEELS))], radii=0.0045)
        for shade, joint in zip(own, self.assembly.attitude_joints, strict=True):
            root = f"world/{entity(joint.rpartition('/')[0])}"
            yield f"{root}/bus/axes", triad(AXIS, AXES, 0.0035)
            yield f"{root}/bus/pointer", rr.LineStrips3D([[[0, 0, -AIM[0]], [0, 0, -AIM[1]]]], colors=[shade], radii=0.005)
            yield f"{root}/aim/pointer", rr.LineStrips3D([[[0, 0, -AIM[0]], [0, 0, -AIM[1]]]], colors=[REFERENCE], radii=0.003)
            yield f"{root}/aim/axes", triad(0.92 * AXIS, (REFERENCE,) * 3, 0.0016)
        ghost = {"fill_mode": "MajorWireframe", "colors": [REFERENCE]}
        yield "world/leader/axes", triad(1.3 * AXIS, AXES, 0.006)
        box = rr.Boxes3D(half_sizes=[[0.05, 0.05, 0.05]], centers=[[0, 0, -0.062]], radii=0.003, **ghost)
        yield "world/leader/cubesat", box
        plate = rr.Cylinders3D(lengths=[0.008], radii=[0.168], centers=[[0, 0, -0.033]], line_radii=0.003, **ghost)
        yield "world/leader/plate", plate
        yield "world/leader/pointer", rr.LineStrips3D([[[0, 0, -AIM[0]], [0, 0, -AIM[1]]]], colors=[REFERENCE], radii=0.005)

    def motion(self, position: int) -> Iterator[Moving]:
        """Bodies and wheels, where each should point, the ghost, the links, and how far each is off."""
        flown, rows = self.flown, rows_of(self.flown)
        model, mount = self.assembly.model, lab_of_N(self.assembly)
        qpos = flown.channels["truth/qpos"][rows, position]
        truth = diagnose(self.assembly, qpos, np.zeros((len(rows), model.nv)))
        for body in range(1, model.nbody):
            pose = rr.Transform3D.columns(translation=truth.position[:, body], quaternion=truth.quaternion[:, body])
            yield f"world/{entity(model.body(body).name)}", rows, pose
        speed = flown.channels["truth/wheel_speed"][rows, position].reshape(len(rows), -1)
        for joint, one in zip(self.assembly.wheel_joints, speed.T, strict=True):
            arrow = self._momentum * one[:, None] * model.jnt_axis[model.joint(joint).id]
            yield f"world/{entity(joint)}/momentum", rows, rr.Arrows3D.columns(vectors=arrow)
        wanted = modified_rodrigues.to_quaternion(flown.leader[rows, :3])
        turned = to_lab(wanted, mount)
        yield "world/leader", rows, rr.Transform3D.columns(translation=np.tile(self._middle, (len(rows), 1)), quaternion=turned)
        off = np.degrees(quaternion.angle(flown.channels["truth/q_BN"][rows, position], wanted[:, None]))
        for agent, (place, shade) in enumerate(zip(flown.places, shades(len(flown.places)), strict=True)):
            aim = rr.Transform3D.columns(translation=np.tile(place, (len(rows), 1)), quaternion=turned)
            yield f"world/testbed_{agent + 1}/aim", rows, aim
            if len(flown.places) <= MOST_LABELS:
                labels = [f"{agent + 1}: {angle:.1f} deg" for angle in off[:, agent]]
                above = np.tile(place + LABEL_ABOVE, (len(rows), 1))
                pale = bytes((*(128 + c // 2 for c in shade), 255))
                colours = np.full(len(rows), int.from_bytes(pale, "big"), dtype=np.uint32)
                marks = rr.Points3D.columns(positions=above, labels=labels, colors=colours, radii=np.full(len(rows), 0.002))
                yield f"world/labels/{agent + 1}", rows, marks
        ends = np.concatenate([(self._middle + LINKS_ABOVE)[None], flown.places + LINKS_ABOVE])
        yield from links(flown, position, ends, 0.26)


def wheel_curves(flown: FormationFlight, position: int, rows: Rows) -> Iterator[Curve]:
    """Angle to the leader and fastest wheel of each testbed, and all wheels of each."""
    agents = len(flown.places)
    names, own = tuple(f"{i + 1}" for i, _ in enumerate(flown.places)), tuple(shades(agents))
    wanted = modified_rodrigues.to_quaternion(flown.leader[rows, :3])
    off = np.degrees(quaternion.angle(flown.channels["truth/q_BN"][rows, position], wanted[:, None]))
    yield Curve("agents/angle", names, own, np.log10(np.maximum(off, 1e-4)))
    speed = flown.channels["truth/wheel_speed"][rows, position] / RPM
    yield Curve("wheels/fastest", names, own, np.max(np.abs(speed), axis=-1))
    for agent, each in enumerate(np.moveaxis(speed, 1, 0)):
        wheels = tuple(f"wheel {i + 1}" for i, _ in enumerate(WHEELS))
        yield Curve(f"wheels/each/{agent + 1}", wheels, tuple(wheel(i) for i, _ in enumerate(WHEELS)), each)
