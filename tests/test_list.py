"""`nacs list`: everything by family, a line each; of a family or a beginning, all that helps to choose."""

from __future__ import annotations

import pytest

from sim.campaign.file import CAMPAIGNS
from sim.scenario.catalogue import FAMILIES, SCENARIOS, families, scenario_names, title


def blocks(text: str) -> dict[str, list[str]]:
    """Indented lines by the line that heads them."""
    found: dict[str, list[str]] = {}
    for line in text.splitlines():
        if line.startswith("  "):
            found[list(found)[-1]].append(line.strip())
        elif line.strip():
            found[line.strip()] = []
    return {head: [line for line in lines if line] for head, lines in found.items()}


def test_every_family_that_there_is_says_what_it_is() -> None:
    assert set(FAMILIES) == {path.name for path in SCENARIOS.iterdir() if path.is_dir()}


def test_without_argument_every_scenario_is_one_line_under_its_family(nacs) -> None:
    result = nacs("list")
    assert result.code == 0, result.err
    found = blocks(result.out)
    for family, names in families().items():
        assert [line.split()[0] for line in found[f"{family}  {FAMILIES[family]}"]] == names
    assert sum(map(len, families().values())) == len(scenario_names())
    assert "`nacs list FAMILY`" in result.out.splitlines()[-1]


def test_campaigns_are_listed_too(nacs) -> None:
    lines = next(lines for head, lines in blocks(nacs("list").out).items() if head.startswith("campaigns"))
    assert {line.split()[0] for line in lines} == {path.stem for path in CAMPAIGNS.glob("*.toml")}


@pytest.mark.parametrize("width", [60, 80, 200])
def test_a_line_is_no_wider_than_the_terminal_and_says_what_was_cut(nacs, monkeypatch, width: int) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    lines = nacs("list").out.splitlines()
    shown = title(SCENARIOS / "antenna-mapping" / "boeing702.toml")
    line = next(line.rstrip() for line in lines if line.split()[:1] == ["boeing702"])
    assert max(map(len, lines[:-1])) <= width
    assert line.endswith(shown) if width == 200 else line.endswith("…")
    assert line.removesuffix("…").split("  ")[-1].strip() in shown


def test_a_family_shows_title_source_and_what_is_flown(nacs) -> None:
    found = blocks(nacs("list", "wmap").out)
    assert list(found) == [name for name in scenario_names() if name.startswith("wmap/")]
    said = " ".join(found["wmap/pd-imm"])
    for part in ("Probe with PD gains blended by an IMM-UKF; wheel 1 fails", "table II, PD-IMM", "freeflyer", "trials of", "pd-imm"):
        assert part in said


def test_a_beginning_picks_names(nacs) -> None:
    found = blocks(nacs("list", "nacs/wheel").out)
    assert list(found) == ["nacs/wheel-failure"]
    said = [" ".join(line.split()) for line in found["nacs/wheel-failure"]]
    assert "plant nacs" in said
    assert "run 10 trials of 100 s, a tick every 0.1 s" in said
    assert "loop pd, closed by nis-fading" in said
    assert "observers ekf, mekf, sif, nis-windowed, nis-fading" in said


@pytest.mark.parametrize(
    ("beginning", "parts"),
    [
        ("formation/sixty", ["formation, 60 agents", "loops"]),
        ("consensus/dynamics", ["agents", "exact, none, adtl"]),
        ("antenna-mapping/panelsat-f", ["flexible (panelsat)", "frozen, nominal"]),
        ("campaigns/nacs", ["campaigns/nacs-wheel-failure", "nacs/wheel-failure", "2000 trials", "plant.wheel_viscous_nms"]),
    ],
)
def test_every_kind_says_its_own(nacs, beginning: str, parts: list[str]) -> None:
    result = nacs("list", beginning)
    assert result.code == 0, result.err
    assert all(part in result.out for part in parts)


@pytest.mark.parametrize("beginning", ["wmpa", "wheel"])
def test_what_nothing_begins_with_is_one_line_that_names_what_there_is(nacs, beginning: str) -> None:
    result = nacs("list", beginning)
    assert (result.code, result.out) == (2, "")
    assert result.err.count("\n") == 1
    assert all(part in result.err for part in (repr(beginning), *FAMILIES, "campaigns"))
