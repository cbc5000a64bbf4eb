"""What the trials of a campaign draw: plants, sensors, faults and starts of a batch, or other keys, each trial a scenario of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple, TypeGuard

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError
from scipy.stats import qmc

from models.plants.inertia import elements, why_impossible
from models.plants.register.entries import kind_of
from models.plants.register.parameters import BodyParameters
from sim.bad_input import BadInput
from sim.campaign.settings import Campaign
from sim.draws import Draw
from sim.faults.kinds import Fault
from sim.loop.variants import Variants
from sim.randomness import Stream, generator
from sim.scenario import files
from sim.scenario.files import AnyScenario
from sim.scenario.one_body import Scenario, StartSettings
from sim.sensors.sensors import SensorSettings

Array = NDArray[np.floating]

REDRAWS = 100
SEEN_BEFORE = {"redraw": 50, "refuse": 1000}  # trials whose draws are tried before anything is flown; a draw takes a few milliseconds
ROOTS = ("plant", "start", "sensors", "faults")  # of a scenario of one body: what can differ within a batch

_FAULTS: TypeAdapter[tuple[Fault, ...]] = TypeAdapter(tuple[Fault, ...])


class Drawn(NamedTuple):
    """What some trials drew."""

    variants: Variants | None  # None: nothing differs among those that are flown together
    values: Array  # (trials, keys) as used
    redrawn: NDArray[np.int64]  # (trials,) how often a draw was impossible


def check(campaign: Campaign, base: AnyScenario, path: Path) -> None:
    """Every key that is dispersed must exist and be of a kind that can differ from trial to trial; raises BadInput."""
    for key, distribution in campaign.dispersion.items():
        where = f"{path}: dispersion.{key}"
        if isinstance(base, Scenario) and key.startswith("plant."):
            _check_dispersible(base, key, where)
        if key in together(campaign, base):
            _check_together(base, key, distribution, where)
        else:
            _check_alone(base, key, distribution, where)


def together(campaign: Campaign, base: AnyScenario) -> tuple[str, ...]:
    """Dispersed keys whose values can differ within a batch: of one body its plant, sensors, faults and start.

    They say what is so; filters and controllers believe the scenario's own. All other keys make a scenario of its own of each trial.
    """
    if not isinstance(base, Scenario):
        return ()
    return tuple(key for key in campaign.dispersion if key.partition(".")[0] in ROOTS)


def own(campaign: Campaign, base: AnyScenario, trial: int) -> AnyScenario:
    """The scenario of a trial: the base, if all that is dispersed can differ within a batch; raises BadInput if it is impossible."""
    among = together(campaign, base)
    changes: dict[str, Any] = {key: value for key, value in picked(campaign, trial).items() if key not in among}
    return files.check(files.dumped(base), f"trial {trial}", changes) if changes else base


def flown_together(campaign: Campaign, base: AnyScenario) -> bool:
    """Whether trials that differ are flown as one batch; otherwise each is flown alone."""
    return len(together(campaign, base)) == len(campaign.dispersion)


def banded(base: AnyScenario, campaign: Campaign) -> TypeGuard[Scenario]:
    """Whether bands over time are kept of the trials: of one loop of one body, flown together."""
    return isinstance(base, Scenario) and not base.loops and flown_together(campaign, base)


def draw(campaign: Campaign, base: AnyScenario, trials: NDArray[np.int64]) -> Drawn:
    """Plants, sensors, faults and starts of the given trials; each depends on the seed and its own number alone.

    A Latin hypercube is one design of all trials, so there it depends on their total too.

    Args:
      campaign: that says what is dispersed.
      base: the scenario of these trials, as `own` gives it; what differs within a batch is drawn beside it.
      trials: their numbers, (trials,).

    Raises:
      BadInput: a draw is impossible and the file says refuse, or a hundred draws in a row were.
    """
    among = together(campaign, base)
    if not among or not isinstance(base, Scenario):
        values = [list(picked(campaign, int(trial)).values()) for trial in trials]
        return Drawn(None, np.array(values).reshape(len(trials), -1), np.zeros(len(trials), dtype=np.int64))
    sections = _sections(base)
    reassemble = kind_of(base.plant).prepare(base.plant).reassemble
    parts, values, redrawn = [], [], []
    for trial, share in zip(trials, _shares(campaign, trials), strict=True):
        first = taken = _at(campaign, share)
        for attempt in range(REDRAWS):
            try:
                part = _variant(base, sections, {key: taken[key] for key in among})
                carrier = reassemble(part[0].inertia, part[0].centre_of_mass)
                reason = why_impossible(part[0].inertia) or why_impossible(np.diag(carrier.moments))
            except ValidationError as invalid:
                reason = str(invalid.errors()[0]["msg"])
            if reason is None:
                break
            if campaign.non_physical == "refuse":
                raise BadInput(f"trial {trial} draws {taken}: {reason}; narrow the dispersion or set non_physical = 'redraw'")
            again = generator(campaign.seed, int(trial), Stream.DISPERSION).random((attempt + 2, len(share)))[-1]
            taken = {key: value if key in among else first[key] for key, value in _at(campaign, again).items()}
        else:
            raise BadInput(f"trial {trial}: {REDRAWS} draws in a row are impossible, the last since {reason}; narrow the dispersion")
        parts.append(part)
        values.append(list(taken.values()))
        redrawn.append(attempt)
    plants, sensors, faults, starts = zip(*parts, strict=True)
    if all(key.partition(".")[0] != "plant" for key in among):
        plants = (base.plant,) * len(trials)
    return Drawn(Variants(plants, sensors, faults, starts), np.array(values).reshape(len(trials), -1), np.array(redrawn))


def check_draws(campaign: Campaign, base: AnyScenario) -> None:
    """Draw some trials before anything is flown: more of them if none may be impossible.

    What is rarer than can be seen here ends the campaign when its trial comes up; what was flown until then is kept.

    Raises:
      BadInput: a draw that may not be is impossible, or a hundred draws in a row are.
    """
    draw(campaign, base, np.arange(min(campaign.trials, SEEN_BEFORE[campaign.non_physical])))


def picked(campaign: Campaign, trial: int) -> dict[str, float]:
    """What a trial draws at first, by scenario key."""
    return _at(campaign, _shares(campaign, np.array([trial]))[0])


def _at(campaign: Campaign, share: Array) -> dict[str, float]:
    """Values at a place in the unit cube, (keys,), by scenario key."""
    return {key: d.quantile(float(s)) for (key, d), s in zip(campaign.dispersion.items(), share, strict=True)}


def _shares(campaign: Campaign, trials: NDArray[np.int64]) -> Array:
    """Place of each trial in the unit cube, (trials, keys)."""
    size = len(campaign.dispersion)
    if campaign.design == "random" or not size:
        drawn = [generator(campaign.seed, int(trial), Stream.DISPERSION).random(size) for trial in trials]
        return np.array(drawn).reshape(len(trials), size)
    if campaign.design == "latin-hypercube":
        return qmc.LatinHypercube(size, rng=campaign.seed).random(campaign.trials)[trials]
    return qmc.Sobol(size, rng=campaign.seed).random_base2(int(np.ceil(np.log2(max(2, campaign.trials)))))[trials]


Part = tuple[BodyParameters, SensorSettings, tuple[Fault, ...], StartSettings]


def _sections(base: Scenario) -> dict[str, Any]:
    """The parts of a scenario that can differ from trial to trial, with every key written out."""
    data = base.model_dump(include={"plant", "sensors", "faults", "start"})
    if isinstance(data["plant"].get("inertia_kg_m2"), str):  # a named set, whose elements can differ all the same
        data["plant"]["inertia_kg_m2"] = elements(base.plant.inertia)
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
        kind_of(base.plant).parameters.model_validate(data["plant"]) if "plant" in data else base.plant,
        SensorSettings.model_validate(data["sensors"]) if "sensors" in data else base.sensors,
        _FAULTS.validate_python(data["faults"]) if "faults" in data else base.faults,
        StartSettings.model_validate(data["start"]) if "start" in data else base.start,
    )


def _copy(node: Any) -> Any:
    """Dictionaries and lists anew, tuples as lists, so that an element can be replaced."""
    if isinstance(node, dict):
        return {key: _copy(value) for key, value in node.items()}
    return [_copy(value) for value in node] if isinstance(node, list | tuple) else node


def _check_dispersible(base: Scenario, key: str, where: str) -> None:
    """A parameter must not be part of the compiled model, which all trials of a batch have in common."""
    dispersible = kind_of(base.plant).dispersible
    if key.split(".")[1] not in dispersible:
        raise BadInput(f"{where}: is part of the compiled model; dispersible are {', '.join(dispersible)}; others go under [grid]")


def _check_together(base: Any, key: str, distribution: Draw, where: str) -> None:
    """The key must exist, and the scenario be possible at the middle of its distribution, faults within the run."""
    root, _, rest = key.partition(".")
    try:
        part = _variant(base, _sections(base), {key: distribution.quantile(0.5)})
    except (KeyError, IndexError, TypeError, ValueError) as wrong:
        reason = wrong.errors()[0]["msg"] if isinstance(wrong, ValidationError) else "there is no such key"
        raise BadInput(f"{where}: {reason[:1].lower()}{reason[1:]}") from None
    duration = base.run.ticks * base.run.tick_s
    for number, fault in enumerate(part[2]):
        low, high = fault.earliest_start, fault.latest_start if fault.duration_s is None else fault.latest_end
        if root == "faults" and rest.startswith(f"{number}.") and rest.endswith("start_s"):
            low, high = distribution.bounds()[0], distribution.bounds()[1] + high - fault.latest_start
        if low < 0 or high > duration + 1e-9:
            raise BadInput(f"{where}: the fault can last from {low:g} to {high:g} s, the run from 0 to {duration:g} s")


def _check_alone(base: AnyScenario, key: str, distribution: Draw, where: str) -> None:
    """The key must exist, and the scenario be possible at the middle of its distribution."""
    try:
        files.check(files.dumped(base), where, {key: distribution.quantile(0.5)})
    except BadInput as wrong:
        raise BadInput(str(wrong).replace(f"--set {key}", where)) from None
