"""Campaign files: a scenario varied over many trials (dispersions) and over settings (a grid)."""

from __future__ import annotations

import itertools
import tomllib
from fnmatch import fnmatch
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, TypeGuard

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError
from scipy.stats import qmc

from models.inertia import why_impossible
from models.nacs import INERTIA_SETS, prepare_nacs
from sim import families
from sim.complaints import first_complaint
from sim.draws import Number
from sim.families import Settings
from sim.faults import Fault
from sim.plants import NacsPlant
from sim.randomness import Stream, generator
from sim.scenario import BadInput, Scenario, StartSettings
from sim.sensors import SensorSettings
from sim.variants import DISPERSIBLE, Variants

Array = NDArray[np.floating]

CAMPAIGNS = Path(__file__).with_name("campaigns")
REDRAWS = 100

_FAULTS: TypeAdapter[tuple[Fault, ...]] = TypeAdapter(tuple[Fault, ...])

_DISTRIBUTIONS = {"constant", "uniform", "normal", "log_uniform", "choice"}

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


class Campaign(BaseModel):
    """One campaign file."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

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
        """Settings of each point of the grid."""
        return [dict(zip(self.grid, values, strict=True)) for values in itertools.product(*self.grid.values())]

    def keeps(self, metric: str, phase: str) -> bool:
        """Whether a metric is kept."""
        return any(fnmatch(metric, pattern) or fnmatch(f"{metric}@{phase}", pattern) for pattern in self.metrics)

    def at(self, point: int) -> Settings:
        """The scenario at a point of the grid; raises BadInput."""
        return families.load(self.scenario, self.changes(point))

    def changes(self, point: int) -> dict[str, Any]:
        """What that scenario has instead of what its file says."""
        return self.override | self.points[point] | {"run.seed": self.seed, "run.trials": self.trials}


class Drawn(NamedTuple):
    """What some trials drew."""

    variants: Variants
    values: Array  # (trials, keys) as used
    redrawn: NDArray[np.int64]  # (trials,) how often a draw was impossible


def load(path: Path) -> Campaign:
    """Read and check a campaign file with all its points; raises BadInput."""
    if not path.is_file():
        raise BadInput(f"no campaign file {path}")
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, OSError) as broken:
        raise BadInput(f"{path}: cannot be read as TOML: {broken}") from None
    for section in ("override", "dispersion", "grid"):
        if isinstance(data.get(section), dict):
            data[section] = dict(_flat(data[section], section))
    scenario = data.get("scenario")
    if isinstance(scenario, str) and scenario.endswith(".toml") and not Path(scenario).is_absolute():
        data["scenario"] = str(path.parent / scenario)
    try:
        campaign = Campaign.model_validate(data)
    except ValidationError as invalid:
        raise BadInput(f"{path}: {first_complaint(invalid, data, Scenario)}") from None
    for point in range(len(campaign.points)):
        try:
            base = campaign.at(point)
        except BadInput as wrong:
            raise BadInput(f"{path}: {wrong}") from None
        if batched(base):
            _check_dispersion(campaign, base, path)
        else:
            _check_alone(campaign, base, path)
    return campaign


def batched(base: Settings) -> TypeGuard[Scenario]:
    """Whether trials that differ are flown as one batch; otherwise each is flown alone, and any key of the scenario may be dispersed."""
    return isinstance(base, Scenario) and isinstance(base.plant, NacsPlant) and not base.loops


def picked(campaign: Campaign, trial: int) -> dict[str, float]:
    """What a trial that is flown alone draws, by scenario key."""
    share = _shares(campaign, np.array([trial]))[0]
    return {key: d.quantile(float(s)) for (key, d), s in zip(campaign.dispersion.items(), share, strict=True)}


def alone(campaign: Campaign, base: Settings, trial: int) -> Settings:
    """The scenario that a trial flown alone is; raises BadInput if it is impossible."""
    return families.check(families.dumped(base), f"trial {trial}", dict(picked(campaign, trial)))


def _check_alone(campaign: Campaign, base: Settings, path: Path) -> None:
    """Every key must exist, and the scenario be possible at the middle of all distributions."""
    for key, distribution in campaign.dispersion.items():
        where = f"{path}: dispersion.{key}"
        try:
            families.check(families.dumped(base), where, {key: distribution.quantile(0.5)})
        except BadInput as wrong:
            raise BadInput(str(wrong).replace(f"--set {key}", where)) from None


def is_campaign(name: str) -> bool:
    """Whether a name on the command line is that of a campaign file: one that names a scenario instead of being one."""
    path = Path(name)
    if path.suffix != ".toml" or not path.is_file():
        return False
    try:
        return "scenario" in tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, OSError):
        return False


def draw(campaign: Campaign, base: Scenario, trials: NDArray[np.int64]) -> Drawn:
    """Plants, sensors, faults and starts of the given trials; each depends on the seed and its own number alone.

    A Latin hypercube is one design of all trials, so there it depends on their total too.

    Raises:
      BadInput: a draw is impossible and the file says refuse, or a hundred draws in a row were.
    """
    assert isinstance(base.plant, NacsPlant)
    sections = _sections(base)
    reassemble = prepare_nacs(base.plant).reassemble
    parts, values, redrawn = [], [], []
    for trial, share in zip(trials, _shares(campaign, trials), strict=True):
        for attempt in range(REDRAWS):
            picked = {key: d.quantile(float(s)) for (key, d), s in zip(campaign.dispersion.items(), share, strict=True)}
            try:
                part = _variant(base, sections, picked)
                bus = reassemble(part[0].inertia, part[0].centre_of_mass)
                reason = why_impossible(part[0].inertia) or why_impossible(np.diag(bus.moments))
            except ValidationError as invalid:
                reason = str(invalid.errors()[0]["msg"])
            if reason is None:
                break
            if campaign.non_physical == "refuse":
                raise BadInput(f"trial {trial} draws {picked}: {reason}; narrow the dispersion or set non_physical = 'redraw'")
            share = generator(campaign.seed, int(trial), Stream.DISPERSION).random((attempt + 2, len(share)))[-1]  # noqa: PLW2901
        else:
            raise BadInput(f"trial {trial}: {REDRAWS} draws in a row are impossible, the last since {reason}; narrow the dispersion")
        parts.append(part)
        values.append(list(picked.values()))
        redrawn.append(attempt)
    plants, sensors, faults, starts = zip(*parts, strict=True)
    if all(key.partition(".")[0] != "plant" for key in campaign.dispersion):
        plants = (base.plant,) * len(trials)
    return Drawn(Variants(plants, sensors, faults, starts), np.array(values).reshape(len(trials), -1), np.array(redrawn))


def _shares(campaign: Campaign, trials: NDArray[np.int64]) -> Array:
    """Place of each trial in the unit cube, (trials, keys)."""
    size = len(campaign.dispersion)
    if campaign.design == "random" or not size:
        drawn = [generator(campaign.seed, int(trial), Stream.DISPERSION).random(size) for trial in trials]
        return np.array(drawn).reshape(len(trials), size)
    if campaign.design == "latin-hypercube":
        return qmc.LatinHypercube(size, rng=campaign.seed).random(campaign.trials)[trials]
    return qmc.Sobol(size, rng=campaign.seed).random_base2(int(np.ceil(np.log2(max(2, campaign.trials)))))[trials]


Part = tuple[NacsPlant, SensorSettings, tuple[Fault, ...], StartSettings]


def _sections(base: Scenario) -> dict[str, Any]:
    """The parts of a scenario that can differ from trial to trial, with every key written out."""
    data = base.model_dump(include={"plant", "sensors", "faults", "start"})
    inertia = data["plant"]["inertia_kg_m2"]
    data["plant"]["inertia_kg_m2"] = INERTIA_SETS[inertia] if isinstance(inertia, str) else inertia
    return data


def _variant(base: Scenario, sections: dict[str, Any], picked: dict[str, float]) -> Part:
    """One trial's parts; raises ValidationError."""
    touched = {key.partition(".")[0] for key in picked}
    data = {name: _copy(sections[name]) for name in touched}
    for key, value in picked.items():
        node: Any = data
        *parents, last = key.split(".")
        for part in parents:
            node = node[int(part)] if isinstance(node, list) else node[part]
        node[int(last) if isinstance(node, list) else last] = value
    return (
        NacsPlant.model_validate(data.get("plant", base.plant)),
        SensorSettings.model_validate(data["sensors"]) if "sensors" in data else base.sensors,
        _FAULTS.validate_python(data["faults"]) if "faults" in data else base.faults,
        StartSettings.model_validate(data["start"]) if "start" in data else base.start,
    )


