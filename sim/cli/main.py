"""The command `nacs`."""

from __future__ import annotations

import sys
from typing import Any

import typer
from rich.table import Table

from sim.bad_input import BadInput
from sim.cli.campaign import campaign
from sim.cli.crosscheck import crosscheck
from sim.cli.list import list_scenarios
from sim.cli.replay import replay
from sim.cli.run import run
from sim.cli.signals import interruptible
from sim.cli.terminal import BAD_INPUT, INTERRUPTED, Name, Overrides, err, load, out
from sim.cli.view import view

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
app.command("list")(list_scenarios)


@app.command("parameters")
def show_parameters(
    scenario: Name = "nacs/fault-free",
    overrides: Overrides = None,
) -> None:
    """Show every parameter of a scenario's plant: value, unit and where it comes from."""
    loaded: Any = load(scenario, None, None, overrides)
    table = Table(box=None, pad_edge=False)
    table.add_column("parameter", no_wrap=True, style="bold")
    table.add_column("value", overflow="fold")
    table.add_column("what it is, and where its value comes from")
    for name, value, unit, meaning, provenance in loaded.plant.table():
        table.add_row(name, f"{value} {unit}", f"{meaning} [dim]({provenance})[/]")
    out.print(table)


app.command("view")(view)


def main() -> None:
    """Run the command; what the user got wrong is one line and exit code 2."""
    try:
        with interruptible():
            app()
    except BadInput as wrong:
        err.print(f"error: {wrong}", style="red", markup=False)
        sys.exit(BAD_INPUT)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
