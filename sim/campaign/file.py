"""Campaign files: found, read and checked with all their points."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import ValidationError

from sim.bad_input import BadInput
from sim.campaign import cost
from sim.campaign.draws import check
from sim.campaign.settings import Campaign
from sim.scenario.validation import first_error
from sim.text import toml_text

CAMPAIGNS = Path(__file__).with_name("campaigns")

_DISTRIBUTIONS = {"constant", "uniform", "normal", "log_uniform", "choice"}


def load(path: Path) -> Campaign:
    """Read and check a campaign file with all its points; raises BadInput."""
    if not toml_text.is_there(path):
        raise BadInput(f"no campaign file {path}")
    data = toml_text.read(path, str(path))
    for section in ("override", "dispersion", "grid"):
        if isinstance(data.get(section), dict):
            data[section] = dict(_flat(data[section], section))
    scenario = data.get("scenario")
    if isinstance(scenario, str) and scenario.endswith(".toml") and not Path(scenario).is_absolute():
        data["scenario"] = str(path.parent / scenario)
    try:
        campaign = Campaign.model_validate(data)
    except ValidationError as invalid:
        raise BadInput(f"{path}: {first_error(invalid, data, Campaign)}") from None
    for point in range(campaign.size):
        try:
            base = campaign.at(point)
            if point == 0:
                cost.check(base, campaign.trials * campaign.size, kept=False)
        except BadInput as wrong:
            raise BadInput(f"{path}: {wrong}") from None
        check(campaign, base, path)
    return campaign


def is_campaign(name: str) -> bool:
    """Whether a name on the command line is that of a campaign: a file that names a scenario instead of being one."""
    path = located(name)
    if not toml_text.is_there(path):
        return False
    try:
        return "scenario" in toml_text.read(path, name)
    except BadInput:  # a scenario file until it can be read
        return False


def located(name: str) -> Path:
    """File of a campaign by path, or by the name of one that comes with the twin; whether there is one or not."""
    return Path(name) if name.endswith(".toml") else CAMPAIGNS / f"{name.removeprefix('campaigns/')}.toml"


def _flat(node: dict[str, Any], section: str, prefix: str = "") -> list[tuple[str, Any]]:
    """Dotted keys of nested tables; a distribution is a leaf."""
    out: list[tuple[str, Any]] = []
    for key, value in node.items():
        name = f"{prefix}{key}"
        leaf = not isinstance(value, dict) or not value or (section == "dispersion" and bool(set(value) & _DISTRIBUTIONS))
        out += [(name, value)] if leaf else _flat(value, section, f"{name}.")
    return out
