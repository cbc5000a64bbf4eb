"""Why model and plant diverge: each effect's share of the total, by switching it on alone and off last."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.attitude import quaternion
from models.dynamics.state_layout import ATTITUDE, WHEELS
from sim.crosscheck.model_variants import Model
from sim.crosscheck.open_loop import Change, Dynamics, Flight, altered, integrate, replay

Array = NDArray[np.floating]

FINE = 10  # integration steps a tick that stand for an exact solution
SUPERPOSE = 0.2  # how far the shares may be from the total and still be called shares
MODEL_STEP = "model's step: RK4, one a tick"
HELD = "wheel readings held for a tick"


class Effect(NamedTuple):
    """Something that the plant has and the exact equations have not."""

    name: str
    off: Change  # what switches it off


class Attribution(NamedTuple):
    """Contributions of effects to the difference between plant and model, as rotation vectors in N, rad.

    The total E is the rotation from the model's attitude to the plant's. An effect's contribution is the mean of two: what it does when
    it alone is switched on, and what is missing when it alone is switched off (for effects that interact in pairs, Shapley's value).
    Its share is the projection sum(e . E) / sum(E . E) over the trials: contributions that add up to E have shares that add up to 1.
    Where the model reads the wheels' speeds, what an effect does to the model by them is part of its contribution.
    """

    names: tuple[str, ...]  # effects of the plant, then the model's own
    alone: Array  # (effects, ticks, trials, 3)
    missing: Array  # (effects, ticks, trials, 3)
    total: Array  # (ticks, trials, 3)
    euler: Array  # (ticks, trials, 3) what Euler steps instead of Runge-Kutta would add
    bare: Array  # (ticks, trials) deg between the plant with everything off and the exact equations

    @property
    def contribution(self) -> Array:
        """(effects, ticks, trials, 3) rad."""
        return 0.5 * (self.alone + self.missing)

    def shares(self, tick: int) -> Array:
        """Of the total at a tick, (effects,)."""
        return self._project(self.contribution[:, tick], tick)

    def shares_alone(self, tick: int) -> Array:
        """The same by switching on alone, (effects,)."""
        return self._project(self.alone[:, tick], tick)

    def _project(self, vectors: Array, tick: int) -> Array:
        total = self.total[tick]
        return np.sum(vectors * total, axis=(-2, -1)) / max(float(np.sum(total**2)), 1e-300)

    def rest(self, tick: int) -> float:
        """Length of what the contributions leave of the total, relative to it (RMS over trials)."""
        total = self.total[tick]
        left = total - self.contribution[:, tick].sum(axis=0)
        return float(np.sqrt(np.sum(left**2) / max(np.sum(total**2), 1e-300)))

    def superposes(self, tick: int) -> bool:
        """Whether the shares sum to the total within `SUPERPOSE`, as a sum and as vectors."""
        if not self.total[tick].any():
            return True  # nothing has happened yet
        return abs(float(self.shares(tick).sum()) - 1.0) <= SUPERPOSE and self.rest(tick) <= SUPERPOSE


def size_deg(vectors: Array) -> Array:
    """Angle of rotation vectors (..., trials, 3) rad, RMS over the trials, in degrees."""
    return np.degrees(np.sqrt(np.mean(np.sum(vectors**2, axis=-1), axis=-1)))


def present(flight: Flight, effects: tuple[Effect, ...]) -> tuple[Effect, ...]:
    """Those effects that the scenario's plant has."""
    plant = flight.scenario.plant
    return tuple(
        effect
        for effect in effects
        if effect.off.built
        or (effect.off.no_faults and flight.scenario.faults)
        or (effect.off.parameters and altered(plant, **dict(effect.off.parameters)) != plant)
    )


def attribute(
    flight: Flight, effects: tuple[Effect, ...], model: Model, exact: Dynamics, ticks: int, progress: Callable[[], None]
) -> tuple[Attribution, Array]:
    """Switch every effect on alone, and off alone, over the first `ticks` of a flight.

    Args:
      flight: what was flown.
      effects: that the plant has.
      model: under test, one Runge-Kutta step a tick.
      exact: equations of the plant without any effect.
      ticks: how far.
      progress: called after every replay.

    Returns:
      The attribution, and the states of the plant with everything off, (ticks, trials, n).
    """

    def flown(off: tuple[Effect, ...]) -> Array:
        change = Change()
        for effect in off:
            change |= effect.off
        states = replay(flight, ticks, change)
        progress()
        return states

    full, bare = flight.states[:ticks], flown(effects)
    believes = _Readings(flight, model, ticks, full, bare)
    alone, missing = [], []
    for effect in effects:
        only, without = flown(tuple(e for e in effects if e is not effect)), flown((effect,))
        alone.append(_turn(only, bare) - believes.turned(only, bare))
        missing.append(_turn(full, without) - believes.turned(full, without))
    command, start, tick_s = flight.command[:ticks], flight.states[0], flight.scenario.run.tick_s
    ideal = integrate(exact, start, command, tick_s, FINE)
    stepped = model.predict(flight, ticks)
    own = {}
    if model.reads_wheels:
        even = model.predict(flight, ticks, FINE, read=bare[..., WHEELS], held=False)
        own = {model.difference: _turn(ideal, even), HELD: _turn(even, believes.of(bare))}
        smooth = believes.of(full)
    elif model.difference:
        smooth = model.predict(flight, ticks, FINE)
        own = {model.difference: _turn(ideal, smooth)}
    else:
        smooth = ideal
    own[MODEL_STEP] = _turn(smooth, stepped)
    names = (*(e.name for e in effects), *own)
    with np.errstate(all="ignore"):  # Euler's steps blow up a mode that nothing damps
        euler = _turn(smooth, model.predict(flight, ticks, euler=True))
    apart = np.degrees(quaternion.angle(bare[..., ATTITUDE], ideal[..., ATTITUDE]))
    parts = np.stack([*alone, *own.values()]), np.stack([*missing, *own.values()])
    return Attribution(names, *parts, _turn(full, stepped), euler, apart), bare


class _Readings:
    """What a model that reads the wheels makes of them: an effect that changes their speeds changes the model too."""

    def __init__(self, flight: Flight, model: Model, ticks: int, full: Array, bare: Array) -> None:
        self._flight, self._model, self._ticks = flight, model, ticks
        self._known = [(states, self._fine(states)) for states in (full, bare)] if model.reads_wheels else []

    def _fine(self, states: Array) -> Array:
        return self._model.predict(self._flight, self._ticks, FINE, read=states[..., WHEELS])

    def of(self, states: Array) -> Array:
        """The model's states if it reads the wheels of `states`, (ticks, trials, n)."""
        for known, path in self._known:
            if known is states:
                return path
        return self._fine(states)

    def turned(self, state: Array, reference: Array) -> Array | float:
        """How far the model turns if it reads the wheels of `state` instead of those of `reference`, as `_turn`."""
        return _turn(self.of(state), self.of(reference)) if self._model.reads_wheels else 0.0


def _turn(state: Array, reference: Array) -> Array:
    """Rotation vector from the attitude of `reference` to that of `state`, resolved in N, rad; (..., n) to (..., 3)."""
    q, q_ref = state[..., ATTITUDE], reference[..., ATTITUDE]
    return (quaternion.attitude_matrix(q_ref).swapaxes(-1, -2) @ quaternion.error(q, q_ref)[..., None])[..., 0]
