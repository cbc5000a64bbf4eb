"""Channels that are put into another order before they are signals: joints of MuJoCo's state, and messages by receiver."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.parts import AnyArray
from sim.plant.kinds import compile_plant

FREE = 7  # components of position that a joint has which lets a body float
SLIDE, HINGE = 2, 3  # types of joint, as MuJoCo numbers them


class _Joints(NamedTuple):
    """Where the joints of a body are in MuJoCo's state."""

    hinges: tuple[str, ...]
    angles: NDArray[np.int64]  # places in qpos, (hinges,)
    rates: NDArray[np.int64]  # places in qvel, (hinges,)
    slides: tuple[str, ...]
    shifts: NDArray[np.int64]  # places in qpos, (slides,)
    speeds: NDArray[np.int64]  # places in qvel, (slides,)
    position: NDArray[np.int64]  # in qpos and in qvel, (3,); (0,) of a body that cannot move away


def _joints(scenario: Any) -> _Joints:
    assembly = compile_plant(scenario.plant)
    joints = [assembly.model.joint(i) for i in range(assembly.model.njnt)]
    others = [joint for joint in joints if joint.name not in assembly.attitude_joints]
    hinges, slides = ([joint for joint in others if int(joint.type[0]) == kind] for kind in (HINGE, SLIDE))
    free = [joint for joint in joints if joint.name in assembly.attitude_joints and len(joint.qpos0) == FREE]
    angles, rates = (np.array([int(where[0]) for where in places], dtype=np.int64) for places in _addresses(hinges))
    position = int(free[0].qposadr[0]) + np.arange(3) if free else np.arange(0)
    shifts, speeds = (np.array([int(where[0]) for where in places], dtype=np.int64) for places in _addresses(slides))
    hinge_labels, slide_labels = (tuple(joint.name for joint in some) for some in (hinges, slides))
    return _Joints(hinge_labels, angles, rates, slide_labels, shifts, speeds, position)


def _addresses(joints: list[Any]) -> tuple[list[Any], list[Any]]:
    return [joint.qposadr for joint in joints], [joint.dofadr for joint in joints]


def hinge_names(scenario: Any) -> tuple[str, ...]:
    """Of a body's wheels and panels."""
    return _joints(scenario).hinges


def hinge_angles(scenario: Any, qpos: AnyArray) -> AnyArray:
    """MuJoCo's positions (ticks, trials, nq) to angles of wheels and panels, (ticks, trials, hinges) rad."""
    return qpos[..., _joints(scenario).angles]


def hinge_rates(scenario: Any, qvel: AnyArray) -> AnyArray:
    """MuJoCo's velocities (ticks, trials, nv) to rates of wheels and panels, (ticks, trials, hinges) rad/s."""
    return qvel[..., _joints(scenario).rates]


def slide_names(scenario: Any) -> tuple[str, ...]:
    """Of a body's balance masses."""
    return _joints(scenario).slides


def slide_positions(scenario: Any, qpos: AnyArray) -> AnyArray:
    """MuJoCo's positions (ticks, trials, nq) to those of balance masses along their rails, (ticks, trials, slides) m."""
    return qpos[..., _joints(scenario).shifts]


def slide_speeds(scenario: Any, qvel: AnyArray) -> AnyArray:
    """MuJoCo's velocities (ticks, trials, nv) to those of balance masses along their rails, (ticks, trials, slides) m/s."""
    return qvel[..., _joints(scenario).speeds]


def place(scenario: Any, coordinates: AnyArray) -> AnyArray:
    """Position, or velocity, of a body that floats freely, (ticks, trials, 3) m or m/s; (ticks, trials, 0) of one that cannot move away."""
    return coordinates[..., _joints(scenario).position]


def senders(scenario: Any) -> tuple[str, ...]:
    """Who may be heard: the leader, and agents counted from one."""
    return ("leader", *(f"agent{1 + i}" for i in np.arange(scenario.plant.agents)))


def by_sender(scenario: Any, received: AnyArray) -> AnyArray:
    """Whether messages came, (ticks, trials, ways), as (ticks, trials, agents, senders): 1, 0, or NaN where there is no way."""
    receiver, sender = scenario.communication().ways.T
    heard = np.full((*received.shape[:2], scenario.plant.agents, 1 + scenario.plant.agents), np.nan)
    heard[:, :, receiver, sender] = received
    return heard


def in_double(scenario: Any, array: AnyArray) -> AnyArray:  # noqa: ARG001  # what is kept in single precision
    """The same numbers in double precision, as all others are."""
    return array.astype(np.float64)
