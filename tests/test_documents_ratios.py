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


def rows(page: str, columns: int) -> list[list[str]]:
    """Cells of all tables of so many columns; a cell that is empty in the first column is that of the row above."""
    found: list[list[str]] = []
    for line in (DOCS / page).read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if line.startswith("|") and len(cells) == columns and set(line) - set("|- "):
            found.append([cells[0] or (found[-1][0] if found else ""), *cells[1:]])
    return found


def several(cell: str) -> list[float]:
    """All numbers of a cell."""
    return [float(part) for part in re.findall(r"\d+(?:\.\d+)?(?:e-?\d+)?", cell)]


def of_gyroless() -> list[str]:
    rates = {(scenario, loop): [float(one) for one in cells] for scenario, loop, *cells in rows("gyroless.md", 6) if _all_numbers(cells)}
    weights = (200.0, 200.0, 100.0)  # seconds of the windows from 100 s on

    def after_100_s(scenario: str, loop: str) -> float:
        """RMS over the last three windows: squares add up by time."""
        windows = rates[scenario, loop][1:]
        return float((sum(w * x * x for w, x in zip(weights, windows, strict=True)) / sum(weights)) ** 0.5)

    for scenario, what in (
        ("inertia", "the PF is better under another inertia"),
        ("disturbance", "... under disturbances"),
        ("constant-torque", "... under constant torque"),
        ("no-command", "... without a command"),
    ):
        particle, unscented = (after_100_s(scenario, f"{filter_}-matched") for filter_ in ("pf", "aukf"))
        row = rf"\| {re.escape(what)} \| figures \| ([\d.]+)e-3 against ([\d.]+)e-3 rad/s \| does not hold \|"
        said = re.search(row, prose("gyroless.md"))
        assert said, what
        # a mean over trials of root mean squares is not the root of the windows' means: a digit of the last place apart at most
        assert [float(part) for part in said.groups()] == pytest.approx([particle, unscented], abs=0.1), what
    free, noisy = "fault-free", "sensor-noise"
    printed = rates[free, "aukf-constant"][2]
    aukf, pf = rates[noisy, "aukf-matched"], rates[noisy, "pf-matched"]
    claims = [
        f"rate after 100 s: `matched` PF {after_100_s(free, 'pf-matched'):.1f}e-3, AUKF {after_100_s(free, 'aukf-matched'):.1f}e-3; "
        f"`as-printed` PF {after_100_s(free, 'pf-printed') / 1e3:.1f}, "
        f"AUKF with the constant factor {after_100_s(free, 'aukf-constant') / 1e3:.3f}",
        f"2e-6: {aukf[1]:.2f}e-3 against {pf[1]:.1f}e-3; 1e-8: {aukf[2] * 1e3:.2f}e-6 against {pf[2]:.1f}e-3 rad/s",
        f"rate {pf[3] / 1e3:.3f} against {aukf[3] / 1e3:.1f} rad/s",
        f"Without fading (the MEKF) it is {rates[noisy, 'mekf'][3] / 1e3:.3f} rad/s",
        f"The PF lags in the disturbance ({rates['disturbance', 'pf-matched'][2]:.2f}e-3 from 300 to 500 s)",
        f"{printed / 1e3:.4f} rad/s on each axis whatever the noise ({printed:.1f} in the table)",
        f"140 (104 to 228), as much as {rates[free, 'pf-matched'][0] ** 2 / 1e6 * 100:.0f} s of 1 rad/s on each axis",
    ]
    particles = {row[0]: row[1:] for row in rows("gyroless.md", 5)}
    assert [float(one) for one in particles["100"]] == rates["disturbance", "pf-matched"]
    assert [float(one) for one in particles["MEKF"]] == rates["disturbance", "mekf"]
    walk = {row[0]: [float(one) for one in row[1:]] for row in rows("gyroless.md", 4) if _all_numbers(row[1:])}
    strong = next(values for name, values in walk.items() if name.startswith("strong tracking"))
    return [*claims, f"to {max(strong):.1f} times (Q = 1e-4 R) the Kalman filter's"]


def _all_numbers(cells: list[str]) -> bool:
    return all(re.fullmatch(r"\d+(\.\d+)?", cell) for cell in cells)


def of_unfalsified() -> list[str]:
    ten = {row[0]: row[1:] for row in rows("unfalsified.md", 5)}
    forty = {row[0]: row[1:] for row in rows("unfalsified.md", 3)}
    error = [several(cell.split("/")[-1]) for cell in ten["sup abs(W1 T_er), initial / nominal / final"]]
    misses = several(forty["sup abs(W1 T_er), final"][1])[-1]
    frequencies = several(forty["final natural frequency [rad/s]"][1])
    theta = ten["final damping (true J)"]
    assert len(set(theta)) == 1  # all on the parabola: 0.707 sqrt(J^ / J), J^ = 0.9 J
    assert f"{0.7071 * 0.9**0.5:.3f}" == theta[0]
    assert all(1.0 < greatest < 1.05 for _, greatest in (error[1], error[3]))
    medians = [several(cell)[1] for cell in forty["sup abs(W1 T_er), final"]]
    point = rows_of_units(forty, "RMS pointing error, adaptive [deg]")
    torque = rows_of_units(forty, "RMS torque, adaptive [N m]")
    for name, low, high, (nominal, adaptive) in (
        ("RMS pointing error over nominal", 0.45, 0.52, point),
        ("RMS torque over nominal", 1.7, 1.9, torque),
    ):
        for place, (base, middle) in enumerate(zip(nominal, adaptive, strict=True)):  # the median of forty lies where the ten do
            assert low - 0.02 <= middle / base <= high + 0.02, (name, place, middle / base)
        assert all(low <= one <= high for cell in ten[name] for one in several(cell))
    return [
        f"Trial 14 misses the claim in elevation by {100 * (misses - 1):.0f} % ({misses:.2f})",
        f"({frequencies[0] + 0.002:.3f} and {frequencies[0]:.3f} rad/s)",
        f"starts anywhere between 2.8 and 6.7 and ends near {min(medians):.1f}",
    ]


