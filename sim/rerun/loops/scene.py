"""The plants of several closed loops side by side as Rerun draws them: each where its loop has it, with the axes it should follow."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from models.attitude import quaternion
from models.dynamics.state_layout import WHEELS
from models.plants.assembly import Assembly
from sim.plant.batch import diagnose
from sim.rerun.blueprint import UP
from sim.rerun.geoms import drawn, rotate, visible_geoms
from sim.rerun.scene import FLOATING, boresight, floating_body, lab_of_N, size_of, to_lab, triad
from sim.series.loops import Flight
from sim.series.palette import AXES, REFERENCE, wheel

Array = NDArray[np.floating]

ROWS_MOST, RATE_MOST_HZ = 3000, 20.0  # poses of a body in the file; curves keep every tick
IN_A_ROW = 5
APART, BEHIND, HIGHER = 1.27, 1.0, 1.0  # of rows and columns, in sizes of what floats
ABOVE = 0.72  # where the label is
AXIS, POINTER, ARROW = 0.62, 0.80, 0.9
HALF_ANGLE = np.radians(27.5)  # of the viewer's field of view, up and down
ASPECT = 2.0  # of the 3-D view in the overview
TRAIL_SHARE = 0.12  # of the run


class Outlook(NamedTuple):
    """From where plants are seen, and what of them is drawn larger than it is.

    Attributes:
      up: of the picture, in the lab.
      towards: from the plants to the eye, in the lab, if it were not raised.
      raised: sine of the eye's elevation above them.
      margin: around the places of plants, below and above, (2, 3) in sizes of what floats.
      tip: where the pointer points, in B; None: out of the top.
      spread: of places, arrows and axes, on their usual size.
      turns: angle of the floating body drawn per angle from N.
      bends: angle drawn per angle of a joint that is neither the body's nor a wheel's.
    """

    up: tuple[float, float, float] = UP
    towards: tuple[float, float, float] = (0.0, -1.0, 0.0)
    raised: float = 0.26
    margin: tuple[tuple[float, float, float], tuple[float, float, float]] = ((0.68, 0.0, 0.55), (0.68, 0.0, 0.75))
    tip: tuple[float, float, float] | None = None
    spread: float = 1.0
    turns: float = 1.0
    bends: float = 1.0


class Stage(NamedTuple):
    """Where everything is.

    Attributes:
      assembly: of every loop.
      places: offset of each loop's plant, (3,) m in the lab.
      stride: ticks from one pose to the next.
      momentum: m drawn per N m s of a wheel.
      outlook: from where it is seen.
    """

    assembly: Assembly
    places: dict[str, Array]
    stride: int
    momentum: float
    outlook: Outlook = Outlook()

    def __str__(self) -> str:
        scale = f"1 N m s = {self.momentum:.2g} m" if self.momentum < 1.0 else f"1 mN m s = {self.momentum:.0f} mm"
        magnified = [
            f"{what} x {factor:g}" for what, factor in (("attitude", self.outlook.turns), ("panels", self.outlook.bends)) if factor > 1.0
        ]
        arrows = [f"wheel arrows: {scale}"] if self.assembly.wheel_joints else []
        return "; ".join([*magnified, *arrows])

    def turned(self, q: Array) -> Array:
        """Attitudes (..., 4) as they are drawn."""
        turns = self.outlook.turns
        return q if turns == 1.0 else quaternion.from_rotation_vector(turns * quaternion.to_rotation_vector(q))

    def posed(self, qpos: Array) -> Array:
        """Joint positions (..., nq) as they are drawn."""
        if self.outlook.turns == self.outlook.bends == 1.0:
            return qpos
        model, posed = self.assembly.model, qpos.copy()
        for joint in (model.joint(number) for number in range(model.njnt)):
            first, size = int(joint.qposadr[0]), len(joint.qpos0)
            if joint.name in self.assembly.attitude_joints:
                where = first + size - 4 + np.array([1, 2, 3, 0])  # scalar last
                posed[..., where] = self.turned(qpos[..., where])
            elif joint.name not in self.assembly.wheel_joints:
                posed[..., first] *= self.outlook.bends
        return posed

    @property
    def extent(self) -> float:
        """Usual size of what is drawn around a plant, m."""
        return FLOATING * size_of(self.assembly) * self.outlook.spread

    @property
    def tip(self) -> Array:
        """Of the pointer, (3,) m in B."""
        tip = boresight(self.assembly) if self.outlook.tip is None else np.array(self.outlook.tip)
        return POINTER * self.extent * tip / np.linalg.norm(tip)


def stage(several: tuple[Flight, ...], assembly: Assembly, outlook: Outlook = Outlook()) -> Stage:  # noqa: B008
    """A row of plants for each control law, the next one behind and higher; all turned alike."""
    extent = FLOATING * size_of(assembly) * outlook.spread
    rows: list[list[str]] = []
    for family in sorted({flight.look.family for flight in several}):
        names = [f.name for f in sorted(several, key=lambda f: f.look.variant) if f.look.family == family]
        rows += [names[first : first + IN_A_ROW] for first in range(0, len(names), IN_A_ROW)]
    places: dict[str, Array] = {
        name: extent * np.array([APART * (column - 0.5 * (len(names) - 1)), BEHIND * row, HIGHER * row])
        for row, names in enumerate(rows)
        for column, name in enumerate(names)
    }
    ticks, dt = max(f.recording.ticks for f in several), several[0].recording.dt
    stride = max(1, int(np.ceil(ticks / ROWS_MOST)), int(np.ceil(1.0 / (RATE_MOST_HZ * dt) - 1e-9)))
    fastest = max(float(np.max(np.abs(f.channel("truth/state")[:, WHEELS]), initial=0.0)) for f in several)
    longest = max(fastest * assembly.wheel_inertia, 1e-9)
    return Stage(assembly, places, stride, ARROW * extent / longest, outlook)


def camera(built: Stage) -> dict[str, Any]:
    """Seen from the front and a little above, from as far as all fit in."""
    scene, outlook, offsets = built.assembly.scene, built.outlook, np.array(list(built.places.values()))
    home, below, above = np.array(scene.stat.center), *(FLOATING * size_of(built.assembly) * np.array(outlook.margin))
    low, high = offsets.min(axis=0) + home - below, offsets.max(axis=0) + home + above
    half, centre = 0.5 * (high - low), 0.5 * (low + high)
    up, flat = np.array(outlook.up), np.array(outlook.towards)
    towards = np.sqrt(1.0 - outlook.raised**2) * flat + outlook.raised * up
    across, upright, deep = (float(np.abs(half @ axis)) for axis in (np.cross(up, flat), up, flat))
    distance = max(across / ASPECT, upright) / np.tan(HALF_ANGLE) + deep
    position = centre + distance * towards
    return {"position": tuple(map(float, position)), "look_target": tuple(map(float, centre)), "eye_up": built.outlook.up}


def log_stage(stream: Any, prefix: str, built: Stage, several: tuple[Flight, ...]) -> None:
    """Log once what does not change: every plant's geoms, axes and arrows, and the way that the pointer should go."""
    assembly, scene = built.assembly, built.assembly.scene
    size, extent = size_of(assembly) * built.outlook.spread, built.extent
    geoms = {
        int(geom): drawn(scene, int(geom)) for geom in visible_geoms(scene) if scene.geom_bodyid[geom]
    }  # not the lab's: it would be there many times
    pivot, mount, tip = assembly.model.body_pos[floating_body(assembly)], lab_of_N(assembly), built.tip
    stream.log(f"{prefix}world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)

    for flight in several:
        root = f"{prefix}{path_of(flight.name)}"

        def static(path: str, *what: Any, root: str = root) -> None:
            stream.log(f"{root}/{path}", *what, static=True)

        stream.log(root, rr.Transform3D(translation=built.places[flight.name]), static=True)
        for geom, archetype in geoms.items():
            name = scene.geom(geom).name or f"geom_{geom}"
            static(f"{body_part(assembly, int(scene.geom_bodyid[geom]))}/{rr.escape_entity_path_part(name)}", archetype)
        body = body_part(assembly, floating_body(assembly))
        static(f"{body}/axes", triad(AXIS * extent, AXES, size * 0.005))
        static(f"{body}/pointer", rr.LineStrips3D([[0.6 * tip, tip]], colors=[flight.look.on_dark], radii=size * 0.003))
        for number, joint in enumerate(assembly.wheel_joints):
            part = body_part(assembly, int(scene.joint(joint).bodyid[0]))
            static(f"{part}/momentum", rr.Arrows3D.from_fields(colors=[wheel(number)], radii=size * 0.0075))
        static("reference/axes", triad(1.15 * AXIS * extent, (REFERENCE,) * 3, size * 0.0028))
        static("reference/tip", rr.Points3D([tip], colors=[REFERENCE], radii=size * 0.014))
        desired = built.turned(flight.channel("reference/q")[:: built.stride])
        trace = pivot + rotate(to_lab(desired, mount), tip)
        static("reference_trace", rr.LineStrips3D([trace], colors=[(*REFERENCE, 110)], radii=size * 0.002))
        static("trail", rr.Points3D.from_fields(colors=[flight.look.on_dark], radii=size * 0.006))
        static("label", rr.Points3D.from_fields(colors=[flight.look.on_dark], radii=size * 0.0004))


def motion(built: Stage, flight: Flight) -> Iterator[tuple[str, NDArray[np.int64], Any]]:
    """Entities of one loop that move: path, ticks of its rows, columns."""
    assembly = built.assembly
    ticks = np.arange(0, flight.recording.ticks, built.stride)
    truth = diagnose(assembly, built.posed(flight.channel("truth/qpos")[ticks]), flight.channel("truth/qvel")[ticks])
    root, body, mount, tip = path_of(flight.name), floating_body(assembly), lab_of_N(assembly), built.tip
    pivot = truth.position[:, body]
    for moving in range(1, assembly.model.nbody):
        pose = rr.Transform3D.columns(translation=truth.position[:, moving], quaternion=truth.quaternion[:, moving])
        yield f"{root}/{body_part(assembly, moving)}", ticks, pose
    desired = to_lab(built.turned(flight.channel("reference/q")[ticks]), mount)
    yield f"{root}/reference", ticks, rr.Transform3D.columns(translation=pivot, quaternion=desired)
    yield f"{root}/trail", ticks, rr.Points3D.columns(positions=pivot + rotate(truth.quaternion[:, body], tip))
    labels = [f"{flight.name}: {angle:.2f} deg off" for angle in flight.angle[ticks]]
    above = pivot + ABOVE * built.extent * np.array(built.outlook.up)
    yield f"{root}/label", ticks, rr.Points3D.columns(positions=above, labels=labels)
    for joint, speed in zip(assembly.wheel_joints, flight.channel("truth/state")[ticks, WHEELS].T, strict=True):
        place = assembly.scene.joint(joint)
        arrow = built.momentum * assembly.wheel_inertia * speed[:, None] * assembly.scene.jnt_axis[place.id]
        yield f"{root}/{body_part(assembly, int(place.bodyid[0]))}/momentum", ticks, rr.Arrows3D.columns(vectors=arrow)


def path_of(loop: str) -> str:
    """Entity of a loop's plant."""
    return f"world/{rr.escape_entity_path_part(loop)}"


def body_part(assembly: Assembly, body: int) -> str:
    """A body's part of an entity path; each carries its own pose in the lab."""
    return rr.escape_entity_path_part(assembly.scene.body(body).name)