def _copy(node: Any) -> Any:
    """Dictionaries and lists anew, tuples as lists, so that an element can be replaced."""
    if isinstance(node, dict):
        return {key: _copy(value) for key, value in node.items()}
    return [_copy(value) for value in node] if isinstance(node, list | tuple) else node


def _check_dispersion(campaign: Campaign, base: Scenario, path: Path) -> None:
    """Every key must exist and be of a kind that can differ within a batch."""
    sections = _sections(base)
    for key, distribution in campaign.dispersion.items():
        root, _, rest = key.partition(".")
        where = f"{path}: dispersion.{key}"
        if root not in sections:
            raise BadInput(f"{where}: only {', '.join(sections)} differ from trial to trial; put {root} under [grid]")
        if root == "plant" and rest.partition(".")[0] not in DISPERSIBLE:
            raise BadInput(f"{where}: is part of the compiled model; dispersible are {', '.join(DISPERSIBLE)}; others go under [grid]")
        try:
            part = _variant(base, sections, {key: distribution.quantile(0.5)})
        except (KeyError, IndexError, TypeError, ValueError) as wrong:
            reason = wrong.errors()[0]["msg"] if isinstance(wrong, ValidationError) else "there is no such key"
            raise BadInput(f"{where}: {reason[:1].lower()}{reason[1:]}") from None
        duration = base.run.ticks * base.run.tick_s
        for number, fault in enumerate(part[2]):
            low, high = fault.start_s.bounds()[0], fault.start_s.bounds()[1] + fault.duration_s.bounds()[1]
            if root == "faults" and rest.startswith(f"{number}.") and rest.endswith("start_s"):
                low, high = distribution.bounds()[0], distribution.bounds()[1] + fault.duration_s.bounds()[1]
            if low < 0 or high > duration + 1e-9:
                raise BadInput(f"{where}: the fault can last from {low:g} to {high:g} s, the run from 0 to {duration:g} s")


def _flat(node: dict[str, Any], section: str, prefix: str = "") -> list[tuple[str, Any]]:
    """Dotted keys of nested tables; a distribution is a leaf."""
    out: list[tuple[str, Any]] = []
    for key, value in node.items():
        name = f"{prefix}{key}"
        leaf = not isinstance(value, dict) or (section == "dispersion" and (not value or bool(set(value) & _DISTRIBUTIONS)))
        out += [(name, value)] if leaf else _flat(value, section, f"{name}.")
    return out
