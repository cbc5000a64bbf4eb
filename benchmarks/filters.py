"""The twin's filters beside other people's, with the same model, noise and readings: cost of a step, and how far estimates are apart."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.measure import cpu_seconds, interleave, one_core, ratio
from benchmarks.peers.conversation import Arrays, Peer, PeerMissing
from benchmarks.show import figure, table
from estimation.extended_kalman import ExtendedFilter
from estimation.interacting_multiple_model import InteractingMultipleModel
from estimation.unscented import UnscentedFilter
from models.attitude.quaternion import IDENTITY, normalize
from models.dynamics.process import ProcessModel, predict, runge_kutta
from models.dynamics.rigid_body import RigidBody
from models.dynamics.wheel_faults import WheelFault
from models.dynamics.wheeled_body import WheeledBody
from models.plants.nacs import NacsParameters
from sim.estimators.tunings import TUNINGS
from sim.sensors.sensors import SensorSettings

Array = NDArray[np.floating]
Filter = ExtendedFilter | UnscentedFilter | InteractingMultipleModel

ROUNDS = 5
TICK_S = 0.1
SIZES = {1: 200, 64: 100, 1000: 20}  # trials: ticks
COMPARED = 3  # trials that everyone estimates
PARAMETERS = NacsParameters()
PLAIN = PARAMETERS.process()
WITH_FRICTION = replace(PLAIN, wheel_coulomb=PARAMETERS.wheel_coulomb_nm)
WHO = {"filterpy": "with_filterpy", "stonesoup": "with_stonesoup"}  # package: module that speaks for it
ALPHA = 1.0  # spread of the sigma points, here and at the peers
CHAIN = np.array([[0.98, 0.02], [0.02, 0.98]])


def told(process: ProcessModel) -> dict[str, Any]:
    """What a filter of eleven or seven states is told, with the noise of the paper."""
    counts = [4, 3, 4] if isinstance(process, WheeledBody) else [4, 3]
    q, r, _ = (np.repeat(values[: len(counts)], counts) for values in TUNINGS["paper"].scaled(SensorSettings(), TICK_S))
    prior = np.concatenate([IDENTITY, np.zeros(sum(counts) - 4)])
    return {
        "process": process,
        "process_noise": np.diag(q),
        "measurement_noise": np.diag(r),
        "prior": prior,
        "prior_variance": np.ones(len(prior)),
    }


def rigid_body(*floating: int) -> RigidBody:
    """Seven states, the wheel speeds being known; `floating` wheels have no power."""
    axes = PARAMETERS.wheel_axes
    return RigidBody(PARAMETERS.inertia, WheelFault.floating(4, *floating).on_body(axes).torque_map, axes * PARAMETERS.wheel_inertia_kg_m2)


HEALTHY, FLOATING = rigid_body(), rigid_body(1)


@dataclass(frozen=True)
class Kind:
    """A kind of filter: the twin's, what no such filter can save, and what peers call it."""

    name: str
    twin: Filter
    model: Callable[[Array, Array], object]  # asked at every tick with readings and commands
    peers: dict[str, str]


def linearized(*processes: ProcessModel) -> Callable[[Array, Array], object]:
    """A Runge-Kutta step of the models and their transition matrices."""
    return lambda state, command: [predict(process, state, command, TICK_S) for process in processes]


def at_sigma_points(*processes: ProcessModel) -> Callable[[Array, Array], object]:
    """Runge-Kutta steps of the models from 2 n + 1 states."""

    def move(state: Array, command: Array) -> object:
        points = np.repeat(state[..., None, :], 2 * state.shape[-1] + 1, axis=-2)
        return [runge_kutta(process, points, command[..., None, :], TICK_S) for process in processes]

    return move


def interacting(*members: ExtendedFilter | UnscentedFilter) -> InteractingMultipleModel:
    """Two modes, as the peers have them."""
    return InteractingMultipleModel(members, CHAIN, np.array([0.5, 0.5]))


