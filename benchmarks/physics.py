"""The twin's plant beside Basilisk: cost of a simulated second, and how far both are from the exact motion after 100 s."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from statistics import median
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from benchmarks.measure import cpu_seconds, interleave, one_core, ratio
from benchmarks.peers.conversation import Peer, PeerMissing
from benchmarks.show import figure, table
from models.attitude import quaternion
from models.plants.assembly import Assembly
from models.plants.nacs import WHEELS, NacsParameters, compile_nacs
from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.plant.batch import Plant
from sim.scenario.files import load

Array = NDArray[np.floating]

ROUNDS = 5
TRIALS = 64
BATCH_TICKS = 40  # the batches fly 4 s
FREE = {"wheel_coulomb_nm": 0, "wheel_viscous_nms": 0, "bearing_viscous_nms": 0, "gravity_m_s2": 0, "centre_of_mass_um": (0, 0, 0)}
QUIET = FREE | {"air_torque_nm": 0, "drive_torque_noise_nm": 0}


@dataclass(frozen=True, eq=False)
class Flight:
    """Torques to fly from a state, and where they lead."""

    parameters: NacsParameters
    start: Array  # [q_BN, omega_BN_B, omega_wheel], (11,)
    torque: Array  # (ticks, wheels) N m on the wheels
    tick_s: float
    exact: Array  # (11,) state of the analytic model after the last tick

    @property
    def seconds(self) -> float:
        """Simulated time."""
        return len(self.torque) * self.tick_s


class Flown(NamedTuple):
    """One flight of one contender."""

    cost: float  # CPU seconds a simulated second and trial
    end: Array  # (11,) state after the last tick


@dataclass(frozen=True, eq=False)
class Contender:
    """Somebody who flies; `batched` if many trials at once, `alike` if by the physics of the analytic model."""

    name: str
    step_s: float
    fly: Callable[[Flight, int], Flown]
    batched: bool = True
    alike: bool = True

    def cost(self, flight: Flight, trials: int) -> float:
        """CPU seconds a simulated second and trial."""
        return self.fly(flight, trials).cost


def tracking() -> Flight:
    """What the twin's controller does to track the sinusoid of nacs/fault-free without friction, gravity and chance.

    The wheels start at 200 rad/s, in the pattern whose momenta cancel.
    """
    changes = {f"plant.{key}": value for key, value in QUIET.items()} | {"start.wheel_speed_rad_s": (200, -200, -200, 200)}
    scenario = load("nacs/fault-free", changes | {"control.feedback": "truth"})
    channels = run(build(scenario, np.zeros(1, dtype=np.int64))).channels
    body, tick = scenario.testbed.process(coupled=True), scenario.run.tick_s
    start, torque = channels["truth/state"][0, 0], channels["applied"][:, 0]
    state = start
    for held in torque:
        leg = solve_ivp(lambda _, x, u: body.derivative(x, u), (0.0, tick), state, "DOP853", args=(held,), rtol=1e-12, atol=1e-13)
        state = leg.y[:, -1]
    return Flight(scenario.testbed, start, torque, tick, state)


def hub_and_wheels(complete: Assembly, step_s: float) -> Assembly:
    """The testbed without balance masses, tilt stop, friction and limits of the drives: what a hub with wheels is in Basilisk."""
    p = NacsParameters()
    across, along = p.wheel_transverse_inertia_kg_m2, p.wheel_inertia_kg_m2
    attached = 4 * across * np.eye(3) + (along - across) * p.wheel_axes @ p.wheel_axes.T  # all wheels sit at the centre
    hub = (p.inertia - attached)[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]

    def text(numbers: Array) -> str:
        return " ".join(map(repr, numbers.tolist()))

    wheels = "".join(
        f"""<body name="{name}" zaxis="{text(axis)}"> <joint name="{name}" axis="0 0 1"/>
              <inertial pos="0 0 0" mass="{p.wheel_mass_kg}" diaginertia="{across} {across} {along}"/> </body>"""
        for name, axis in zip(WHEELS, p.wheel_axes.T, strict=True)
    )
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco>
              <compiler angle="radian"/>
              <option timestep="{step_s}" integrator="RK4" gravity="0 0 0"> <flag contact="disable" constraint="disable"/> </option>
              <worldbody>
                <body name="bus"> <joint name="bearing" type="ball"/>
                  <inertial pos="0 0 0" mass="{p.mass_kg - 4 * p.wheel_mass_kg}" fullinertia="{text(hub)}"/> {wheels} </body>
              </worldbody>
              <actuator> {"".join(f'<motor name="{name}" joint="{name}"/>' for name in WHEELS)} </actuator>
              <keyframe> <key name="{complete.keyframe}"/> </keyframe>
            </mujoco>"""
    )
    return replace(complete, model=model)


