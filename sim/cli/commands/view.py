"""`nacs view`: one loop of a scenario in MuJoCo's own viewer, in real time."""

from __future__ import annotations

import os
import sys
from typing import Annotated, Any

import typer

from sim.bad_input import BadInput
from sim.campaign import cost
from sim.cli.terminal import FAILED, Name, Overrides, Seed, err, load, out
from sim.loop.motion import motion
from sim.plant.batch import SimulationFailed


def view(
    name: Name,
    loop: Annotated[str | None, typer.Option(metavar="NAME", help="which of several closed loops; default: the first")] = None,
    seed: Seed = None,
    overrides: Overrides = None,
) -> None:
    """Fly the first trial of a scenario in MuJoCo's own viewer, in real time; several agents are simulated first, then shown."""
    loaded: Any = load(name, 1, seed, overrides)
    cost.check(loaded, 1)
    loops = list(loaded.loop_names)
    chosen = loops[0] if loop is None else loop
    if chosen not in loops:
        raise BadInput(f"--loop {loop}: {name} flies {', '.join(loops) if loaded.loops else 'one loop, which has no name'}")
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise BadInput("nacs view needs a display and found none; `nacs run` writes a recording that can be opened elsewhere")
    from sim.cli.commands import viewer  # opens windows when imported

    if len(loops) > 1:
        others = ", ".join(other for other in loops if other != chosen)
        out.print(f"loop {chosen} of {name}; --loop shows another: {others}", soft_wrap=True)
    try:
        if loaded.family == "body":
            viewer.fly(loaded, chosen)
            return
        with err.status(f"simulating {loaded.run.ticks * loaded.run.tick_s:g} s of {loaded.plant.type} first"):
            moved = motion(loaded, chosen)
        viewer.show(*moved)
    except SimulationFailed as failure:
        err.print(f"error: {failure}", style="red")
        raise typer.Exit(FAILED) from None
