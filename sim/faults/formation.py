"""What goes wrong in a formation: timed events of bodies, commands, readings and links, and what they come to at every tick."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from control.communication_graph import CommunicationGraph
from control.formation_law import Gains
from models.sections import NonNegative, Ordinal, Section, Share

Array = NDArray[np.floating]
Flags = NDArray[np.bool_]

Vector = tuple[float, float, float]


class Event(Section):
    """When it begins and ends; the same in every trial. Where two say different things of one agent, the later in the file is heard."""

    start_s: NonNegative
    end_s: NonNegative

    @model_validator(mode="after")
    def _lasts(self) -> Event:
        if self.end_s <= self.start_s:
            raise ValueError(f"end_s = {self.end_s:g} is not after start_s = {self.start_s:g}")
        return self


class AddedInertia(Event):
    """All bodies have more inertia, which filters and laws do not know (Rososhansky 2017, table 4.4)."""

    kind: Literal["inertia"]
    add_kg_m2: Vector


class Disturbance(Event):
    """A torque of size [sin t, cos t, sin 2t] on each body (table 4.5)."""

    kind: Literal["disturbance"]
    size_nm: float


class ConstantCommand(Event):
    """Agents give a constant torque whatever their laws say; their filters believe the laws (tables 4.6 and 4.7)."""

    kind: Literal["command"]
    agents: tuple[Ordinal, ...]
    torque_nm: Vector


class WheelFailure(Event):
    """Drives of a wheel give only a share of the torque that they are told; without any the wheel coasts. Nobody on board knows."""

    kind: Literal["wheel-failure"]
    agents: tuple[Ordinal, ...]
    wheel: Ordinal
    remaining: Share = 0.0


class OtherGains(Event):
    """Agents' laws have other gains (tables 4.6 and 4.7)."""

    kind: Literal["gains"]
    agents: tuple[Ordinal, ...] | Literal["all"] = "all"
    k1: NonNegative | None = None
    k2: NonNegative | None = None
    k3: NonNegative | None = None
    gamma: NonNegative | None = None


class Readings(Event):
    """All readings have a bias, the same of each component and agent, and another deviation (table 4.8)."""

    kind: Literal["readings"]
    bias: float = 0.0
    deviation: NonNegative


class Loss(Event):
    """Each message is lost with a probability, by itself."""

    kind: Literal["message-loss"]
    probability: Share


class Late(Event):
    """Messages come late."""

    kind: Literal["delay"]
    delay_s: NonNegative


class Cut(Event):
    """Links are cut in both directions, 0 being the leader; who is left alone knows it and gives them no weight."""

    kind: Literal["cut"]
    links: tuple[tuple[Annotated[int, Field(ge=0)], Ordinal], ...]


Fault = Annotated[
    AddedInertia | Disturbance | ConstantCommand | WheelFailure | OtherGains | Readings | Loss | Late | Cut, Field(discriminator="kind")
]


class Happening(NamedTuple):
    """One event as it happens, in every trial."""

    start_tick: int
    end_tick: int
    kind: str
    text: str


@dataclass(frozen=True, eq=False)
class FormationFaults:
    """All events of a run, tick by tick; first axis: tick."""

    inertia: Array  # (ticks, 3) kg m2 added to each body's diagonal
    disturbance: Array  # (ticks,) N m
    command: Array  # (ticks, agents, 3) N m in place of the law's, NaN where there is none
    gains: Array  # (ticks, 4, agents, 1): k1, k2, k3, gamma
    lambda_: float
    bias: Array  # (ticks,)
    deviation: Array  # (ticks,)
    loss: Array  # (ticks,) probability
    delay: NDArray[np.int64]  # (ticks,) in ticks
    cut: Flags  # (ticks, messages) of the graph's ways
    wheels: Array  # (ticks, agents, wheels) share that each wheel's drive gives
    occurrences: tuple[Happening, ...]

    def gains_at(self, tick: int) -> Gains:
        """Of every agent's law."""
        k1, k2, k3, gamma = self.gains[tick]
        return Gains(k1, k2, k3, gamma, self.lambda_)


