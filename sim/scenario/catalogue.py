"""The scenarios that come with the twin, by family."""

from __future__ import annotations

from pathlib import Path

from models.plants.register.entries import KINDS
from sim.text import toml_text

SCENARIOS = Path(__file__).with_name("scenarios")

# What the scenarios of a folder have in common.
FAMILIES = {
    "nacs": "the air-bearing testbed with four reaction wheels: faults, and filters that detect them",
    "wmap": "a free-flying probe with four wheels of which one fails: gains blended by an IMM filter",
    "monolithic": "a rigid spacecraft without wheels or rate gyro: adaptive UKF and particle filter",
    "antenna-mapping": "a spacecraft with sprung panels: unfalsified control replaces its gains in flight",
    "formation": "spacecraft, or testbeds, that follow a virtual leader which only some of them see",
    "consensus": "agents in the plane that learn unknown dynamics while they follow a leader",
}


def scenario_names() -> list[str]:
    """Names family/name, or family/group/name, of the scenarios that come with the twin."""
    return sorted(path.relative_to(SCENARIOS).with_suffix("").as_posix() for path in SCENARIOS.glob("*/**/*.toml"))


def families() -> dict[str, list[str]]:
    """Names of a family's scenarios without the family, by family: the testbed first, unknown folders last."""
    order = {family: place for place, family in enumerate(FAMILIES)}
    found: dict[str, list[str]] = {}
    for name in scenario_names():
        family, _, own = name.partition("/")
        found.setdefault(family, []).append(own)
    return {family: found[family] for family in sorted(found, key=lambda family: order.get(family, len(order)))}


def what(family: str) -> str:
    """What the scenarios of a folder have in common; of one that nobody has described, what the plant of its first is."""
    if family in FAMILIES:
        return FAMILIES[family]
    first = min(SCENARIOS.glob(f"{family}/*.toml"))
    plant = toml_text.read(first, first.name).get("plant", {}).get("type", "")
    return KINDS[plant].says if plant in KINDS else ""


def title(path: Path) -> str:
    """Title of a file, read and not checked."""
    return str(toml_text.read(path, path.name).get("title", ""))
