"""`nacs bound`: how near the filters of a scenario come to the least error that there can be."""

from __future__ import annotations

from typing import Annotated

import numpy as np
import typer

from sim.bad_input import BadInput
from sim.campaign import cost
from sim.cli.result_files import interrupted_as
from sim.cli.terminal import Name, Overrides, Seed, err, load, out
from sim.loop.build import build
from sim.loop.closed_loop import run
from sim.metrics.bound import efficiency
from sim.tables.bound import table
from sim.text.progress import Work


def bound(
    name: Name = "nacs/fault-free",
    loop: Annotated[
        str | None, typer.Option(metavar="NAME", help="whose filters are judged, of a scenario of several loops; default: the first")
    ] = None,
    start: Annotated[float | None, typer.Option("--from", metavar="SECONDS", help="errors before do not count; default: a quarter")] = None,
    trials: Annotated[int, typer.Option(min=1, help="trials over which errors are averaged")] = 8,
    seed: Seed = None,
    overrides: Overrides = None,
) -> None:
    """Fly a scenario and hold its filters' errors against the posterior Cramer-Rao bound along the way that was flown."""
    whole = load(name, trials, seed, overrides)
    slow = cost.check(whole, trials)
    if loop is not None and loop not in whole.loop_names:
        raise BadInput(f"--loop {loop}: no such loop; there are {', '.join(whole.loop_names)}")
    chosen = loop or whole.loop_names[0]
    duration = whole.run.ticks * whole.run.tick_s
    since = duration / 4.0 if start is None else start
    if not 0.0 <= since < duration - whole.run.tick_s / 2.0:
        raise BadInput(f"--from {since:g}: the run lasts from 0 to {duration:g} s")
    single = whole.singles()[chosen] if whole.family == "body" else whole
    for line in slow:
        err.print(f"warning: {line}", style="yellow")
    numbers = np.arange(trials)
    try:
        with interrupted_as("nothing was written"):
            system = build(single, numbers) if whole.family == "body" else build(whole, numbers, loop=chosen)
            with Work(err, "ticks") as work:
                recording = run(system, lambda _, recorder: work.report("flight", recorder.done, recorder.ticks))
            found = efficiency(single, recording, since)
    except ValueError as wrong:
        raise BadInput(f"{name}: {wrong}") from None
    if not found:
        raise BadInput(f"{name}: no filter watches loop {chosen} that estimates what the model does; choose another with --loop")
    out.print(table(found, chosen, since, duration, trials))
