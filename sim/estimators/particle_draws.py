"""Random numbers of particle filters, of every trial from streams named by the filter."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

from estimation.particle import Draws
from sim.randomness import RandomStream, Stream, Trials

BLOCK_NUMBERS = 4_000_000  # drawn at a time, of all trials together: 32 MB


@dataclass(eq=False)
class ParticleDraws:
    """What a particle filter is given at each step; the same in every loop that it watches.

    Attributes:
      normals: (trials, [agents,] particles, size) a step.
      uniforms: for resampling, (trials, [agents,] particles or 1) a step.
      jitter: for roughening, as normals; None: there is none.
      choices: of the sizes of a mixture, (trials, [agents,] particles) a step; None: there is none.
    """

    normals: RandomStream
    uniforms: RandomStream
    jitter: RandomStream | None = None
    choices: RandomStream | None = None

    @classmethod
    def of_a_filter(
        cls, name: str, seed: int, trials: Trials, particles: int, size: int, roughening: bool = False, mixture: bool = False
    ) -> ParticleDraws:
        """Four streams of the filter of that name."""
        first = Stream.PARTICLES + 3 * zlib.crc32(name.encode())
        block = max(1, BLOCK_NUMBERS // (len(trials) * particles * (2 * size + 1)))
        jitter = RandomStream(seed, trials, first + 2, (particles, size), block=block) if roughening else None
        return cls(
            RandomStream(seed, trials, first, (particles, size), block=block),
            RandomStream(seed, trials, first + 1, (particles,), uniform=True, block=block),
            jitter,
            _choices(name, seed, trials, (particles,)) if mixture else None,
        )

    @classmethod
    def of_agents(
        cls, name: str, seed: int, trials: Trials, agents: int, particles: int, size: int, mixture: bool = False
    ) -> ParticleDraws:
        """Three streams of the filter of that name, for each agent of a formation."""
        first = Stream.AGENTS_PARTICLES + 2 * (zlib.crc32(name.encode()) % 1_000_000)
        return cls(
            RandomStream(seed, trials, first, (agents, particles, size), block=20),
            RandomStream(seed, trials, first + 1, (agents, 1), uniform=True),
            choices=_choices(name, seed, trials, (agents, particles)) if mixture else None,
        )

    def step(self) -> Draws:
        """Of the next step."""
        rest = (None if stream is None else stream.tick() for stream in (self.jitter, self.choices))
        return Draws(self.normals.tick(), self.uniforms.tick(), *rest)

    def rewind(self) -> None:
        """Give the last step's numbers again."""
        for stream in (self.normals, self.uniforms, self.jitter, self.choices):
            if stream is not None:
                stream.rewind()


def _choices(name: str, seed: int, trials: Trials, shape: tuple[int, ...]) -> RandomStream:
    return RandomStream(seed, trials, Stream.CHOICES + zlib.crc32(name.encode()), shape, uniform=True, block=20)