STANDARD = ExtendedFilter(**told(PLAIN))
KINDS = (
    Kind("EKF-11", STANDARD, linearized(PLAIN), {"filterpy": "extended", "stonesoup": "extended"}),
    Kind("UKF-11", UnscentedFilter(**told(PLAIN), alpha=ALPHA), at_sigma_points(PLAIN), {"filterpy": "unscented"}),
    Kind("UKF-7", UnscentedFilter(**told(HEALTHY), alpha=ALPHA), at_sigma_points(HEALTHY), {"filterpy": "unscented_7"}),
    Kind(
        "IMM of two EKF-11",
        interacting(STANDARD, ExtendedFilter(**told(WITH_FRICTION))),
        linearized(PLAIN, WITH_FRICTION),
        {"filterpy": "interacting"},
    ),
    Kind(
        "IMM of two UKF-7",
        interacting(*(UnscentedFilter(**told(process), alpha=ALPHA) for process in (HEALTHY, FLOATING))),
        at_sigma_points(HEALTHY, FLOATING),
        {"filterpy": "interacting_7"},
    ),
)
BLANK = ("",) * len(SIZES)


@dataclass(frozen=True, eq=False)
class Log:
    """What a filter is told, tick by tick."""

    commands: Array  # (ticks, trials, wheels) N m, from the tick before to this one, and what else is known
    readings: Array  # (ticks, trials, n)

    def first(self, ticks: int, trials: int) -> Log:
        """The first ticks of the first trials."""
        return Log(self.commands[:ticks, :trials], self.readings[:ticks, :trials])

    def for_states(self, size: int) -> Log:
        """For filters of `size` states: those of seven know the wheels' speeds, as read at the tick before, by the command."""
        if size == self.readings.shape[-1]:
            return self
        speeds = np.concatenate([self.readings[:1, :, 7:], self.readings[:-1, :, 7:]])
        return Log(np.concatenate([self.commands, speeds], axis=-1), self.readings[..., :7])


def log(noise: Array) -> Log:
    """Trials of the analytic model under slowly varying torques, read with the noise (11, 11)."""
    ticks, trials, random = max(SIZES.values()), max(SIZES), np.random.default_rng(1)
    phase = random.uniform(0.0, 2.0 * np.pi, (trials, 4))
    commands = 2e-3 * np.sin(phase + 0.06 * np.arange(ticks)[:, None, None])
    spread = np.concatenate([np.zeros(4), np.full(3, 0.05), np.full(4, 50.0)])
    path = [np.concatenate([IDENTITY, np.zeros(7)]) + spread * random.normal(size=(trials, 11))]
    for command in commands[1:]:
        moved = runge_kutta(PLAIN, path[-1], command, TICK_S)
        path.append(np.concatenate([normalize(moved[:, :4]), moved[:, 4:]], axis=-1))
    return Log(commands, np.array(path) + random.normal(size=(ticks, trials, 11)) @ np.sqrt(noise))


def follow(filter_: Filter, heard: Log) -> Array:
    """The twin's estimates, (ticks, trials, n)."""
    belief = filter_.initial(heard.readings[0])
    means = [belief.mean]
    for command, reading in zip(heard.commands[1:], heard.readings[1:], strict=True):
        belief = filter_.step(belief, command, reading, TICK_S)
        means.append(belief.mean)
    return np.array(means)


def evaluate(model: Callable[[Array, Array], object], heard: Log) -> None:
    """What no filter can save: the model, asked at every tick."""
    for command, reading in zip(heard.commands[1:], heard.readings[1:], strict=True):
        model(reading, command)


