"""Noise with heavy tails as a mixture of normal densities of one shape and several sizes, and a particle filter's likelihood by it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from estimation.proposals import Proposal, Through

Array = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class ScaleMixture:
    """Noise that is N(0, s_j^2 R) with probability pi_j; with sum pi_j s_j^2 = 1 its covariance is R.

    Attributes:
      probabilities: pi, (sizes,), which sum to one.
      scales: s, (sizes,).
    """

    probabilities: Array
    scales: Array

    def propose(
        self,
        proposal: Proposal,
        errors: Array,
        reading: Array,
        root: Array,
        noise: Array,
        normals: Array,
        through: Through | None,
        choices: Array,
    ) -> tuple[Array, Array]:
        """Draw particles and weigh them as a `Proposal` does, by the mixture in the place of a normal likelihood.

        Each size has the proposal's own density and weight w_j; a particle comes from size j with probability pi_j w_j / sum pi w and
        weighs sum pi w. That is the density of least weight variance where the proposal is that of each size: for `Optimal` where the
        reading is linear; for `Bootstrap`, which draws the same particle for all, always.

        Args:
          proposal: of a normal density.
          errors: as for `Proposal.propose`.
          reading: likewise.
          root: likewise.
          noise: R of the whole mixture, (..., d, d).
          normals: as for `Proposal.propose`.
          through: likewise.
          choices: uniform numbers in [0, 1), (..., particles).
        """
        each = [proposal.propose(errors, reading, root, scale**2 * noise, normals, through) for scale in self.scales]
        logs = np.stack([gained for _, gained in each], axis=-1) + np.log(self.probabilities)
        total = logsumexp(logs, axis=-1)
        bounds = np.cumsum(np.exp(logs - total[..., None]), axis=-1)[..., :-1]
        chosen = np.sum(choices[..., None] >= bounds, axis=-1)
        moved = np.stack([drawn for drawn, _ in each], axis=-2)  # (..., particles, sizes, e)
        return np.take_along_axis(moved, chosen[..., None, None], axis=-2)[..., 0, :], total
