"""The page of claims: every row has one of three verdicts, a figure, and a command, test or page that there is."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import typer.main

from sim.campaign.file import load as load_campaign
from sim.campaign.file import located
from sim.cli import terminal
from sim.cli.command import app
from sim.outputs.register import OUTPUTS

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "claims.md"
HEADER = ("where", "claim", "verdict", "figure", "made by")
VERDICTS = ("holds", "fails", "not decidable")
ERRATUM = re.compile(r"\[err(?:atum|ata) ([\d, to]+)\]\(errata\.md\)")


class Claim(NamedTuple):
    """One row of the page."""

    where: str
    claim: str
    verdict: str
    figure: str
    made_by: str


def cells(line: str) -> tuple[str, ...]:
    """Of a row of a table; a bar within backticks is no edge."""
    return tuple(cell.strip() for cell in re.findall(r"((?:`[^`]*`|[^|`])*)\|", line.strip()[1:]))


def rows() -> list[tuple[str, ...]]:
    """Of all tables of the page, heads and rules apart."""
    lines = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("|")]
    return [row for row in map(cells, lines) if row != HEADER and not re.fullmatch(r"[-| ]+", "|".join(row))]


CLAIMS = [Claim(*row) for row in rows() if len(row) == len(HEADER)]
COMMANDS = sorted({command for claim in CLAIMS for command in re.findall(r"`(nacs [^`]*)`", claim.made_by)})


def errata() -> set[int]:
    """Numbers of the items of docs/errata.md."""
    return {int(n) for n in re.findall(r"^### (\d+)\.", (ROOT / "docs" / "errata.md").read_text(encoding="utf-8"), re.MULTILINE)}


def numbers(said: str) -> set[int]:
    """Of items, as a row says them: `28, 29` or `22 to 25`."""
    found = [int(n) for n in re.findall(r"\d+", said)]
    return set(range(found[0], found[-1] + 1)) if "to" in said else set(found)


def test_every_table_has_the_same_columns() -> None:
    assert [row for row in rows() if len(row) != len(HEADER)] == []
    text = PAGE.read_text(encoding="utf-8")
    assert text.count("| " + " | ".join(HEADER) + " |") == text.count("|---|---|---|---|---|") > 10


def test_every_claim_has_one_of_three_verdicts() -> None:
    assert [claim for claim in CLAIMS if claim.verdict not in VERDICTS] == []


def test_every_claim_is_said_once_and_has_a_figure() -> None:
    assert [claim for claim in CLAIMS if not (claim.where and claim.claim and claim.figure)] == []
    said = [(claim.where, claim.claim) for claim in CLAIMS]
    assert len(said) == len(set(said))


def test_what_nobody_has_flown_is_not_decided() -> None:
    untested = [claim for claim in CLAIMS if claim.figure.startswith("untested")]
    assert {claim.verdict for claim in untested} == {"not decidable"}


def test_a_verdict_has_a_number_or_says_what_is_wrong_by_reasoning() -> None:
    """A figure without a digit argues about a definition or a theorem: only an erratum, a page or a test may stand behind it."""
    bare = [claim for claim in CLAIMS if claim.verdict != "not decidable" and not re.search(r"\d", claim.figure)]
    assert [claim for claim in bare if not re.search(r"\.md\)|tests/", claim.made_by)] == []


def test_what_makes_a_figure_is_there() -> None:
    """Each row names a command, a test or a page, and files that it names exist, and items of the errata."""
    listed = re.search(r"WORKS = \(([\w, ]+)\)", (ROOT / "benchmarks" / "__main__.py").read_text(encoding="utf-8"))
    assert listed
    tables = listed[1].split(", ")
    known, missing = errata(), []
    for claim in CLAIMS:
        pages = re.findall(r"\]\(([\w-]+\.md)\)", claim.made_by)
        scripts = re.findall(r"`(?:python )?((?:tests|docs)/\w+\.py)`", claim.made_by)
        benchmarks = re.findall(r"`python -m benchmarks (\w+)`", claim.made_by)
        commands = re.findall(r"`(nacs [^`]*)`", claim.made_by)
        missing += [(claim.claim, "names nothing")] * (not (pages or scripts or benchmarks or commands))
        missing += [(claim.claim, page) for page in pages if not (ROOT / "docs" / page).is_file()]
        missing += [(claim.claim, script) for script in scripts if not (ROOT / script).is_file()]
        missing += [(claim.claim, name) for name in benchmarks if name not in tables]
        missing += [(claim.claim, item) for said in ERRATUM.findall(claim.made_by) for item in numbers(said) - known]
    assert missing == []


@pytest.mark.parametrize("command", COMMANDS)
def test_the_commands_of_the_page_are_understood(command: str) -> None:
    """Options are parsed as the command does, and the scenario or campaign that it names is read with its settings; nothing is flown."""
    _, verb, *rest = shlex.split(command)
    known: Any = typer.main.get_command(app)
    assert verb in known.commands
    if not rest:
        return
    given = known.commands[verb].make_context(verb, rest).params
    assert set(given.get("also") or ()) <= OUTPUTS.keys()
    if verb == "campaign":
        load_campaign(located(given["file"]))
    else:
        named = given.get("scenario") or given["name"]
        terminal.load(named, given.get("trials"), given.get("seed"), given.get("overrides"))


@pytest.mark.parametrize("table", ["table 1", "table 2", "table 3", "table 4", "fig. 4", "future"])
def test_no_table_of_the_first_paper_is_without_a_row(table: str) -> None:
    text = PAGE.read_text(encoding="utf-8")
    first = text[: text.index("# Hill, Gadsden")]
    assert f"| {table} |" in first
