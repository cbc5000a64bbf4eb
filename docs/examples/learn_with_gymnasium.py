"""Fly sixteen bodies in one batch by a policy, the simplest there is, under an environment of Gymnasium."""

from __future__ import annotations

import gymnasium
import numpy as np

import nacs.environments  # noqa: F401  # registers nacs/Tracking-v0

many = gymnasium.make_vec(
    "nacs/Tracking-v0", num_envs=16, set={"run.ticks": 60}, dispersion={"plant.centre_of_mass_um.0": {"normal": [0.0, 2.0]}}
)
observed, _ = many.reset(seed=1)
returned, over = np.zeros(16), np.zeros(16, dtype=bool)
while not over.all():
    observed, reward, terminated, truncated, info = many.step(np.clip(-12.0 * observed[:, :3] - 5.0 * observed[:, 3:6], -1.0, 1.0))
    returned, over = returned + reward * ~over, over | terminated | truncated
print(f"return {returned.mean():.1f} of 60 at most, error {info['error_deg'].mean():.2f} deg")
