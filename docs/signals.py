"""Prints docs/signals.md from the register of signals: python docs/signals.py > docs/signals.md."""

from __future__ import annotations

from collections.abc import Iterator

from sim.series.signals.entry import Entry, Part
from sim.series.signals.register import OF_OBSERVER, OF_RUN

FAMILIES = {
    "body": "One body",
    "formation": "Formations",
    "consensus": "Agents in the plane",
}


def columns(entry: Entry, part: Part) -> str:
    """Names of the columns; what is counted begins with 1."""
    prefix = entry.prefix.format(observer="OBSERVER")
    axes = [axis for axis in (entry.lead, part.axis) if axis is not None]
    if not axes:
        return f"`{prefix}/{part.stem}`" if part.stem else f"`{prefix}`"
    labels = axes[0].labels
    counted = {"joint": "NAME", "sender": "NAME", "mass": "NAME"}.get(axes[0].name, "1")
    if not labels:
        return f"`{prefix}/{part.stem}{counted}`" + (", ..." if counted == "1" else "")
    return f"`{prefix}/{part.stem}{labels[0]}`" + (f" to `{labels[-1]}`" if len(labels) > 2 else f", `{labels[-1]}`")


def rows(entries: tuple[Entry, ...]) -> Iterator[str]:
    """A row for every signal."""
    for entry in entries:
        for part in entry.parts:
            prefix = entry.prefix.format(observer="OBSERVER")
            name = f"{prefix}/{part.name}" if part.name else prefix
            where = {True: "with wheels", False: "without wheels", None: ""}[entry.wheels]
            meaning = ", ".join(text for text in (part.what, entry.meaning, where) if text)
            yield f"| `{name}` | {columns(entry, part)} | {part.unit} | {part.frame} | {meaning} |"


FORMATS = (
    ("csv", "the same table as text; numbers come back to the bit", "nothing"),
    (
        "mat",
        "for MATLAB (`load`): a struct for each loop with `time`, `trial`, `agent`, an array for each signal, as `truth_rate` "
        "(trials, [agents,] ticks, axis), and `about`: unit, frame, meaning, axes, columns; what MATLAB's names cannot have is `_`",
        "nothing",
    ),
    (
        "netcdf",
        "a dataset with named axes and labels, as `xarray.open_dataset` takes it; a group for each loop where there are several",
        "`nacs-twin[data]`",
    ),
    (
        "mcap",
        "for Foxglove and others: a topic for each trial and agent, `/loop/trial0`, an object a tick, in which `truth.rate_x` is a number",
        "`nacs-twin[data]`",
    ),
)


def formats() -> Iterator[str]:
    """Table of the formats of other tools."""
    yield "| format | what is in it | needs |\n|---|---|---|"
    for key, what, needs in FORMATS:
        yield f"| `{key}` | {what} | {needs} |"


def tables() -> Iterator[str]:
    """One for every family, and one for the observers of it."""
    for family, title in FAMILIES.items():
        yield f"## {title}\n"
        yield "| signal | columns | unit | frame | meaning |\n|---|---|---|---|---|"
        yield "\n".join([*rows(OF_RUN[family]), *rows(OF_OBSERVER[family])]) + "\n"


PAGE = f"""# Signals

Every run leaves `signals.parquet`: all numbers of its recorded trials (`--record-trials`), the same to the bit as the recording's. This
page is printed by `python docs/signals.py`; a test compares the two.

```sh
nacs run nacs/disturbance --trials 10 --record-trials 10 --out it
nacs export it --to csv                # it/signals.csv; also mat, netcdf, mcap
```

```python
import pyarrow.parquet as pq

table = pq.read_table("it/signals.parquet", columns=["trial", "time_s", "truth/rate_x", "estimate/mekf/rate_x"])
said = pq.read_schema("it/signals.parquet").field("truth/rate_x").metadata  # unit, frame, meaning, signal
```

**The table** is long: a row for every closed loop, trial, agent and control tick, in this order.

| column | what it is |
|---|---|
| `loop` | name of the closed loop; `loop` if there is one |
| `trial` | number of the trial |
| `agent` | number of the agent, from one; only where there are several bodies |
| `time_s` | since the start; everything in a row is of this instant ([conventions.md](conventions.md)) |

Then a column for each number, as below. NaN is what was missing or unknown: a reading that did not come, a trial that was lost. Null is
what a loop does not have, such as another loop's observers. What all agents or trials have in common, such as the reference, stands in all
rows. Frames and units are those of [conventions.md](conventions.md). `OBSERVER` stands for the name of each observer; `1, ...` is counted.
A run of a million rows is read in parts: row groups have at most 65536 rows, compressed by zstd. `--without signals` leaves the file out.

**Other tools.** `nacs export RUN --to FORMAT [--out FILE]`, where RUN is the run's folder:

{chr(10).join(formats())}

A user's own control law or filter may record what the register does not know; that is kept under its own name with numbered components.
Not in the table are wheel angles of several agents, and what is worked out of all agents or ticks together (`trials.parquet`).

{chr(10).join(tables())}
**Another signal** is an `Entry` in sim/series/signals/register.py: which channel of the recording it is, and which quantities its
components are. A channel that no entry is about stands in the table with numbered components and no unit.
"""

if __name__ == "__main__":
    print(PAGE, end="")
