"""What the trials of a campaign draw: plants, sensors, faults and starts of a batch, or any keys of scenarios that are flown one by one."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError
from scipy.stats import qmc

from models.plants.inertia import why_impossible
from models.plants.nacs import INERTIA_SETS, prepare_nacs
from sim.bad_input import BadInput
from sim.campaign.settings import Campaign, batched
from sim.faults.kinds import Fault
from sim.loop.variants import DISPERSIBLE, Variants
from sim.plant.kinds import NacsPlant
from sim.randomness import Stream, generator
from sim.scenario import files
from sim.scenario.files import AnyScenario
from sim.scenario.one_body import Scenario, StartSettings
from sim.sensors.sensors import SensorSettings

Array = NDArray[np.floating]

REDRAWS = 100

_FAULTS: TypeAdapter[tuple[Fault, ...]] = TypeAdapter(tuple[Fault, ...])


class Drawn(NamedTuple):
    """What some trials drew."""

    variants: Variants
    values: Array  # (trials, keys) as used
    redrawn: NDArray[np.int64]  # (trials,) how often a draw was impossible


def check(campaign: Campaign, base: AnyScenario, path: Path) -> None:
    """Every key that is dispersed must exist and be of a kind that can differ from trial to trial; raises BadInput."""
    if batched(base):
        _check_batch(campaign, base, path)
    else:
        _check_alone(campaign, base, path)


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


def picked(campaign: Campaign, trial: int) -> dict[str, float]:
    """What a trial that is flown alone draws, by scenario key."""
    share = _shares(campaign, np.array([trial]))[0]
    return {key: d.quantile(float(s)) for (key, d), s in zip(campaign.dispersion.items(), share, strict=True)}


def alone(campaign: Campaign, base: AnyScenario, trial: int) -> AnyScenario:
    """The scenario that a trial flown alone is; raises BadInput if it is impossible."""
    return files.check(files.dumped(base), f"trial {trial}", dict(picked(campaign, trial)))


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


def _check_batch(campaign: Campaign, base: Scenario, path: Path) -> None:
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


def _check_alone(campaign: Campaign, base: AnyScenario, path: Path) -> None:
    """Every key must exist, and the scenario be possible at the middle of all distributions."""
    for key, distribution in campaign.dispersion.items():
        where = f"{path}: dispersion.{key}"
        try:
            files.check(files.dumped(base), where, {key: distribution.quantile(0.5)})
        except BadInput as wrong:
            raise BadInput(str(wrong).replace(f"--set {key}", where)) from None
