"""The cross-check of several agents: analytic models of each, under the commands of a closed-loop flight, held against the plant."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.attitude import modified_rodrigues, quaternion
from models.dynamics.attitude_by_rodrigues import AttitudeByRodrigues
from models.dynamics.planar_body import PlanarBody
from models.dynamics.process import runge_kutta_along
from models.dynamics.state_layout import POSITION, SIGMA, SIGMA_RATE, VELOCITY
from sim.faults.timeline import Timeline, schedule
from sim.loop.build import build
from sim.loop.closed_loop import run_whole
from sim.loop.consensus import UnknownForce
from sim.loop.recording import Recording

Array = NDArray[np.floating]
Slope = Callable[[Array, Array, float], Array]  # of state, command held over a tick, and time

SUBSTEPS = 10  # a tick
INSTANTS_S = (1.0, 3.0, 10.0, 30.0)
CHECKED_S = 1.0  # over which the exact model must stay with the plant


class Quantity(NamedTuple):
    """Something that is compared, of each agent.

    Attributes:
      unit: of it.
      threshold: beyond which the model counts as off.
      apart: model's and plant's states, (ticks, trials, agents, n), to (ticks, trials, agents).
    """

    unit: str
    threshold: float
    apart: Callable[[Array, Array], Array]


class AgentsFamily(NamedTuple):
    """What the cross-check knows of a kind of scenario with several agents.

    Attributes:
      models: by name, of a scenario and a loop; the first is the most exact.
      command: that the models are given, of a recording, (ticks, trials, agents, k).
      quantities: by name.
      exact: how close the first model must stay to the plant over the first second, in the first quantity; None: it need not.
    """

    models: Callable[[Any], dict[str, Slope]]
    command: Callable[[Recording], Array]
    quantities: dict[str, Quantity]
    exact: Callable[[Any], float | None]


@dataclass(frozen=True, eq=False)
class AgentsCrossCheck:
    """All that was found.

    Attributes:
      loop: whose commands were flown.
      time: of every tick, (ticks,) s.
      apart: by model and quantity, (ticks, trials, agents).
      quantities: by name.
      ticks: at which divergence is reported.
      limit: that the first model must keep to over the first second; None: it need not.
    """

    loop: str
    time: Array
    apart: dict[str, dict[str, Array]]
    quantities: dict[str, Quantity]
    ticks: tuple[int, ...]
    limit: float | None

    @property
    def reached(self) -> float:
        """Greatest divergence of the first model over the first second, in the first quantity."""
        first = next(iter(next(iter(self.apart.values())).values()))
        return float(np.max(first[self.time <= CHECKED_S]))

    @property
    def passed(self) -> bool:
        """Whether the exact model stays with the plant."""
        return self.limit is None or self.reached <= self.limit


def examine(
    scenario: Any, loop: str, instants: tuple[float, ...] = INSTANTS_S, progress: Callable[[str, int, int], None] = lambda *_: None
) -> AgentsCrossCheck:
    """Fly a loop, and every model under the torques or forces that its agents were given.

    Args:
      scenario: of several agents.
      loop: that is flown.
      instants: at which the divergence is reported, s.
      progress: called with what is being done, how much is done and of how much.

    Raises:
      SimulationFailed: a trial broke down.
    """
    family = FAMILIES[scenario.family]
    system = build(scenario, np.arange(scenario.run.trials), loop=loop)
    recording = run_whole(system, lambda _, recorder: progress("ticks of the flight", recorder.done, recorder.ticks))
    truth, command, time = recording.channels["truth/state"], family.command(recording), recording.time
    apart = {}
    for name, slope in family.models(scenario).items():
        states = integrate(slope, truth[0], command, recording.dt)
        apart[name] = {quantity: of.apart(states, truth) for quantity, of in family.quantities.items()}
    reported = tuple(round(s / recording.dt) for s in instants if s <= time[-1] + 1e-9) or (len(time) - 1,)
    return AgentsCrossCheck(loop, time, apart, family.quantities, reported, family.exact(scenario))


def integrate(slope: Slope, start: Array, command: Array, dt: float) -> Array:
    """States (ticks, trials, agents, n) of a model under commands that are held for a tick, by Runge-Kutta steps."""
    step, state, path = dt / SUBSTEPS, start, [start]
    for tick, held in enumerate(command[:-1]):
        for part in np.arange(SUBSTEPS):
            time = tick * dt + (float(part) + 0.5) * step
            state = runge_kutta_along(lambda at, held=held, time=time: slope(at, held, time), state, step)  # type: ignore[misc]
        path.append(state)
    return np.stack(path)


def _turned(one: Array, other: Array) -> Array:
    """Angle between two attitudes, deg."""
    attitudes = (modified_rodrigues.to_quaternion(state[..., SIGMA]) for state in (one, other))
    return np.degrees(quaternion.angle(*attitudes))


def _apart(place: slice) -> Callable[[Array, Array], Array]:
    return lambda one, other: np.linalg.norm(one[..., place] - other[..., place], axis=-1)


def _laid(scenario: Any) -> Timeline:
    """Faults of the scenario's trials, of which torques and forces from outside act on the models too."""
    run = scenario.run
    return schedule([scenario.faults] * run.trials, scenario.parts, run.seed, np.arange(run.trials), run.ticks, run.tick_s)


def _rodrigues_models(scenario: Any) -> dict[str, Slope]:
    """True and believed inertias; of testbeds the believed one alone, since their wheels and their weight are no part of it."""
    faults = _laid(scenario)

    def with_inertia(inertia: Array) -> Slope:
        model = AttitudeByRodrigues(inertia)

        def slope(state: Array, command: Array, time: float) -> Array:
            outside = faults.push(int(time / faults.dt))
            if outside is not None:
                command = np.concatenate([command[..., :3] + outside, command[..., 3:]], axis=-1)
            return model.derivative(state, command)

        return slope

    believed = {"believed inertia": with_inertia(scenario.plant.believed_inertia)}
    return believed if scenario.wheels else {"true inertia": with_inertia(scenario.plant.inertia), **believed}


def _planar_models(scenario: Any) -> dict[str, Slope]:
    """With all forces, and with the command alone."""
    body, faults = PlanarBody(scenario.plant.mass_kg), _laid(scenario)
    unknown = UnknownForce(scenario.plant, scenario.parts.disturbance, faults)

    def whole(state: Array, command: Array, time: float) -> Array:
        tick = int(time / faults.dt)
        outside, force = faults.push(tick), command + unknown.at(tick, state, time)
        return body.derivative(state, force if outside is None else force + outside)

    return {
        "f + d and command": whole,
        "command alone": lambda state, command, time: body.derivative(state, command),  # noqa: ARG005
    }


FAMILIES = {
    "formation": AgentsFamily(
        models=_rodrigues_models,
        command=lambda recording: np.concatenate([recording.channels["applied"], recording.channels["known"][..., 3:]], axis=-1),
        quantities={"attitude": Quantity("deg", 1.0, _turned), "rate": Quantity("1/s", 1e-2, _apart(SIGMA_RATE))},
        exact=lambda scenario: None if scenario.wheels else 1e-4,
    ),
    "consensus": AgentsFamily(
        models=_planar_models,
        command=lambda recording: recording.channels["force"],
        quantities={"position": Quantity("m", 1e-2, _apart(POSITION)), "velocity": Quantity("m/s", 1e-2, _apart(VELOCITY))},
        exact=lambda scenario: 1e-3,  # noqa: ARG005
    ),
}
