"""What both pictures of consensus tracking show: looks of the loops, moving means, and what happens when."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from sim.estimators.learner_settings import Exact, Marginalised, Nothing
from sim.faults.timeline import Occurrence
from sim.loop.recording import Recording
from sim.scenario.consensus import ConsensusScenario
from sim.series.palette import LOOP_VARIANTS, Colour

Array = NDArray[np.floating]

SMOOTHING_S = 0.5
GREY: tuple[tuple[str, Colour], ...] = (("#8a8f98", (150, 156, 166)), ("#c0c4cc", (104, 110, 120)))  # of what is no way to learn


class LineStyle(NamedTuple):
    """How a loop is drawn everywhere."""

    on_light: str
    on_dark: Colour
    dashes: tuple[float, ...]


def line_styles(scenario: ConsensusScenario) -> dict[str, LineStyle]:
    """Looks of all loops: those that do not learn are grey, those with particles dashed, since they may lie on others."""
    grey, hue = iter(GREY * len(scenario.loops)), iter(LOOP_VARIANTS * len(scenario.loops))
    return {
        name: LineStyle(*next(grey if isinstance(loop, Exact | Nothing) else hue), (4.0, 2.0) if isinstance(loop, Marginalised) else ())
        for name, loop in scenario.loops.items()
    }


def moving_mean(values: Array, dt: float) -> Array:
    """Mean over a moving window, (ticks, ...); NaN spreads over the window."""
    return uniform_filter1d(values, max(1, round(SMOOTHING_S / dt)), axis=0, mode="nearest")


def occurrences(flown: dict[str, Recording]) -> list[Occurrence]:
    """Faults of the first recorded trial, which are the same in all loops."""
    return [one for one in next(iter(flown.values())).occurrences if one.trial == 0]


def chosen(flown: dict[str, Recording]) -> str:
    """The loop whose motion is drawn: the joint filter's where there is one, or else the last."""
    return "aukf" if "aukf" in flown else list(flown)[-1]
