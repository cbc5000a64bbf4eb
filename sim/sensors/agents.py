"""Readings of several agents: each reads some components of its own state, with white noise, and with the faults of its sensors."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sim.faults.effects import AGE, BIAS, MISSING, NOISE
from sim.faults.timeline import Timeline
from sim.randomness import RandomStream
from sim.sensors.distribution import NoiseDistribution, NormalNoise

Array = NDArray[np.floating]

NORMAL = NormalNoise()


class AgentsTruth(Protocol):
    """What is so of several agents."""

    @property
    def state(self) -> Array:
        """(trials, agents, n); what is read are its first components."""
        ...


@dataclass(frozen=True, eq=False)
class AgentsSensors:
    """White noise on each component, normal or with heavy tails.

    Attributes:
      deviation: of each component, broadcast to (components,), while no sensor is faulty.
      noise: standard normal, (trials, agents, components) a tick.
      components: how many each sensor reads, (sensors,).
      faults: of the sensors.
      distribution: of the noise, whose deviation is then its scale.
      uniforms: for that, (trials, agents, sensors) a tick; None: it is normal.
    """

    deviation: Array | float
    noise: RandomStream
    components: NDArray[np.int64]
    faults: Timeline
    distribution: NoiseDistribution = NORMAL
    uniforms: RandomStream | None = None
    _passed: list[Array] = field(default_factory=list)

    def rest(self) -> Array:
        """Zero until something has been read, (trials, agents, components)."""
        return np.zeros((len(self.noise.trials), *self.noise.shape))

    def read(self, tick: int, truth: AgentsTruth, past: Array) -> Array:  # noqa: ARG002
        """Reading at a tick, (trials, agents, components); a missing component is NaN. To be called once a tick."""
        faults = self.faults
        reading = self._late(tick, truth.state[..., : self.noise.shape[-1]])
        bias, noise, missing = faults.at(BIAS, tick), faults.at(NOISE, tick), faults.at(MISSING, tick)
        if bias is not None:
            reading = reading + bias
        deviation = self.deviation if noise is None else np.repeat(noise, self.components, axis=-1)
        if self.uniforms is not None and not isinstance(self.distribution, NormalNoise):
            scale = self.distribution.scales(self.uniforms.tick())
            deviation = deviation * np.repeat(scale, self.components, axis=-1)
        reading = reading + deviation * self.noise.tick()
        if missing is not None and missing.any():
            reading = np.where(np.repeat(missing, self.components, axis=-1), np.nan, reading)
        return reading

    def _late(self, tick: int, state: Array) -> Array:
        """What was so when the readings were taken, between ticks by interpolation; the start before the start."""
        track = self.faults.tracks.get(AGE)
        if track is None:
            return state
        longest = int(np.ceil(np.max(track.values) / self.faults.dt)) + 2
        self._passed[:] = [*self._passed, state][-longest:]
        age = np.broadcast_to(track.at(tick)[..., 0] / self.faults.dt, state.shape[:-1])  # (trials, agents) ticks
        if not age.any():
            return state
        since = np.minimum(age, len(self._passed) - 1)
        newer = np.floor(since).astype(int)
        older = np.minimum(newer + 1, len(self._passed) - 1)
        share = (since - newer)[..., None]
        passed = np.stack(self._passed[::-1])
        trial, agent = np.indices(since.shape)
        late: Array = (1.0 - share) * passed[newer, trial, agent] + share * passed[older, trial, agent]
        return late
