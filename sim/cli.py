"""The command `nacs`."""

from __future__ import annotations

import os
import sys

import typer
from rich.table import Table

from sim import families
from sim import scenario as scenarios
from sim.command_campaign import campaign
from sim.command_crosscheck import crosscheck
from sim.command_replay import replay
from sim.command_run import run
from sim.scenario import BadInput
from sim.terminal import BAD_INPUT, INTERRUPTED, Name, Overrides, Seed, err, load, out

app = typer.Typer(
    help="Digital twin of the NACS, an air-bearing CubeSat testbed with four reaction wheels.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.command("run")(run)
app.command("replay")(replay)
app.command("crosscheck")(crosscheck)
app.command("campaign")(campaign)


@app.command("list")
def list_scenarios() -> None:
    """Show the scenarios that come with the twin."""
    table = Table(box=None, pad_edge=False)
    table.add_column("name", no_wrap=True, style="bold")
    table.add_column("what it shows, and where it comes from")
    for name in scenarios.names():
        found = families.load(name, {})
        table.add_row(name, f"{found.title} [dim]({found.source})[/]")
    out.print(table)


@app.command("parameters")
def show_parameters(
    scenario: Name = "nacs/fault-free",
    overrides: Overrides = None,
) -> None:
    """Show every parameter of a scenario's plant: value, unit and where it comes from."""
    loaded = load(scenario, None, None, overrides)
    table = Table(box=None, pad_edge=False)
    table.add_column("parameter", no_wrap=True, style="bold")
    table.add_column("value", overflow="fold")
    table.add_column("what it is, and where its value comes from")
    for name, value, unit, meaning, provenance in loaded.plant.table():
        table.add_row(name, f"{value} {unit}", f"{meaning} [dim]({provenance})[/]")
    out.print(table)


@app.command("view")
def view_scenario(name: Name, seed: Seed = None, overrides: Overrides = None) -> None:
    """Fly the first trial of a scenario in MuJoCo's own viewer, in real time."""
    loaded = load(name, 1, seed, overrides)
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise BadInput("nacs view needs a display and found none; `nacs run` writes a recording that can be opened elsewhere")
    from sim.viewer import fly  # the viewer opens windows when imported

    fly(loaded)


def main() -> None:
    """Run the command; what the user got wrong is one line and exit code 2."""
    try:
        app()
    except BadInput as wrong:
        err.print(f"error: {wrong}", style="red", markup=False)
        sys.exit(BAD_INPUT)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
