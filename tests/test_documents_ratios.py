"""Sentences of the pages that compute with a table: each ratio is computed anew from the cells above it."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[1] / "docs"

Table = dict[str, list[float]]  # of each row the first number of every cell behind its name; NaN where there is none


def number(cell: str) -> float:
    found = re.search(r"-?\d+(\.\d+)?(e-?\d+)?", cell)
    return float(found[0]) if found else float("nan")


@cache
def tables(page: str) -> list[Table]:
    """Those of a page, in order."""
    found: list[Table] = []
    for block in re.findall(r"(?:^\|.*\|\n)+", (DOCS / page).read_text(encoding="utf-8"), re.MULTILINE):
        rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in block.splitlines()]
        found.append({row[0]: [number(cell) for cell in row[1:]] for row in rows[2:]})
    return found


def prose(page: str) -> str:
    """A page with its lines joined, so that a sentence is found wherever it is broken."""
    return re.sub(r"\s+", " ", (DOCS / page).read_text(encoding="utf-8"))


def of_imm() -> list[str]:
    rmse, _, testbed = tables("imm.md")
    before, after, psi = 1, 4, 2  # columns: theta before and after, psi before
    delay, nees = 0, 4
    track = tracking()
    pd, smc = rmse["pd-ukf"], rmse["smc-ukf"]
    shared = [100.0 * (1.0 - track[f"{law}-imm-realloc"] / track[f"{law}-nis"]) for law in ("pd", "smc")]
    blended = [100.0 * (1.0 - track[f"{law}-imm"] / track[f"{law}-nis"]) for law in ("pd", "smc")]
    found = [100.0 * testbed[f"{law}-imm"][delay] / testbed[f"{law}-nis"][delay] for law in ("pd", "smc")]
    return [
        f"theta is better by {pd[after] / rmse['pd-imm'][after]:.2f} (PD) and {smc[after] / rmse['smc-imm'][after]:.1f} (SMC)",
        f"PD wins {100 * (1 - rmse['pd-imm'][after] / rmse['pd-fault-gains'][after]):.0f} % in theta after the fault "
        f"({rmse['pd-imm'][after]:.3f} against {rmse['pd-fault-gains'][after]:.3f})",
        f"loses before it ({rmse['pd-imm'][before]:.3f} against {rmse['pd-fault-gains'][before]:.3f})",
        f"overshoots (psi {rmse['smc-fault-gains'][psi]:.1f} against {rmse['smc-imm'][psi]:.1f})",
        f"brings theta to {rmse['pd-imm-realloc'][after]:.3f} (PD, {pd[after] / rmse['pd-imm-realloc'][after]:.0f} times better "
        f"than PD-UKF) and {rmse['smc-imm-realloc'][after]:.3f} deg (SMC, {smc[after] / rmse['smc-imm-realloc'][after]:.0f} times)",
        f"finds the lost wheel in {found[0]:.0f} % (PD) and {found[1]:.0f} % (SMC) of the time",
        f"NEES over the whole run {testbed['pd-imm'][nees]:.1f} where 10 is right, against {testbed['pd-nis'][nees]:.1f}",
        f"Blended gains then track {blended[0]:.0f} % (PD) and {blended[1]:.0f} % (SMC) better in the fault",
        f"reallocation {shared[0]:.0f} and {shared[1]:.0f} %",
        f"({track['pd-imm-realloc']:.3f} and {track['smc-imm-realloc']:.3f} deg; with blended gains {track['pd-imm']:.3f} and "
        f"{track['smc-imm']:.3f})",
    ]


def tracking() -> dict[str, float]:
    """Error in the fault, deg, of the table on the testbed: the second of the three numbers of a cell."""
    text = (DOCS / "imm.md").read_text(encoding="utf-8")
    found = re.findall(r"^\| ([\w-]+) \|.*\| [\d.]+ / ([\d.]+) / [\d.]+ \| [\d.]+ \|$", text, re.MULTILINE)
    assert len(found) == 6
    return {loop: float(value) for loop, value in found}


def of_consensus() -> list[str]:
    free, changing, pushed, commands = tables("consensus.md")[1:5]
    every = (free, changing, pushed, commands)
    aem = [one["adtl"][0] / one["aukf"][0] for one in every]
    learned = [one["adtl"][4] / one["aukf"][4] for one in every]
    apart = [[abs(b / a - 1.0) for a, b in zip(one["aukf"], one["mupf-b"], strict=True)] for one in every]
    all_windows, position = max(map(max, apart)), max(max(one[:4]) for one in apart)
    cost = re.search(r"joint filter (\d+) us an agent, of mupf-b with 100 particles ([\d.]+) ms", prose("consensus.md"))
    assert cost
    return [
        f"It costs {1000 * float(cost[2]) / float(cost[1]):.0f} times as much (below).",
        f"On 2 to 10 s adtl's AEM is {aem[0]:.1f} times that of aukf without faults, {aem[1]:.0f} times under changing dynamics, "
        f"{aem[2]:.0f} times under disturbances, {aem[3]:.1f} times under the command fault",
        f"its dynamics error {learned[0]:.0f}, {learned[1]:.0f}, {learned[2]:.1f} and {learned[3]:.0f} times",
        f"Variant B agrees with it within {100 * all_windows:.1f} % in every window, in AEM within {100 * position:.1f} %",
        f"below exact knowledge** ({free['adtl'][3]:.4f} against {free['exact'][3]:.4f})",
        f"Its dynamics error of {free['adtl'][7]:.3f} N on 15 to 20 s",
    ]


def of_formation() -> list[str]:
    (table,) = (one for one in tables("formation.md") if "and link 3-4 cut, 50-65 s" in one)
    free, lost = table["nothing fails, 25-45 s"], table["wheel failed, 25-45 s"]
    later, cut = table["wheel failed, 50-65 s"], table["and link 3-4 cut, 50-65 s"]
    own, neighbours = lost[2] / free[2], sorted((lost[1] / free[1], lost[3] / free[3]))
    return [
        f"they get worse by {100 * (cut[2] / later[2] - 1):.0f} and {100 * (cut[1] / later[1] - 1):.0f} %",
        f"come back to {min(cut[3:]):.2f} to {max(cut[3:]):.2f} deg",
        f"3 is off {own:.1f} times as far, its neighbours {neighbours[0]:.1f} to {neighbours[1]:.1f} times",
        f"6 and 1, which see the leader, {lost[5] / free[5]:.1f} and {lost[0] / free[0]:.1f} times",
    ]


def of_performance() -> list[str]:
    text = prose("performance.md")
    row = re.search(r"64 +100 +15 +(\d+) +(\d+) +([\d.]+)", text)
    assert row
    whole, physics = int(row[1]), int(row[2])
    parts = "four additive filters stepped as one stack 31 us, the MEKF 9 us, NEES and standard deviations 12 us"
    assert parts in text
    return [f"At 64 trials the loop costs {whole - physics} us a trial and tick beyond its physics (the table's {whole} less {physics})"]


@pytest.mark.parametrize("page", ["imm", "consensus", "formation", "performance"])
def test_the_ratios_of_a_page_are_those_of_its_tables(page: str) -> None:
    claims: dict[str, Callable[[], list[str]]] = {
        "imm": of_imm,
        "consensus": of_consensus,
        "formation": of_formation,
        "performance": of_performance,
    }
    text = prose(f"{page}.md")
    assert [claim for claim in claims[page]() if claim not in text] == []


def test_what_two_pages_say_of_one_thing_is_the_same() -> None:
    """Probabilities of the fault with p_ii = 0.9999, in the errata and in the table of the page."""
    _, modes, _ = tables("imm.md")
    text = (DOCS / "imm.md").read_text(encoding="utf-8")
    pairs = [re.search(rf"^\| {loop} \|.*\| ([\d.]+) / ([\d.]+) \| 0 \|$", text, re.MULTILINE) for loop in ("pd-imm", "smc-imm")]
    assert modes
    assert all(pairs)
    (before_pd, after_pd), (before_smc, after_smc) = (found.groups() for found in pairs if found)
    assert f"with 0.9999 {before_pd}, {before_smc}, {after_pd} and {after_smc}." in prose("errata.md")


def test_docstrings_make_no_claims_of_speed() -> None:
    """A figure of speed belongs into docs/performance.md, with the command that makes it; in a docstring nothing holds it."""
    root = DOCS.parent
    claim = re.compile(r"\b(times as fast|times faster|of the time of|a \w+ of the time)\b")
    found = [
        f"{path.relative_to(root)}: {match[0]}"
        for room in ("models", "estimation", "control", "sim")
        for path in sorted((root / room).rglob("*.py"))
        for match in claim.finditer(path.read_text(encoding="utf-8"))
    ]
    assert found == []