def ask(peer: Peer, work: str, noise: ExtendedFilter | UnscentedFilter, heard: Log) -> Arrays:
    """A peer's estimates and its seconds."""
    return peer.ask(
        work,
        inertia=PARAMETERS.inertia,
        wheel_axes=PARAMETERS.wheel_axes,
        wheel_inertia=PARAMETERS.wheel_inertia_kg_m2,
        wheel_coulomb=PARAMETERS.wheel_coulomb_nm,
        Q=noise.process_noise,
        R=noise.measurement_model.noise,
        dt=TICK_S,
        commands=heard.commands,
        readings=heard.readings,
    )


def single(peer: Peer, work: str, noise: ExtendedFilter | UnscentedFilter, heard: Log) -> float:
    """The peer's seconds alone."""
    return float(ask(peer, work, noise, heard)["seconds"])


def compare(kind: Kind, peers: dict[str, Peer], everything: Log) -> Iterator[tuple[str, ...]]:
    """Rows of one kind: the twin's filter, the model's share, and every peer."""
    first = kind.twin.filters[0] if isinstance(kind.twin, InteractingMultipleModel) else kind.twin
    assert isinstance(first, ExtendedFilter | UnscentedFilter)
    heard = everything.for_states(len(first.prior))
    sizes = [heard.first(ticks, trials) for trials, ticks in SIZES.items()]
    few = heard.first(max(SIZES.values()), COMPARED)
    works = {package: work for package, work in kind.peers.items() if package in peers}
    estimates = [ask(peers[package], work, first, few)["means"] for package, work in works.items()]  # and warm up
    contenders = [partial(single, peers[package], work, first, sizes[0]) for package, work in works.items()]
    means = follow(kind.twin, few)
    contenders += [
        partial(cpu_seconds, partial(work, some)) for work in (partial(follow, kind.twin), partial(evaluate, kind.model)) for some in sizes
    ]
    per_step = [1e6 / (trials * (ticks - 1)) for trials, ticks in SIZES.items()]
    taken = interleave(ROUNDS, contenders)
    theirs, ours, model = np.split(np.array(taken).reshape(-1, ROUNDS), [len(works), len(works) + len(sizes)])

    def costs(seconds: Array) -> list[str]:
        return [figure(median(one) * scale) for one, scale in zip(seconds, per_step, strict=False)]

    yield f"{kind.name}, twin", *costs(ours), *BLANK, ""
    yield "  of it the model", *costs(model), *BLANK, ""
    for package, seconds, estimate in zip(works, theirs, estimates, strict=True):
        faster = [figure(ratio(seconds, one) * per_step[0] / scale) for one, scale in zip(ours, per_step, strict=False)]
        apart = f"{np.abs(estimate - means)[1:].max():.0e}"  # all start from the first reading
        yield f"{kind.name}, {package} {peers[package].version}", *costs(seconds[None]), *BLANK[1:], *faster, apart


def filters() -> None:
    """Print the table."""
    everything = log(STANDARD.measurement_model.noise)
    with one_core(), ExitStack() as stack:
        peers = {}
        for package, module in WHO.items():
            try:
                peers[package] = stack.enter_context(Peer(package, module))
            except PeerMissing as missing:
                print(f"\n{package} is left out: {missing}")
        rows = [row for kind in KINDS for row in compare(kind, peers, everything)]
    batches = [f"of {trials}" for trials in SIZES if trials > 1]
    table(
        "Filters: us a step and trial, the whole state being read",
        ("", "single", *batches, "x single", *(f"x {batch}" for batch in batches), "apart"),
        rows,
        f"CPU time on one core, medians of {ROUNDS} interleaved rounds. of N: a trial in a batch of N. x: the peer's step, always single, "
        "over the twin's. apart: greatest difference of any component of an estimate from the twin's, in "
        f"{COMPARED} trials of {max(SIZES.values())} ticks. Peers are given the twin's model, a Runge-Kutta step with its transition "
        "matrix or at sigma points; UKF-7 knows the wheels' speeds, the second mode of its IMM has a floating wheel.",
    )


if __name__ == "__main__":
    filters()
