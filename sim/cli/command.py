"""The command `nacs`, and the one place where everything that can go wrong becomes one line and an exit code."""

from __future__ import annotations

import os
import sys
import warnings
from importlib.metadata import version
from typing import Annotated, Any

import typer
from rich.table import Table
from rich.text import Text

from sim.bad_input import BadInput
from sim.cli.bridges.convert import convert
from sim.cli.bridges.export import export
from sim.cli.bridges.export_fmu import export_fmu
from sim.cli.bridges.linearize import linearize_scenario
from sim.cli.commands.bound import bound
from sim.cli.commands.campaign import campaign
from sim.cli.commands.crosscheck import crosscheck
from sim.cli.commands.falsify import falsify
from sim.cli.commands.list import list_scenarios
from sim.cli.commands.new import new, schema
from sim.cli.commands.replay import replay
from sim.cli.commands.run import run
from sim.cli.commands.view import view
from sim.cli.in_words import SHOW_TRACEBACK, in_words
from sim.cli.terminal import BAD_INPUT, INTERRUPTED, Name, Overrides, err, load, out
from sim.signals import AS_BEFORE
from sim.text.one_line import one_line

UsageError: type[Exception] = typer.BadParameter.__bases__[0]  # of the library that Typer parses arguments with, whichever that is

app = typer.Typer(
    help="Digital twin of the NACS, an air-bearing CubeSat testbed with four reaction wheels.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


def _say_version(asked: bool) -> None:
    if asked:
        out.print(f"nacs {version('nacs-twin')}")
        raise typer.Exit


@app.callback()
def options(
    _: Annotated[bool, typer.Option("--version", is_eager=True, callback=_say_version, help="say which version this is")] = False,
) -> None:
    """Digital twin of the NACS, an air-bearing CubeSat testbed with four reaction wheels."""


app.command("run")(run)
app.command("export")(export)
app.command("linearize")(linearize_scenario)
app.command("convert")(convert)
app.command("export-fmu")(export_fmu)
app.command("replay")(replay)
app.command("falsify")(falsify)
app.command("crosscheck")(crosscheck)
app.command("bound")(bound)
app.command("campaign")(campaign)
app.command("list")(list_scenarios)
app.command("new")(new)
app.command("schema")(schema)


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
        table.add_row(name, f"{value} {unit}", Text.assemble(meaning, " ", (f"({provenance})", "dim")))
    out.print(table)


app.command("view")(view)


def command() -> int:
    """Do what the arguments of the process say; its exit code: 0 done, 2 bad input, 3 failed, 130 interrupted."""
    _quieten()
    try:
        code = _run()
        sys.stdout.flush()
    except Exception as wrong:  # the end of the line: nobody above turns it into words
        if os.environ.get(SHOW_TRACEBACK):
            raise
        code, said = in_words(wrong)
        err.print(f"error: {one_line('; '.join([said, *getattr(wrong, '__notes__', ())]))}", style="red")
    except KeyboardInterrupt as asked:  # where nobody had anything to keep
        code = INTERRUPTED
        err.print(one_line("; ".join(getattr(asked, "__notes__", (AS_BEFORE,)))))
    return code


def _run() -> int:
    """The command as the arguments say; its exit code."""
    for argument in sys.argv[1:]:
        if argument != argument.encode(errors="replace").decode():
            raise BadInput(f"{argument!r}: is not text in UTF-8")
    parsed = typer.main.get_command(app)
    try:
        with parsed.make_context("nacs", sys.argv[1:]) as context:  # what Typer itself does, but that it answers Ctrl-C without a word
            parsed.invoke(context)
    except typer.Exit as left:
        return left.exit_code
    except BadInput as wrong:
        err.print(f"error: {one_line(str(wrong))}", style="red")
        return BAD_INPUT
    except UsageError as wrong:
        if said := wrong.format_message().strip():  # type: ignore[attr-defined]  # a command without arguments has shown its help
            err.print(f"error: {one_line(said)}", style="red")
        return BAD_INPUT
    return 0


def _quieten() -> None:
    """Nothing on stderr but what the twin says itself: no library's warnings, here or in processes that are started.

    A number that overflows is said where it harms: in a trial that is lost, a metric that is missing, a check that fails.
    """
    if not sys.warnoptions:  # unless asked for by -W
        warnings.showwarning = lambda *_, **__: None
        os.environ.setdefault("PYTHONWARNINGS", "ignore")
    for stream in (sys.stdout, sys.stderr):  # a terminal that cannot show a letter shows its number
        if (reconfigure := getattr(stream, "reconfigure", None)) is not None:
            reconfigure(errors="backslashreplace")
