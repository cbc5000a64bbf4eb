"""A linear policy for `nacs/Tracking-v0`, found by the cross-entropy method: `python -m benchmarks.tracking_policy` finds it anew.

De Boer, Kroese, Mannor, Rubinstein (2005): candidates are drawn from a normal distribution, which is then fitted to the best of them. A
candidate is a gain an axis on attitude error, rate error and the reference's acceleration, nine numbers; a body of the batch flies it.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nacs.environments import TrackingVectorEnv

Array = NDArray[np.floating]

FILE = Path(__file__).with_suffix(".json")
SCENARIO, TICKS, SEED = "nacs/fault-free", 150, 7
CANDIDATES, BEST, GENERATIONS = 64, 12, 24
SPREAD = 5.0  # of the first candidates: full torque at 0.2 rad, or rad/s
EXTRA = 1.0  # added spread, which goes to zero with the generations, so that the search does not freeze


def action(gains: Array, observed: Array) -> Array:
    """What gains (..., 3, 3), of error, rate and acceleration by axis, make of observations (trials, 9 + wheels); (trials, 3)."""
    parts = observed[:, :9].reshape(-1, 3, 3)
    return np.clip(np.sum(gains * parts, axis=-2), -1.0, 1.0)


def train() -> Array:
    """Gains (3, 3) after all generations."""
    random = np.random.default_rng(SEED)
    mean, spread = np.zeros((3, 3)), np.full((3, 3), SPREAD)
    environment = TrackingVectorEnv(CANDIDATES, SCENARIO, set={"run.ticks": TICKS, "start.attitude_error_deg": 3.0})
    observed, _ = environment.reset(seed=SEED)
    for generation in range(GENERATIONS):
        gains = mean + spread * random.normal(size=(CANDIDATES, 3, 3))
        score, alive, over = np.zeros(CANDIDATES), np.ones(CANDIDATES, dtype=bool), False
        while not over:
            observed, reward, terminated, _, _ = environment.step(action(gains, observed))
            score += alive * reward
            alive &= ~terminated
            over = environment.loop.over
        observed = environment.step(np.zeros((CANDIDATES, 3)))[0]  # the next episodes
        best = gains[np.argsort(score)[-BEST:]]
        mean = best.mean(axis=0)
        spread = best.std(axis=0) + EXTRA * max(0.0, 1.0 - generation / (0.6 * GENERATIONS))
        print(
            f"generation {generation + 1:2}: best {score.max() / TICKS:.3f}, mean of the best {np.sort(score)[-BEST:].mean() / TICKS:.3f}"
        )
    return mean


def read() -> Array:
    """The gains that come with the benchmarks, (3, 3)."""
    return np.array(json.loads(FILE.read_text(encoding="utf-8"))["gains"])


if __name__ == "__main__":
    how = {"scenario": SCENARIO, "ticks": TICKS, "seed": SEED, "candidates": CANDIDATES, "best": BEST, "generations": GENERATIONS}
    FILE.write_text(json.dumps(how | {"gains": np.round(train(), 3).tolist()}, indent=1) + "\n", encoding="utf-8")