def schedule(
    faults: tuple[Fault, ...], ticks: int, dt: float, graph: CommunicationGraph, gains: Gains, deviation: float, wheels: int = 0
) -> FormationFaults:
    """Lay out the events over the ticks; each agent has so many wheels."""
    agents = graph.agents
    out = FormationFaults(
        inertia=np.zeros((ticks, 3)),
        disturbance=np.zeros(ticks),
        command=np.full((ticks, agents, 3), np.nan),
        gains=np.tile(np.array(gains[:4], dtype=float)[:, None, None], (ticks, 1, agents, 1)),
        lambda_=float(np.asarray(gains.lambda_)),
        bias=np.zeros(ticks),
        deviation=np.full(ticks, deviation),
        loss=np.zeros(ticks),
        delay=np.zeros(ticks, dtype=np.int64),
        cut=np.zeros((ticks, len(graph.ways)), dtype=bool),
        wheels=np.ones((ticks, agents, wheels)),
        occurrences=tuple(
            Happening(round(fault.start_s / dt), min(ticks, round(fault.end_s / dt)), fault.kind, _text(fault)) for fault in faults
        ),
    )
    for fault, occurrence in zip(faults, out.occurrences, strict=True):
        when = slice(occurrence.start_tick, occurrence.end_tick)
        match fault:
            case AddedInertia():
                out.inertia[when] = fault.add_kg_m2
            case Disturbance():
                out.disturbance[when] = fault.size_nm
            case ConstantCommand():
                out.command[when, np.array(fault.agents) - 1] = fault.torque_nm
            case WheelFailure():
                out.wheels[when, np.array(fault.agents) - 1, fault.wheel - 1] = fault.remaining
            case OtherGains():
                which = np.arange(agents) if fault.agents == "all" else np.array(fault.agents) - 1
                for number, value in enumerate((fault.k1, fault.k2, fault.k3, fault.gamma)):
                    if value is not None:
                        out.gains[when, number, which] = value
            case Readings():
                out.bias[when], out.deviation[when] = fault.bias, fault.deviation
            case Loss():
                out.loss[when] = fault.probability
            case Late():
                out.delay[when] = round(fault.delay_s / dt)
            case Cut():
                pairs = graph.ways
                receivers, senders = pairs[:, 0] + 1, pairs[:, 1]
                for i, j in fault.links:
                    out.cut[when] |= ((receivers == i) & (senders == j)) | ((receivers == j) & (senders == i))
    return out


def _text(fault: Fault) -> str:
    match fault:
        case AddedInertia():
            return f"inertia + {list(fault.add_kg_m2)} kg m2"
        case Disturbance():
            return f"torque {fault.size_nm:g} [sin t, cos t, sin 2t] N m"
        case ConstantCommand():
            return f"{', '.join(map(str, fault.agents))} give {list(fault.torque_nm)} N m"
        case WheelFailure():
            left = f"gives {100 * fault.remaining:g} %" if fault.remaining else "fails"
            return f"wheel {fault.wheel} of {', '.join(map(str, fault.agents))} {left}"
        case OtherGains():
            said = [f"{key} = {value:g}" for key in ("k1", "k2", "k3", "gamma") if (value := getattr(fault, key)) is not None]
            return f"{'all' if fault.agents == 'all' else ', '.join(map(str, fault.agents))}: {', '.join(said)}"
        case Readings():
            return f"readings: bias {fault.bias:g}, deviation {fault.deviation:g}"
        case Loss():
            return f"{100 * fault.probability:g} % of messages lost"
        case Late():
            return f"messages {fault.delay_s:g} s late"
        case Cut():
            return f"cut: {', '.join(f'{i}-{j}' if i else f'leader-{j}' for i, j in fault.links)}"
