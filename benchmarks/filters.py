"""The twin's filters beside other people's, with the same model, noise and readings: cost of a step, and how far estimates are apart."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from statistics import median

import numpy as np
from numpy.typing import NDArray

from benchmarks.measure import cpu_seconds, interleave, one_core, ratio
from benchmarks.peers.conversation import Arrays, Peer, PeerMissing
from benchmarks.show import figure, table
from estimation.extended_kalman import ExtendedFilter
from models.nacs import NacsParameters
from models.process import predict, runge_kutta
from models.quaternion import IDENTITY, normalize
from sim.observers import Ekf, Models, ObserverSettings, build_filter
from sim.sensors import SensorSettings

Array = NDArray[np.floating]

ROUNDS = 5
TICK_S = 0.1
SIZES = {1: 200, 64: 100, 1000: 20}  # trials: ticks
COMPARED = 3  # trials that everyone estimates
PARAMETERS = NacsParameters()
MODELS = Models(PARAMETERS.process(), PARAMETERS.process(wheel_drag=True))
WHO = {"filterpy": "with_filterpy", "stonesoup": "with_stonesoup"}  # package: module that speaks for it


@dataclass(frozen=True)
class Kind:
    """A kind of filter: its settings in the twin, if it has one, and what peers call it."""

    name: str
    twin: ObserverSettings | None
    peers: dict[str, str]


STANDARD = Ekf(type="ekf", tuning="paper")
KINDS = (
    Kind("EKF-11", STANDARD, {"filterpy": "extended", "stonesoup": "extended"}),
    Kind("UKF-11", None, {"filterpy": "unscented"}),
    Kind("IMM of two EKF-11", None, {"filterpy": "interacting"}),
    Kind("particle filter", None, {}),
)
BLANK = ("",) * len(SIZES)


@dataclass(frozen=True, eq=False)
class Log:
    """What a filter is told, tick by tick."""

    commands: Array  # (ticks, trials, wheels) N m, from the tick before to this one
    readings: Array  # (ticks, trials, 11)

    def first(self, ticks: int, trials: int) -> Log:
        """The first ticks of the first trials."""
        return Log(self.commands[:ticks, :trials], self.readings[:ticks, :trials])


def own(settings: ObserverSettings) -> ExtendedFilter:
    """The twin's filter."""
    return build_filter(settings, MODELS, SensorSettings(), PARAMETERS.wheel_axes.shape[1])


def log(noise: Array) -> Log:
    """Trials of the analytic model under slowly varying torques, read with the noise (11, 11)."""
    ticks, trials, random = max(SIZES.values()), max(SIZES), np.random.default_rng(1)
    phase = random.uniform(0.0, 2.0 * np.pi, (trials, 4))
    commands = 2e-3 * np.sin(phase + 0.06 * np.arange(ticks)[:, None, None])
    spread = np.concatenate([np.zeros(4), np.full(3, 0.05), np.full(4, 50.0)])
    path = [np.concatenate([IDENTITY, np.zeros(7)]) + spread * random.normal(size=(trials, 11))]
    for command in commands[1:]:
        moved = runge_kutta(MODELS.plain, path[-1], command, TICK_S)
        path.append(np.concatenate([normalize(moved[:, :4]), moved[:, 4:]], axis=-1))
    return Log(commands, np.array(path) + random.normal(size=(ticks, trials, 11)) @ np.sqrt(noise))


def follow(filter_: ExtendedFilter, heard: Log) -> Array:
    """The twin's estimates, (ticks, trials, n)."""
    belief = filter_.initial(heard.readings[0])
    means = [belief.mean]
    for command, reading in zip(heard.commands[1:], heard.readings[1:], strict=True):
        belief = filter_.step(belief, command, reading, TICK_S)
        means.append(belief.mean)
    return np.array(means)


def evaluate(heard: Log) -> None:
    """What no filter can save: a Runge-Kutta step of the model and its transition matrix at every tick."""
    for command, reading in zip(heard.commands[1:], heard.readings[1:], strict=True):
        predict(MODELS.plain, reading, command, TICK_S)


def ask(peer: Peer, work: str, filter_: ExtendedFilter, heard: Log) -> Arrays:
    """A peer's estimates and its seconds."""
    return peer.ask(
        work,
        inertia=PARAMETERS.inertia,
        wheel_axes=PARAMETERS.wheel_axes,
        wheel_inertia=PARAMETERS.wheel_inertia_kg_m2,
        wheel_coulomb=PARAMETERS.wheel_coulomb_nm,
        Q=filter_.process_noise,
        R=filter_.measurement_noise,
        dt=TICK_S,
        commands=heard.commands,
        readings=heard.readings,
    )


def single(peer: Peer, work: str, filter_: ExtendedFilter, heard: Log) -> float:
    """The peer's seconds alone."""
    return float(ask(peer, work, filter_, heard)["seconds"])


def compare(kind: Kind, peers: dict[str, Peer], everything: Log) -> Iterator[tuple[str, ...]]:
    """Rows of one kind: the twin's filter, the model's share, and every peer."""
    sizes = [everything.first(ticks, trials) for trials, ticks in SIZES.items()]
    few = everything.first(max(SIZES.values()), COMPARED)
    reference = own(kind.twin or STANDARD)
    works = {package: work for package, work in kind.peers.items() if package in peers}
    estimates = [ask(peers[package], work, reference, few)["means"] for package, work in works.items()]  # and warm up
    contenders = [partial(single, peers[package], work, reference, sizes[0]) for package, work in works.items()]
    if kind.twin:
        means = follow(reference, few)
        contenders += [partial(cpu_seconds, partial(work, heard)) for work in (partial(follow, reference), evaluate) for heard in sizes]
    per_step = [1e6 / (trials * (ticks - 1)) for trials, ticks in SIZES.items()]
    taken = interleave(ROUNDS, contenders)
    theirs, ours, model = np.split(np.array(taken).reshape(-1, ROUNDS), [len(works), len(works) + len(sizes)])

    def costs(seconds: Array) -> list[str]:
        return [figure(median(one) * scale) for one, scale in zip(seconds, per_step, strict=False)]

    if kind.twin:
        yield f"{kind.name}, twin", *costs(ours), *BLANK, ""
        yield "  of it the model", *costs(model), *BLANK, ""
    else:
        yield f"{kind.name}, twin", "none yet", *BLANK[1:], *BLANK, ""
    for package, seconds, estimate in zip(works, theirs, estimates, strict=True):
        faster = [figure(ratio(seconds, one) * per_step[0] / scale) for one, scale in zip(ours, per_step, strict=False)] or BLANK
        apart = f"{np.abs(estimate - means).max():.0e}" if kind.twin else ""
        yield f"{kind.name}, {package} {peers[package].version}", *costs(seconds[None]), *BLANK[1:], *faster, apart


def filters() -> None:
    """Print the table."""
    everything = log(own(STANDARD).measurement_noise)
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
        "matrix. none yet: the twin has no such filter so far; peers are timed alone.",
    )


if __name__ == "__main__":
    filters()
