"""A campaign: a scenario varied over many trials (dispersions) and over settings (a grid)."""

from __future__ import annotations

import itertools
import re
from fnmatch import translate
from functools import cached_property
from typing import Annotated, Any, Literal

from pydantic import Field

from models.sections import Section
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


class Campaign(Section):
    """One campaign file."""

    title: str
    scenario: str = Field(description="family/name, or a path to a scenario file")
    seed: Annotated[int, Field(ge=0)]
    trials: Annotated[int, Field(ge=1)] = Field(description="trials at every point of the grid")
    shard: Annotated[int, Field(ge=1)] = Field(50, description="trials that are simulated together; no result depends on it")
    design: Literal["random", "latin-hypercube", "sobol"] = "random"
    non_physical: Literal["redraw", "refuse"] = Field("redraw", description="what to do with a draw that no plant can have")
    metrics: tuple[str, ...] = Field(HEADLINES, description="metrics that are kept, with wildcards; metric@phase for one phase")
    override: dict[str, Any] = Field({}, description="scenario keys that are the same in all trials")
    dispersion: dict[str, Number] = Field({}, description="scenario keys that are drawn anew in every trial")
    grid: dict[str, tuple[Any, ...]] = Field({}, description="scenario keys whose values are all tried, crossed with the trials")

    @cached_property
    def points(self) -> list[dict[str, Any]]:
        """AnyScenario of each point of the grid."""
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

    def changes(self, point: int) -> dict[str, Any]:
        """What that scenario has instead of what its file says."""
        return self.override | self.points[point] | {"run.seed": self.seed, "run.trials": self.trials}
