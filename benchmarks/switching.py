"""What a filter that switches its gain costs beside the filters that it switches between, and beside one that knows which wheel fails."""

from __future__ import annotations

from functools import partial
from statistics import median

import numpy as np

from benchmarks.filters import PLAIN, SIZES, TICK_S, Filter, follow, log, told
from benchmarks.measure import cpu_seconds, interleave, one_core, ratio
from benchmarks.show import figure, table
from estimation.extended_kalman import ExtendedFilter, GainLaw, KalmanGain
from estimation.interacting_multiple_model import InteractingMultipleModel
from estimation.nis_switching import Fading, SwitchedGain, Windowed
from estimation.sliding_innovation import SlidingGain
from models.dynamics.wheel_faults import WheelFault
from models.plants.nacs import NacsParameters
from sim.estimators.tunings import TUNINGS
from sim.sensors.sensors import SensorSettings

ROUNDS = 5
WHEELS = 4
LAYER = np.repeat(TUNINGS["paper"].scaled(SensorSettings(), TICK_S)[2], [4, 3, WHEELS])
GAINS: dict[str, GainLaw] = {
    "EKF": KalmanGain(),
    "SIF": SlidingGain(LAYER),
    "hybrid, windowed NIS of 45": SwitchedGain(LAYER, Windowed(45), 11.0),
    "hybrid, fading NIS": SwitchedGain(LAYER, Fading(0.965), 11.0),
}


def informed() -> InteractingMultipleModel:
    """One EKF for the healthy wheels and one for each that may be without power."""
    parameters = NacsParameters()
    faults = [WheelFault.floating(WHEELS), *(WheelFault.floating(WHEELS, wheel) for wheel in range(1, WHEELS + 1))]
    members = tuple(ExtendedFilter(**told(parameters.process(fault=fault))) for fault in faults)
    modes = len(members)
    stay = np.where(np.eye(modes) > 0, 0.9999, 1e-4 / (modes - 1))
    return InteractingMultipleModel(members, stay, np.full(modes, 1.0 / modes))


def switching() -> None:
    """Print the table."""
    contenders: dict[str, Filter] = {name: ExtendedFilter(**told(PLAIN), gain=gain) for name, gain in GAINS.items()}
    contenders["IMM of five EKF"] = informed()
    first = contenders["EKF"]
    assert isinstance(first, ExtendedFilter)
    heard = log(first.measurement_model.noise)
    sizes = [heard.first(ticks, trials) for trials, ticks in SIZES.items()]
    with one_core():
        for filter_ in contenders.values():
            follow(filter_, sizes[0])  # to warm up
        taken = [
            interleave(ROUNDS, [partial(cpu_seconds, partial(follow, filter_, some)) for filter_ in contenders.values()]) for some in sizes
        ]
    scales = [1e6 / (trials * (ticks - 1)) for trials, ticks in SIZES.items()]
    rows = []
    for place, name in enumerate(contenders):
        costs = [figure(scale * median(of_size[place])) for scale, of_size in zip(scales, taken, strict=True)]
        rows.append((name, *costs, *(f"{ratio(of_size[place], of_size[0]):.2f}" for of_size in taken)))
    sizes_of = ["single", *(f"of {trials}" for trials in SIZES if trials > 1)]
    table(
        "Filters that switch their gain: us a step and trial, and over the EKF's",
        ("", *sizes_of, *(f"x {size}" for size in sizes_of)),
        rows,
        f"CPU time on one core, medians of {ROUNDS} interleaved rounds; x: median of the rounds' ratios to the EKF. of N: a trial in a "
        "batch of N. Noise, layer and detectors of McCafferty-Leroux et al. (2024), eleven states, all read.",
    )


if __name__ == "__main__":
    switching()
