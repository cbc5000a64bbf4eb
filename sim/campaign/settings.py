"""A campaign: a scenario varied over many trials (dispersions) and over settings (a grid)."""

from __future__ import annotations

import itertools
import math
import re
from fnmatch import translate
from functools import cached_property
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from models.sections import Headline, Section, Seed
from sim.draws import Number
from sim.scenario import files
from sim.scenario.files import AnyScenario

HEADLINES = (  # of all kinds of scenario; each has some of them
    "rmse_truth_quaternion",
    "rmse_truth_rate",
    "rmse_residual_total",
    "attitude_error_deg",
    "nees_mean",
    "nis_mean",
    "peak_statistic",
    "detection_delay_s",
    "false_alarm_fraction",
    "missed_fraction",
    "missed_watch_s",
    "faults",
    "faults_detected",
    "faults_missed",
    "faults_already_alarmed",
    "false_alarms",
    "nis_dof_mean",
    "tracking_error_deg",
    "control_effort_rms",
    "peak_wheel_speed",
    "saturated_time_s",
    "missing_readings",
    "rms_rate_error",
    "rms_attitude_error",
    "time_to_region_s",
    "final_attitude",
    "ess_median",
    "lost",
    "skae",
    "fkae",
    "settling_time_s",
    "rms_velocity_error",
    "lost_filters",
    "aem",
    "rem",
    "dynamics_error",
    "lost_s",
)


MOST_POINTS = 10_000  # to read and check one takes some hundredths of a second


class Campaign(Section):
    """One campaign file."""

    title: Headline
    scenario: str = Field(description="family/name, or a path to a scenario file")
    seed: Seed
    trials: Annotated[int, Field(ge=1)] = Field(description="trials at every point of the grid")
    shard: Annotated[int, Field(ge=1)] = Field(50, description="trials that are simulated together; no result depends on it")
    design: Literal["random", "latin-hypercube", "sobol"] = "random"
    non_physical: Literal["redraw", "refuse"] = Field("redraw", description="what to do with a draw that no plant can have")
    metrics: tuple[str, ...] = Field(HEADLINES, description="metrics that are kept, with wildcards; metric@phase for one phase")
    override: dict[str, Any] = Field({}, description="scenario keys that are the same in all trials")
    dispersion: dict[str, Number] = Field({}, description="scenario keys that are drawn anew in every trial")
    grid: dict[str, tuple[Any, ...]] = Field({}, description="scenario keys whose values are all tried, crossed with the trials")

    @model_validator(mode="after")
    def _says_everything_once(self) -> Campaign:
        sections = {"override": self.override, "dispersion": self.dispersion, "grid": self.grid}
        for section, keys in sections.items():
            for key in keys:
                if not all(part.strip() for part in key.split(".")):
                    raise ValueError(f"{section}.{key}: a name is empty")
                if key in ("run.seed", "run.trials"):
                    raise ValueError(f"{section}.{key}: is the campaign's own, {key.removeprefix('run.')} = ... before all sections")
        if twice := [key for key in self.grid if key in self.dispersion]:
            raise ValueError(f"grid.{twice[0]}: is under [dispersion] too; give it once")
        if empty := [key for key, values in self.grid.items() if not values]:
            raise ValueError(f"grid.{empty[0]}: is empty; list the values that are to be tried")
        if self.size > MOST_POINTS:
            raise ValueError(
                f"grid: has {self.size} points of {self.trials} trials each; at most {MOST_POINTS} points can be read and kept"
            )
        return self

    @property
    def size(self) -> int:
        """How many points the grid has."""
        return math.prod(len(values) for values in self.grid.values())

    @cached_property
    def points(self) -> list[dict[str, Any]]:
        """Settings of each point of the grid."""
        return [dict(zip(self.grid, values, strict=True)) for values in itertools.product(*self.grid.values())]

    @cached_property
    def _kept(self) -> re.Pattern[str]:
        """All patterns in one, since each metric of each shard is held against them."""
        return re.compile("|".join(map(translate, self.metrics)) or "(?!)")

    def keeps(self, metric: str, phase: str) -> bool:
        """Whether a metric is kept."""
        return bool(self._kept.match(metric) or self._kept.match(f"{metric}@{phase}"))

    def at(self, point: int) -> AnyScenario:
        """The scenario at a point of the grid; raises BadInput."""
        return files.load(self.scenario, self.changes(point))

    def _point(self, number: int) -> dict[str, Any]:
        """Settings of a point, without those of all others."""
        settings = {}
        for key, values in reversed(self.grid.items()):
            number, place = divmod(number, len(values))
            settings[key] = values[place]
        return {key: settings[key] for key in self.grid}

    def changes(self, point: int) -> dict[str, Any]:
        """What that scenario has instead of what its file says."""
        return self.override | self._point(point) | {"run.seed": self.seed, "run.trials": self.trials}