def rows_of_units(table: dict[str, list[str]], name: str) -> tuple[list[float], list[float]]:
    """Nominal values that a row names in its head, and the medians of its cells."""
    head, cells = next((head, cells) for head, cells in table.items() if head.startswith(name))
    nominal = several(head.split("nominal")[1])
    return nominal, [several(cell)[1] for cell in cells]


def pair(cell: str) -> list[float]:
    """Of a cell `a / b`."""
    return [float(part) for part in cell.split("/")]


def of_results() -> list[str]:
    six = [row for row in rows("results.md", 6) if row[1].count("/") == 1]
    first = {row[0]: [pair(cell) for cell in row[1:5]] for row in six}
    ekf, sif, windowed, fading = range(4)
    attitude, rate = 0, 1
    push, failed, healthy = first["disturbance"], first["wheel failure"], first["fault free"]
    assert set(first) == {"fault free", "disturbance", "effectiveness loss", "wheel failure"}
    assert healthy[ekf] == healthy[windowed] == healthy[fading]  # "in health they are the EKF to the bit"
    for case, filters in first.items():  # "the paper's conclusion stands for both hybrids, in rate in every case"
        for hybrid in (windowed, fading):
            others = (ekf, sif) if case != "fault free" else (sif,)
            assert all(filters[hybrid][rate] < filters[other][rate] for other in others), case
    weak = first["effectiveness loss"]
    assert failed[windowed][attitude] > failed[ekf][attitude]  # "worse in the wheel failure"
    assert f"{weak[windowed][attitude]:.2f}" == f"{weak[ekf][attitude]:.2f}"  # "all three"
    delays = {row[0]: row[1:] for row in rows("results.md", 5) if row[0] in first}
    outside = {case: pair(cells[3]) for case, cells in delays.items()}
    late = max(value for case, cells in delays.items() if case != "disturbance" for value in pair(cells[0]))
    assert late <= 1.0  # "within a second for wheel faults"
    longer = outside["disturbance"][1] / outside["disturbance"][0]
    assert 1.75 <= longer < 2.5  # "twice as long"
    harder = {row[0]: [pair(cell) for cell in row[1:]] for row in rows("results.md", 5) if re.fullmatch(r"\d+", row[0])}
    assert len(harder) == 2
    for filters in harder.values():  # "the order of the filters is the same"
        assert [sorted(range(4), key=lambda one: filters[one][part]) for part in (attitude, rate)] == [
            sorted(range(4), key=lambda one: push[one][part]) for part in (attitude, rate)
        ]
    own = {row[0]: row[1:] for row in rows("results.md", 6) if row[2].count("/") == 3}
    paper = [float(part) for part in own["fault free"][1].split("/")]
    assert paper[sif] < paper[ekf]
    return [
        f"better than the SIF's ({weak[windowed][attitude]:.2f} and {failed[windowed][attitude]:.2f} against {failed[sif][attitude]:.2f}) "
        f"but no better than the EKF's in the effectiveness loss ({weak[ekf][attitude]:.2f} all three) and worse in the wheel failure "
        f"({failed[windowed][attitude]:.2f} against {failed[ekf][attitude]:.2f})",
        f"the window is slightly better ({push[windowed][attitude]:.3f} against {push[fading][attitude]:.3f}, "
        f"{push[windowed][rate]:.2f} against {push[fading][rate]:.2f} under pushes)",
        f"the SIF's rate error is below the EKF's ({paper[sif]:.1f} against {paper[ekf]:.1f} mrad/s)",
    ]


PAGES: dict[str, Callable[[], list[str]]] = {
    "imm": of_imm,
    "consensus": of_consensus,
    "formation": of_formation,
    "performance": of_performance,
    "gyroless": of_gyroless,
    "unfalsified": of_unfalsified,
    "results": of_results,
}


@pytest.mark.parametrize("page", PAGES)
def test_the_ratios_of_a_page_are_those_of_its_tables(page: str) -> None:
    text = prose(f"{page}.md")
    assert [claim for claim in PAGES[page]() if claim not in text] == []


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
    claim = re.compile(
        r"\b(times as fast|times faster|of the time of|a \w+ of the time|fast for|fast enough|cheap\w*|negligibl[ey]|for free|expensive"
        r"|costs? (nothing|hardly|next to)|efficient\w*|quickly|speeds? up|slow to (compute|evaluate))\b"
    )
    found = [
        f"{path.relative_to(root)}: {match[0]}"
        for room in ("models", "estimation", "control", "sim")
        for path in sorted((root / room).rglob("*.py"))
        for match in claim.finditer(path.read_text(encoding="utf-8"))
    ]
    assert found == []
