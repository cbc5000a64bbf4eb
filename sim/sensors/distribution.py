"""How a sensor's noise is distributed: settings in a file."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.stats import chi2

from estimation.scale_mixture import ScaleMixture
from models.sections import Section

Array = NDArray[np.floating]

SIZES = 12  # normal densities that a filter takes for Student's t


class NormalNoise(Section):
    """Normal noise."""

    type: Literal["normal"] = "normal"

    @property
    def variance(self) -> float:
        """Of noise whose deviation is set to one."""
        return 1.0

    @property
    def information(self) -> float:
        """Most that a reading can tell, over that of a normal one with the deviation that is set: as if its size were known, E[1 / s^2]."""
        return 1.0

    def scales(self, uniforms: Array) -> Array:
        """What a normal number is multiplied by, of uniform ones; (...)."""
        return np.ones(uniforms.shape)

    @property
    def mixture(self) -> ScaleMixture | None:
        """As a filter knows it; None: normal."""
        return None


class StudentNoise(Section):
    """Student's t, of all components of a sensor together: heavy tails."""

    type: Literal["student-t"]
    dof: Annotated[float, Field(gt=2, le=1000)] = Field(3.0, description="degrees of freedom; above two, or there is no variance")

    @property
    def variance(self) -> float:
        """Of noise whose deviation is set to one: that of its scale."""
        return self.dof / (self.dof - 2.0)

    @property
    def information(self) -> float:
        """Most that a reading can tell, over that of a normal one with the deviation that is set: as if its size were known, E[1 / s^2]."""
        return 1.0

    def scales(self, uniforms: Array) -> Array:
        """The root of nu over a chi-square number of nu degrees of freedom, (...)."""
        found: Array = np.sqrt(self.dof / chi2.ppf(np.maximum(uniforms, 1e-300), self.dof))
        return found

    @property
    def mixture(self) -> ScaleMixture | None:
        """Sizes at the middles of twelve slices of probability, which are thinner towards the tail, scaled to the right variance."""
        edges = np.concatenate([[1.0], 0.5 ** np.arange(1, SIZES), [0.0]])  # of the chi-square number's distribution
        found = self.scales(0.5 * (edges[1:] + edges[:-1]))
        probabilities = -np.diff(edges)
        return ScaleMixture(probabilities, found / np.sqrt(probabilities @ found**2))


class GlintNoise(Section):
    """Normal noise that is larger by a factor in a share of the readings: outliers."""

    type: Literal["glint"]
    share: Annotated[float, Field(gt=0, lt=1)] = Field(0.05, description="of the readings of each sensor")
    factor: Annotated[float, Field(gt=1, le=1e6)] = Field(30.0, description="by which their noise is larger")

    @property
    def variance(self) -> float:
        """Of noise whose deviation is set to one: that of the rest."""
        return 1.0 + self.share * (self.factor**2 - 1.0)

    @property
    def information(self) -> float:
        """Most that a reading can tell, over that of a normal one with the deviation that is set: as if its size were known, E[1 / s^2]."""
        return 1.0 - self.share + self.share / self.factor**2

    def scales(self, uniforms: Array) -> Array:
        """The factor or one, (...)."""
        found: Array = np.where(uniforms < self.share, self.factor, 1.0)
        return found

    @property
    def mixture(self) -> ScaleMixture | None:
        """Both sizes."""
        return ScaleMixture(np.array([1.0 - self.share, self.share]), np.array([1.0, self.factor]) / np.sqrt(self.variance))


NoiseDistribution = Annotated[NormalNoise | StudentNoise | GlintNoise, Field(discriminator="type")]
