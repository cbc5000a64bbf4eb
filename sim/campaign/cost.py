"""What a run takes at the very least, said before it is begun: who asks for what cannot be paid is told so at once."""

from __future__ import annotations

import os
from typing import Any, NamedTuple

from models.plants.register.entries import kind_of
from sim.bad_input import BadInput
from sim.campaign.blocks import TRIALS_PER_BLOCK
from sim.text.table_style import counted

# Rough lower bounds, well below what any processor took: of a tick of a trial in a loop, of a physics step of a body, of a particle's step
TICK_S, STEP_S, PARTICLE_S = 1e-5, 1e-6, 1e-7
RECORD_B, BELIEF_B = 700.0, 190.0  # of a trial's tick, and of an observer in it
TRIAL_B = 5000.0  # metrics of a trial, kept until all are written
LONGEST_S = 30 * 86400.0
WORTH_A_WORD_S = 10.0


class Cost(NamedTuple):
    """Of a run: never less than this."""

    seconds: float
    bytes: float

    def __str__(self) -> str:
        return f"{_time(self.seconds)} and {self.bytes / 2**30:.3g} GiB of memory"


def cost(scenario: Any, trials: int, workers: int = 1, kept: bool = True) -> Cost:
    """Of so many trials of a scenario.

    Args:
      scenario: of any kind.
      trials: of all points together.
      workers: processes that share them.
      kept: whether all metrics are held until the end, as those of a campaign are not.
    """
    run = scenario.run
    ticks, loops = float(run.ticks), len(scenario.loop_names)
    observers = [*getattr(scenario, "observers", {}).values(), *scenario.loops.values()]
    agents = kind_of(scenario.plant).layout(scenario.plant).agents
    steps = run.tick_s / min([scenario.plant.step_s, *(getattr(one, "tick_s", run.tick_s) for one in observers)])
    particles = sum(getattr(one, "particles", 0) for one in observers) * (agents or 1)
    seconds = trials * ticks * (loops * (TICK_S + STEP_S * steps * (agents or 1)) + PARTICLE_S * particles) / min(workers, max(1, trials))
    together = min(trials, TRIALS_PER_BLOCK)
    beliefs = RECORD_B + BELIEF_B * len(observers) if agents is None else 8.0 * agents
    windows = sum(8.0 * getattr(one, "window", 0) + 100.0 * getattr(one, "particles", 0) * (agents or 1) for one in observers)
    held = together * min(workers, -(-trials // together)) * (ticks * beliefs + windows) + (TRIAL_B * trials if kept else 0.0)
    return Cost(seconds, held)


def check(scenario: Any, trials: int, workers: int = 1, kept: bool = True, flights: int = 1) -> list[str]:
    """A line if it takes long; raises BadInput if it takes more than a month, or more memory than there is.

    The arguments are those of `cost`, and how many times each trial is flown.
    """
    once = cost(scenario, trials, workers, kept)
    least = once._replace(seconds=flights * once.seconds)
    what = f"{counted(trials, 'trial')} of {scenario.run.ticks} ticks"
    if least.seconds > LONGEST_S:
        raise BadInput(f"{what} would take at least {least}; fewer trials, ticks or physics steps a tick can be paid")
    if least.bytes > (here := _memory()):
        raise BadInput(f"{what} would take at least {least}, and there are {here / 2**30:.3g} GiB; fewer trials or ticks need less")
    return [f"{what} take at least {_time(least.seconds)}"] if least.seconds > WORTH_A_WORD_S else []


def _memory() -> float:
    """Bytes of memory of this machine."""
    return float(os.sysconf("SC_PAGE_SIZE")) * os.sysconf("SC_PHYS_PAGES")


def _time(seconds: float) -> str:
    for size, name in ((365.25 * 86400.0, "years"), (86400.0, "days"), (3600.0, "hours"), (60.0, "minutes")):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.3g} {name}"
    return f"{seconds:.3g} s"