def fly_twin(assembly: Assembly, flight: Flight, trials: int) -> Flown:
    """The torques in the twin's plant."""
    plant = Plant(assembly, trials)
    plant.start(flight.start[:4], flight.start[4:7], flight.start[7:])
    steps, calm = round(flight.tick_s / plant.step_s), np.zeros(3)

    def fly() -> None:
        for torque in flight.torque:
            plant.advance(torque, calm, steps)

    return Flown(cpu_seconds(fly) / flight.seconds / trials, plant.truth().state[0])


def fly_basilisk(peer: Peer, step_s: float, flight: Flight, trials: int) -> Flown:
    """The torques in Basilisk, which has no batches."""
    assert trials == 1
    p = flight.parameters
    told = peer.ask(
        "replay",
        mass=p.mass_kg,
        inertia=p.inertia,
        wheel_axes=p.wheel_axes,
        wheel_inertia=p.wheel_inertia_kg_m2,
        start=flight.start,
        torque=flight.torque,
        tick_s=flight.tick_s,
        step_s=step_s,
    )
    sigma, rest = np.split(told["end"], [3])
    q_BN = np.array([*(2.0 * sigma), 1.0 - sigma @ sigma]) / (1.0 + sigma @ sigma)
    return Flown(float(told["seconds"]) / flight.seconds, np.concatenate([q_BN, rest]))


def contenders(peer: Peer | None) -> Iterator[Contender]:
    """Everyone who flies."""
    if peer:
        for step in (1e-3, 10e-3):
            yield Contender(f"Basilisk {peer.version}, hub and wheels", step, partial(fly_basilisk, peer, step), batched=False)
    everything, calm = compile_nacs(NacsParameters()), NacsParameters.model_validate(FREE)
    for step in (1e-3, 10e-3, 20e-3):
        yield Contender("twin, hub and wheels", step, partial(fly_twin, hub_and_wheels(everything, step)))
    yield Contender("twin, balance masses and stop too", calm.step_s, partial(fly_twin, compile_nacs(calm)))
    yield Contender("twin, friction and gravity too", calm.step_s, partial(fly_twin, everything), alike=False)


def apart_deg(end: Array, other: Array) -> float:
    """Angle between the attitudes of two states."""
    return float(np.degrees(quaternion.angle(quaternion.normalize(end[:4]), quaternion.normalize(other[:4]))))


def physics() -> None:
    """Print the table."""
    flight = tracking()
    short = replace(flight, torque=flight.torque[:BATCH_TICKS])
    with one_core(), ExitStack() as stack:
        try:
            peer = stack.enter_context(Peer("bsk", "with_basilisk"))
        except PeerMissing as missing:
            peer = None
            print(f"\nBasilisk is left out: {missing}")
        everyone = list(contenders(peer))
        ends = [contender.fly(flight, 1).end for contender in everyone]
        alone = interleave(ROUNDS, [partial(contender.cost, flight, 1) for contender in everyone])
        batch = interleave(ROUNDS, [partial(contender.cost, short, TRIALS if contender.batched else 1) for contender in everyone])
    rows = [
        (
            who.name,
            f"{1e3 * who.step_s:g} ms",
            figure(1e6 * who.step_s * median(one)),
            figure(1e3 * median(one)),
            figure(ratio(alone[0], one)),
            figure(1e3 * median(many)) if who.batched else "-",
            figure(ratio(alone[0], many)) if who.batched else "-",
            f"{apart_deg(end, flight.exact):.1e}" if who.alike else "-",
        )
        for who, end, one, many in zip(everyone, ends, alone, batch, strict=True)
    ]
    table(
        "Physics: the same torques for 100 s, from the same state",
        ("RK4", "step", "us a step", "ms a s", "faster", f"ms a s of {TRIALS}", "faster", "off, deg"),
        rows,
        f"CPU time on one core, medians of {ROUNDS} interleaved rounds. ms a s: milliseconds a simulated second, told a torque every "
        f"0.1 s; of {TRIALS}: each trial in a batch of {TRIALS}; faster: than the first row, single. off: attitude after 100 s from the "
        "analytic model integrated to 1e-12. Balance masses sit on stiff springs and give a little, which is physics; with friction "
        "and gravity it is another motion.",
    )
    if peer:
        print(f"Basilisk and the twin's hub and wheels, both at 1 ms: {apart_deg(ends[0], ends[2]):.1e} deg apart after 100 s")


if __name__ == "__main__":
    physics()
