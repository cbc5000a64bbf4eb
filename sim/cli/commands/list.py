"""`nacs list`: what comes with the twin, a line each by family; of one family or name, everything that helps to choose."""

from __future__ import annotations

from math import prod
from typing import Annotated, Any

import typer
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from models.plants.register.entries import kind_of
from sim.bad_input import BadInput
from sim.campaign.file import CAMPAIGNS
from sim.cli.terminal import out
from sim.scenario import catalogue, files
from sim.scenario.catalogue import SCENARIOS
from sim.text import toml_text
from sim.text.table_style import counted

CAMPAIGN = "campaigns"
SAID_OF_CAMPAIGNS = "many trials, dispersed or over a grid; `nacs campaign NAME` flies one"


def list_scenarios(
    beginning: Annotated[
        str | None, typer.Argument(metavar="FAMILY", help="say more of this family, of names that begin so (nacs/wheel), or of campaigns")
    ] = None,
) -> None:
    """Show the scenarios and campaigns that come with the twin."""
    campaigns = sorted(path.stem for path in CAMPAIGNS.glob("*.toml"))
    if beginning is None:
        _overview(campaigns)
        return
    scenarios = [name for name in catalogue.scenario_names() if name.startswith(beginning)]
    chosen = [name for name in campaigns if f"{CAMPAIGN}/{name}".startswith(beginning)]
    if not scenarios and not chosen:
        raise BadInput(f"no scenario or campaign begins with {beginning!r}; there are {', '.join([*catalogue.families(), CAMPAIGN])}")
    for name in scenarios:
        _show(name, _of_scenario(name))
    for name in chosen:
        _show(f"{CAMPAIGN}/{name}", _of_campaign(name))


def _overview(campaigns: list[str]) -> None:
    """One line a scenario, under its family."""
    found = catalogue.families()
    width = max(len(name) for names in (*found.values(), campaigns) for name in names)
    for family, names in found.items():
        titles = {name: catalogue.title(SCENARIOS / family / f"{name}.toml") for name in names}
        _group(family, catalogue.what(family), titles, width)
    _group(CAMPAIGN, SAID_OF_CAMPAIGNS, {name: catalogue.title(CAMPAIGNS / f"{name}.toml") for name in campaigns}, width)
    out.print("`nacs list FAMILY` says more of each, `nacs run FAMILY/NAME` flies one", style="dim", soft_wrap=True)


def _group(heading: str, what: str, titles: dict[str, str], width: int) -> None:
    out.print(Text.assemble((heading, "bold"), "  ", (what, "dim")), no_wrap=True, overflow="ellipsis")
    table = Table(box=None, show_header=False, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True, min_width=width)
    table.add_column()
    for name, title in titles.items():
        table.add_row(name, Text(title, no_wrap=True, overflow="ellipsis"))
    out.print(Padding(table, (0, 0, 1, 2), expand=False))


def _show(name: str, rows: dict[str, str]) -> None:
    out.print(Text(name, style="bold"))
    table = Table(box=None, show_header=False, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True, style="dim")
    table.add_column(overflow="fold")
    for key, value in rows.items():
        table.add_row(key, Text(value))
    out.print(Padding(table, (0, 0, 1, 2), expand=False))


def _of_scenario(name: str) -> dict[str, str]:
    found: Any = files.load(name, {})  # every kind has a plant, and most have observers
    run, kind = found.run, kind_of(found.plant)
    agents = kind.layout(found.plant).agents
    plant = f"{kind.type} ({kind.variant(found.plant)})" if kind.variant else kind.type
    rows = {
        "title": found.title,
        "source": found.source,
        "plant": plant if agents is None else f"{plant}, {agents} agents",
        "run": f"{counted(run.trials, 'trial')} of {run.ticks * run.tick_s:g} s, a tick every {run.tick_s:g} s",
    }
    if found.loops:
        rows["loops"] = ", ".join(found.loops)
    elif found.control is not None:
        rows["loop"] = f"{found.control.type}, closed by {found.control.feedback}"
    if observers := getattr(found, "observers", None):
        rows["observers"] = ", ".join(observers)
    return rows


def _of_campaign(name: str) -> dict[str, str]:
    """As its file says it: to check it would take every point of its grid."""
    data = toml_text.read(CAMPAIGNS / f"{name}.toml", name)
    grid: dict[str, list[Any]] = data.get("grid", {})
    rows = {"title": data["title"], "scenario": data["scenario"], "run": counted(data["trials"], "trial")}
    if grid:
        points = prod(len(values) for values in grid.values())
        rows |= {"run": f"{counted(data['trials'], 'trial')} at each of {counted(points, 'point')}", "grid": ", ".join(grid)}
    if drawn := data.get("dispersion"):
        rows["dispersed"] = ", ".join(drawn)
    return rows
